/* SPDX-License-Identifier: MIT */
/*
 * Own models for the host programs: a C file compiled into a shared object and given to `meshkal simulate --models FILE.so`. It exports one
 * function,
 *
 *     const mk_plugin_t *meshkal_plugin(void);
 *
 * whose table lists models by the names that a scenario uses:
 *
 *     "model": {"motion": "plugin", "name": "bicycle", "parameters": [2.5], ...}
 *     "nodes": [{"sensor": "plugin", "name": "signal-strength", "parameters": [-40, 2], "position_m": [0, 0], "R": [[4]]}, ...]
 *
 * Functions follow the contract of meshkal/model.h. Their context is an mk_plugin_context_<real>_t. They are called by several threads at
 * once. All functions of the library can be called: the program that loads the file holds them. Example: tools/meshkal/examples.
 *
 *     cc -std=c99 -O2 -ffp-contract=off -shared -fPIC own.c -o own.so
 */
#ifndef MESHKAL_PLUGIN_H
#define MESHKAL_PLUGIN_H

#include <meshkal/model.h>
#include <meshkal/tracking.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MK_PLUGIN_VERSION 1

enum { MK_PLUGIN_MOTION, MK_PLUGIN_SENSOR };

#define MK_DECLARE_PLUGIN(real)                                                                                               \
    /* What the scenario says of one motion or sensor. */                                                                     \
    typedef struct {                                                                                                          \
        mk_site_##real##_t site; /* first, so that mk_range_<real>(context, ...) and the like can be called. site.motion: the states by their \
                                    names; dimensions is 0 if they hold no position, and mk_motion_check tells the rest. position and        \
                                    reference: of a sensor, 0 where the scenario gives none */                                \
        int n, rows;             /* states; rows of a sensor, n of a motion */                                                \
        int parameters;                                                                                                       \
        const mk_##real##_t *parameter; /* `parameters` numbers */                                                            \
    } mk_plugin_context_##real##_t;                                                                                           \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_function_##real##_t function;  /* required in f64, from which truth is drawn; null in f32: --real float32 is refused */ \
        mk_jacobian_##real##_t jacobian;  /* null: filters that need it are refused */                                        \
        /* of mk_space_<real>_t, with the context above; null: ordinary numbers */                                            \
        void (*difference)(const void *context, const mk_##real##_t *a, const mk_##real##_t *b, mk_##real##_t *d);            \
        void (*mean)(const void *context, int count, const mk_##real##_t *weight, const mk_##real##_t *y, mk_##real##_t *mean); \
        /* Motions: Q of a step of dt seconds, packed n, positive semidefinite. Null: the scenario gives Q. */                \
        mk_status_t (*noise)(const void *context, mk_##real##_t dt, mk_##real##_t *Q);                                        \
    } mk_plugin_functions_##real##_t;

MK_DECLARE_PLUGIN(f32)
MK_DECLARE_PLUGIN(f64)

typedef struct {
    const char *name;
    int kind;       /* MK_PLUGIN_ */
    int size;       /* states of a motion, 0: any number; rows of a sensor, at least 1 */
    int parameters; /* that the scenario must give */
    mk_plugin_functions_f32_t f32;
    mk_plugin_functions_f64_t f64;
} mk_plugin_model_t;

typedef struct {
    int version; /* MK_PLUGIN_VERSION */
    int models;
    const mk_plugin_model_t *model;
} mk_plugin_t;

/* The exported function; what it returns stays as it is as long as the file is loaded. */
const mk_plugin_t *meshkal_plugin(void);

#ifdef __cplusplus
}
#endif

#endif
