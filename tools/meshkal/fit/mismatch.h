/* SPDX-License-Identifier: MIT */
/* How far the law of a sample of whitened residuals is from N(0, I): an estimate, a confidence interval and a test.
 *
 * Measure, in the unit of spec 1.2 (TWICE the Kullback-Leibler divergence, nats): for p rows with mean mu and covariance Sigma
 *
 *     c = tr Sigma - log det Sigma - p + mu' mu
 *
 * the divergence of the normal law with these two moments. What a law has beyond them (tails) is not in c.
 *
 * Estimate. With the sample's mean m and covariance S = sum v v' / T, v = u - m, put raw = tr S - log det S - p + m' m. For independent
 * normal residuals T S is Wishart with T - 1 degrees, independent of m, so that exactly, whatever mu and Sigma are,
 *
 *     E raw   = c + bias          bias     = - sum_i psi((T - i) / 2) - p log(2 / T)
 *     Var raw = variance + signal variance = sum_i psi'((T - i) / 2) - 2 p / T,     i = 1 .. p
 *                                 signal   = (2 tr (Sigma - I)^2 + 4 mu' Sigma mu) / T
 *
 * psi: digamma. raw - bias is the estimate; the signal has an unbiased estimate as well (E tr S^2 and E m' S m of the Wishart law).
 *
 * Test of c = 0. T raw is the likelihood ratio statistic, asymptotically chi-square with p (p + 3) / 2 degrees. Exact mean and variance are
 * matched instead: raw nu / bias is taken as chi-square with nu = 2 bias^2 / variance degrees (which tend to p (p + 3) / 2). Size at 5 %: 4.95
 * to 5.4 %, seen down to T = p + 2.
 *
 * Interval: the values c that a test of level 1 - level accepts. Under c the estimate has mean c, variance(c) = variance + slope c, and the
 * shape of a noncentral chi-square (Pearson's approximation by three moments; at c = 0 the law of the test). slope = signal / c; near
 * c = 0, where both are noise, it is drawn to its limit 4 / T by a weight of one standard deviation. How the error probability is
 * split between the two sides goes with Feldman and Cousins (1998): two-sided far from the boundary c = 0, one-sided at it. So the interval is
 * never empty, and contains 0 exactly when the test accepts.
 *
 * Residuals that are correlated in time count less. With the autocorrelations a_i(k) of row i (each row scaled to one), the mean of row i
 * has the variance l_i = 1 + 2 sum_k a_i(k) times that of independent residuals, the product of rows i and j l_ij = 1 + 2 sum_k a_i(k) a_j(k)
 * (normal residuals, no correlation across rows and time at once). Lags are taken as long as sum_i T a_i(k)^2 is beyond the 0.1 % point of
 * chi-square with p degrees, up to MK_MISMATCH_LAGS and T / 4. With r the mean of all l, bias and variance are those of T / r effective
 * steps, variance times the mean of (l / r)^2. The signal's estimate takes the long-run variance of the influence values
 * v' (I - S^-1) v + 2 m' v instead, summed over the same lags and on while significant. Tails: if Mardia's kurtosis differs from the
 * normal one by more than three standard deviations, r is multiplied by what it does to the variance of the products, and the influence
 * values' own variance counts. All of these are 1 for white normal residuals, and the results then exactly those above.
 *
 * Limits. Correlated residuals: the expansion needs r p well below T (effective_steps of 4 p or more; with fewer c comes out too low).
 * Heavy tails: coverage of 95 % intervals seen 82 to 98 % for Student's t with five degrees, worst at c = 0; worse for tails common to many rows. */
#ifndef MESHKAL_MISMATCH_H
#define MESHKAL_MISMATCH_H

#define MK_MISMATCH_LAGS 1000

typedef struct {
    int steps, rows;
    double raw, bias, variance;
    double signal;  /* estimate, unbiased: may be below 0 */
    double spread;  /* 1 / effective steps */
    double degrees; /* p (p + 3) / 2: parameters of mean and covariance */
    int lags;
    double white_p;            /* of the first lag of all rows: probability if residuals are white */
    double kurtosis, tails_p;  /* relative to the normal law; two-sided */
} mk_mismatch_t;

/* residual: steps x rows, whitened by the nominal covariance. steps >= rows + 3. 1, or 0 with *bad the first row that is a linear combination
   of those before it (or constant): c is then infinite. covariance: S, packed, or null. */
int mk_mismatch_make(mk_mismatch_t *mismatch, int steps, int rows, const double *residual, double *covariance, int *bad);

/* Independent samples together: c is the sum. */
void mk_mismatch_add(mk_mismatch_t *sum, const mk_mismatch_t *part);

/* What S says of correlation between blocks of rows: sum of c of the blocks + this = c of all; under c = 0 independent of the blocks. first:
   blocks + 1 row numbers. whole: of the sample that S comes from. Test it with mk_mismatch_test; it has no signal. */
void mk_mismatch_across(mk_mismatch_t *across, const mk_mismatch_t *whole, const double *covariance, int blocks, const int *first);

/* The chi-square statistic and its degrees, and the probability of one as large if c = 0. */
double mk_mismatch_test(const mk_mismatch_t *mismatch, double *statistic, double *degrees);
/* level, for example 0.95. */
void mk_mismatch_interval(const mk_mismatch_t *mismatch, double level, double *low, double *high);

/* Variance of the mean of a series relative to independent values: 1 + 2 times the sum of its autocorrelations, at least 1. Lags 1 .. least are
   counted in any case, more as long as they are beyond three standard deviations. */
double mk_long_run(int count, const double *series, int least);

/* log det of a packed matrix by Cholesky, which overwrites it; 1, or 0 with *bad the row without a pivot. */
int mk_log_det(int n, double *S, double *result, int *bad);

#endif
