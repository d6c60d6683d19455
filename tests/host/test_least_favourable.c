/* SPDX-License-Identifier: MIT */
/* The least favourable model in n x n matrices against spec 1.7 as it is written: noise B v, D v of all sensors, Kt and H, by LAPACKE. */
#include <lapacke.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "dense.h"
#include "design/design.h"
#include "design/least_favourable.h"
#include "random.h"

enum { LARGEST = 6, NODES = 4, MOST_ROWS = 2 * NODES, MOST_NOISE = LARGEST + MOST_ROWS, HORIZON = 30 };
#define PACKED(n) ((n) * ((n) + 1) / 2)
#define AT(i, j) ((i) * ((i) + 1) / 2 + (j))

static mk_random_t source;
static double draw(void) { return mk_random_normal(&source); }

typedef struct {
    mk_scenario_t scenario;
    mk_sensor_t sensor[NODES];
    double A[LARGEST * LARGEST], Q[PACKED(LARGEST)], P0[PACKED(LARGEST)], C[NODES][2 * LARGEST], R[NODES][3];
} model_t;

static void draw_covariance(int n, double scale, double *S) {
    double root[LARGEST * LARGEST];
    for (int i = 0; i < n * n; i++) root[i] = draw();
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            S[AT(i, j)] = i == j ? 0.3 * scale : 0.0;
            for (int k = 0; k < n; k++) S[AT(i, j)] += scale * root[i * n + k] * root[j * n + k];
        }
}

/* Stable or not, sensors of one and two rows, some of which see little. */
static void draw_model(model_t *m, int n) {
    memset(m, 0, sizeof *m);
    mk_scenario_t *s = &m->scenario;
    s->n = n;
    s->nodes = NODES;
    s->A = m->A;
    s->Q = m->Q;
    s->P0 = m->P0;
    s->sensor = m->sensor;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) m->A[i * n + j] = (i == j) * 0.9 + 0.15 * draw();
    draw_covariance(n, 0.1, m->Q);
    draw_covariance(n, 0.5, m->P0);
    for (int k = 0; k < NODES; k++) {
        m->sensor[k].rows = 1 + k % 2;
        m->sensor[k].C = m->C[k];
        m->sensor[k].R = m->R[k];
        for (int i = 0; i < m->sensor[k].rows * n; i++) m->C[k][i] = draw();
        draw_covariance(m->sensor[k].rows, 1.0, m->R[k]);
    }
}

/* to (a x c) = from (a x b) times with (b x c). */
static void times(int a, int b, int c, const double *from, const double *with, double *to) {
    for (int i = 0; i < a; i++)
        for (int j = 0; j < c; j++) {
            double sum = 0.0;
            for (int k = 0; k < b; k++) sum += from[i * b + k] * with[k * c + j];
            to[i * c + j] = sum;
        }
}

static void transpose(int rows, int columns, const double *from, double *to) {
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) to[j * rows + i] = from[i * columns + j];
}

static void invert(int n, double *S) {
    assert_int_equal(LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, S, n), 0);
    assert_int_equal(LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', n, S, n), 0);
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) S[i * n + j] = S[j * n + i];
}

static void assert_near(int count, const double *a, const double *b, double least_scale, double tolerance) {
    double scale = least_scale;
    for (int i = 0; i < count; i++) scale = fmax(scale, fabs(b[i]));
    for (int i = 0; i < count; i++)
        if (!(fabs(a[i] - b[i]) <= tolerance * scale)) fail_msg("element %d: %.17g, not %.17g (scale %g)", i, a[i], b[i], scale);
}

/* Cholesky factor of a packed matrix as a full one, at (row, column) of `to`, which has `width` columns. */
static void put_root(int n, const double *S, double *to, int width, int row, int column) {
    double full[LARGEST * LARGEST];
    mk_unpack(n, S, full);
    assert_int_equal(LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, full, n), 0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) to[(row + i) * width + column + j] = full[i * n + j];
}

/* What spec 1.7 needs of one step. */
typedef struct {
    double Ag[LARGEST * LARGEST], Bg[LARGEST * MOST_NOISE], Kt[MOST_NOISE * MOST_NOISE], H[MOST_NOISE * LARGEST];
} dense_step_t;

