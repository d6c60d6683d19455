/* SPDX-License-Identifier: MIT */
/* Who holds which node of a network in parts. No MPI in here. */
#ifndef MESHKAL_MPI_PARTITION_H
#define MESHKAL_MPI_PARTITION_H

#include "scenario.h"

/* Part of every node for `parts` processes, of about the same work, few links cut (METIS, k-way). 1, or 0 and an error. */
int mk_partition(const mk_scenario_t *scenario, int parts, int *part, mk_error_t *error);

#endif
