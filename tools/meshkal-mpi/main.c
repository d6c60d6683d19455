/* SPDX-License-Identifier: MIT */
#include <meshkal/base.h>
#include <mpi.h>
#include <stdio.h>
#include <string.h>

#include "commands.h"
#include "team_mpi.h"

static const char help[] =
    "meshkal-mpi " MK_VERSION ": meshkal simulate on many processes\n"
    "\n"
    "mpirun -n K meshkal-mpi simulate SCENARIO.json [options]\n"
    "    the options of meshkal simulate (meshkal help), and\n"
    "    --split runs|nodes   what the processes share out: runs, each process holding the whole network (default if there are\n"
    "                         at least K of them), or the nodes of each network\n"
    "    --threads N          of each process (default 1)\n"
    "Logs and figures are those of one process, bit for bit.\n"
    "To end early with log and summary: kill -USR1 the mpirun. After Ctrl-C mpirun kills what is not done within a second.\n";

int main(int argc, char **argv) {
    int provided, status = MK_EXIT_INPUT;
    (void)MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
    mk_team_t team;
    mk_team_mpi_open(&team);
    int wants_help = argc < 2;
    for (int i = 1; i < argc; i++) wants_help |= strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "help") == 0;
    if (wants_help) {
        if (team.rank == 0) (void)fputs(help, argc < 2 ? stderr : stdout);
        status = argc < 2 ? MK_EXIT_INPUT : 0;
    } else if (strcmp(argv[1], "simulate") != 0) {
        if (team.rank == 0) (void)fprintf(stderr, "meshkal-mpi: unknown command %s (meshkal-mpi --help)\n", argv[1]);
    } else {
        status = mk_command_simulate(argc - 1, argv + 1, &team);
    }
    /* Before the others end: mpirun may stop those that are left when one has ended with an error. */
    status = mk_finish(status);
    mk_team_mpi_close(&team);
    (void)MPI_Finalize();
    return status;
}
