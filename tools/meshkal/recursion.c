/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>

#include "dense.h"
#include "design.h"
#include "sized.h"

static size_t packed(int n) { return (size_t)MK_PACKED(n); }

void mk_sensor_matrices(int n, const mk_sensor_t *sensor, double *F, double *S, double *R_inverse) {
    const int m = sensor->rows;
    double *room = mk_allocate((size_t)(m * n) + packed(n) + 4 * packed(m), sizeof *room);
    double *own_F = room, *own_S = own_F + m * n, *own_R = own_S + packed(n), *work = own_R + packed(m);
    /* The loader has checked R: this cannot fail. */
    (void)mk_rkfd_sensor_f64(n, m, m, sensor->C, sensor->R, F ? F : own_F, S ? S : own_S, R_inverse ? R_inverse : own_R, work);
    free(room);
}

void mk_recursion_open(mk_recursion_t *r, const mk_scenario_t *s, double tolerance) {
    const int n = s->n;
    r->n = n;
    r->A = s->A;
    r->Q = s->Q;
    r->tolerance = tolerance;
    r->theta = 0.0;
    r->S = mk_allocate(3 * packed(n) + 4 * packed(n) + (size_t)(n * n) + MK_ROBUST_WORK((size_t)n), sizeof *r->S);
    r->W = r->S + packed(n);
    r->P = r->W + packed(n);
    r->work = r->P + packed(n);
    memcpy(r->P, s->P0, packed(n) * sizeof *r->P);
    memcpy(r->work, s->P0, packed(n) * sizeof *r->P);
    (void)mk_inverse_f64(n, r->work, r->work + packed(n), r->W);
}

void mk_recursion_close(mk_recursion_t *r) { free(r->S); }

void mk_recursion_add(mk_recursion_t *r, const mk_sensor_t *sensor) {
    mk_sensor_matrices(r->n, sensor, NULL, r->work, NULL);
    for (size_t i = 0; i < packed(r->n); i++) r->S[i] += r->work[i];
}

void mk_recursion_gain(const mk_recursion_t *r, double *MA, double *map, double *scratch) {
    const int n = r->n;
    double *Y = scratch, *K = Y + packed(n), *M = K + packed(n), *full = M + packed(n), *T = full + n * n;
    for (size_t i = 0; i < packed(n); i++) Y[i] = r->W[i] + r->S[i];
    (void)mk_sized_inverse(n, Y, K, M); /* the step finds out whether Y is positive definite */
    mk_unpack(n, M, full);
    mk_multiply_transposed(n, full, r->A, MA);
    mk_multiply_transposed(n, r->A, full, T);
    mk_unpack(n, r->W, full);
    mk_multiply(n, T, full, map);
}

int mk_recursion_step(mk_recursion_t *r) {
    const size_t count = packed(r->n);
    double *Y = r->work, *Z = Y + count, *X = Z + count, *work = X + r->n * r->n, theta;
    for (size_t i = 0; i < count; i++) Y[i] = r->W[i] + r->S[i];
    if (mk_sized_predict(r->n, r->A, r->Q, Y, X, r->P) != MK_OK) return 0;
    if (mk_sized_information(r->n, r->P, r->tolerance, Z, &theta, work) != MK_OK) return 0;
    memcpy(r->W, Z, count * sizeof *Z);
    r->theta = theta;
    return 1;
}

int mk_recursion_settle(mk_recursion_t *r, long limit) {
    /* Rounding keeps the last digits moving, more so at large c: a change that has stopped shrinking below 1e-11 is one too.
       Cycles, the way in which a large c fails, stay far above. */
    const size_t count = packed(r->n);
    double *before = mk_allocate(count, sizeof *before), least = (double)INFINITY;
    long since = 0;
    int settled = 0;
    for (long step = 0; step < limit && !settled; step++) {
        memcpy(before, r->P, count * sizeof *before);
        if (!mk_recursion_step(r)) break;
        double change = 0.0;
        for (int i = 0; i < r->n; i++)
            for (int j = 0; j <= i; j++) {
                const double size = sqrt(r->P[MK_AT(i, i)] * r->P[MK_AT(j, j)]);
                change = fmax(change, fabs(r->P[MK_AT(i, j)] - before[MK_AT(i, j)]) / size);
            }
        since = change < least ? 0 : since + 1;
        least = fmin(least, change);
        settled = step > 0 && (change < 1e-15 || (least < 1e-11 && since > 50));
    }
    free(before);
    return settled;
}
