/* SPDX-License-Identifier: MIT */
/* The normal distribution and derivatives of log Gamma, for confidence intervals and tests; meshkal/quantile.h has chi-square and Student.
   Relative error below 1e-12 of probabilities down to 1e-300 and of quantiles. Arguments outside the domain, NaN among them, give NaN. */
#ifndef MESHKAL_HOST_DISTRIBUTIONS_H
#define MESHKAL_HOST_DISTRIBUTIONS_H

/* Standard normal. tail: P(X > x), quantile: x with P(X <= x) = p, 0 < p < 1; for a small upper tail q use -mk_normal_quantile(q). */
double mk_normal_tail(double x);
double mk_normal_quantile(double p);

/* Confidence interval (Clopper and Pearson) of a probability of which `hits` of `trials` were seen, tail on either side; NaN unless
   0 <= hits <= trials, trials >= 1, 0 < tail < 0.5. Relative error below 1e-8 for up to 1e6 trials, 1e-6 for 1e9. */
void mk_share_interval(double hits, double trials, double tail, double *low, double *high);

/* First and second derivative of log Gamma, x > 0. Error 1e-14 of max(|value|, 1), and of the value. */
double mk_digamma(double x);
double mk_trigamma(double x);

#endif
