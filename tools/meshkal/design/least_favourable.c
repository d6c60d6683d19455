/* SPDX-License-Identifier: MIT */
#include "design/least_favourable.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "design/design.h"
#include "design/sized.h"

#define MK_AT(i, j) ((i) * ((i) + 1) / 2 + (j))

static size_t packed(int n) { return (size_t)MK_PACKED(n); }

/* S = root root' with root lower triangular (n x n), S packed and positive semidefinite: a pivot within rounding of zero gives a zero
   column. */
static void root_lower(int n, const double *S, double *root) {
    memset(root, 0, (size_t)(n * n) * sizeof *root);
    for (int j = 0; j < n; j++) {
        double pivot = S[MK_AT(j, j)];
        for (int k = 0; k < j; k++) pivot -= root[j * n + k] * root[j * n + k];
        if (!(pivot > n * DBL_EPSILON * S[MK_AT(j, j)])) continue;
        root[j * n + j] = sqrt(pivot);
        for (int i = j + 1; i < n; i++) {
            double sum = S[MK_AT(i, j)];
            for (int k = 0; k < j; k++) sum -= root[i * n + k] * root[j * n + k];
            root[i * n + j] = sum / root[j * n + j];
        }
    }
}

/* G = U U' with U upper triangular, in place of G (n x n), whose diagonal is at most 1: with it L U^-T stays lower triangular. 1, or 0:
   not positive definite. */
static int root_upper(int n, double *G) {
    for (int j = n - 1; j >= 0; j--) {
        double pivot = G[j * n + j];
        for (int k = j + 1; k < n; k++) pivot -= G[j * n + k] * G[j * n + k];
        if (!(pivot > n * DBL_EPSILON)) return 0;
        G[j * n + j] = sqrt(pivot);
        for (int i = 0; i < j; i++) {
            double sum = G[i * n + j];
            for (int k = j + 1; k < n; k++) sum -= G[i * n + k] * G[j * n + k];
            G[i * n + j] = sum / G[j * n + j];
        }
    }
    return 1;
}

/* Numbers of one step, before the adversary: V, Ag, MA and, in the place of N, Z. scratch: 3 packed matrices and two of n x n. */
static void take_step(const mk_least_favourable_t *model, const mk_recursion_t *r, int t, double *scratch) {
    const int n = model->n;
    const size_t square = (size_t)(n * n), at = (size_t)t * square;
    double *Z = model->N + at, *MA = model->MA + at, *Y = scratch, *T = scratch + 3 * packed(n);
    mk_recursion_gain(r, MA, model->Ag + at, scratch);
    memcpy(Y, r->W, packed(n) * sizeof *Y);
    (void)mk_sized_inverse(n, Y, Y + packed(n), model->V + (size_t)t * packed(n));
    mk_unpack(n, r->S, Z);
    mk_multiply(n, Z, MA, T);
    mk_multiply_left_transposed(n, MA, T, Z);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) Z[i * n + j] = Z[j * n + i] = 0.5 * (Z[i * n + j] + Z[j * n + i]) + r->Q[MK_AT(i, j)];
}

/* From Z, in the place of N, and Oi of the step after: N and its root, and Oi of the step. scratch: packed + 2 n x n numbers. 0: not
   positive definite. */
static int step_back(const mk_least_favourable_t *model, int t, double *Oi, double *scratch) {
    const int n = model->n;
    const size_t square = (size_t)(n * n), at = (size_t)t * square;
    double *N = model->N + at, *root = model->root_N + at, *L = scratch, *G = L + square;
    for (int i = 0; i < n; i++) Oi[MK_AT(i, i)] += model->theta[t];
    root_lower(n, Oi, L);
    /* N = (W^-1 - Z)^-1 = L (I - L' Z L)^-1 L' */
    mk_multiply(n, N, L, root);
    mk_multiply_left_transposed(n, L, root, G);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) G[i * n + j] = G[j * n + i] = (i == j) - 0.5 * (G[i * n + j] + G[j * n + i]);
    if (!root_upper(n, G)) return 0;
    for (int i = 0; i < n; i++)
        for (int j = n - 1; j >= 0; j--) {
            double sum = L[i * n + j];
            for (int k = j + 1; k <= i; k++) sum -= root[i * n + k] * G[j * n + k];
            root[i * n + j] = j > i ? 0.0 : sum / G[j * n + j];
        }
    mk_multiply_transposed(n, root, root, N);
    mk_multiply_left_transposed(n, root, model->Ag + at, G);
    mk_multiply_left_transposed(n, G, G, L);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) Oi[MK_AT(i, j)] = L[i * n + j];
    return 1;
}

int mk_least_favourable_make(mk_least_favourable_t *model, const mk_scenario_t *s, double tolerance, int horizon, mk_error_t *error) {
    const int n = s->n;
    const size_t steps = (size_t)horizon + 1, square = (size_t)(n * n);
    double *scratch = mk_allocate(4 * packed(n) + 2 * square, sizeof *scratch), *Oi = scratch + 3 * packed(n) + 2 * square;
    mk_recursion_t r;
    int good = 1;
    model->n = n;
    model->horizon = horizon;
    model->Ag = mk_allocate(steps * (4 * square + packed(n) + 1), sizeof *model->Ag);
    model->MA = model->Ag + steps * square;
    model->N = model->MA + steps * square;
    model->root_N = model->N + steps * square;
    model->V = model->root_N + steps * square;
    model->theta = model->V + steps * packed(n);
    mk_recursion_open(&r, s, tolerance);
    for (int k = 0; k < s->nodes; k++) mk_recursion_add(&r, &s->sensor[k]);
    for (int t = 0; t <= horizon && good; t++) {
        take_step(model, &r, t, scratch);
        good = mk_recursion_step(&r) || mk_fail(error, "tolerance %g: the centralised filter fails in step %d", tolerance, t);
        model->theta[t] = r.theta;
    }
    mk_recursion_close(&r);
    if (!(tolerance > 0.0)) memset(model->N, 0, steps * square * sizeof *model->N);
    for (int t = horizon; t >= 0 && good && tolerance > 0.0; t--)
        good = step_back(model, t, Oi, scratch) ||
               mk_fail(error, "tolerance %g: no least favourable model: its backward recursion from t = %d is not positive definite at step %d; "
                              "lower the tolerance (a shorter horizon does not help in general)", tolerance, horizon, t);
    free(scratch);
    if (!good) mk_least_favourable_free(model);
    return good;
}

void mk_least_favourable_free(mk_least_favourable_t *model) {
    free(model->Ag);
    memset(model, 0, sizeof *model);
}
