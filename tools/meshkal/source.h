/* SPDX-License-Identifier: MIT */
/* Where truth and measurements of a run come from: drawn from the nominal model (spec 1.1), or recorded in CSV files. */
#ifndef MESHKAL_SOURCE_H
#define MESHKAL_SOURCE_H

#include "random.h"
#include "scenario.h"

typedef struct {
    const mk_scenario_t *scenario;
    uint64_t seed;
    int recorded, has_truth, steps; /* steps: of a recording */
    int *row_first;                 /* nodes + 1: where each node's rows begin in y */
    double *x, *y;                  /* of the step; NaN where unknown or missing. Without truth x is all NaN */
    int dropped_readings;           /* recorded readings with some rows missing: dropped whole */
    /* drawn */
    double *root_P0, *root_Q, **root_R; /* lower triangular, packed */
    double *next;
    /* recorded: steps x n, steps x rows */
    double *all_x, *all_y;
} mk_source_t;

/* Draws of the nominal model. */
void mk_source_draw(mk_source_t *source, const mk_scenario_t *scenario, uint64_t seed);
/* Recorded measurements, columns t,node,row,value, and truth, columns t,state,value (path null: none). The number of steps is one more
   than the last t, or `steps` if that is above 0. */
int mk_source_record(mk_source_t *source, const mk_scenario_t *scenario, const char *measurements, const char *truth, int steps,
                     mk_error_t *error);
void mk_source_free(mk_source_t *source);

/* Puts x(t) and y(t) of a run into source->x and y. Steps of a run are asked for in order, from 0. */
void mk_source_step(mk_source_t *source, int run, int t);

#endif
