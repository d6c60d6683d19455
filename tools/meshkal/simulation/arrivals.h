/* SPDX-License-Identifier: MIT */
/* Which messages arrived, recorded in a CSV file: of a real network, to run it again. */
#ifndef MESHKAL_ARRIVALS_H
#define MESHKAL_ARRIVALS_H

#include "design/node_config.h"
#include "error.h"
#include "scenario.h"

typedef struct {
    uint64_t place; /* 2 x slot in the whole network + stage - 1 */
    long line;
} mk_arrival_t;

typedef struct {
    const mk_scenario_t *scenario;
    size_t *first;       /* steps + 1: where the arrivals of each step begin */
    mk_arrival_t *entry; /* those of a step by place */
    double missing;      /* share of all messages that is not listed */
    char sha256[65];     /* of what the file says, in whatever order; empty if there is none */
} mk_arrivals_t;

/* Columns t,stage,from,to: in step t the frame of stage 1 (reading) or 2 (estimate) of node `from` arrived at its neighbour `to` in time.
   What is not listed was lost; lines of steps from `steps` on are not used. 1, or 0 and an error that names the line; *arrivals is then
   empty. */
int mk_arrivals_read(mk_arrivals_t *arrivals, const mk_scenario_t *scenario, int steps, const char *path, mk_error_t *error);
void mk_arrivals_free(mk_arrivals_t *arrivals);

/* Links of the estimators begin .. end - 1 of a distributed topology in step t: a byte for each of their slots, of which the nodes' own are
   left as they are. */
void mk_arrivals_links(const mk_arrivals_t *arrivals, int t, const mk_topology_t *topology, int begin, int end, uint8_t *readings,
                       uint8_t *estimates);

#endif
