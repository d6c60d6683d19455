/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>

#include "dense.h"
#include "design/design.h"
#include "design/fixed_point.h"
#include "design/sized.h"

static size_t packed(int n) { return (size_t)MK_PACKED(n); }

/* room: SENSOR_ROOM(n, rows) numbers. */
#define SENSOR_ROOM(n, m) ((size_t)((m) * (n)) + packed(n) + 4 * packed(m))
static void sensor_matrices(int n, const mk_sensor_t *sensor, double *F, double *S, double *R_inverse, double *room) {
    const int m = sensor->rows;
    double *own_F = room, *own_S = own_F + m * n, *own_R = own_S + packed(n), *work = own_R + packed(m);
    /* The loader has checked R: this cannot fail. */
    (void)mk_rkfd_sensor_f64(n, m, m, sensor->C, sensor->R, F ? F : own_F, S ? S : own_S, R_inverse ? R_inverse : own_R, work);
}

void mk_sensor_matrices(int n, const mk_sensor_t *sensor, double *F, double *S, double *R_inverse) {
    double *room = mk_allocate(SENSOR_ROOM(n, sensor->rows), sizeof *room);
    sensor_matrices(n, sensor, F, S, R_inverse, room);
    free(room);
}

void mk_neighbourhood_information(const mk_scenario_t *s, long k, double *S) {
    int rows = 0;
    for (int i = s->first[k]; i < s->first[k + 1]; i++)
        if (s->sensor[s->slot[i]].rows > rows) rows = s->sensor[s->slot[i]].rows;
    double *one = mk_allocate(packed(s->n) + SENSOR_ROOM(s->n, rows), sizeof *one);
    memset(S, 0, packed(s->n) * sizeof *S);
    for (int i = s->first[k]; i < s->first[k + 1]; i++) {
        sensor_matrices(s->n, &s->sensor[s->slot[i]], NULL, one, NULL, one + packed(s->n));
        for (size_t j = 0; j < packed(s->n); j++) S[j] += one[j];
    }
    free(one);
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

/* Largest element of P - Q relative to standard deviations; scale: 1 / those of P. */
static double distance(int n, const double *P, const double *Q, const double *scale) {
    double largest = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            const double relative = fabs(P[MK_AT(i, j)] - Q[MK_AT(i, j)]) * (scale[i] * scale[j]);
            if (relative > largest) largest = relative;
        }
    return largest;
}

int mk_recursion_settle(mk_recursion_t *r, long limit) {
    /* Rounding keeps the last digits moving, more so at large c: a change that has stopped shrinking below 1e-11 is one too.
       Cycles, the way in which a large c fails, stay far above. */
    const size_t count = packed(r->n);
    const int leaps = r->n <= MK_FIXED_POINT_LARGEST_N;
    double *before = mk_allocate(2 * count + (size_t)r->n + (leaps ? MK_FIXED_POINT_WORK(r->n) : 0), sizeof *before);
    double *earlier = before + count, *scale = earlier + count, *work = scale + r->n;
    double least = (double)INFINITY;
    long since = 0, next = 16;
    int settled = 0;
    for (long step = 0; step < limit && !settled; step++) {
        memcpy(before, r->P, count * sizeof *before);
        if (!mk_recursion_step(r)) break;
        for (int i = 0; i < r->n; i++) scale[i] = 1.0 / sqrt(r->P[MK_AT(i, i)]);
        const double change = distance(r->n, r->P, before, scale);
        since = change < least ? 0 : since + 1;
        if (change < least) least = change;
        settled = step > 0 && (change < 1e-15 || (least < 1e-11 && since > 50));
        if (!leaps || settled || step + 1 < next) continue;
        /* Where P still moves by its own size, an attempt would be vain. */
        if (next > 16 && distance(r->n, r->P, earlier, scale) < 0.6) settled = mk_fixed_point(r, earlier, work);
        memcpy(earlier, r->P, count * sizeof *earlier);
        next += next / 2;
    }
    free(before);
    return settled;
}
