/* SPDX-License-Identifier: MIT */
#include "distributions.h"

#include <math.h>

#define HALF_LOG_2PI 0.918938533204672741780329736406
#define LOG_PI 1.14472988584940017414342735135

/* --- Gamma function -------------------------------------------------------------------------------------------------------- */

/* log Gamma(a) - ((a - 1/2) log a - a + log(2 pi) / 2), for a >= 10: Stirling's series, error of the first term left out. */
static double stirling(double a) {
    const double r = 1.0 / a, z = r * r;
    return r * (1.0 / 12 - z * (1.0 / 360 - z * (1.0 / 1260 - z * (1.0 / 1680 - z * (1.0 / 1188 - z * (691.0 / 360360 - z / 156))))));
}

/* u - log(1 + u), u = (y - a) / a, without cancellation. With s = u / (2 + u): log(1 + u) = 2 atanh(s) and u - 2 s = s u. */
static double log_gap(double y, double a) {
    const double u = (y - a) / a, s = u / (2.0 + u), z = s * s;
    if (fabs(u) > 0.5) return u - log(y / a);
    double power = z, sum = 0.0;
    for (int k = 3; power > 1e-18 * z; k += 2, power *= z) sum += power / k;
    return s * (u - 2.0 * sum);
}

/* log of y^a exp(-y) / Gamma(a + 1). Large a: by the distance of y from a, for the terms are much larger than their sum. */
static double log_gamma_term(double y, double a) {
    if (a < 10.0) return a * log(y) - y - lgamma(a + 1.0);
    return -a * log_gap(y, a) - 0.5 * log(a) - HALF_LOG_2PI - stirling(a);
}

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

/* --- roots ----------------------------------------------------------------------------------------------------------------- */

/* log of a probability at x = exp(u), and its derivative by u. */
typedef double (*log_probability_t)(double x, double degrees, double *slope);

/* x > 0 with probability(x) = exp(target), rising or falling; Newton on the logarithms, kept between bounds. 0 or infinity where x is not a
   number of this range. */
static double solve(log_probability_t probability, double degrees, double target, int rising, double start) {
    double low = -745.0, high = 709.7, u = start > 0.0 ? log(start) : 0.0;
    for (int i = 0; i < 300; i++) {
        double slope;
        if (!(u > low && u < high)) u = 0.5 * (low + high);
        const double gap = probability(exp(u), degrees, &slope) - target;
        if ((gap > 0.0) == (rising != 0)) high = u;
        else low = u;
        const double step = gap / slope;
        if (fabs(step) < 1e-15 * (1.0 + fabs(u)) || high - low < 1e-15 * (1.0 + fabs(u))) break;
        /* NaN where the probability underflows: the middle is next. */
        u -= step;
    }
    return exp(u);
}

static int is_probability(double p) { return p >= 0.0 && p <= 1.0; }

/* --- normal ---------------------------------------------------------------------------------------------------------------- */

double mk_normal_tail(double x) { return 0.5 * erfc(x * sqrt(0.5)); }

static double log_normal_tail(double x, double unused, double *slope) {
    (void)unused;
    const double tail = mk_normal_tail(x);
    *slope = -x * exp(-0.5 * x * x - HALF_LOG_2PI) / tail;
    return log(tail);
}

static double log_normal_centre(double x, double unused, double *slope) {
    (void)unused;
    const double centre = erf(x * sqrt(0.5));
    *slope = 2.0 * x * exp(-0.5 * x * x - HALF_LOG_2PI) / centre;
    return log(centre);
}

/* The quantile of a law symmetric about 0, by its tail or, near the middle, by P(|X| < x), whichever is well conditioned. */
static double symmetric_quantile(double p, double degrees, log_probability_t tail, log_probability_t centre, double start) {
    if (!is_probability(p)) return (double)NAN;
    const double q = p < 0.5 ? p : 1.0 - p, sign = p < 0.5 ? -1.0 : 1.0;
    if (q <= 0.0) return sign * (double)INFINITY;
    if (q >= 0.5) return 0.0;
    return sign * (q < 0.25 ? solve(tail, degrees, log(q), 0, start) : solve(centre, degrees, log1p(-2.0 * q), 1, start));
}

