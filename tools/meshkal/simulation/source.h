/* SPDX-License-Identifier: MIT */
/* Where truth and measurements of a run come from: drawn from the nominal model (spec 1.1) or from the least favourable one (1.7), or
   recorded in CSV files. */
#ifndef MESHKAL_SOURCE_H
#define MESHKAL_SOURCE_H

#include "design/least_favourable.h"
#include "random.h"
#include "simulation/team.h"

typedef enum { MK_TRUTH_NOMINAL, MK_TRUTH_LEAST_FAVOURABLE, MK_TRUTH_RECORDED } mk_truth_t;

/* The same for all runs. */
typedef struct {
    const mk_scenario_t *scenario;
    uint64_t seed;
    mk_truth_t truth;
    int has_truth, steps;   /* steps: of a recording */
    int *row_first;         /* nodes + 1: where each node's rows begin in y */
    int dropped_readings;   /* recorded readings with some rows missing: dropped whole */
    /* drawn: lower triangular roots, packed; root_R of node k from root_first[k] */
    double *root_P0, *root_Q, *root_R;
    size_t *root_first;
    /* least favourable: the model; F of all sensors, n numbers a row; their information */
    mk_least_favourable_t worst;
    double *F, *S;
    /* recorded: steps x n, steps x rows */
    double *all_x, *all_y;
    char sha256[65]; /* of those two; empty if drawn */
} mk_source_t;

/* An empty source of a scenario, row_first filled. */
void mk_source_open(mk_source_t *source, const mk_scenario_t *scenario, mk_truth_t truth);
/* Draws of the nominal model. */
void mk_source_draw(mk_source_t *source, const mk_scenario_t *scenario, uint64_t seed);
/* Draws of the least favourable model of RKFC with this tolerance over t = 0 .. horizon; w and v are those of the nominal draws with the
   same seed plus what the adversary adds. 1, or 0 and an error; *source is then empty. */
int mk_source_draw_worst(mk_source_t *source, const mk_scenario_t *scenario, uint64_t seed, double tolerance, int horizon, mk_error_t *error);
/* Recorded measurements, columns t,node,row,value, and truth, columns t,state,value (path null: none). The number of steps is one more
   than the last t, or `steps` if that is above 0. */
int mk_source_record(mk_source_t *source, const mk_scenario_t *scenario, const char *measurements, const char *truth, int steps,
                     mk_error_t *error);
void mk_source_free(mk_source_t *source);
/* "nominal", "least-favourable" or "recorded". */
const char *mk_truth_name(mk_truth_t truth);

/* One run under way. */
typedef struct {
    const mk_source_t *source;
    const mk_topology_t *part; /* whose sensors are drawn; null: all */
    mk_team_t *team;           /* that holds the other parts */
    int threads;               /* that draw readings at once */
    double *x, *y;             /* of the step; NaN where unknown or missing. Without truth x is all NaN */
    double *fault;             /* of all rows of all parts: what the scenario's faults added to y; null without faults */
    /* n numbers each. e: error of RKFC under its least favourable model; w: what the adversary adds to the noise of the step; g; bias: M A' g,
       by which all sensors see the state displaced */
    double *e, *w, *g, *bias, *next;
    mk_exact_t *sum; /* of F_k v0_k, n numbers; then those of other threads */
} mk_stream_t;

void mk_stream_open(mk_stream_t *stream, const mk_source_t *source, const mk_topology_t *part, mk_team_t *team, int threads);
void mk_stream_close(mk_stream_t *stream);
/* Puts x(t) and y(t) of a run into stream->x and y; of y only the rows of the part. Steps of a run are asked for in order, from 0. */
void mk_stream_step(mk_stream_t *stream, int run, int t);

#endif