static double C_all[MOST_ROWS * LARGEST], B[LARGEST * MOST_NOISE], D[MOST_ROWS * MOST_NOISE];
static int rows, noise;

static void stack(const mk_scenario_t *s) {
    const int n = s->n;
    rows = 0;
    for (int k = 0; k < NODES; k++) rows += s->sensor[k].rows;
    noise = n + rows;
    memset(B, 0, sizeof B);
    memset(D, 0, sizeof D);
    put_root(n, s->Q, B, noise, 0, 0);
    for (int k = 0, at = 0; k < NODES; at += s->sensor[k].rows, k++) {
        memcpy(C_all + at * n, s->sensor[k].C, (size_t)(s->sensor[k].rows * n) * sizeof *C_all);
        put_root(s->sensor[k].rows, s->sensor[k].R, D, noise, at, n + at);
    }
}

/* Ag and Bg from V(t): G = A V C' (C V C' + D D')^-1, another form of the gain. */
static void make_gain(const mk_scenario_t *s, const double *V, dense_step_t *d) {
    const int n = s->n;
    double full[LARGEST * LARGEST], Ct[LARGEST * MOST_ROWS], Dt[MOST_NOISE * MOST_ROWS], T[MOST_NOISE * MOST_NOISE], U[MOST_NOISE * MOST_NOISE];
    double G[LARGEST * MOST_ROWS], K[MOST_ROWS * MOST_ROWS];
    mk_unpack(n, V, full);
    transpose(rows, n, C_all, Ct);
    transpose(rows, noise, D, Dt);
    times(n, n, rows, full, Ct, T);
    times(rows, n, rows, C_all, T, K);
    times(rows, noise, rows, D, Dt, U);
    for (int i = 0; i < rows * rows; i++) K[i] += U[i];
    invert(rows, K);
    times(n, rows, rows, T, K, U);
    times(n, n, rows, s->A, U, G);
    times(n, rows, n, G, C_all, T);
    for (int i = 0; i < n * n; i++) d->Ag[i] = s->A[i] - T[i];
    times(n, rows, noise, G, D, T);
    for (int i = 0; i < n * noise; i++) d->Bg[i] = B[i] - T[i];
}

/* Kt, H and Oi(t) in the place of Oi(t+1). */
static void go_back(int n, double theta, double *Oi, dense_step_t *d) {
    double W[LARGEST * LARGEST], T[MOST_NOISE * MOST_NOISE], U[MOST_NOISE * MOST_NOISE], Bt[MOST_NOISE * LARGEST], At[LARGEST * LARGEST];
    for (int i = 0; i < n * n; i++) W[i] = Oi[i] + (i % (n + 1) ? 0.0 : theta);
    transpose(n, noise, d->Bg, Bt);
    transpose(n, n, d->Ag, At);
    times(n, n, noise, W, d->Bg, T);
    times(noise, n, noise, Bt, T, d->Kt);
    for (int i = 0; i < noise * noise; i++) d->Kt[i] = (i % (noise + 1) ? 0.0 : 1.0) - d->Kt[i];
    memcpy(U, d->Kt, sizeof U);
    invert(noise, d->Kt);
    times(n, n, n, W, d->Ag, T);
    double BtWA[MOST_NOISE * LARGEST], HtKH[LARGEST * LARGEST], Ht[LARGEST * MOST_NOISE];
    times(noise, n, n, Bt, T, BtWA);
    times(noise, noise, n, d->Kt, BtWA, d->H);
    times(n, n, n, At, T, Oi);
    transpose(noise, n, d->H, Ht);
    times(noise, noise, n, U, d->H, T);
    times(n, noise, n, Ht, T, HtKH);
    for (int i = 0; i < n * n; i++) Oi[i] += HtKH[i];
}

static void congruence(int a, int b, const double *F, const double *X, double *to) {
    double T[MOST_NOISE * MOST_NOISE], Ft[MOST_NOISE * MOST_NOISE];
    times(a, b, b, F, X, T);
    transpose(a, b, F, Ft);
    times(a, b, a, T, Ft, to);
}

