/* SPDX-License-Identifier: MIT */
/*
 * Quantiles of meshkal/quantile.h. Part of the shared build.
 *
 * Both laws are treated as one of a positive variable X: chi-square, or |T| of Student's T. A point of a law is the density of log X
 * and the ratio to it of one of the two parts P(X > x), P(X < x): ratios stay moderate where both numbers underflow. Continued fractions
 * are used at least 2.4 standard deviations from the middle, where they need as many terms for a million degrees as for a hundred.
 */
#ifndef MESHKAL_STATISTICS_QUANTILE_H
#define MESHKAL_STATISTICS_QUANTILE_H

#include <meshkal/kernels.h>
#include <meshkal/quantile.h>

/* Terms of the series (they end themselves) and of the fractions, which rounding error then hides. */
#define MK_SERIES_LIMIT 160
#define MK_FRACTION_TERMS 60
/* Evaluations of a root search: 3 or 4, or bisection where the start was bad. */
#define MK_QUANTILE_LIMIT 64
/* From here on half the degrees are many: the middle of the chi-square law by its series about its mean. */
#define MK_CHI2_MANY 60.0

#define MK_LOG_2PI 1.8378770664093454836
#define MK_LOG_PI 1.1447298858494001741

typedef struct {
    int student;
    double degrees, a; /* a = degrees / 2 */
    double log_scale;  /* what the logarithm of the density has that depends on the degrees only */
} mk_law_t;

typedef struct {
    double log_density, slope; /* of log X; d log density / d log x */
    double ratio;              /* part / density */
    int upper;                 /* which part */
} mk_law_point_t;

static double mk_log_1p(double t) { return t <= 0.5 ? t - mk_log_gap_f64(t) : mk_log_f64(1.0 + t); }

/* log Gamma(a) - ((a - 1/2) log a - a + log(2 pi) / 2), a > 0. DLMF 5.11.1 from 10 on, where the first term left out is below 1e-15. */
static double mk_stirling(double a) {
    double sum = 0.0;
    for (int i = 0; i < 10 && a < 10.0; i++, a += 1.0) sum += (a + 0.5) * mk_log_1p(1.0 / a) - 1.0;
    const double r = 1.0 / a, z = r * r;
    return sum + r * (1.0 / 12 - z * (1.0 / 360 - z * (1.0 / 1260 - z * (1.0 / 1680 - z * (1.0 / 1188 - z * (691.0 / 360360))))));
}

static mk_law_t mk_law(int student, double degrees) {
    const double a = 0.5 * degrees;
    mk_law_t law = {student, degrees, a, 0.0};
    /* Student: log of 2 Gamma(a + 1/2) / (Gamma(a) sqrt(pi)). */
    if (student) law.log_scale = 0.5 * (mk_log_f64(4.0 * a) - MK_LOG_PI) - a * mk_log_gap_f64(0.5 / a) + mk_stirling(a + 0.5);
    else law.log_scale = 0.5 * (mk_log_f64(a) - MK_LOG_2PI);
    law.log_scale -= mk_stirling(a);
    return law;
}

/* --- chi-square ------------------------------------------------------------------------------------------------------------- */

/* Gamma(a, y) / (y^a exp(-y)), y well above a: DLMF 8.9.2, contracted. Backwards: all terms are positive, one division each. */
static double mk_gamma_above(double a, double y) {
    double v = y - a + (2 * MK_FRACTION_TERMS + 1);
    for (int k = MK_FRACTION_TERMS; k > 0; k--) v = y - a + (2 * k - 1) - k * (k - a) / v;
    return 1.0 / v;
}

/* gamma(a, y) / (y^a exp(-y)), y well below a: 1 / (a - y + y / (a + 1 - y + 2 y / (a + 2 - y + ...))). */
static double mk_gamma_below(double a, double y) {
    double v = a - y + MK_FRACTION_TERMS;
    for (int k = MK_FRACTION_TERMS; k > 0; k--) v = a - y + (k - 1) + k * y / v;
    return 1.0 / v;
}

/* The same, a and y small or moderate: the sum over k of y^k / (a .. (a + k)). */
static double mk_gamma_series(double a, double y) {
    double term = 1.0 / a, sum = term;
    for (int k = 1; k < MK_SERIES_LIMIT && term > 1e-17 * sum; k++) sum += term *= y / (a + k);
    return sum;
}

/* The integral from a to y of u^(a - 1) exp(-u) over y^a exp(-y), y near a, a large. As a function H of s = (y - a) / a it solves
   (1 + s) H' = 1 + a s H, so the terms of its power series are t[k+1] = s (a s t[k-1] - k t[k]) / (k + 1). */
static double mk_gamma_middle(double a, double s) {
    double before = 0.0, term = s, sum = s;
    for (int k = 1; k < MK_SERIES_LIMIT / 2; k++) {
        const double next = s * (a * s * before - k * term) / (k + 1);
        before = term;
        term = next;
        sum += term;
    }
    return sum;
}

