/* SPDX-License-Identifier: MIT */
/* A network in parts: who holds which node, and what they have to tell each other. No MPI in here. */
#ifndef MESHKAL_MPI_PARTITION_H
#define MESHKAL_MPI_PARTITION_H

#include "node_config.h"

/* Part of every node for `parts` processes, of about the same work, few links cut (METIS, k-way). 1, or 0 and an error. */
int mk_partition(const mk_scenario_t *scenario, int parts, int *part, mk_error_t *error);

/* What one process holds. Values go to and come from the parts peer[0 .. peers - 1]: those of topology.send_estimator from send_first[p],
   those of topology.halo_node from halo_first[p], in the order of nodes on both sides. */
typedef struct {
    mk_topology_t topology;
    int peers, *peer, *send_first, *halo_first;
    long cut_edges; /* links of this part's nodes to other parts */
} mk_division_t;

void mk_division_make(mk_division_t *division, const mk_scenario_t *scenario, const int *part, int parts, int own);
void mk_division_free(mk_division_t *division);

#endif
