/* SPDX-License-Identifier: MIT */
/* A step of the error covariance in panels against the same step by dense matrices: random gains, directed links, random weights, every
   rest that the last panel can have. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "analysis/analysis.h"
#include "analysis/error_covariance.h"
#include "dense.h"
#include "random.h"

enum { LARGEST = 9, MOST = 9, MOST_ROWS = (MOST + 1) * LARGEST };

static mk_random_t source;
static double draw(void) { return mk_random_normal(&source); }

typedef struct {
    int n, estimators, sensors, diffuses;
    mk_scenario_t scenario;
    mk_sensor_t sensor[MOST];
    double Q[45], P0[45], C[MOST][LARGEST], R[MOST];
    mk_topology_t topology;
    int first[MOST + 1], slot[MOST * MOST];
    double weight[MOST * MOST];
    double Phi[MOST * 81], MA[MOST * 81], Ag[81], central_MA[81], N[81];
} case_t;

static void draw_square(int n, double scale, double *to) {
    for (int i = 0; i < n * n; i++) to[i] = scale * draw();
}

static void draw_covariance(int n, double *packed) {
    double root[81];
    draw_square(n, 1.0, root);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            packed[i * (i + 1) / 2 + j] = i == j ? 0.1 : 0.0;
            for (int k = 0; k < n; k++) packed[i * (i + 1) / 2 + j] += root[i * n + k] * root[j * n + k];
        }
}

/* Without diffusion: estimators and sensors are not the same in number, as for a centralised filter. */
static void draw_case(case_t *c, int n, int estimators, int diffuses) {
    memset(c, 0, sizeof *c);
    c->n = c->scenario.n = n;
    c->estimators = estimators;
    c->sensors = c->scenario.nodes = diffuses ? estimators : MOST;
    c->diffuses = diffuses;
    c->scenario.sensor = c->sensor;
    c->scenario.Q = c->Q;
    c->scenario.P0 = c->P0;
    draw_covariance(n, c->Q);
    draw_covariance(n, c->P0);
    for (int k = 0; k < c->sensors; k++) {
        c->sensor[k].rows = 1;
        c->sensor[k].C = c->C[k];
        c->sensor[k].R = &c->R[k];
        c->R[k] = 0.5 + mk_random_uniform(&source);
        for (int i = 0; i < n; i++) c->C[k][i] = draw();
    }
    c->topology.estimators = estimators;
    c->topology.first = c->first;
    c->topology.slot = c->slot;
    c->topology.weight = c->weight;
    int at = 0;
    for (int e = 0; e < estimators; e++) {
        for (int s = 0; s < c->sensors; s++)
            if (s == e || mk_random_uniform(&source) < 0.4) {
                c->slot[at] = s;
                c->weight[at++] = mk_random_uniform(&source);
            }
        c->first[e + 1] = at;
        double sum = 0.0;
        for (int i = c->first[e]; i < at; i++) sum += c->weight[i];
        for (int i = c->first[e]; i < at; i++) c->weight[i] /= sum;
        draw_square(n, 0.5, c->Phi + e * n * n);
        draw_square(n, 0.5, c->MA + e * n * n);
    }
    draw_square(n, 0.5, c->Ag);
    draw_square(n, 0.5, c->central_MA);
    double N[45];
    draw_covariance(n, N);
    mk_unpack(n, N, c->N);
}

/* What a step is, in matrices of (estimators + 1) n rows; RKFC is the last estimator, which hears all sensors. */
static void dense_step(const case_t *c, int adversary, double *X) {
    static double F[MOST_ROWS * MOST_ROWS], noise[MOST_ROWS * MOST_ROWS], mixed[MOST_ROWS * MOST_ROWS], T[MOST_ROWS * MOST_ROWS];
    const int n = c->n, square = n * n, all = c->estimators + 1, D = all * n;
    double S[MOST * 81], E[(MOST + 1) * 81], A[81], B[81], U[81], Q[81], W[(MOST + 1) * (MOST + 1)] = {0};
    int hears[(MOST + 1) * MOST] = {0};
    mk_unpack(n, c->Q, Q);
    for (int s = 0; s < c->sensors; s++)
        for (int i = 0; i < square; i++) S[s * square + i] = c->C[s][i / n] * c->C[s][i % n] / c->R[s];
    for (int e = 0; e < all; e++) {
        if (e == c->estimators || !c->diffuses) W[e * all + e] = 1.0;
        for (int s = 0; e == c->estimators && s < c->sensors; s++) hears[e * MOST + s] = 1;
        for (int i = c->first[e]; e < c->estimators && i < c->first[e + 1]; i++) {
            hears[e * MOST + c->slot[i]] = 1;
            if (c->diffuses) W[e * all + c->slot[i]] = c->weight[i];
        }
    }
    memset(F, 0, sizeof F);
    for (int e = 0; e < all; e++) {
        memset(A, 0, sizeof A);
        for (int s = 0; s < c->sensors; s++)
            for (int i = 0; hears[e * MOST + s] && i < square; i++) A[i] += S[s * square + i];
        mk_multiply(n, A, c->central_MA, B);
        mk_multiply_left_transposed(n, e < c->estimators ? c->MA + e * square : c->central_MA, B, E + e * square);
        for (int i = 0; i < square; i++) E[e * square + i] += Q[i];
        mk_multiply(n, c->N, c->Ag, A);
        mk_multiply(n, E + e * square, A, B);
        for (int i = 0; i < square; i++) {
            double *row = F + (e * n + i / n) * D + i % n;
            row[e * n] = e < c->estimators ? c->Phi[e * square + i] : c->Ag[i];
            if (adversary) row[c->estimators * n] += B[i];
        }
    }
    for (int l = 0; l < all; l++)
        for (int m = 0; m < all; m++) {
            memset(A, 0, sizeof A);
            for (int s = 0; s < c->sensors; s++)
                for (int i = 0; hears[l * MOST + s] && hears[m * MOST + s] && i < square; i++) A[i] += S[s * square + i];
            mk_multiply(n, A, m < c->estimators ? c->MA + m * square : c->central_MA, B);
            mk_multiply_left_transposed(n, l < c->estimators ? c->MA + l * square : c->central_MA, B, U);
            mk_multiply(n, E + l * square, c->N, A);
            mk_multiply_transposed(n, A, E + m * square, B);
            for (int i = 0; i < square; i++) noise[(l * n + i / n) * D + m * n + i % n] = Q[i] + U[i] + adversary * B[i];
        }
    mk_multiply(D, F, X, T);
    mk_multiply_transposed(D, T, F, X);
    for (int i = 0; i < D * D; i++) X[i] += noise[i];
    memset(mixed, 0, sizeof mixed);
    for (int k = 0; k < all; k++)
        for (int l = 0; l < all; l++)
            for (int i = 0; i < n; i++) mixed[(k * n + i) * D + l * n + i] = W[k * all + l];
    mk_multiply(D, mixed, X, T);
    mk_multiply_transposed(D, T, mixed, X);
}

