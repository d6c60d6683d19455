/* SPDX-License-Identifier: MIT */
#include <meshkal/base.h>
#include <stdio.h>
#include <string.h>

#include "commands.h"
#include "daemon.h"

static const char help[] =
    "meshkal-node CONFIG.json: one node of a sensor network, over UDP\n"
    "\n"
    "CONFIG.json is described in tools/meshkal-node/README.md and settings.schema.json. Readings come in as lines STEP,y1,y2,... or now,y1,y2,...\n"
    "SIGUSR1 prints all counters to standard error, SIGTERM and Ctrl-C end the node and keep its state.\n"
    "\n"
    "Exit status: 0; 1 the node could not go on; 2 wrong settings.\n";

int main(int argc, char **argv) {
    mk_daemon_t daemon;
    mk_error_t error;
    if (argc == 2 && (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 || strcmp(argv[1], "help") == 0)) {
        (void)fputs(help, stdout);
        return mk_finish(0);
    }
    if (argc == 2 && strcmp(argv[1], "--version") == 0) {
        (void)puts("meshkal-node " MK_VERSION);
        return mk_finish(0);
    }
    if (argc != 2) {
        (void)fputs(help, stderr);
        return MK_EXIT_INPUT;
    }
    if (!mk_daemon_open(&daemon, argv[1], &error)) {
        (void)fprintf(stderr, "meshkal-node: %s\n", error.text);
        return MK_EXIT_INPUT;
    }
    const int good = mk_daemon_run(&daemon, &error);
    if (!good) mk_daemon_say(&daemon, "%s", error.text);
    else mk_daemon_save(&daemon);
    mk_daemon_report(&daemon);
    mk_daemon_close(&daemon);
    return good ? 0 : MK_EXIT_FAILED;
}
