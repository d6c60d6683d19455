/* SPDX-License-Identifier: MIT */
#include "distributions.h"

#include <math.h>

#define HALF_LOG_2PI 0.918938533204672741780329736406

/* --- derivatives of log Gamma ---------------------------------------------------------------------------------------------- */

double mk_digamma(double x) {
    if (!(x > 0.0)) return (double)NAN;
    double sum = 0.0;
    while (x < 10.0) {
        sum -= 1.0 / x;
        x += 1.0;
    }
    const double z = 1.0 / (x * x);
    return sum + log(x) - 0.5 / x -
           z * (1.0 / 12 - z * (1.0 / 120 - z * (1.0 / 252 - z * (1.0 / 240 - z * (1.0 / 132 - z * (691.0 / 32760 - z / 12))))));
}

double mk_trigamma(double x) {
    if (!(x > 0.0)) return (double)NAN;
    double sum = 0.0;
    while (x < 10.0) {
        sum += 1.0 / (x * x);
        x += 1.0;
    }
    const double z = 1.0 / (x * x);
    return sum + (1.0 + 0.5 / x + z * (1.0 / 6 - z * (1.0 / 30 - z * (1.0 / 42 - z * (1.0 / 30 - z * (5.0 / 66 - z * 691.0 / 2730)))))) / x;
}

/* --- normal ---------------------------------------------------------------------------------------------------------------- */

double mk_normal_tail(double x) { return 0.5 * erfc(x * sqrt(0.5)); }

/* log of P(X > x) or of P(|X| < x), x > 0, and its derivative by log x. */
static double log_normal(double x, int centre, double *slope) {
    const double value = centre ? erf(x * sqrt(0.5)) : mk_normal_tail(x);
    *slope = (centre ? 2.0 : -1.0) * x * exp(-0.5 * x * x - HALF_LOG_2PI) / value;
    return log(value);
}

double mk_normal_quantile(double p) {
    if (!(p >= 0.0 && p <= 1.0)) return (double)NAN;
    const double q = p < 0.5 ? p : 1.0 - p, sign = p < 0.5 ? -1.0 : 1.0;
    if (q <= 0.0) return sign * (double)INFINITY;
    if (q >= 0.5) return 0.0;
    /* By the tail or, near the middle, by P(|X| < x), whichever is well conditioned: Newton on the logarithms, kept between bounds. */
    const int centre = q >= 0.25;
    const double target = centre ? log1p(-2.0 * q) : log(q), start = sqrt(-2.0 * log(q)) - 0.7;
    double low = -745.0, high = 709.7, u = start > 0.0 ? log(start) : 0.0;
    for (int i = 0; i < 300; i++) {
        double slope;
        if (!(u > low && u < high)) u = 0.5 * (low + high);
        const double gap = log_normal(exp(u), centre, &slope) - target;
        if ((gap > 0.0) == centre) high = u;
        else low = u;
        const double step = gap / slope;
        if (fabs(step) < 1e-15 * (1.0 + fabs(u)) || high - low < 1e-15 * (1.0 + fabs(u))) break;
        /* NaN where the probability underflows: the middle is next. */
        u -= step;
    }
    return sign * exp(u);
}

/* --- shares ---------------------------------------------------------------------------------------------------------------- */

/* I_x(a, b) by its continued fraction (Lentz), 0 < x < 1, where that converges fast. */
static double beta_fraction(double a, double b, double x) {
    double c = 1.0, d = 1.0 - (a + b) * x / (a + 1.0), value;
    d = 1.0 / (fabs(d) < 1e-300 ? 1e-300 : d);
    value = d;
    for (int m = 1; m < 100000; m++) {
        const double even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2.0 * m)), odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2 * m + 1.0));
        for (int half = 0; half < 2; half++) {
            const double term = half ? odd : even;
            d = 1.0 + term * d;
            c = 1.0 + term / c;
            d = 1.0 / (fabs(d) < 1e-300 ? 1e-300 : d);
            if (fabs(c) < 1e-300) c = 1e-300;
            value *= c * d;
        }
        if (fabs(c * d - 1.0) < 1e-15) break;
    }
    return exp(a * log(x) + b * log1p(-x) + lgamma(a + b) - lgamma(a) - lgamma(b)) / a * value;
}

/* P(X <= x) of a beta variable. */
static double beta_probability(double a, double b, double x) {
    return x < (a + 1.0) / (a + b + 2.0) ? beta_fraction(a, b, x) : 1.0 - beta_fraction(b, a, 1.0 - x);
}

static double beta_quantile(double a, double b, double p) {
    double low = log(1e-300), high = 0.0;
    for (int i = 0; i < 200 && high - low > 1e-15; i++) {
        const double u = 0.5 * (low + high);
        if (beta_probability(a, b, exp(u)) < p) low = u;
        else high = u;
    }
    return exp(0.5 * (low + high));
}

void mk_share_interval(double hits, double trials, double tail, double *low, double *high) {
    *low = *high = (double)NAN;
    if (!(hits >= 0.0 && hits <= trials && trials >= 1.0 && tail > 0.0 && tail < 0.5)) return;
    *low = hits > 0.0 ? beta_quantile(hits, trials - hits + 1.0, tail) : 0.0;
    /* By its complement, whose small tail keeps its digits. */
    *high = hits < trials ? 1.0 - beta_quantile(trials - hits, hits + 1.0, tail) : 1.0;
}
