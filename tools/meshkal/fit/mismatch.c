/* SPDX-License-Identifier: MIT */
#include "fit/mismatch.h"

#include <math.h>
#include <meshkal/base.h>
#include <meshkal/quantile.h>
#include <stdlib.h>
#include <string.h>

#include "distributions.h"
#include "error.h"

#define AT(i, j) ((size_t)(i) * ((size_t)(i) + 1) / 2 + (size_t)(j))

static double *doubles(size_t count) { return mk_allocate(count, sizeof(double)); }

int mk_log_det(int n, double *S, double *result, int *bad) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) {
        const double before = S[AT(i, i)];
        for (int j = 0; j <= i; j++) {
            double value = S[AT(i, j)];
            for (int k = 0; k < j; k++) value -= S[AT(i, k)] * S[AT(j, k)];
            if (j < i) {
                S[AT(i, j)] = value / S[AT(j, j)];
                continue;
            }
            *bad = i;
            /* Below this the pivot is what rounding left of a number 1e12 times larger. */
            if (!(value > 1e-12 * before)) return 0;
            S[AT(i, i)] = sqrt(value);
            sum += log(value);
        }
    }
    *result = sum;
    return 1;
}

double mk_long_run(int count, const double *series, int least) {
    double mean = 0.0, variance = 0.0, sum = 1.0;
    for (int t = 0; t < count; t++) mean += series[t] / count;
    for (int t = 0; t < count; t++) variance += (series[t] - mean) * (series[t] - mean);
    if (!(variance > 0.0)) return 1.0;
    const int most = count / 4 < MK_MISMATCH_LAGS ? count / 4 : MK_MISMATCH_LAGS;
    for (int k = 1; k <= most; k++) {
        double r = 0.0;
        for (int t = 0; t + k < count; t++) r += (series[t] - mean) * (series[t + k] - mean);
        r /= variance;
        if (k > least && !(r * sqrt(count) > 3.0)) break;
        sum += 2.0 * r;
    }
    return fmax(sum, 1.0);
}

/* --- null law: mean and variance of raw ------------------------------------------------------------------------------------- */

static double null_bias(double steps, int rows) {
    double sum = -rows * log(2.0 / steps);
    for (int i = 1; i <= rows; i++) sum -= mk_digamma(0.5 * (steps - i));
    return sum;
}

static double null_variance(double steps, int rows) {
    double sum = -2.0 * rows / steps;
    for (int i = 1; i <= rows; i++) sum += mk_trigamma(0.5 * (steps - i));
    return sum;
}

/* --- dependence in time and tails ------------------------------------------------------------------------------------------- */

/* Autocorrelations of every row at lag k into a, and T sum of their squares. v: rows of mean 0. */
static double autocorrelate(int steps, int rows, int k, const double *v, const double *S, double *a) {
    double sum = 0.0;
    memset(a, 0, (size_t)rows * sizeof *a);
    for (int t = 0; t + k < steps; t++) {
        const double *now = v + (size_t)t * (size_t)rows, *later = now + (size_t)k * (size_t)rows;
        for (int i = 0; i < rows; i++) a[i] += now[i] * later[i];
    }
    for (int i = 0; i < rows; i++) {
        /* The mean taken off makes white residuals look correlated by -1 / T. */
        a[i] = (a[i] / S[AT(i, i)] + 1.0) / steps;
        sum += a[i] * a[i];
    }
    return steps * sum;
}

/* Ratios of variances to those of white residuals: mean r of all means and products of rows, and in *unequal the mean of their squares
   over r^2. */
static double time_ratio(mk_mismatch_t *m, const double *v, const double *S, double *unequal) {
    const int p = m->rows, T = m->steps, most = T / 4 < MK_MISMATCH_LAGS ? T / 4 : MK_MISMATCH_LAGS;
    const double critical = mk_chi2_quantile(0.001, p);
    double *a = doubles((size_t)p), *of_mean = doubles((size_t)p), *of_product = NULL;
    m->lags = 0;
    for (int k = 1; k <= most; k++) {
        const double square = autocorrelate(T, p, k, v, S, a);
        if (k == 1) m->white_p = mk_chi2_tail(square, p);
        if (square < critical) break;
        if (!of_product) of_product = doubles(AT(p, 0));
        for (int i = 0; i < p; i++) {
            of_mean[i] += 2.0 * a[i];
            for (int j = 0; j < i; j++) of_product[AT(i, j)] += 2.0 * a[i] * a[j];
            of_product[AT(i, i)] += 2.0 * (a[i] * a[i] - 1.0 / T);
        }
        m->lags = k;
    }
    double sum = 0.0, square = 0.0;
    for (int i = 0; i < p && of_product; i++) {
        const double mean = fmax(1.0 + of_mean[i], 0.1);
        sum += mean;
        square += mean * mean;
        for (int j = 0; j <= i; j++) {
            const double product = 1.0 + of_product[AT(i, j)];
            sum += product;
            square += product * product;
        }
    }
    const double ratio = of_product ? sum / m->degrees : 1.0;
    *unequal = of_product ? square / (m->degrees * ratio * ratio) : 1.0;
    free(a);
    free(of_mean);
    free(of_product);
    return fmax(ratio, 1.0);
}

