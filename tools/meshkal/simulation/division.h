/* SPDX-License-Identifier: MIT */
/* A network in parts, or whole, in an order in which nodes that hear each other are near in memory. */
#ifndef MESHKAL_DIVISION_H
#define MESHKAL_DIVISION_H

#include "design/node_config.h"

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