static void assert_same(const case_t *c, const mk_error_covariance_t *x, const double *X) {
    const int n = c->n, E = c->estimators, D = (E + 1) * n;
    double scale = 0.0;
    for (int i = 0; i < D * D; i++) scale = fmax(scale, fabs(X[i]));
    for (int k = 0; k < E; k++)
        for (int j = 0; j < E; j++) {
            int stride, back;
            const double *block = mk_error_covariance_block(x, k, j, &stride), *mirror = mk_error_covariance_block(x, j, k, &back);
            for (int r = 0; r < n; r++)
                for (int q = 0; q < n; q++) {
                    assert_true(fabs(block[r * stride + q] - X[(k * n + r) * D + j * n + q]) < 1e-12 * scale);
                    assert_true(block[r * stride + q] == mirror[q * back + r]);
                }
        }
    for (int r = 0; r < n; r++)
        for (int q = 0; q < n; q++) {
            assert_true(fabs(x->central[r * n + q] - X[(E * n + r) * D + E * n + q]) < 1e-12 * scale);
            for (int k = 0; k < E; k++) assert_true(fabs(x->cross[k * n * n + r * n + q] - X[(k * n + r) * D + E * n + q]) < 1e-12 * scale);
        }
}

static void steps(void **unused) {
    static case_t c;
    static double X[MOST_ROWS * MOST_ROWS];
    (void)unused;
    mk_random_start(&source, 41, 0, 0, 0, MK_DRAW_NETWORK);
    for (int n = 1; n <= LARGEST; n++)
        for (int E = 1; E <= MOST; E++)
            for (int kind = 0; kind < 4; kind++) {
                const int adversary = kind & 1, diffuses = kind >> 1, D = (E + 1) * n;
                mk_error_covariance_t x;
                double P0[81];
                draw_case(&c, n, E, diffuses);
                mk_unpack(n, c.P0, P0);
                for (int i = 0; i < D; i++)
                    for (int j = 0; j < D; j++) X[i * D + j] = P0[i % n * n + j % n];
                mk_error_covariance_open(&x, &c.scenario, &c.topology, diffuses, 1 + E % 2);
                assert_same(&c, &x, X);
                for (int t = 0; t < 3; t++) {
                    const mk_error_maps_t maps = {c.Phi, c.MA, c.Ag, c.central_MA, adversary ? c.N : NULL};
                    mk_error_covariance_step(&x, &maps);
                    dense_step(&c, adversary, X);
                    assert_same(&c, &x, X);
                }
                mk_error_covariance_close(&x);
            }
}

/* value at t: 1 + early a^t + late a^(T - t) + slope t */
static int still(int T, double a, double early, double late, double slope) {
    double *values = malloc(((size_t)T + 1) * sizeof *values);
    for (int t = 0; t <= T; t++) values[t] = 1.0 + early * pow(a, t) + late * pow(a, T - t) + slope * t;
    const int good = mk_stands_still(values, T);
    free(values);
    return good;
}

static void stands_still(void **unused) {
    (void)unused;
    assert_int_equal(still(9, 0.9, 0.0, 0.0, 0.0), 1);
    assert_int_equal(still(8, 0.9, 0.0, 0.0, 0.0), 0); /* too short to tell */
    for (int ends = 1; ends < 4; ends++) {
        const double early = ends & 1 ? 20.0 : 0.0, late = ends & 2 ? -20.0 : 0.0;
        assert_int_equal(still(200, 0.90, early, late, 0.0), 1); /* 5e-4 of the value is left */
        assert_int_equal(still(200, 0.95, early, late, 0.0), 0); /* 0.12 */
        assert_int_equal(still(400, 0.95, early, late, 0.0), 1);
    }
    /* What moves slowly moves far: hardly visible within the windows, 0.05 to 1 from its limit. */
    assert_int_equal(still(200, 0.9999, 0.05, 0.0, 0.0), 0);
    assert_int_equal(still(200, 0.99999, 1.0, 0.0, 0.0), 0);
    assert_int_equal(still(200, 0.9, 0.0, 0.0, 1e-6), 0);
    assert_int_equal(still(200, 0.9, 0.0, 0.0, 1e-3), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(steps), cmocka_unit_test(stands_still)};
    return cmocka_run_group_tests_name("test_error_covariance", tests, NULL, NULL);
}