static mk_law_point_t mk_chi2_point(const mk_law_t *law, double x) {
    const double a = law->a, y = 0.5 * x, s = (y - a) / a, width = 1.5 + 2.5 * mk_sqrt_f64(a);
    /* a - y + a log(y / a) without cancellation: mk_log_gap is as good down to -1/3. */
    const double distance = s < -1.0 / 3 ? s - mk_log_f64(y / a) : mk_log_gap_f64(s);
    mk_law_point_t point = {law->log_scale - a * distance, a - y, 0.0, 0};
    if (y > a + width) {
        point.upper = 1;
        point.ratio = mk_gamma_above(a, y);
    } else if (a < MK_CHI2_MANY) {
        point.ratio = mk_gamma_series(a, y);
    } else if (y < a - width) {
        point.ratio = mk_gamma_below(a, y);
    } else {
        /* P(X < degrees) - 1/2 is this series over sqrt(2 pi a): DLMF 8.12.15. */
        const double r = 1.0 / a;
        const double late = 25.0 / 6048 + r * (101.0 / 155520 - r * (3184811.0 / 3695155200.0 + r * (2745493.0 / 8151736320.0)));
        const double series = 1.0 / 3 + r * (1.0 / 540 - r * late);
        const double to_degrees = 0.5 + series * mk_exp_f64(-0.5 * (mk_log_f64(a) + MK_LOG_2PI));
        point.ratio = to_degrees * mk_exp_f64(-point.log_density) + mk_gamma_middle(a, s);
    }
    return point;
}

/* --- Student ---------------------------------------------------------------------------------------------------------------- */

/* I_x(a, 1/2) B(a, 1/2) / (x^a y^(1/2)), y = 1 - x: the even part of DLMF 8.17.22, backwards. Its a - (a + 1/2) x is a y - x / 2. */
static double mk_student_above(double a, double x, double y) {
    double u = DBL_MAX; /* the end of the fraction */
    for (int n = MK_FRACTION_TERMS; n >= 0; n--) {
        const double r = 1.0 / (a + (2 * n + 1)), c = (n + 1) * (-0.5 - n) * x * r;
        u = n + (a + n) * r * (a * y - 0.5 * x + 1.0 + n * (2.0 - x) + (a + n + 0.5) * x * (c / (c + u)));
    }
    return 1.0 / u;
}

static mk_law_point_t mk_student_point(const mk_law_t *law, double t) {
    const double a = law->a, q = t / mk_sqrt_f64(law->degrees);
    /* q^2 may overflow, the smaller of q^2 and 1 / q^2 does not. */
    const double small = q > 1.0 ? 1.0 / q : q, z = small * small, large = 1.0 / (1.0 + z);
    const double x = q > 1.0 ? z * large : large, y = q > 1.0 ? large : z * large, log_q = mk_log_f64(q);
    const double log_sum = mk_log_1p(z) + (q > 1.0 ? 2.0 * log_q : 0.0); /* log(1 + q^2) */
    mk_law_point_t point = {law->log_scale + log_q - (a + 0.5) * log_sum, 1.0 - (law->degrees + 1.0) * y, 0.0, 0};
    point.upper = q > 1.0 || t * t > 6.0;
    if (point.upper) {
        point.ratio = 0.5 * mk_student_above(a, x, y);
    } else {
        /* DLMF 8.17.8 for I_y(1/2, a) */
        double term = 1.0;
        point.ratio = 1.0;
        for (int k = 0; k < MK_SERIES_LIMIT && term > 1e-17 * point.ratio; k++)
            point.ratio += term *= y * (a + 0.5 + k) / (1.5 + k);
    }
    return point;
}

/* --- both ------------------------------------------------------------------------------------------------------------------- */

static mk_law_point_t mk_law_point(const mk_law_t *law, double x) { return law->student ? mk_student_point(law, x) : mk_chi2_point(law, x); }

/* P(X > x), 0 < x < infinity */
static double mk_law_tail(const mk_law_t *law, double x) {
    const mk_law_point_t point = mk_law_point(law, x);
    const double part = mk_exp_f64(point.log_density) * point.ratio;
    return point.upper ? part : part < 1.0 ? 1.0 - part : 0.0;
}

/* A first guess, within about 0.003, of the normal quantile of a tail of at most 1/2. Abramowitz and Stegun 26.2.22. */
static double mk_normal_guess(double tail) {
    const double w = mk_sqrt_f64(-2.0 * mk_log_f64(tail));
    return w - (2.30753 + 0.27061 * w) / (1.0 + (0.99229 + 0.04481 * w) * w);
}

/* x with P(X > x) = upper and P(X < x) = lower, by the smaller one, which has the digits. Halley's method for its logarithm as a function
   of log x, kept between bounds. 0 or infinity where x is not a number of this range. */