/* Ratio by tails: Mardia's kurtosis, its mean and variance exact for normal samples. 1 unless it is significant. */
static double tail_ratio(mk_mismatch_t *m, double fourth) {
    const double p = m->rows, T = m->steps, mean = p * (p + 2.0) * (T - 1.0) / (T + 1.0);
    const double variance = 8.0 * p * (p + 2.0) * (T - 3.0) * (T - p - 1.0) * (T - p + 1.0) / ((T + 1.0) * (T + 1.0) * (T + 3.0) * (T + 5.0));
    const double score = (fourth - mean) / sqrt(variance);
    m->kurtosis = fourth / mean;
    m->tails_p = 2.0 * mk_normal_tail(fabs(score));
    return fabs(score) > 3.0 ? (p + 0.5 * (fourth * (T + 1.0) / (T - 1.0) - p)) / m->degrees : 1.0;
}

/* --- the sample ------------------------------------------------------------------------------------------------------------- */

/* m, v = u - m, S; returns tr S. */
static double moments(int steps, int rows, const double *u, double *m, double *v, double *S) {
    double trace = 0.0;
    for (int t = 0; t < steps; t++)
        for (int i = 0; i < rows; i++) m[i] += u[(size_t)t * (size_t)rows + (size_t)i] / steps;
    for (int t = 0; t < steps; t++) {
        double *row = v + (size_t)t * (size_t)rows;
        for (int i = 0; i < rows; i++) row[i] = u[(size_t)t * (size_t)rows + (size_t)i] - m[i];
        for (int i = 0; i < rows; i++)
            for (int j = 0; j <= i; j++) S[AT(i, j)] += row[i] * row[j];
    }
    for (size_t i = 0; i < AT(rows, 0); i++) S[i] /= steps;
    for (int i = 0; i < rows; i++) trace += S[AT(i, i)];
    return trace;
}

/* Estimate of 2 tr (Sigma - I)^2 + 4 mu' Sigma mu without the part that the noise of S and m puts into `plain`, the value at S and m. */
static double unbiased_signal(const mk_mismatch_t *m, double trace, double square, double mean_S_mean, double *plain) {
    const double p = m->rows, T = m->steps, nu = T - 1.0, scale = T / nu;
    const double trace_square = nu * nu / ((nu - 1.0) * (nu + 2.0)) * scale * scale * (square - trace * trace / nu);
    *plain = 2.0 * (square - 2.0 * trace + p) + 4.0 * mean_S_mean;
    return 2.0 * (trace_square - 2.0 * scale * trace + p) + 4.0 * (scale * mean_S_mean - trace_square / T);
}

/* Influence values v'(I - S^-1) v + 2 m'v into y, their mean square returned; mean of (v' S^-1 v)^2 into *fourth. L: Cholesky factor of S. */
static double influence(const mk_mismatch_t *m, const double *mean, const double *v, const double *L, double *y, double *fourth) {
    const int p = m->rows, T = m->steps;
    double *w = doubles((size_t)p), centre = 0.0, variance = 0.0;
    *fourth = 0.0;
    for (int t = 0; t < T; t++) {
        const double *row = v + (size_t)t * (size_t)p;
        double size = 0.0, white = 0.0, along = 0.0;
        for (int i = 0; i < p; i++) {
            w[i] = row[i];
            for (int j = 0; j < i; j++) w[i] -= L[AT(i, j)] * w[j];
            w[i] /= L[AT(i, i)];
            size += row[i] * row[i];
            white += w[i] * w[i];
            along += mean[i] * row[i];
        }
        y[t] = size - white + 2.0 * along;
        centre += y[t] / T;
        *fourth += white * white / T;
    }
    for (int t = 0; t < T; t++) variance += (y[t] - centre) * (y[t] - centre) / T;
    free(w);
    return variance;
}

