/* SPDX-License-Identifier: MIT */
/* A filter of any dimensions in either precision behind one interface in double, so that a test is written once. It drives the
   shared kernels of libmeshkal. Numbers given to a float32 node must be floats already, or the conversion would hide an error. */
#ifndef UNIT_NODE_H
#define UNIT_NODE_H

#include <meshkal/rkfd.h>

#include "reference.h"

typedef struct node node_t;

/* Everything the header lets a caller see, V from mk_rkfd_covariance. No padding to speak of: compare field by field or the
   arrays as bytes. */
typedef struct {
    double x[LARGEST_N], psi[LARGEST_N], V[LARGEST_N * LARGEST_N], W[LARGEST_N * (LARGEST_N + 1) / 2];
    double theta, trace_P, nis;
    double nis_rows, iterations, measurements, estimates, steps, steps_since_measurement, rejected, faults, steady, frozen;
} seen_t;

/* The limit of a node's recursion, as the configuration takes it: matrices full, in row order. */
typedef struct {
    double Phi[LARGEST_N * LARGEST_N], G[LARGEST_SLOTS][LARGEST_N * LARGEST_M], W[LARGEST_N * LARGEST_N];
    double theta, trace_P, close;
    int period;
} steady_t;

typedef struct {
    const char *name;
    double epsilon;
    /* Never fails; free with node_free. */
    node_t *(*make)(const model_t *model);
    mk_status_t (*start)(node_t *node);
    /* Before start: gives the configuration a steady part. */
    void (*give_steady)(node_t *node, const steady_t *steady);
    /* Rewrites C, F, S and R_inverse of one sensor from the model. */
    mk_status_t (*sensor)(node_t *node, const model_t *model, int slot);
    mk_status_t (*put)(node_t *node, int slot, const double *values, int is_innovation);
    mk_status_t (*predict)(node_t *node, int slot, double *e, double *variance);
    /* S full, rows x rows of what is there. */
    mk_status_t (*innovations)(node_t *node, double *r, double *S, uint8_t *rows);
    mk_status_t (*drop)(node_t *node, int slot);
    mk_status_t (*incremental)(node_t *node, const double *input);
    mk_status_t (*put_estimate)(node_t *node, int slot, const double *psi);
    mk_status_t (*diffuse)(node_t *node);
    mk_status_t (*set_tolerance)(node_t *node, double c);
    /* To x and V of the model's start. */
    mk_status_t (*restart)(node_t *node);
    /* The covariance may be refused; the rest of `seen` is filled all the same. */
    mk_status_t (*see)(node_t *node, seen_t *seen);
    int (*gamma_root)(int n, const double *packed_P, double c, double *theta);
    int (*gamma)(int n, const double *packed_P, double theta, double *gamma, double *slope);
} precision_t;

extern const precision_t float32, float64;

void node_free(node_t *node);

#endif
