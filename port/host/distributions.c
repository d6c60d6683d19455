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