int mk_mismatch_make(mk_mismatch_t *m, int steps, int rows, const double *u, double *covariance, int *bad) {
    const size_t packed = AT(rows, 0);
    double *mean = doubles((size_t)rows), *v = doubles((size_t)steps * (size_t)rows), *S = doubles(packed), *L = doubles(packed);
    double *y = doubles((size_t)steps), log_det = 0.0;
    memset(m, 0, sizeof *m);
    m->steps = steps;
    m->rows = rows;
    m->degrees = 0.5 * rows * (rows + 3.0);
    m->white_p = m->tails_p = 1.0;
    const double trace = moments(steps, rows, u, mean, v, S);
    if (covariance) memcpy(covariance, S, packed * sizeof *S);
    memcpy(L, S, packed * sizeof *S);
    int good = 1;
    /* A row that is constant but for rounding. */
    for (int i = 0; i < rows && good; i++) {
        *bad = i;
        good = S[AT(i, i)] > 1e-24 * mean[i] * mean[i];
    }
    good = good && mk_log_det(rows, L, &log_det, bad);
    if (good) {
        double square = 0.0, mean_square = 0.0, mean_S_mean = 0.0, fourth, plain, unequal;
        for (int i = 0; i < rows; i++) {
            mean_square += mean[i] * mean[i];
            for (int j = 0; j <= i; j++) {
                const double twice = j < i ? 2.0 : 1.0;
                square += twice * S[AT(i, j)] * S[AT(i, j)];
                mean_S_mean += twice * mean[i] * S[AT(i, j)] * mean[j];
            }
        }
        m->raw = trace - log_det - rows + mean_square;
        const double signal = unbiased_signal(m, trace, square, mean_S_mean, &plain), own = influence(m, mean, v, L, y, &fourth);
        const double by_time = time_ratio(m, v, S, &unequal), by_tails = tail_ratio(m, fourth), ratio = by_time * by_tails;
        /* Steps that count: never so few that the law does not exist. */
        const double effective = fmax(steps / ratio, rows + 2.0);
        m->spread = ratio / steps;
        m->bias = null_bias(effective, rows);
        m->variance = null_variance(effective, rows) * unequal;
        m->signal = signal;
        /* Without these plain and own agree but for noise, and what is subtracted is the noise of S in plain. */
        const double long_run = own * (mk_long_run(steps, y, m->lags) - 1.0);
        if (ratio != 1.0 || long_run != 0.0) m->signal = (by_tails != 1.0 ? own : plain) + long_run - ratio * (plain - signal);
        m->signal /= steps;
    }
    free(mean);
    free(v);
    free(S);
    free(L);
    free(y);
    return good;
}

void mk_mismatch_add(mk_mismatch_t *sum, const mk_mismatch_t *part) {
    if (sum->rows == 0) {
        *sum = *part;
        return;
    }
    sum->spread = (sum->spread * sum->degrees + part->spread * part->degrees) / (sum->degrees + part->degrees);
    sum->degrees += part->degrees;
    sum->steps = part->steps < sum->steps ? part->steps : sum->steps;
    sum->rows += part->rows;
    sum->raw += part->raw;
    sum->bias += part->bias;
    sum->variance += part->variance;
    sum->signal += part->signal;
    sum->lags = part->lags > sum->lags ? part->lags : sum->lags;
    sum->white_p = fmin(sum->white_p, part->white_p);
    sum->tails_p = fmin(sum->tails_p, part->tails_p);
    sum->kurtosis = fabs(log(part->kurtosis)) > fabs(log(sum->kurtosis)) ? part->kurtosis : sum->kurtosis;
}