double mk_normal_quantile(double p) {
    const double start = sqrt(-2.0 * log(p < 0.5 ? p : 1.0 - p)) - 0.7;
    return symmetric_quantile(p, 0.0, log_normal_tail, log_normal_centre, start);
}

/* --- chi-square ------------------------------------------------------------------------------------------------------------ */

/* The incomplete Gamma function of a at y: the smaller part of the two, and which it is. */
static double gamma_part(double y, double a, int *is_tail) {
    const double term = exp(log_gamma_term(y, a));
    *is_tail = y >= a + 1.0;
    if (!*is_tail) {
        /* sum over k of y^k / ((a + 1) .. (a + k)) */
        double sum = 1.0, next = 1.0;
        for (double k = 1.0; next > 1e-17 * sum; k += 1.0) sum += next *= y / (a + k);
        return term * sum;
    }
    /* DLMF 8.9.2 by the modified method of Lentz. */
    double b = y + 1.0 - a, c = 1e300, d = 1.0 / b, fraction = d;
    for (double k = 1.0; k < 1e7; k += 1.0) {
        const double numerator = -k * (k - a);
        b += 2.0;
        d = 1.0 / (numerator * d + b);
        c = b + numerator / c;
        fraction *= c * d;
        if (fabs(c * d - 1.0) < 4e-16) break;
    }
    return term * a * fraction;
}

static double chi_square(double x, double degrees, int tail) {
    if (!(degrees > 0.0) || isinf(degrees) || isnan(x)) return (double)NAN;
    if (x <= 0.0) return tail ? 1.0 : 0.0;
    if (isinf(x)) return tail ? 0.0 : 1.0;
    int is_tail;
    const double part = gamma_part(0.5 * x, 0.5 * degrees, &is_tail);
    return is_tail == tail ? part : 1.0 - part;
}

double mk_chi_square_cdf(double x, double degrees) { return chi_square(x, degrees, 0); }
double mk_chi_square_tail(double x, double degrees) { return chi_square(x, degrees, 1); }

static double log_chi_square(double x, double degrees, double *slope, int tail) {
    const double value = chi_square(x, degrees, tail), a = 0.5 * degrees;
    *slope = (tail ? -a : a) * exp(log_gamma_term(0.5 * x, a)) / value;
    return log(value);
}
static double log_chi_square_cdf(double x, double degrees, double *slope) { return log_chi_square(x, degrees, slope, 0); }
static double log_chi_square_tail(double x, double degrees, double *slope) { return log_chi_square(x, degrees, slope, 1); }

static double chi_square_quantile(double p, double degrees, int tail) {
    if (!(degrees > 0.0) || isinf(degrees) || !is_probability(p)) return (double)NAN;
    if (p <= 0.0 || p >= 1.0) return (p <= 0.0) == (tail != 0) ? (double)INFINITY : 0.0;
    /* Wilson and Hilferty's cube; where it is not above 0, the first term of the series. */
    const double spread = 2.0 / (9.0 * degrees), root = 1.0 - spread + (tail ? -1.0 : 1.0) * mk_normal_quantile(p) * sqrt(spread);
    double start = degrees * root * root * root;
    if (!(root > 0.1)) start = 2.0 * exp((log(tail ? 1.0 - p : p) + lgamma(0.5 * degrees + 1.0)) / (0.5 * degrees));
    /* By the smaller of the two probabilities, which has the digits. */
    if (p > 0.5) return solve(tail ? log_chi_square_cdf : log_chi_square_tail, degrees, log1p(-p), tail, start);
    return solve(tail ? log_chi_square_tail : log_chi_square_cdf, degrees, log(p), !tail, start);
}

double mk_chi_square_quantile(double p, double degrees) { return chi_square_quantile(p, degrees, 0); }
double mk_chi_square_tail_quantile(double q, double degrees) { return chi_square_quantile(q, degrees, 1); }

/* --- Student --------------------------------------------------------------------------------------------------------------- */

