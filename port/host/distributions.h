/* SPDX-License-Identifier: MIT */
/* Distribution functions for confidence intervals and tests. Relative error below 1e-10 of every probability down to 1e-300 and of every
   quantile for probabilities down to 1e-12 and far below; degrees of freedom above 0, whole or not, to 1e7 (chi-square: loops grow with their
   square root) or without limit (Student). Arguments outside the domain, NaN among them, give NaN.

   "cdf" is P(X <= x), "tail" P(X > x). A small probability is exact in the one of the two that is small: 1 - cdf is not. */
#ifndef MESHKAL_HOST_DISTRIBUTIONS_H
#define MESHKAL_HOST_DISTRIBUTIONS_H

/* Standard normal. quantile: x with P(X <= x) = p, 0 < p < 1; for a small upper tail q use -mk_normal_quantile(q). */
double mk_normal_tail(double x);
double mk_normal_quantile(double p);

/* Chi-square. quantile: x with cdf(x) = p; tail_quantile: x with tail(x) = q. */
double mk_chi_square_cdf(double x, double degrees);
double mk_chi_square_tail(double x, double degrees);
double mk_chi_square_quantile(double p, double degrees);
double mk_chi_square_tail_quantile(double q, double degrees);

/* Student's t. quantile as for the normal: mk_student_quantile(0.975, runs - 1) is the factor of a 95 % interval of a mean. */
double mk_student_tail(double t, double degrees);
double mk_student_quantile(double p, double degrees);

/* First and second derivative of log Gamma, x > 0. Error 1e-14 of max(|value|, 1), and of the value. */
double mk_digamma(double x);
double mk_trigamma(double x);

#endif
