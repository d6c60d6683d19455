/* SPDX-License-Identifier: MIT */
/* Tails and quantiles of meshkal/quantile.h: closed forms, round trips, order, arguments outside the domain; and the exponential they use.
   Their digits elsewhere are compared in tests/host/test_quantile.py. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include <meshkal/kernels.h>
#include <meshkal/quantile.h>

#include "generator.h"

/* NAN and INFINITY are floats. */
#define NOT_A_NUMBER ((double)NAN)
#define INFINITE ((double)INFINITY)
#define PI 3.14159265358979323846

typedef double (*law_t)(double value, double degrees);
static const law_t tails[2] = {mk_chi2_tail, mk_student_tail}, quantiles[2] = {mk_chi2_quantile, mk_student_quantile};

static void assert_close(double got, double wanted, double bound) {
    if (!(fabs(got - wanted) <= bound * fabs(wanted))) fail_msg("%.17g, wanted %.17g", got, wanted);
}

/* Tails from 1e-300 to 1/2, and as near to 1 as 1e-15. */
static double draw_tail(generator_t *g) {
    const double small = draw_uniform(g, 0.0, 1.0) < 0.5 ? draw_log_uniform(g, 1e-15, 0.5) : draw_log_uniform(g, 1e-300, 0.5);
    return draw_uniform(g, 0.0, 1.0) < 0.3 ? 1.0 - fmax(small, 1e-15) : small;
}

static void test_closed_forms(void **unused) {
    (void)unused;
    generator_t g = {20251122};
    for (int i = 0; i < 4000; i++) {
        const double p = draw_tail(&g), x = draw_log_uniform(&g, 1e-12, 1200.0);
        const double log_p = p > 0.5 ? log1p(-(1.0 - p)) : log(p), t = draw_log_uniform(&g, 1e-8, 1e100);
        assert_close(mk_chi2_quantile(p, 2.0), -2.0 * log_p, 1e-13);
        assert_close(mk_chi2_tail(x, 1.0), erfc(sqrt(0.5 * x)), 1e-12);
        assert_close(mk_chi2_tail(x, 2.0), exp(-0.5 * x), 1e-12);
        assert_close(mk_chi2_tail(x, 4.0), exp(-0.5 * x) * (1.0 + 0.5 * x), 1e-12);
        assert_close(mk_chi2_tail(x, 6.0), exp(-0.5 * x) * (1.0 + 0.5 * x * (1.0 + 0.25 * x)), 1e-12);
        assert_close(mk_student_tail(t, 1.0), atan2(1.0, t) / PI, 1e-12);
        assert_close(mk_student_tail(t, 2.0), 1.0 / (2.0 + t * t + t * sqrt(2.0 + t * t)), 1e-12);
        const double q = fmin(p, 1.0 - p), sign = p < 0.5 ? 1.0 : -1.0;
        assert_close(mk_student_quantile(p, 1.0), sign / tan(PI * q), 1e-12);
        assert_close(mk_student_quantile(p, 2.0), sign * (1.0 - 2.0 * q) / sqrt(2.0 * q * (1.0 - q)), 1e-12);
        /* Four degrees (Shaw 2006). */
        if (q > 1e-100 && q < 0.45) {
            const double alpha = 4.0 * q * (1.0 - q), root = cos(acos(sqrt(alpha)) / 3.0) / sqrt(alpha);
            assert_close(mk_student_quantile(p, 4.0), sign * 2.0 * sqrt(root - 1.0), 1e-11);
        }
    }
    /* Many degrees: the normal law. */
    for (double t = 0.1; t < 35.0; t += 0.1) assert_close(mk_student_tail(t, 1e15), 0.5 * erfc(t * sqrt(0.5)), 1e-9);
}