void mk_mismatch_across(mk_mismatch_t *across, const mk_mismatch_t *whole, const double *S, int blocks, const int *first) {
    const int rows = whole->rows;
    const double effective = fmax(1.0 / whole->spread, rows + 2.0);
    double *copy = doubles(AT(rows, 0)), log_det = 0.0;
    int bad;
    *across = *whole;
    across->signal = 0.0;
    across->bias = null_bias(effective, rows);
    across->variance = null_variance(effective, rows);
    const double factor = whole->variance / across->variance;
    memcpy(copy, S, AT(rows, 0) * sizeof *copy);
    (void)mk_log_det(rows, copy, &log_det, &bad);
    across->raw = -log_det;
    for (int b = 0; b < blocks; b++) {
        const int begin = first[b], n = first[b + 1] - begin;
        for (int i = 0; i < n; i++)
            for (int j = 0; j <= i; j++) copy[AT(i, j)] = S[AT(begin + i, begin + j)];
        (void)mk_log_det(n, copy, &log_det, &bad);
        across->raw += n ? log_det : 0.0;
        across->bias -= null_bias(effective, n);
        across->variance -= null_variance(effective, n);
        across->degrees -= 0.5 * n * (n + 3.0);
    }
    across->variance *= factor;
    free(copy);
}

/* --- test and interval ------------------------------------------------------------------------------------------------------ */

/* Also of an approximation that reaches below 0. */
static double chi2_tail(double x, double degrees) { return x < 0.0 ? 1.0 : mk_chi2_tail(x, degrees); }

double mk_mismatch_test(const mk_mismatch_t *m, double *statistic, double *degrees) {
    *degrees = 2.0 * m->bias * m->bias / m->variance;
    *statistic = m->raw * *degrees / m->bias;
    return chi2_tail(*statistic, *degrees);
}

typedef struct {
    double estimate, variance, slope, degrees, error;
    double one_sided, two_sided; /* normal quantiles */
} law_t;

/* Probabilities, if c is the truth, of an estimate as low and as high as the one seen; how much of the error probability the high side has. */
static void tails(const law_t *law, double c, double *as_low, double *as_high, double *share) {
    const double deviation = sqrt(law->variance + law->slope * c);
    const double shift = 0.5 * law->degrees * law->slope * c / law->variance, degrees = pow(law->degrees + 2.0 * shift, 3.0) /
                         pow(law->degrees + 3.0 * shift, 2.0);
    const double z = (law->estimate - c) / deviation;
    /* Beyond, the skewness sqrt(8 / degrees) is below 0.003. */
    *as_high = degrees < 1e6 ? chi2_tail(degrees + z * sqrt(2.0 * degrees), degrees) : mk_normal_tail(z);
    *as_low = degrees < 1e6 ? 1.0 - *as_high : mk_normal_tail(-z);
    /* Feldman and Cousins for a normal estimate of s >= 0: accepted from -(s^2 + d^2) / (2 s) to d standard deviations about s. */
    const double s = c / deviation;
    double low = law->one_sided, high = law->two_sided;
    if (s >= high) low = high;
    while (s > 0.0 && high - low > 1e-12) {
        const double d = 0.5 * (low + high);
        if (mk_normal_tail(d) + mk_normal_tail((s * s + d * d) / (2.0 * s)) > law->error) low = d;
        else high = d;
    }
    *share = fmin(mk_normal_tail(low) / law->error, 1.0);
}

/* Is c in the interval, seen from its lower (side 0) or upper end. */
static int accepted(const law_t *law, double c, int side) {
    double as_low, as_high, share;
    tails(law, c, &as_low, &as_high, &share);
    return side ? as_low >= law->error * (1.0 - share) : as_high >= law->error * share;
}

static double boundary(const law_t *law, double inside, double outside, int side) {
    for (int i = 0; i < 200 && fabs(inside - outside) > 1e-12 * (fabs(inside) + fabs(outside)); i++) {
        const double middle = 0.5 * (inside + outside);
        if (accepted(law, middle, side)) inside = middle;
        else outside = middle;
    }
    return inside;
}

void mk_mismatch_interval(const mk_mismatch_t *m, double level, double *low, double *high) {
    const double estimate = m->raw - m->bias, noise = sqrt(m->variance), limit = 4.0 * m->spread;
    const law_t law = {estimate, m->variance, (fmax(m->signal, 0.0) + noise * limit) / (fmax(estimate, 0.0) + noise),
                       2.0 * m->bias * m->bias / m->variance, 1.0 - level, -mk_normal_quantile(1.0 - level),
                       -mk_normal_quantile(0.5 * (1.0 - level))};
    const double start = fmax(estimate, 0.0);
    double statistic, degrees, step = noise;
    /* At 0 the test itself decides, so that the two never disagree by rounding. */
    *low = mk_mismatch_test(m, &statistic, &degrees) >= 1.0 - level ? 0.0 : boundary(&law, start, 0.0, 0);
    while (accepted(&law, start + step, 1)) step *= 2.0;
    *high = boundary(&law, start, start + step, 1);
}