static void compare(const model_t *m, double tolerance) {
    const mk_scenario_t *s = &m->scenario;
    const int n = s->n, square = n * n;
    mk_least_favourable_t model;
    mk_error_t error;
    static dense_step_t dense[HORIZON + 1];
    double Oi[LARGEST * LARGEST] = {0}, X[LARGEST * LARGEST], Y[LARGEST * LARGEST], T[MOST_NOISE * MOST_NOISE], U[MOST_NOISE * MOST_NOISE];
    assert_int_equal(mk_least_favourable_make(&model, s, tolerance, HORIZON, &error), 1);
    stack(s);
    for (int t = HORIZON; t >= 0; t--) {
        dense_step_t *d = &dense[t];
        make_gain(s, model.V + t * PACKED(n), d);
        double W[LARGEST * LARGEST], N[LARGEST * LARGEST], Bt[MOST_NOISE * LARGEST];
        for (int i = 0; i < square; i++) W[i] = Oi[i] + (i % (n + 1) ? 0.0 : model.theta[t]);
        go_back(n, model.theta[t], Oi, d);
        assert_near(square, model.Ag + t * square, d->Ag, 1.0, 1e-11);
        /* N = W + W Bg Kt Bg' W and Kt - I = Bg' N Bg, H = Bg' N Ag. */
        times(n, n, noise, W, d->Bg, T);
        congruence(n, noise, T, d->Kt, N);
        for (int i = 0; i < square; i++) N[i] += W[i];
        assert_near(square, model.N + t * square, N, 0.0, 1e-9);
        transpose(n, noise, d->Bg, Bt);
        congruence(noise, n, Bt, model.N + t * square, T);
        for (int i = 0; i < noise; i++) T[i * noise + i] += 1.0;
        assert_near(noise * noise, T, d->Kt, 1.0, 1e-9);
        times(n, n, n, model.N + t * square, model.Ag + t * square, T);
        times(noise, n, n, Bt, T, U);
        assert_near(noise * n, U, d->H, 0.0, 1e-9);
        mk_multiply_transposed(n, model.root_N + t * square, model.root_N + t * square, T);
        assert_near(square, T, model.N + t * square, 0.0, 1e-13);
        for (int i = 0; i < n; i++)
            for (int j = i + 1; j < n; j++) assert_true(model.root_N[t * square + i * n + j] == 0.0);
    }
    /* From e(0) with covariance (P0^-1 - Oi(0))^-1 the error of RKFC at T + 1 has covariance V(T+1): by H and Kt (X), by N (Y). */
    mk_unpack(n, s->P0, X);
    invert(n, X);
    for (int i = 0; i < square; i++) X[i] -= Oi[i];
    invert(n, X);
    memcpy(Y, X, sizeof Y);
    for (int t = 0; t <= HORIZON; t++) {
        const dense_step_t *d = &dense[t];
        const double *Ag = model.Ag + t * square, *MA = model.MA + t * square, *N = model.N + t * square;
        times(n, noise, n, d->Bg, d->H, T);
        for (int i = 0; i < square; i++) T[i] += d->Ag[i];
        congruence(n, n, T, X, U);
        congruence(n, noise, d->Bg, d->Kt, X);
        for (int i = 0; i < square; i++) X[i] += U[i];
        /* e+ = Ag e + w0 - sum of G_k v0_k + Z g, g ~ N(N Ag e, N), and Z = Q + A M S M A' */
        double S[LARGEST * LARGEST], Z[LARGEST * LARGEST], F[LARGEST * LARGEST], ZNZ[LARGEST * LARGEST], own[PACKED(LARGEST)], one[LARGEST * LARGEST];
        memset(S, 0, sizeof S);
        for (int k = 0; k < NODES; k++) {
            mk_sensor_matrices(n, &s->sensor[k], NULL, own, NULL);
            mk_unpack(n, own, one);
            for (int i = 0; i < square; i++) S[i] += one[i];
        }
        transpose(n, n, MA, one);
        congruence(n, n, one, S, Z);
        mk_unpack(n, s->Q, one);
        for (int i = 0; i < square; i++) Z[i] += one[i];
        times(n, n, n, N, Ag, T);
        times(n, n, n, Z, T, F);
        for (int i = 0; i < square; i++) F[i] += Ag[i];
        congruence(n, n, Z, N, ZNZ);
        congruence(n, n, F, Y, U);
        for (int i = 0; i < square; i++) Y[i] = U[i] + Z[i] + ZNZ[i];
    }
    mk_recursion_t r;
    mk_recursion_open(&r, s, tolerance);
    for (int k = 0; k < NODES; k++) mk_recursion_add(&r, &s->sensor[k]);
    for (int t = 0; t <= HORIZON; t++) {
        double V[LARGEST * LARGEST], P[LARGEST * LARGEST];
        mk_unpack(n, r.W, P);
        invert(n, P);
        mk_unpack(n, model.V + t * PACKED(n), V);
        assert_near(square, V, P, 0.0, 1e-12);
        assert_int_equal(mk_recursion_step(&r), 1);
        assert_true(model.theta[t] == r.theta);
    }
    mk_unpack(n, r.W, T);
    invert(n, T);
    assert_near(square, X, T, 0.0, 1e-9);
    assert_near(square, Y, T, 0.0, 1e-9);
    mk_recursion_close(&r);
    mk_least_favourable_free(&model);
}

