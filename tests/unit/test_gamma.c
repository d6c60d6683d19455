/* SPDX-License-Identifier: MIT */
/* theta, the root of gamma(P, theta) = c, by both ways the library finds it: the public root, and the one inside the filter step. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "generator.h"
#include "node.h"

/* NAN is a float. */
#define NOT_A_NUMBER ((double)NAN)

enum { SPECTRA = 6000, KINDS = 7 };

/* A spectrum with largest eigenvalue 1; the kinds are those that root finders trip over. */
static void draw_spectrum(generator_t *g, int kind, int n, double condition, double *spectrum) {
    const double split = draw_log_uniform(g, 1.0 / condition, 1.0), spread = draw_log_uniform(g, 1e-15, 1e-2);
    for (int i = 0; i < n; i++) {
        switch (kind) {
        case 0: spectrum[i] = draw_log_uniform(g, 1.0 / condition, 1.0); break; /* any */
        case 1: spectrum[i] = 1.0; break;                                       /* P = s I */
        case 2: spectrum[i] = i == 0 ? 1.0 : split * draw_uniform(g, 0.5, 1.0); break; /* one dominant */
        case 3: spectrum[i] = 1.0 - spread * draw_uniform(g, 0.0, 1.0); break;  /* nearly equal */
        case 4: spectrum[i] = i % 2 ? split : 1.0 - spread * i; break;          /* two clusters */
        case 5: spectrum[i] = pow(condition, -(double)i / n); break;            /* geometric */
        default: spectrum[i] = i == n - 1 ? 1.0 / condition : 1.0; break;       /* one far below */
        }
    }
    spectrum[0] = 1.0;
}

/* P as the precision can hold it, full and packed: the reference must see the rounded matrix. */
static void draw_P(generator_t *g, const precision_t *precision, int kind, int n, double condition, double scale, double *P,
                   double *packed) {
    double spectrum[LARGEST_N];
    draw_spectrum(g, kind, n, condition, spectrum);
    for (int i = 0; i < n; i++) spectrum[i] *= scale;
    if (kind == 1 || draw_chance(g, 0.15)) {
        for (int i = 0; i < n * n; i++) P[i] = 0.0;
        for (int i = 0; i < n; i++) P[i * n + i] = spectrum[i];
    } else {
        draw_covariance(g, n, spectrum, P);
    }
    if (precision == &float32) round_to_float(n * n, P);
    pack(n, P, packed);
}

typedef struct {
    const precision_t *precision;
    double condition, exponent, allowed;
} range_t;

static const range_t ranges[] = {{&float64, 1e10, 150.0, 1e-9}, {&float32, 1e5, 15.0, 1e-4}};

static double draw_c(generator_t *g, const precision_t *precision) {
    const double c = draw_log_uniform(g, 1e-9, 10.0);
    return precision == &float32 ? (double)(float)c : c;
}

static void public_root(void **unused) {
    (void)unused;
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; k++) {
        const range_t *const range = &ranges[k];
        generator_t g = {101 + k};
        double worst = 0.0;
        int most = 0;
        for (int trial = 0; trial < SPECTRA; trial++) {
            const int n = 1 + trial % LARGEST_N, kind = draw_below(&g, KINDS);
            double P[LARGEST_N * LARGEST_N], packed[MK_PACKED(LARGEST_N)], theta = -1.0;
            const double condition = pow(range->condition, draw_uniform(&g, 0.0, 1.0));
            const double scale = pow(10.0, draw_uniform(&g, -range->exponent, range->exponent));
            draw_P(&g, range->precision, kind, n, condition, scale, P, packed);
            const double c = draw_c(&g, range->precision);
            const int evaluations = range->precision->gamma_root(n, packed, c, &theta);
            if (evaluations < 1 || evaluations > 100)
                fail_msg("no root: n %d kind %d condition %g scale %g c %g", n, kind, condition, scale, c);
            const double expected = reference_theta(n, P, c), error = fabs(theta / expected - 1.0);
            if (!(error < range->allowed))
                fail_msg("theta %.17g, not %.17g: n %d kind %d condition %g scale %g c %g", theta, expected, n, kind, condition,
                         scale, c);
            worst = fmax(worst, error);
            if (evaluations > most) most = evaluations;
        }
        print_message("- root, %s: worst relative error %.1e, at most %d evaluations\n", range->precision->name, worst, most);
    }
}