/* log of x^a (1 - x)^b / (a B(a, b)) with a = degrees / 2, b = 1/2 or the other way round; y = 1 - x. */
static double log_beta_half(double degrees) {
    const double a = 0.5 * degrees;
    if (a < 10.0) return lgamma(a) + 0.5 * LOG_PI - lgamma(a + 0.5);
    return 0.5 * LOG_PI - 0.5 * log(a) + 0.5 - a * log1p(0.5 / a) - stirling(a + 0.5) + stirling(a);
}

/* Continued fraction of I_x(a, b), DLMF 8.17.22, for x < (a + 1) / (a + b + 2), by the modified method of Lentz. */
static double beta_fraction(double x, double a, double b) {
    double c = 1.0, d = 0.0, fraction = 1.0;
    for (double k = 1.0; k < 1e6; k += 1.0) {
        const double m = floor(0.5 * k), odd = k - 2.0 * m;
        const double step = odd > 0.0 ? -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
                                      : m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / (1.0 + step * d);
        c = 1.0 + step / c;
        fraction *= c * d;
        if (odd == 0.0 && fabs(c * d - 1.0) < 4e-16) break;
    }
    return 1.0 / fraction;
}

/* P(T > t) or P(|T| < t), t > 0. */
static double student(double t, double degrees, int centre) {
    /* Beyond this the expansion about the normal law (Wallace 1959) is exact to rounding, and the fraction slow. */
    if (degrees > 1e6) {
        const double s = t * t, z = t * (1.0 - ((s + 1.0) / 4.0 - ((13.0 * s + 8.0) * s + 3.0) / (96.0 * degrees)) / degrees);
        if (s < 1e-3 * degrees) return centre ? erf(z * sqrt(0.5)) : mk_normal_tail(z);
    }
    /* s = t^2 / degrees overflows before t does: x = 1 / (1 + s) and y = 1 - x by their logarithms. */
    const double a = 0.5 * degrees, log_s = 2.0 * log(t) - log(degrees), log_x = log_s > 30.0 ? -log_s : -log1p(exp(log_s));
    const double log_y = log_s + log_x, log_power = a * log_x + 0.5 * log_y - log_beta_half(degrees);
    const int by_tail = exp(log_x) < (a + 1.0) / (a + 2.5);
    if (by_tail) {
        const double tail = 0.5 * exp(log_power) / a * beta_fraction(exp(log_x), a, 0.5);
        return centre ? 1.0 - 2.0 * tail : tail;
    }
    const double middle = exp(log_power) / 0.5 * beta_fraction(exp(log_y), 0.5, a);
    return centre ? middle : 0.5 - 0.5 * middle;
}

static double log_student(double t, double degrees, double *slope, int centre) {
    const double value = student(t, degrees, centre), log_s = 2.0 * log(t) - log(degrees);
    const double log_t_density = -0.5 * (degrees + 1.0) * (log_s > 30.0 ? log_s : log1p(exp(log_s))) + 0.5 * log_s - log_beta_half(degrees);
    *slope = (centre ? 2.0 : -1.0) * exp(log_t_density) / value;
    return log(value);
}
static double log_student_tail(double t, double degrees, double *slope) { return log_student(t, degrees, slope, 0); }
static double log_student_centre(double t, double degrees, double *slope) { return log_student(t, degrees, slope, 1); }

double mk_student_tail(double t, double degrees) {
    if (!(degrees > 0.0) || isnan(t)) return (double)NAN;
    if (isinf(degrees)) return mk_normal_tail(t);
    if (t < 0.0) return 1.0 - mk_student_tail(-t, degrees);
    return t > 0.0 ? isinf(t) ? 0.0 : student(t, degrees, 0) : 0.5;
}

double mk_student_quantile(double p, double degrees) {
    if (!(degrees > 0.0) || isnan(p)) return (double)NAN;
    const double normal = mk_normal_quantile(p);
    if (isinf(degrees)) return normal;
    return symmetric_quantile(p, degrees, log_student_tail, log_student_centre, fabs(normal));
}