static void test_round_trip(void **unused) {
    (void)unused;
    generator_t g = {4};
    double worst = 0.0;
    for (int i = 0; i < 20000; i++) {
        const double p = draw_tail(&g), degrees = draw_log_uniform(&g, 0.5, 1e6);
        for (int law = 0; law < 2; law++) {
            const double x = quantiles[law](p, degrees), again = tails[law](x, degrees);
            if (isinf(x)) {
                assert_true(law == 1 && degrees < 1.0 && p < 1e-150);
                continue;
            }
            /* The logarithms have rounding errors of their size; one of x is worth x f(x) / P(X > x), about sqrt(degrees |log P|). */
            const double error = fabs(again - p) / p, bound = 1e-15 * (300.0 - 3.0 * log(p) + 0.5 * sqrt(-degrees * log(p)));
            worst = fmax(worst, error / bound);
            if (!(error < bound)) fail_msg("law %d, degrees %.17g, tail %.17g: %.17g", law, degrees, p, again);
        }
    }
    print_message("- largest share of the bound that a round trip took: %.2f\n", worst);
}

/* Within a method rounding moves neighbours; from one to the next the step is as small. */
static void test_order(void **unused) {
    (void)unused;
    static const double degrees[] = {0.5, 1.0, 3.0, 6.0, 119.9, 120.0, 1000.0, 1e6};
    for (int d = 0; d < (int)(sizeof degrees / sizeof degrees[0]); d++) {
        for (int law = 0; law < 2; law++) {
            const double k = degrees[d], middle = law ? sqrt(fmin(6.0, k)) : k, scale = law ? 1e-5 * middle : 5e-4 * sqrt(2.0 * k);
            double last = 2.0;
            for (int i = -12000; i <= 12000; i++) {
                const double x = middle + scale * i;
                if (x < 0.0) continue;
                const double tail = tails[law](x, k);
                assert_true(tail >= 0.0 && tail <= 1.0 && tail <= last);
                last = tail;
            }
            last = INFINITE;
            for (double p = 1e-300; p < 0.999; p *= p < 1e-12 ? 7.0 : 1.003) {
                const double x = quantiles[law](p, k);
                assert_true(x <= last);
                last = x;
            }
            for (double q = 1e-3; q > 1e-16; q *= 0.99) {
                const double x = quantiles[law](1.0 - q, k);
                assert_true(x <= last);
                last = x;
            }
        }
    }
    /* More degrees: a larger chi-square, a smaller t. */
    for (double p = 1e-12; p < 0.5; p *= 1.7) {
        for (double k = 0.5; k < 1e6; k *= 1.01) {
            assert_true(mk_chi2_quantile(p, 1.01 * k) > mk_chi2_quantile(p, k));
            if (p < 0.49) assert_true(mk_student_quantile(p, 1.01 * k) < mk_student_quantile(p, k));
        }
    }
}

