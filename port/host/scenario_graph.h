/* SPDX-License-Identifier: MIT */
/* Edges and weights of a scenario. */
#ifndef MESHKAL_HOST_SCENARIO_GRAPH_H
#define MESHKAL_HOST_SCENARIO_GRAPH_H

#include "scenario.h"
#include "scenario_read.h"

/* Fills first, slot and weight of a scenario whose nodes are read. 1, or 0 with the reader's error. */
int mk_read_graph(mk_reader_t *reader, json_t *root, const mk_elements_t *edges, mk_scenario_t *scenario);

#endif
