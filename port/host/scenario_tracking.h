/* SPDX-License-Identifier: MIT */
/* The tracking part of a scenario (model.motion in scenario.schema.json): motion, sensors, and settings of the filters. */
#ifndef MESHKAL_HOST_SCENARIO_TRACKING_H
#define MESHKAL_HOST_SCENARIO_TRACKING_H

#include <meshkal/tracking.h>

#include "scenario.h"
#include "scenario_read.h"

typedef enum { MK_MOTION_CONSTANT_VELOCITY, MK_MOTION_CONSTANT_TURN, MK_MOTION_PLUGIN } mk_motion_kind_t;

typedef enum {
    MK_SENSOR_NONE, /* a node that only relays; rows 0 */
    MK_SENSOR_RANGE,
    MK_SENSOR_BEARING,
    MK_SENSOR_RANGE_BEARING,
    MK_SENSOR_RANGE_RATE,
    MK_SENSOR_TDOA,
    MK_SENSOR_PLUGIN
} mk_sensor_kind_t;

typedef enum { MK_TRANSFORM_KIND_JULIER, MK_TRANSFORM_KIND_CUBATURE, MK_TRANSFORM_KIND_SCALED } mk_transform_kind_t;
typedef enum { MK_PROTOCOL_PAPER, MK_PROTOCOL_PERRON, MK_PROTOCOL_METROPOLIS, MK_PROTOCOL_RATIO } mk_protocol_t;

/* An own model (meshkal/plugin.h) as the scenario names it. */
typedef struct {
    char *name; /* null: none */
    int parameters;
    double *parameter;
} mk_own_model_t;

/* What a tracking node has besides mk_sensor_t, whose C is null. */
typedef struct {
    mk_sensor_kind_t kind;
    mk_own_model_t own;
    double reference_m[3];
    double range_limit_m;     /* infinite: none */
    double loss;              /* probability */
    double fault_probability;
    double *fault_sigma;      /* one a row; null: no faults */
} mk_tracking_node_t;

#define MK_TRACKING_FILTERS {"ekf", "ukf", "iukf", "iukf-literal", "pukf", "mpukf", "duif", "kcf", "rekfd"}
enum { MK_TRACKING_FILTER_COUNT = 9, MK_TRACKING_PATIENCE = 10 };

typedef struct {
    int exists;           /* 0: no gate */
    double significance;
    int sensor, stacked;  /* which are judged */
    int policy;           /* MK_GATE_ of meshkal/gate.h */
    int patience;
    unsigned filters;     /* bit i: filter i of MK_TRACKING_FILTERS is gated */
} mk_gate_settings_t;

/* scenario.Q is for one dt_s: the explicit one, or made from the densities; zero where only the own model knows it (mk_models_noise_<real>). */
typedef struct mk_tracking {
    mk_motion_kind_t motion_kind;
    mk_own_model_t own;
    char **state;                /* n names, in the scenario's order */
    mk_motion_t motion;          /* which state is what; dimensions 0: no position among them */
    int has_velocity;            /* of all dimensions */
    int has_Q;                   /* explicit: multiplied by dt / dt_s for other steps */
    int has_psd;                 /* the densities below */
    double acceleration_psd[3];  /* m^2/s^3 */
    double turn_rate_psd;        /* rad^2/s^3 */
    int has_start_s;
    double start_s;              /* time of x0 and P0 */
    int estimate_is_drawn;       /* 1: truth starts at x0, the estimate is drawn; 0: the other way round */
    double reading_loss;
    mk_tracking_node_t *node;    /* nodes */

    mk_transform_kind_t transform;
    double kappa, alpha, beta;
    int increments, rule;        /* rule: MK_RULE_ of meshkal/unscented.h, for mpukf */
    mk_gate_settings_t gate;
    mk_protocol_t protocol;
    int iterations;              /* of consensus */
    int without_residual;        /* information as published */
} mk_tracking_t;

/* "range", ...; "metropolis", ... */
const char *mk_sensor_kind_name(mk_sensor_kind_t kind);
const char *mk_protocol_name(mk_protocol_t protocol);
/* 1 if the scenario has a gate for the filter of this name. */
int mk_tracking_gates(const mk_tracking_t *tracking, const char *filter);

/* Parts of mk_scenario_load_any, in this order. The model of a scenario that has one with "motion": fills n, Q, x0, P0, dt_s, position_states and tracking. */
int mk_read_motion(mk_reader_t *reader, json_t *model, mk_scenario_t *scenario);
/* "name" and "parameters" of the object at `at`, which only an own model has. */
int mk_read_own_model(mk_reader_t *reader, json_t *object, const char *at, int is_own, mk_own_model_t *own);
/* Everything of one node but R: returns the rows that R must have, 0 without a sensor, -1 with an error. *R is the value for it. */
int mk_read_tracking_node(mk_reader_t *reader, json_t *node, const char *at, const mk_tracking_t *tracking, mk_sensor_t *sensor,
                          mk_tracking_node_t *more, json_t **R);
/* "reading_loss" and "tracking". */
int mk_read_tracking(mk_reader_t *reader, json_t *root, mk_scenario_t *scenario);
void mk_tracking_free(mk_tracking_t *tracking, int n, int nodes);

#endif
