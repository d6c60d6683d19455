/* SPDX-License-Identifier: MIT */
#include "design/node_config.h"

#include <stdlib.h>
#include <string.h>

#include "design/design.h"

mk_topology_t mk_distributed_topology(const mk_scenario_t *s) {
    const mk_topology_t topology = {s->nodes, s->first, s->slot, s->weight, NULL, NULL, s->nodes, 0, 0, NULL, NULL};
    return topology;
}

int mk_topology_id(const mk_topology_t *topology, int e) { return topology->id ? topology->id[e] : e; }

mk_topology_t mk_central_topology(const mk_scenario_t *s) {
    int *first = mk_allocate((size_t)s->nodes + 2, sizeof *first), *slot = first + 2;
    double *weight = mk_allocate((size_t)s->nodes, sizeof *weight);
    first[1] = s->nodes;
    for (int k = 0; k < s->nodes; k++) slot[k] = k;
    weight[0] = 1.0;
    const mk_topology_t topology = {1, first, slot, weight, NULL, NULL, 1, 0, 0, NULL, NULL};
    return topology;
}

void mk_central_free(mk_topology_t *topology) {
    void *block;
    memcpy(&block, &topology->first, sizeof block);
    free(block);
    memcpy(&block, &topology->weight, sizeof block);
    free(block);
}

int mk_node_digits(int nodes) { return nodes <= 100 ? 2 : nodes <= 1000 ? 3 : 7; }

uint32_t mk_scenario_model(const mk_scenario_t *s) {
    char text[9];
    memcpy(text, s->sha256, 8);
    text[8] = 0;
    return (uint32_t)strtoul(text, NULL, 16);
}

int mk_topology_rows(const mk_topology_t *topology, const mk_scenario_t *s, int e) {
    int most = 1;
    for (int i = topology->first[e]; i < topology->first[e + 1]; i++)
        if (s->sensor[topology->slot[i]].rows > most) most = s->sensor[topology->slot[i]].rows;
    return most;
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "design/node_config.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "design/node_config.tmpl.h"
#undef MK_BITS
