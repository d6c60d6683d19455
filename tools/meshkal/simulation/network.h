/* SPDX-License-Identifier: MIT */
/* A network of node filters, or a part of one: one statically sized object for each estimator, in one precision. Runs the library's own
   steps. Estimators do best in an order in which those that hear each other are near. */
#ifndef MESHKAL_NETWORK_H
#define MESHKAL_NETWORK_H

#include "design/node_config.h"
#include "exact_sum.h"
#include "host_monitor.h"

/* What the nodes say of a step, in the network's precision: E numbers each; the estimate and the diagonal of V E x n; of V the block of the p
   position states, packed, E x p (p + 1) / 2. Of the readings of an estimator's own sensors (all of a centre's): own_first[E] numbers each. */
typedef struct {
    void *estimate, *variance, *trace_covariance, *position_covariance; /* before the step: belong to t */
    void *innovation, *innovation_variance; /* y - C x and the diagonal of C V C' + R there; NaN: no reading */
    const int *own_first;                   /* first of estimator e's; null: there are no innovations */
    void *theta, *tolerance, *nis;     /* of the step */
    uint32_t *nis_rows, *faults;
    uint8_t *frozen;
} mk_snapshot_t;

/* What a step has found, summed over estimators. */
enum { MK_THETA, MK_TOLERANCE, MK_NIS, MK_NIS_ROWS, MK_FINDINGS };

/* Estimators are numbered as in the topology. Functions that return a status stop no estimator for the failure of another; *bad is, of
   those that failed, the one with the lowest number in the whole network. */
typedef struct {
    size_t real_size;
    const char *name;
    /* threads: how many work on it at once. frozen > 0: estimators that have a limit freeze their gain that close to it (design/steady.h).
       monitor: of every estimator, which then has at most MK_MONITOR_ROWS rows (mk_monitor_rows); null or scheme MK_MONITOR_NONE: none. topology
       and tolerance stay the caller's. */
    void *(*open)(const mk_scenario_t *scenario, const mk_topology_t *topology, const double *tolerance, double frozen,
                  const mk_monitor_settings_t *monitor, int threads);
    void (*close)(void *network);
    /* All nodes to x0, P0. */
    mk_status_t (*start)(void *network, int *bad);
    mk_status_t (*set_tolerance)(void *network, const double *tolerance, int *bad);
    /* Steps of the estimators begin .. end - 1. arrived, a byte for each slot: in, whether the link works; out, whether a reading was there
       as well; a monitor may then leave it out. y: rows of all nodes one after another from row_first[k], NaN in the first row: no reading.
       seen: gets the innovations, also of readings that a monitor leaves out; null: nobody looks at them. */
    mk_status_t (*incremental)(void *network, int begin, int end, const double *y, const int *row_first, uint8_t *arrived, mk_snapshot_t *seen,
                               int *bad);
    /* arrived may be null: no estimates are exchanged. halo: psi of the topology's halo. */
    mk_status_t (*diffuse)(void *network, int begin, int end, uint8_t *arrived, const void *halo, int *bad);
    /* psi of some estimators, one after another. */
    void (*intermediate)(void *network, const int *estimator, int count, void *psi);
    /* estimate of the estimators begin .. end - 1 as float64, n each. Several threads may do this at once; so with `add`. */
    void (*estimate)(void *network, int begin, int end, double *estimate);
    /* Normalised errors squared (x - xh)' V^-1 (x - xh) of all estimators, before a step. */
    void (*nees)(void *network, const double *x, double *nees);
    /* Before a step: estimate and covariances. After it: the rest. */
    void (*look_before)(void *network, mk_snapshot_t *snapshot);
    void (*look_after)(void *network, mk_snapshot_t *snapshot);
    /* After `incremental`, with a monitor: what those of the estimators begin .. end - 1 said of this step; each slot by its place in the
       topology. Several threads may do this at once. rejected, one an estimator: epochs that the monitor could not take, since `start`. */
    void (*look_monitor)(void *network, int begin, int end, mk_monitor_snapshot_t *snapshot, uint32_t *rejected);
    /* Adds what the last step of these estimators has found to MK_FINDINGS sums. */
    void (*add)(void *network, int begin, int end, mk_exact_t *sums);
} mk_network_t;

extern const mk_network_t mk_network_f32, mk_network_f64;

/* Rows of the monitor of estimator e. */
int mk_monitor_rows(const mk_topology_t *topology, const mk_scenario_t *scenario, int e);

/* own_first, estimators + 1 numbers or null, stays the caller's. */
mk_snapshot_t mk_snapshot_make(const mk_network_t *network, int estimators, const mk_scenario_t *scenario, const int *own_first);
void mk_snapshot_free(mk_snapshot_t *snapshot);

#endif