static void test_arguments(void **unused) {
    (void)unused;
    static const double bad_degrees[] = {0.0, -0.0, -1.0, NOT_A_NUMBER, INFINITE, -INFINITE};
    static const double bad_tails[] = {0.0, -0.0, 1.0, -0.1, 1.1, NOT_A_NUMBER, INFINITE, -INFINITE};
    for (int law = 0; law < 2; law++) {
        for (int i = 0; i < 6; i++) {
            assert_true(isnan(tails[law](1.0, bad_degrees[i])));
            assert_true(isnan(tails[law](0.0, bad_degrees[i])));
            assert_true(isnan(quantiles[law](0.1, bad_degrees[i])));
            assert_true(isnan(quantiles[law](0.5, bad_degrees[i])));
        }
        for (int i = 0; i < 8; i++) assert_true(isnan(quantiles[law](bad_tails[i], 3.0)));
        assert_true(isnan(tails[law](NOT_A_NUMBER, 3.0)));
        assert_true(tails[law](INFINITE, 3.0) == 0.0);
    }
    assert_true(isnan(mk_chi2_tail(-1e-300, 3.0)) && isnan(mk_chi2_tail(-INFINITE, 3.0)));
    assert_true(mk_chi2_tail(0.0, 3.0) == 1.0 && mk_chi2_tail(-0.0, 3.0) == 1.0);
    assert_true(mk_student_tail(0.0, 3.0) == 0.5 && mk_student_tail(-INFINITE, 3.0) == 1.0);
    assert_true(mk_student_quantile(0.5, 3.0) == 0.0);
    /* Numbers that the range of a double does not hold. */
    assert_true(isinf(mk_student_quantile(1e-300, 0.5)) && mk_student_quantile(1e-300, 0.5) > 0.0);
    assert_true(isinf(mk_student_quantile(1.0 - 1e-15, 1e-3)) && mk_student_quantile(1.0 - 1e-15, 1e-3) < 0.0);
    assert_true(mk_chi2_quantile(1.0 - 1e-15, 1e-3) == 0.0);
    /* Whatever the arguments, an answer, and one in the range. */
    generator_t g = {9};
    for (int i = 0; i < 20000; i++) {
        const double k = draw_log_uniform(&g, 1e-300, 1e300), x = draw_log_uniform(&g, 1e-300, 1e300), p = draw_tail(&g);
        for (int law = 0; law < 2; law++) {
            const double tail = tails[law](x, k), quantile = quantiles[law](p, k);
            if (!(tail >= 0.0 && tail <= 1.0)) fail_msg("law %d, degrees %.17g, x %.17g: tail %.17g", law, k, x, tail);
            if (isnan(quantile)) fail_msg("law %d, degrees %.17g, tail %.17g: no quantile", law, k, p);
        }
    }
}

/* Against the long double function: in units of the last place, subnormal results too. */
static void test_exponential(void **unused) {
    (void)unused;
    generator_t g = {11};
    double worst = 0.0, worst_f32 = 0.0;
    for (int i = 0; i < 400000; i++) {
        const double x = i % 2 ? draw_uniform(&g, -745.0, 709.7) : draw_uniform(&g, -1.0, 1.0) * draw_log_uniform(&g, 1e-20, 2.0);
        const long double wanted = expl((long double)x);
        int exponent;
        (void)frexpl(wanted, &exponent);
        const long double unit = ldexpl(1.0L, exponent - 53 > -1074 ? exponent - 53 : -1074);
        worst = fmax(worst, (double)(fabsl((long double)mk_exp_f64(x) - wanted) / unit));
        const float y = (float)(i % 2 ? x / (x < 0.0 ? 7.2 : 8.0) : x);
        const double wanted_f32 = exp((double)y);
        (void)frexp(wanted_f32, &exponent);
        const double unit_f32 = ldexp(1.0, exponent - 24 > -149 ? exponent - 24 : -149);
        worst_f32 = fmax(worst_f32, fabs((double)mk_exp_f32(y) - wanted_f32) / unit_f32);
    }
    print_message("- exponential: %.2f units of the last place (f64), %.2f (f32)\n", worst, worst_f32);
    assert_true(worst < 1.1 && worst_f32 < 1.1);
    assert_true(mk_exp_f64(0.0) == 1.0 && mk_exp_f32(0.0f) == 1.0f);
    assert_true(mk_exp_f64(-INFINITE) == 0.0 && mk_exp_f64(-1e300) == 0.0 && isinf(mk_exp_f64(INFINITE)) && isinf(mk_exp_f64(709.79)));
    assert_true(mk_exp_f32(-1e30f) == 0.0f && isinf(mk_exp_f32(88.73f)) && isinf(mk_exp_f32(1e30f)));
    assert_true(isnan(mk_exp_f64(NOT_A_NUMBER)) && isnan(mk_exp_f32(NAN)));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_closed_forms), cmocka_unit_test(test_round_trip), cmocka_unit_test(test_order),
                                       cmocka_unit_test(test_arguments), cmocka_unit_test(test_exponential)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