/* Relative error of the theta that one filter step finds. With A = 0 the step's P is Q to the last bit, so the root inside the
   step can be held to the same accuracy as the public one whatever the condition of Q. */
static double step_root_error(generator_t *g, const range_t *range, int n, int kind, double condition, double scale, double c) {
    model_t model;
    seen_t seen;
    double packed[MK_PACKED(LARGEST_N)];
    memset(&model, 0, sizeof model);
    model.n = n;
    model.m = model.slots = 1;
    model.weight[0] = 1.0;
    model.tolerance = c;
    for (int i = 0; i < n; i++) model.P0[i * n + i] = 1.0;
    draw_P(g, range->precision, kind, n, condition, scale, model.Q, packed);
    node_t *const node = range->precision->make(&model);
    assert_int_equal(range->precision->start(node), MK_OK);
    const mk_status_t status = range->precision->incremental(node, NULL);
    range->precision->see(node, &seen);
    node_free(node);
    if (status != MK_OK)
        fail_msg("%s: n %d kind %d condition %g scale %g c %g", mk_status_name(status), n, kind, condition, scale, c);
    const double expected = reference_theta(n, model.Q, c), error = fabs(seen.theta / expected - 1.0);
    if (!(error < range->allowed))
        fail_msg("%s: theta %.17g, not %.17g: n %d kind %d condition %g scale %g c %g", range->precision->name, seen.theta,
                 expected, n, kind, condition, scale, c);
    return error;
}

static void step_root(void **unused) {
    (void)unused;
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; k++) {
        const range_t *const range = &ranges[k];
        generator_t g = {1201 + k};
        double worst = 0.0;
        for (int trial = 0; trial < SPECTRA; trial++) {
            /* The polynomial root serves n <= 6, where most of the trials belong. */
            const int n = trial % 8 == 7 ? 7 + draw_below(&g, LARGEST_N - 6) : 1 + trial % 6;
            const double condition = pow(range->condition, draw_uniform(&g, 0.0, 1.0));
            /* Further down the squares in the step's own factorisation underflow. */
            const double exponent = range->exponent * (trial % 3 ? 0.02 : 0.7);
            const double scale = pow(10.0, draw_uniform(&g, -exponent, exponent));
            const double c = draw_c(&g, range->precision);
            worst = fmax(worst, step_root_error(&g, range, n, draw_below(&g, KINDS), condition, scale, c));
        }
        print_message("- root in the step, %s: worst relative error %.1e\n", range->precision->name, worst);
    }
}

/* A high-order step taken far from the root may land on another branch of the polynomial, where the determinant is positive
   again: theta < 0, or theta beyond the second pole. Large c and equal eigenvalues provoke it. */
static void step_root_branch(void **unused) {
    (void)unused;
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; k++) {
        const range_t *const range = &ranges[k];
        generator_t g = {401 + k};
        for (int trial = 0; trial < 2 * SPECTRA; trial++) {
            const int n = 2 + trial % 5, kind = draw_chance(&g, 0.7) ? KINDS - 1 : draw_below(&g, KINDS);
            const double condition = pow(range->condition, draw_uniform(&g, 0.0, 1.0)), scale = draw_log_uniform(&g, 0.5, 2.0);
            const double c = (double)(float)draw_log_uniform(&g, 1.0, 10.0);
            step_root_error(&g, range, n, kind, condition, scale, c);
        }
    }
}

/* log det(I - theta P) + tr[(I - theta P)^-1 - I] as it stands, by LU: the cancellation is the caller's to avoid. */
static double gamma_by_definition(int n, const double *P, double theta) {
    double D[LARGEST_N * LARGEST_N], sum = 0.0;
    lapack_int pivots[LARGEST_N];
    for (int i = 0; i < n * n; i++) D[i] = -theta * P[i];
    for (int i = 0; i < n; i++) D[i * n + i] += 1.0;
    assert_int_equal(LAPACKE_dgetrf(LAPACK_ROW_MAJOR, n, n, D, n, pivots), 0);
    for (int i = 0; i < n; i++) sum += log(fabs(D[i * n + i]));
    assert_int_equal(LAPACKE_dgetri(LAPACK_ROW_MAJOR, n, D, n, pivots), 0);
    for (int i = 0; i < n; i++) sum += D[i * n + i] - 1.0;
    return sum;
}

