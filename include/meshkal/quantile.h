/* SPDX-License-Identifier: MIT */
/*
 * Quantiles of the chi-square and Student distributions, for thresholds (spec 2.4). Upper tails, so that small probabilities keep their
 * digits: the quantile at `tail` is the x with P(X > x) = tail. For degrees of freedom from 0.5 to 1e6, whole or not, the relative error of
 * a quantile is below 1e-13 for tails from 1e-10 to 1 - 1e-10 and below 1e-12 down to 1e-300; that of a tail below 1e-12 down to 1e-300. Fewer
 * or more degrees are allowed. Neighbouring arguments may come out in the wrong order by as little as that.
 *
 * One precision: they belong to start-up, not to steps. Every call ends after a bounded number of operations: a tail takes up to 160 terms
 * of a series or 60 of a fraction, a quantile as a rule three or four times that, 64 times at most.
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

/* x with P(X > x) = tail, 0 < tail < 1; NaN elsewhere, and as above. 0 or infinity where x is too small or too large for a double. */
double mk_chi2_quantile(double tail, double degrees);
double mk_student_quantile(double tail, double degrees);

#ifdef __cplusplus
}
#endif

#endif
