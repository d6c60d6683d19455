/* SPDX-License-Identifier: MIT */
/* The six filters (spec 1.3, 1.4) and the tolerance that each gives its estimators. */
#ifndef MESHKAL_FILTER_H
#define MESHKAL_FILTER_H

#include "design/node_config.h"

typedef enum { MK_TOLERANCE_ZERO, MK_TOLERANCE_GLOBAL, MK_TOLERANCE_SCHEDULE, MK_TOLERANCE_STEADY } mk_tolerance_mode_t;

typedef struct {
    const char *name;
    int central; /* one estimator that hears every sensor; else one a node */
    mk_tolerance_mode_t mode;
} mk_filter_t;

#define MK_FILTERS 6
extern const mk_filter_t mk_filters[MK_FILTERS];

/* The filter of that name, null for "all". 1, or 0 and an error that lists the names. */
int mk_filter_find(const char *name, const mk_filter_t **filter, mk_error_t *error);

/* Tolerances of the topology's estimators when c of the design is `tolerance`: fixed, one an estimator, 0 for RKFDNU; and for RKFDNU
   *schedule, steps x estimators, for t = 0 .. steps - 1 (null for the others; free it). 1, or 0 and an error of the design. */
int mk_filter_tolerances(const mk_filter_t *filter, const mk_scenario_t *scenario, double tolerance, int steps, const mk_topology_t *topology,
                         int threads, double *fixed, double **schedule, mk_error_t *error);

#endif