static void value_and_slope(void **unused) {
    (void)unused;
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; k++) {
        const range_t *const range = &ranges[k];
        generator_t g = {301 + k};
        double worst = 0.0, worst_slope = 0.0;
        for (int trial = 0; trial < SPECTRA; trial++) {
            const int n = 1 + trial % LARGEST_N, kind = draw_below(&g, KINDS);
            double P[LARGEST_N * LARGEST_N], packed[MK_PACKED(LARGEST_N)], eigenvalues[LARGEST_N];
            draw_P(&g, range->precision, kind, n, pow(range->condition, draw_uniform(&g, 0.0, 1.0)),
                   pow(10.0, draw_uniform(&g, -10.0, 10.0)), P, packed);
            reference_eigenvalues(n, P, eigenvalues);
            const double share = draw_chance(&g, 0.5) ? draw_log_uniform(&g, 1e-6, 0.1) : draw_uniform(&g, 0.1, 0.9);
            double theta = share / eigenvalues[n - 1], value = -1.0, slope = -1.0, expected_slope, alone = -1.0;
            if (range->precision == &float32) theta = (double)(float)theta;
            const double expected = reference_gamma(n, eigenvalues, theta, &expected_slope);
            if (share > 0.3 && range->precision == &float64)
                assert_true(fabs(gamma_by_definition(n, P, theta) / expected - 1.0) < 1e-9);
            assert_int_equal(range->precision->gamma(n, packed, theta, &value, &slope), 1);
            assert_int_equal(range->precision->gamma(n, packed, theta, &alone, NULL), 1);
            assert_true(alone == value);
            worst = fmax(worst, fabs(value / expected - 1.0));
            worst_slope = fmax(worst_slope, fabs(slope / expected_slope - 1.0));
        }
        print_message("- gamma, %s: worst relative error %.1e, of the slope %.1e\n", range->precision->name, worst, worst_slope);
        /* Close to the pole a rounding of P is magnified by 1 / (1 - theta lambda_max) twice. */
        assert_true(worst < 500.0 * range->precision->epsilon && worst_slope < 1000.0 * range->precision->epsilon);
    }
}

/* Values known without any computer: gamma(s I) = n (t - log(1 + t)), t = theta s / (1 - theta s). */
static void known_values(void **unused) {
    (void)unused;
    const double P[] = {2.0, 0.0, 2.0, 0.0, 0.0, 2.0};
    double value = -1.0, slope = -1.0, theta = 0.25;
    assert_int_equal(float64.gamma(3, P, 0.25, &value, &slope), 1);
    assert_true(fabs(value - 3.0 * (1.0 - 0.69314718055994530942)) < 1e-15);
    assert_true(fabs(slope - 3.0) < 1e-14);
    assert_int_equal(float64.gamma(3, P, 0.0, &value, &slope), 1);
    assert_true(value == 0.0 && slope == 0.0);
    assert_true(float64.gamma_root(3, P, 3.0 * (1.0 - 0.69314718055994530942), &theta) > 0);
    assert_true(fabs(theta - 0.25) < 1e-15);
}

static const double refused_c[] = {0.0, -0.0, -1e-3, NOT_A_NUMBER, HUGE_VAL, -HUGE_VAL};

/* 3 x 3, packed; what is wrong with them is beyond doubt. */
static const double refused_P[][6] = {
    {0.0, 0.0, 0.0, 0.0, 0.0, 0.0},          {-1.0, 0.0, -1.0, 0.0, 0.0, -1.0},       {-3.0, 0.0, 1.0, 0.0, 0.0, 1.0},
    {NOT_A_NUMBER, 0.0, 1.0, 0.0, 0.0, 1.0}, {1.0, NOT_A_NUMBER, 1.0, 0.0, 0.0, 1.0}, {1.0, 0.0, 1.0, 0.0, NOT_A_NUMBER, 1.0},
    {1.0, 0.0, 1.0, 0.0, 0.0, NOT_A_NUMBER}, {HUGE_VAL, 0.0, 1.0, 0.0, 0.0, 1.0},     {1.0, 0.0, 1.0, 0.0, 0.0, HUGE_VAL},
    {1.0, 0.0, 1.0, HUGE_VAL, 0.0, 1.0},     {1.0, 0.0, 1.0, 0.0, -HUGE_VAL, 1.0},
};

