/* SPDX-License-Identifier: MIT */
/*
 * Quantiles of the chi-square and Student distributions, for thresholds (spec 2.4). Upper tails, so that small probabilities keep their
 * digits: the quantile at `tail` is the x with P(X > x) = tail. Relative error below 1e-6 for tails from 1e-10 to 1 - 1e-10 and degrees of
 * freedom from 0.5 to 1e6 (far below where that is stated with the function). One precision: they belong to start-up, not to steps.
 */
#ifndef MESHKAL_QUANTILE_H
#define MESHKAL_QUANTILE_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* P(X > x). NaN where an argument is NaN, degrees are not positive and finite, or (chi-square) x is negative. */
double mk_chi2_tail(double x, double degrees);
double mk_student_tail(double x, double degrees);

/* x with P(X > x) = tail, 0 < tail < 1; NaN elsewhere, and as above. */
double mk_chi2_quantile(double tail, double degrees);
double mk_student_quantile(double tail, double degrees);

#ifdef __cplusplus
}
#endif

#endif
