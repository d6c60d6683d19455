/* SPDX-License-Identifier: MIT */
/* Nodes of a scenario. */
#ifndef MESHKAL_HOST_SCENARIO_NODES_H
#define MESHKAL_HOST_SCENARIO_NODES_H

#include "scenario.h"
#include "scenario_read.h"

/* Fills nodes, sensor and block of a scenario whose model is read, on all cores. 1, or 0 with the reader's error, that of the first node
   in the file. */
int mk_read_nodes(mk_reader_t *reader, json_t *root, const mk_elements_t *elements, mk_scenario_t *scenario);

#endif