static void refused_inputs(void **unused) {
    (void)unused;
    const precision_t *const both[] = {&float32, &float64};
    for (size_t k = 0; k < 2; k++) {
        const double good[] = {1.0, 0.25, 2.0, 0.0, 0.5, 1.0};
        double theta = 42.0, value = 43.0, slope = 44.0;
        for (size_t i = 0; i < sizeof refused_c / sizeof *refused_c; i++) {
            assert_int_equal(both[k]->gamma_root(3, good, refused_c[i], &theta), 0);
            assert_true(theta == 42.0);
        }
        for (size_t i = 0; i < sizeof refused_P / sizeof *refused_P; i++) {
            if (both[k]->gamma_root(3, refused_P[i], 0.02, &theta) != 0 || theta != 42.0)
                fail_msg("%s: gamma_root took matrix %d", both[k]->name, (int)i);
            if (both[k]->gamma(3, refused_P[i], 0.1, &value, &slope) != 0 || value != 43.0 || slope != 44.0)
                fail_msg("%s: gamma took matrix %d", both[k]->name, (int)i);
        }
        /* At the pole, beyond it, beyond all poles where the determinant is positive again, negative, not a number. */
        const double refused_theta[] = {1.0, 1.5, 3.0, 1e9, HUGE_VAL, -1e-9, NOT_A_NUMBER};
        const double diagonal[] = {1.0, 0.0, 0.5, 0.0, 0.0, 0.5};
        for (size_t i = 0; i < sizeof refused_theta / sizeof *refused_theta; i++) {
            assert_int_equal(both[k]->gamma(3, diagonal, refused_theta[i], &value, &slope), 0);
            assert_true(value == 43.0 && slope == 44.0);
        }
    }
}

/* Towards large c the root runs into the pole, until no number lies between them. Either it is found, as accurate as any, or none
   may be returned. */
static void refused_large_c(void **unused) {
    (void)unused;
    const double P[] = {1.0, 0.25, 0.0, 0.25, 2.0, 0.5, 0.0, 0.5, 1.0};
    double packed[6];
    pack(3, P, packed);
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; k++) {
        const precision_t *const precision = ranges[k].precision;
        for (double c = 10.0; c < 1e37; c *= 10.0) {
            double theta = 42.0;
            const int evaluations = precision->gamma_root(3, packed, c, &theta);
            const double expected = reference_theta(3, P, c), error = fabs(theta / expected - 1.0);
            if (evaluations == 0) assert_true(theta == 42.0);
            else if (c * precision->epsilon > 10.0 || !(error < ranges[k].allowed))
                fail_msg("%s, c %g: gamma_root returned %d with theta %.17g, not %.17g", precision->name, c, evaluations, theta,
                         expected);
        }
    }
}

/* "P not positive": an indefinite matrix with a positive trace is one, too. */
static void refused_indefinite(void **unused) {
    (void)unused;
    const double indefinite[][6] = {{1.0, 0.0, -0.5, 0.0, 0.0, 1.0}, {1.0, 2.0, 1.0, 0.0, 0.0, 1.0}};
    const precision_t *const both[] = {&float32, &float64};
    for (size_t k = 0; k < 2; k++) {
        for (size_t i = 0; i < 2; i++) {
            double theta = 42.0, value = 43.0;
            const int root = both[k]->gamma_root(3, indefinite[i], 0.02, &theta);
            const int evaluated = both[k]->gamma(3, indefinite[i], 0.1, &value, NULL);
            if (root != 0 || evaluated != 0)
                fail_msg("%s, indefinite matrix %d: gamma_root returned %d (theta %g), gamma %d", both[k]->name, (int)i, root,
                         theta, evaluated);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(public_root),     cmocka_unit_test(step_root),    cmocka_unit_test(step_root_branch),
        cmocka_unit_test(value_and_slope), cmocka_unit_test(known_values), cmocka_unit_test(refused_inputs),
        cmocka_unit_test(refused_large_c), cmocka_unit_test(refused_indefinite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
