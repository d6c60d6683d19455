/* SPDX-License-Identifier: MIT */
/* A sensor network as scenario.schema.json describes it: read, checked, and put into the order that filters use. */
#ifndef MESHKAL_HOST_SCENARIO_H
#define MESHKAL_HOST_SCENARIO_H

#include <stddef.h>
#include <stdint.h>

#include "error.h"

typedef struct {
    int rows;
    double *C;          /* rows x n; null in a tracking or navigation scenario */
    double *R;          /* packed, rows */
    int position_count; /* 0, 2 or 3 */
    double position_m[3];
} mk_sensor_t;

/* What is added to row `row` of node `node` for from_s < t <= to_s: step + rate (t - from_s). */
typedef struct {
    int node, row;
    double from_s, to_s, rate, step; /* to_s: infinite where it has no end */
} mk_sensor_fault_t;

/* Of the monitors (meshkal/monitor.h), whose configuration explains them. */
typedef struct {
    int scheme, window, most, patience; /* scheme: MK_MONITOR_, or MK_MONITOR_NONE of scenario_monitor.h */
    double false_alarm;       /* Pfa */
    double jump;              /* 0: 2 x window */
    double evidence, separation, level, slope;
} mk_monitor_settings_t;

typedef struct {
    char *name;
    int n;
    double *A;     /* n x n; null in a tracking or navigation scenario */
    double *Q;     /* packed */
    double *input; /* n; null in a tracking scenario */
    double *x0;    /* n */
    double *P0;    /* packed */
    double dt_s;
    int position_count; /* states that are a position: 0, 1, 2 or 3 */
    int position_states[3];

    int nodes;
    mk_sensor_t *sensor;
    double **block; /* C and R of the sensors, many to a block */
    int blocks;
    /* Slots of node k: slot[first[k]] .. slot[first[k + 1] - 1], k itself first, then its neighbours ascending. weight[i] is
       w_lk of slot l = slot[i]. */
    int *first, *slot;
    double *weight;

    double tolerance;
    int steps;
    uint64_t seed;

    int faults;
    mk_sensor_fault_t *fault;
    mk_monitor_settings_t monitor;

    struct mk_tracking *tracking; /* motion and sensors that are not linear (scenario_tracking.h); null: the scenario is linear, or .. */
    struct mk_navigation *navigation; /* .. an inertial unit with satellites (scenario_navigation.h) where this is not null */

    char *text; /* the file, byte for byte; null once it is dropped */
    size_t text_length;
    char sha256[65];
} mk_scenario_t;

/* Reads and checks a scenario of any kind. 1, or 0 and an error that names file, line and key; *scenario is then empty. */
int mk_scenario_load_any(mk_scenario_t *scenario, const char *path, mk_error_t *error);
/* The same, any but a linear one being an error. */
int mk_scenario_load(mk_scenario_t *scenario, const char *path, mk_error_t *error);
/* Releases the text, which only a log asks for: a third of what a large scenario holds. */
void mk_scenario_drop_text(mk_scenario_t *scenario);
void mk_scenario_free(mk_scenario_t *scenario);

#endif