static void as_written(void **unused) {
    static const double tolerances[] = {1e-6, 0.02, 0.1};
    (void)unused;
    mk_random_start(&source, 31, 0, 0, 0, MK_DRAW_NETWORK);
    for (int n = 1; n <= LARGEST; n++)
        for (int trial = 0; trial < 10; trial++) {
            model_t m;
            draw_model(&m, n);
            for (int i = 0; i < 3; i++) compare(&m, tolerances[i]);
        }
}

static void nominal(void **unused) {
    (void)unused;
    mk_random_start(&source, 32, 0, 0, 0, MK_DRAW_NETWORK);
    model_t m;
    mk_least_favourable_t model;
    mk_error_t error;
    draw_model(&m, 3);
    assert_int_equal(mk_least_favourable_make(&model, &m.scenario, 0.0, HORIZON, &error), 1);
    for (int i = 0; i < 9 * (HORIZON + 1); i++) assert_true(model.N[i] == 0.0 && model.root_N[i] == 0.0);
    for (int t = 0; t <= HORIZON; t++) assert_true(model.theta[t] == 0.0);
    mk_least_favourable_free(&model);
}

/* A prior that no sensor ever corrects: RKFC's covariance overflows, which is said, with the step. */
static void refused(void **unused) {
    (void)unused;
    mk_random_start(&source, 33, 0, 0, 0, MK_DRAW_NETWORK);
    model_t m;
    mk_least_favourable_t model;
    mk_error_t error;
    draw_model(&m, 1);
    m.A[0] = 1e80;
    for (int k = 0; k < NODES; k++) memset(m.C[k], 0, sizeof m.C[k]);
    assert_int_equal(mk_least_favourable_make(&model, &m.scenario, 0.1, HORIZON, &error), 0);
    assert_non_null(strstr(error.text, "tolerance 0.1: the centralised filter fails in step 1"));
    assert_true(model.Ag == NULL);
    /* Only tolerances at the end of the precision make the backward recursion fail, and not each of them. */
    int drowned = 0;
    for (int trial = 0; trial < 10; trial++) {
        draw_model(&m, 6);
        memset(m.A, 0, sizeof m.A);
        for (int i = 0; i < 6; i++) {
            m.A[i * 6 + i] = 1.0;
            if (i > 2) m.A[i * 6 + i - 3] = 0.1;
            for (int j = 0; j <= i; j++) m.Q[AT(i, j)] = i == j ? 0.001 : 0.0;
        }
        for (double c = 1e14; c < 1e16; c *= 1.2) {
            if (mk_least_favourable_make(&model, &m.scenario, c, 200, &error)) {
                mk_least_favourable_free(&model);
                continue;
            }
            char start[64];
            (void)snprintf(start, sizeof start, "tolerance %g: ", c);
            assert_ptr_equal(strstr(error.text, start), error.text);
            drowned += strstr(error.text, "its backward recursion from t = 200 is not positive definite at step ") != NULL;
            assert_true(model.Ag == NULL);
        }
    }
assert_true(drowned > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(as_written), cmocka_unit_test(nominal), cmocka_unit_test(refused)};
    return cmocka_run_group_tests_name("test_least_favourable", tests, NULL, NULL);
}
