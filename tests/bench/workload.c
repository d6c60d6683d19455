/* SPDX-License-Identifier: MIT */
/* The workload's numbers and its count of operations. */
#include <meshkal/rkfd.h>

#include "bench.h"

#include <stdint.h>
#include <string.h>

static uint64_t state;

/* Uniform on (-1, 1) with variance 1/3; a fixed sequence on every machine. */
static double draw(void) {
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(int64_t)(state >> 11) * 0x1p-52 - 1.0;
}

/* Packed sum of `rank` outer products of random vectors times scale, plus `diagonal` I. */
static void correlated(int n, int rank, double scale, double diagonal, double *packed) {
    for (int i = 0; i < BENCH_PACKED(n); i++) packed[i] = 0.0;
    for (int k = 0; k < rank; k++) {
        double v[BENCH_N];
        for (int i = 0; i < n; i++) v[i] = draw();
        for (int i = 0, at = 0; i < n; i++)
            for (int j = 0; j <= i; j++) packed[at++] += scale * v[i] * v[j];
    }
    for (int i = 0; i < n; i++) packed[BENCH_PACKED(i) + i] += diagonal;
}

/* Correlated Q, R and P0, dense A near the identity, every row of C full. */
static void make_dense(int n, bench_data_double *d) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) d->A[i * n + j] = (i == j ? 0.95 : 0.0) + 0.1 * draw();
    correlated(n, n, 0.03, 0.01, d->Q);
    correlated(n, n, 0.3, 0.1, d->P0);
    for (int i = 0; i < BENCH_SLOTS * BENCH_M * n; i++) d->C[i] = 1.5 * draw();
    for (int l = 0; l < BENCH_SLOTS; l++) correlated(BENCH_M, BENCH_M, 1.0, 0.2, d->R + l * BENCH_PACKED(BENCH_M));
}

/* The published model (spec 1.9) for any n: A = I + delta Phi, Phi feeding each level of derivatives into the next, and each
   sensor measuring two of the positions, which are the last level. */
static void make_block(int n, bench_data_double *d) {
    const int level = n % 3 == 0 ? 3 : n / 2;
    for (int i = 0; i < n; i++) {
        d->A[i * n + i] = 1.0;
        if (i >= level) d->A[i * n + i - level] = 0.1;
    }
    correlated(n, 0, 0.0, 0.001, d->Q);
    correlated(n, 0, 0.0, 1.0, d->P0);
    for (int l = 0; l < BENCH_SLOTS; l++) {
        for (int r = 0; r < BENCH_M; r++) {
            d->C[(l * BENCH_M + r) * n + n - level + (BENCH_M * l + r) % level] = 1.0;
            d->R[l * BENCH_PACKED(BENCH_M) + (r == 0 ? 0 : 2)] = 0.5 * (1 + 3 * ((l + r) % 3));
        }
    }
}

int bench_make_case(bench_case *c, int n, const char *shape, double tolerance) {
    bench_data_double *const d = &c->d;
    memset(c, 0, sizeof *c);
    c->n = n;
    c->shape = shape;
    state = (uint64_t)n;
    if (strcmp(shape, "dense") == 0) make_dense(n, d);
    else make_block(n, d);
    for (int i = 0; i < n; i++) d->x0[i] = draw();
    for (int l = 0; l < BENCH_SLOTS; l++) {
        double work[3 * BENCH_PACKED(BENCH_M)];
        d->weight[l] = 1.0 / BENCH_SLOTS;
        if (mk_rkfd_sensor_f64(n, BENCH_M, BENCH_M, d->C + l * BENCH_M * n, d->R + l * BENCH_PACKED(BENCH_M),
                               d->F + l * BENCH_M * n, d->S + l * BENCH_PACKED(n),
                               d->R_inverse + l * BENCH_PACKED(BENCH_M), work) != MK_OK)
            return 0;
    }
    d->tolerance[0] = tolerance;
    for (int t = 0; t < BENCH_MESSAGES; t++) {
        for (int l = 0; l < BENCH_SLOTS; l++) {
            for (int r = 0; r < BENCH_M; r++) d->y[t][l][r] = draw();
            for (int i = 0; i < n; i++) d->psi[t][l][i] = draw();
        }
    }
    const double *const from = (const double *)d;
    float *const to = (float *)&c->f;
    for (size_t i = 0; i < sizeof *d / sizeof *from; i++) to[i] = (float)from[i];
    return 1;
}

double bench_flops(int n, int robust, int evaluations) {
    const double N = n, m = BENCH_M, slots = BENCH_SLOTS, packed = N * (N + 1) / 2;
    const double slot = m * (2 * N + 1) + packed + 2 * N * m + 2 * m * m + m;    /* e, S, b, e' R^-1 e */
    const double factor = N * (N - 1) * (N - 2) / 3 + 2 * N * (N - 1) + 2 * N; /* L D L' with its pivot tests */
    const double forward = N * (N - 1);                                          /* one column */
    double sum = slots * slot + 2 * N * N;                                       /* and A x + r */
    sum += factor + N * forward + N * N + 2 * N * packed;                        /* A M A' + Q */
    sum += forward + N * (3 + 2 * N);                                            /* psi */
    sum += factor + N * (N - 1) * (N - 2) / 3 + N * (N - 1) / 2 + (N - 1) * N * (N + 1) / 3; /* P^-1 */
    sum += slots * 2 * N;                                                        /* diffusion */
    if (robust && n <= 6) {
        sum += N * (N - 1) * (N - 2) / 2 + 7 * N * (N - 1) / 2 + 8 * N + 45; /* tr P^2, tr P^3 and the first guess */
        sum += 4 * N + (n == 6 ? 2 * packed : 0) + 12;                       /* coefficients */
        sum += evaluations * 110.0 + 15 + N;
    } else if (robust) {
        sum += 4 * N * N * N / 3 + 6 * N * N + packed;         /* tridiagonal form */
        sum += evaluations * (32 * N + 50) + 10 * N + 30;
    }
    return sum;
}
