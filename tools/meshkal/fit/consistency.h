/* SPDX-License-Identifier: MIT */
/* Do the filters' covariances tell the truth about recorded data: normalised innovations and errors squared.
 *
 *     NIS  = e' (C V C' + R)^-1 e over the rows of all readings of a step, mean over rows:    1 if the filter's model holds
 *     NEES = (x - xh)' V^-1 (x - xh) before the readings of a step are used, mean over states: 1 likewise
 *
 * over the second half of the steps (a wrong x0 or P0 is forgotten by then). Interval: chi-square, as if the filter were exact; NIS of an
 * exact filter are independent from step to step, NEES are not: their steps count as the model's own autocorrelation of kfc says, for the
 * nodes as that of the series (mk_long_run, which misses long weak correlation: the intervals are then somewhat narrow). The level holds for all
 * estimators of a filter together (Bonferroni). Only for kfc (c = 0) is the law exact under the model. V of a distributed filter is not
 * diffused (spec 1.10, trap 4): its NEES may leave the interval on data of the nominal model, and V of a robust filter is widened on purpose. */
#ifndef MESHKAL_CONSISTENCY_H
#define MESHKAL_CONSISTENCY_H

#include "simulation/campaign.h"

typedef struct {
    double mean, low, high; /* NaN where there is nothing to average */
} mk_mean_t;

typedef struct {
    const mk_filter_t *filter;
    double tolerance; /* c of the design */
    int estimators, steps;
    mk_mean_t *nis, *nees; /* one an estimator */
} mk_consistency_t;

/* Runs the node code in float64 over the source, which is recorded with truth in every step. Filters: kfc, kfd, rkfdnu2. 1, or 0 and an
   error; *result is then empty. */
int mk_consistency_make(mk_consistency_t *result, const mk_source_t *source, const mk_filter_t *filter, double tolerance, double level,
                        mk_error_t *error);
void mk_consistency_free(mk_consistency_t *result);

/* "consistent", "optimistic" (larger than its law allows: the covariance is too small), "cautious" (smaller), "-" (no mean). */
const char *mk_consistency_verdict(const mk_mean_t *mean);

#endif
