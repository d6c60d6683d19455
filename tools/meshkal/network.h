/* SPDX-License-Identifier: MIT */
/* A whole network of node filters, one statically sized object for each estimator, in one precision. Runs the library's own steps. */
#ifndef MESHKAL_NETWORK_H
#define MESHKAL_NETWORK_H

#include "node_config.h"

/* What the nodes say of a step, in the network's precision: E numbers each; the estimate E x n; of V the block of the p position states,
   packed, E x p (p + 1) / 2. */
typedef struct {
    void *estimate, *trace_covariance, *position_covariance; /* before the step: belong to t */
    void *theta, *tolerance, *nis;     /* of the step */
    uint32_t *nis_rows, *faults;
} mk_snapshot_t;

typedef struct {
    size_t real_size;
    const char *name;
    void *(*open)(const mk_scenario_t *scenario, const mk_topology_t *topology, const double *tolerance);
    void (*close)(void *network);
    /* All nodes to x0, P0. Each returns the first failure and its estimator in *bad. */
    mk_status_t (*start)(void *network, int *bad);
    mk_status_t (*set_tolerance)(void *network, const double *tolerance, int *bad);
    /* arrived, a byte for each slot: in, whether the link works; out, whether a reading was there as well. y: rows of all nodes one
       after another from row_first[k], NaN in the first row: no reading. */
    mk_status_t (*incremental)(void *network, const double *y, const int *row_first, uint8_t *arrived, int *bad);
    mk_status_t (*diffuse)(void *network, const uint8_t *arrived, int *bad);
    /* estimate as float64, E x n. */
    void (*estimate)(void *network, double *estimate);
    /* Normalised errors squared (x - xh)' V^-1 (x - xh) of all estimators, before a step. */
    void (*nees)(void *network, const double *x, double *nees);
    /* Before a step: estimate and covariances. After it: the rest. */
    void (*look_before)(void *network, mk_snapshot_t *snapshot);
    void (*look_after)(void *network, mk_snapshot_t *snapshot);
    /* Means over estimators of theta and tolerance of the last step. */
    void (*means)(void *network, double *theta, double *tolerance, double *nis_ratio);
} mk_network_t;

extern const mk_network_t mk_network_f32, mk_network_f64;

mk_snapshot_t mk_snapshot_make(const mk_network_t *network, int estimators, const mk_scenario_t *scenario);
void mk_snapshot_free(mk_snapshot_t *snapshot);

#endif
