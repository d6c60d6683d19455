/* SPDX-License-Identifier: MIT */
/* All processes of an MPI job as a team. */
#ifndef MESHKAL_TEAM_MPI_H
#define MESHKAL_TEAM_MPI_H

#include "simulation/team.h"

/* Between MPI_Init and MPI_Finalize. */
void mk_team_mpi_open(mk_team_t *team);
void mk_team_mpi_close(mk_team_t *team);

#endif
