/* SPDX-License-Identifier: MIT */
/* Firmware headers: node_NN.h with the constant configuration of one node. */
#ifndef MESHKAL_C_HEADER_H
#define MESHKAL_C_HEADER_H

#include <stdio.h>

#include "design/design.h"

/* Writes directory/node_NN.h for every node (the directory is made if it does not exist), real "float32" or "float64", with the local
   tolerances of the design and, if close > 0, the steady part that freezes the gain with that `close`; nodes that have none are named in
   `notes`. 1, or 0 and *error; files already written stay. */
int mk_write_headers(const char *directory, const char *real, const mk_scenario_t *scenario, const mk_design_t *design, double close,
                     FILE *notes, mk_error_t *error);

#endif