static double mk_law_quantile(const mk_law_t *law, double upper, double lower, double x) {
    const int by_upper = upper < lower;
    const double target = mk_log_f64(by_upper ? upper : lower);
    double low = DBL_MIN, high = DBL_MAX, step = 0.0;
    if (!(x > low && x < high)) x = 1.0;
    for (int i = 0; i < MK_QUANTILE_LIMIT; i++) {
        const mk_law_point_t point = mk_law_point(law, x);
        double ratio = point.ratio, gap;
        if (point.upper == by_upper) {
            gap = point.log_density + mk_log_f64(ratio) - target;
        } else {
            const double density = mk_exp_f64(point.log_density), part = 1.0 - density * ratio;
            /* Far on the other side nothing is left of this part: the middle of the bounds is next. */
            gap = part > 0.0 ? mk_log_f64(part) - target : -1.0;
            ratio = part > 0.0 ? part / density : 0.0;
        }
        /* Derivatives of log part by log x: 1 / signed_ratio, and that times slope - 1 / signed_ratio. */
        const double signed_ratio = by_upper ? -ratio : ratio;
        const double newton = -gap * signed_ratio, bend = 1.0 + 0.5 * (newton * point.slope + gap);
        step = bend > 0.25 ? newton / bend : newton;
        /* What is left after this step is of the third order. Not x exp(step): libgcc 12 for Cortex-M4F and M33 rounds 1 - t wrongly for t
           between 2^-33 and 2^-32 (the bit below the last is lost), and last steps are often as small. */
        if (gap < 1e-6 && gap > -1e-6 && step < 1e-5 && step > -1e-5) return x + x * (step + 0.5 * step * step);
        if ((gap > 0.0) == by_upper) low = x;
        else high = x;
        const double next = x * mk_exp_f64(step);
        x = next > low && next < high ? next : mk_sqrt_f64(low) * mk_sqrt_f64(high);
    }
    return x * mk_exp_f64(step);
}

static int mk_is_degrees(double degrees) { return degrees > 0.0 && degrees <= DBL_MAX; }
static int mk_is_probability(double tail) { return tail > 0.0 && tail < 1.0; }

double mk_chi2_tail(double x, double degrees) {
    if (!(x >= 0.0) || !mk_is_degrees(degrees)) return (double)NAN;
    if (x <= 0.0 || x > DBL_MAX) return x <= 0.0 ? 1.0 : 0.0;
    const mk_law_t law = mk_law(0, degrees);
    return mk_law_tail(&law, x);
}

double mk_student_tail(double x, double degrees) {
    if (!(x >= 0.0 || x < 0.0) || !mk_is_degrees(degrees)) return (double)NAN;
    const double t = x < 0.0 ? -x : x;
    double tail = 0.5;
    if (t > DBL_MAX) {
        tail = 0.0;
    } else if (t > 0.0) {
        const mk_law_t law = mk_law(1, degrees);
        tail = 0.5 * mk_law_tail(&law, t);
    }
    return x < 0.0 ? 1.0 - tail : tail;
}

double mk_chi2_quantile(double tail, double degrees) {
    if (!mk_is_probability(tail) || !mk_is_degrees(degrees)) return (double)NAN;
    const mk_law_t law = mk_law(0, degrees);
    /* Exact where it is the smaller one. */
    const double lower = 1.0 - tail, spread = 2.0 / (9.0 * degrees), root = mk_sqrt_f64(spread);
    /* Wilson and Hilferty's cube; near 0 the first term of the series. */
    const double cube = 1.0 - spread + root * (tail < lower ? mk_normal_guess(tail) : -mk_normal_guess(lower)), log_a = mk_log_f64(law.a);
    const double start = cube > 0.3 ? degrees * cube * cube * cube
                                    : 2.0 * mk_exp_f64(log_a - 1.0 + (log_a - law.log_scale + mk_log_f64(lower)) / law.a);
    return mk_law_quantile(&law, tail, lower, start);
}

double mk_student_quantile(double tail, double degrees) {
    if (!mk_is_probability(tail) || !mk_is_degrees(degrees)) return (double)NAN;
    const double smaller = tail < 0.5 ? tail : 1.0 - tail;
    if (smaller >= 0.5) return 0.0;
    const mk_law_t law = mk_law(1, degrees);
    /* Wallace's normal deviate of t, turned round; h = log(1 + t^2 / degrees). */
    const double z = mk_normal_guess(smaller), scale = z * (8.0 * degrees + 3.0) / (8.0 * degrees + 1.0), h = scale * scale / degrees;
    const double start = h < 1e-3 ? scale : mk_sqrt_f64(degrees * (mk_exp_f64(h) - 1.0));
    const double t = mk_law_quantile(&law, 2.0 * smaller, 1.0 - 2.0 * smaller, start);
    return tail < 0.5 ? t : -t;
}

#undef MK_SERIES_LIMIT
#undef MK_FRACTION_TERMS
#undef MK_QUANTILE_LIMIT
#undef MK_CHI2_MANY
#undef MK_LOG_2PI
#undef MK_LOG_PI

#endif
