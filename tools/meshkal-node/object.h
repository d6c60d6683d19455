/* SPDX-License-Identifier: MIT */
/* The node object of <meshkal/node.h> in either precision, with the dimensions that a scenario gives it: node and configuration in one. */
#ifndef MESHKAL_NODE_OBJECT_H
#define MESHKAL_NODE_OBJECT_H

#include <meshkal/node.h>

#include "scenario.h"
#include "simulation/network.h"

typedef struct {
    int node, numbers, catch_up;        /* MK_NUMBERS_ */
    double tolerance;
    double gate_reading, gate_estimate; /* probability of a good reading to pass, 0: none; threshold, 0: none */
    int patience;
} mk_object_facts_t;

/* What the object says of itself; counts are its own memory. */
typedef struct {
    uint32_t step;
    int stage;
    const uint32_t *counts; /* by mk_status_t */
    uint32_t early, caught_up, restarts, reinitialised, unsent; /* restarts: changes where there was one */
} mk_object_look_t;

/* What there is to log of a step; arrays of the object, slots long but for y: all rows of slot 0, then of slot 1, ... */
typedef struct {
    mk_snapshot_t seen; /* one estimator */
    double *y;          /* NaN: no reading */
    uint8_t *have_y, *have_psi;
} mk_moment_t;

/* Functions are those of <meshkal/node.h>, with the same errors. */
typedef struct {
    size_t real_size;
    const char *name;
    /* The model's number in frames is the start of the scenario's SHA-256, as in generated headers. */
    void *(*open)(const mk_scenario_t *scenario, const mk_object_facts_t *facts);
    void (*close)(void *object);
    size_t (*blob_max)(const void *object);
    size_t (*frame_max)(const void *object);
    mk_status_t (*start)(void *object);
    mk_status_t (*restore)(void *object, const uint8_t *blob, size_t length);
    mk_status_t (*secure)(void *object, const mk_aead_t *aead, uint64_t sequence);
    mk_status_t (*measure)(void *object, const double *y);
    size_t (*frame)(void *object, int stage, uint8_t *bytes);
    mk_status_t (*accept)(void *object, const uint8_t *bytes, size_t length);
    /* Both leave in the object's moment what happened. */
    mk_status_t (*incremental)(void *object);
    mk_status_t (*diffuse)(void *object);
    mk_status_t (*advance)(void *object, uint32_t step);
    /* To x0 and P0 of the configuration. */
    mk_status_t (*restart)(void *object);
    size_t (*save)(void *object, uint8_t *blob);
    mk_object_look_t (*look)(const void *object);
    const mk_moment_t *(*moment)(const void *object);
} mk_object_t;

extern const mk_object_t mk_object_f32, mk_object_f64;

#endif
