/* SPDX-License-Identifier: MIT */
#include "design/fixed_point.h"

#include <math.h>
#include <meshkal/kernels.h>

#include "design/sized.h"

#define HALF_ROOT 0.70710678118654752
#define ROOT 1.4142135623730950

/* Places in the work array. square: n x n, packed: n (n + 1) / 2, d of them. */
typedef struct {
    double *P, *W, *Y, *Z, *T, *m, *e, *scratch; /* packed */
    double *A, *L, *B, *G, *F, *H, *K;         /* square */
    double *J, *power;                         /* d x d */
    double *robust;
    double theta;
} newton_t;

static newton_t divide(int n, double *work) {
    const size_t packed = (size_t)MK_PACKED(n), square = (size_t)(n * n);
    newton_t w;
    double **const packed_places[] = {&w.P, &w.W, &w.Y, &w.Z, &w.T, &w.m, &w.e, &w.scratch};
    double **const square_places[] = {&w.A, &w.L, &w.B, &w.G, &w.F, &w.H, &w.K};
    for (size_t i = 0; i < sizeof packed_places / sizeof *packed_places; i++, work += packed) *packed_places[i] = work;
    for (size_t i = 0; i < sizeof square_places / sizeof *square_places; i++, work += square) *square_places[i] = work;
    w.J = work;
    w.power = w.J + MK_FIXED_POINT_MATRIX(n);
    w.robust = w.power + MK_FIXED_POINT_MATRIX(n);
    w.theta = 0.0;
    return w;
}

/* L L' = P, B = L^-1; both full, lower triangular. 1, or 0: not positive definite. */
MK_KERNEL int factor(int n, const double *P, double *L, double *B) {
    memset(L, 0, (size_t)(n * n) * sizeof *L);
    memset(B, 0, (size_t)(n * n) * sizeof *B);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = P[MK_AT(i, j)];
            for (int k = 0; k < j; k++) sum -= L[i * n + k] * L[j * n + k];
            if (i > j) L[i * n + j] = sum * B[j * n + j];
            else if (!(sum > 0.0)) return 0;
            else B[i * n + i] = 1.0 / (L[i * n + i] = sqrt(sum));
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            double sum = 0.0;
            for (int k = j; k < i; k++) sum += L[i * n + k] * B[k * n + j];
            B[i * n + j] = -sum * B[i * n + i];
        }
    return 1;
}

/* Z := S^-1, full, by way of L and B. 1, or 0: not positive definite. */
MK_KERNEL int invert(int n, const double *S, double *L, double *B, double *Z) {
    if (!factor(n, S, L, B)) return 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = i; k < n; k++) sum += B[k * n + i] * B[k * n + j];
            Z[i * n + j] = Z[j * n + i] = sum;
        }
    return 1;
}

/* C := A B, by rows. */
MK_KERNEL void product(int n, const double *MK_RESTRICT A, const double *MK_RESTRICT B, double *MK_RESTRICT C) {
    for (int i = 0; i < n; i++) {
        mk_row_scale_f64(n, A[i * n], B, C + i * n);
        for (int k = 1; k < n; k++) mk_row_add_f64(n, A[i * n + k], B + k * n, C + i * n);
    }
}

/* Coordinates of B D B' in the orthonormal basis of symmetric matrices: off-diagonal elements count sqrt(2). room: n x n. */
MK_KERNEL void whiten(int n, const double *B, const double *D, double *room, double *e) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k <= i; k++) sum += B[i * n + k] * D[k > j ? MK_AT(k, j) : MK_AT(j, k)];
            room[i * n + j] = sum;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k <= j; k++) sum += room[i * n + k] * B[j * n + k];
            e[MK_AT(i, j)] = i == j ? sum : ROOT * sum;
        }
}

/* P += L E L' for coordinates e. room: 2 n x n. */
MK_KERNEL void correct(int n, const double *L, const double *e, double *E, double *room, double *P) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) E[i * n + j] = E[j * n + i] = i == j ? e[MK_AT(i, i)] : HALF_ROOT * e[MK_AT(i, j)];
    product(n, L, E, room);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k <= j; k++) sum += room[i * n + k] * L[j * n + k];
            P[MK_AT(i, j)] += sum;
        }
}

/* m: coordinates of theta H^2 / tr H^2, whose product with those of E is -d theta. 1, or 0: theta is at or beyond the pole. */
MK_KERNEL int make_slope(int n, const newton_t *w) {
    double trace = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = i; k < n; k++) sum += w->L[k * n + i] * w->L[k * n + j];
            w->K[i * n + j] = w->K[j * n + i] = sum;
            w->scratch[MK_AT(i, j)] = (i == j) - w->theta * sum;
        }
    if (!invert(n, w->scratch, w->G, w->F, w->A)) return 0;
    product(n, w->A, w->K, w->H);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += w->H[i * n + k] * w->H[k * n + j];
            w->m[MK_AT(i, j)] = i == j ? sum : ROOT * sum;
            trace += i == j ? sum : 0.0;
        }
    for (int i = 0; i < MK_AT(n, 0); i++) w->m[i] *= w->theta / trace;
    return 1;
}

/* theta, J and the residual e = L^-1 (T(P) - P) L^-T at w->P. 1, or 0: not positive definite or no root. */
MK_KERNEL int linearise(int n, const mk_recursion_t *r, newton_t *w) {
    const int d = MK_AT(n, 0);
    if (mk_sized_information(n, w->P, r->tolerance, w->W, &w->theta, w->robust) != MK_OK) return 0;
    for (int i = 0; i < d; i++) w->Z[i] = w->Y[i] = w->W[i] + r->S[i];
    if (mk_sized_predict(n, r->A, r->Q, w->Y, w->A, w->T) != MK_OK) return 0;
    if (!factor(n, w->P, w->L, w->B)) return 0;
    for (int i = 0; i < d; i++) w->T[i] -= w->P[i];
    whiten(n, w->B, w->T, w->A, w->e);
    if (r->tolerance > 0.0) {
        if (!make_slope(n, w)) return 0;
    } else {
        memset(w->m, 0, (size_t)d * sizeof *w->m);
    }
    if (!invert(n, w->Z, w->G, w->F, w->H)) return 0;
    product(n, w->B, r->A, w->A);
    product(n, w->A, w->H, w->G);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k <= j; k++) sum += w->G[i * n + k] * w->B[j * n + k];
            w->F[i * n + j] = sum;
        }
    for (int p = 0; p < n; p++)
        for (int q = 0; q <= p; q++) {
            double gain = 0.0, *const row = w->J + MK_AT(p, q) * d;
            for (int k = 0; k < n; k++) gain += w->G[p * n + k] * w->G[q * n + k];
            gain *= p == q ? 1.0 : ROOT;
            const double *const Fp = w->F + p * n, *const Fq = w->F + q * n, scale = p == q ? HALF_ROOT : 1.0, diagonal = p == q ? 1.0 : ROOT;
            for (int i = 0; i < n; i++) {
                for (int j = 0; j < i; j++) row[MK_AT(i, j)] = scale * (Fp[i] * Fq[j] + Fp[j] * Fq[i]);
                row[MK_AT(i, i)] = diagonal * Fp[i] * Fq[i];
            }
            mk_row_subtract_f64(d, gain, w->m, row);
        }
    return 1;
}

/* e := (I - J)^-1 e by elimination with partial pivoting. 1, or 0: singular. */
MK_KERNEL int solve(int n, newton_t *w) {
    const int d = MK_AT(n, 0);
    double *const U = w->power, *const e = w->e;
    for (int i = 0; i < d * d; i++) U[i] = -w->J[i];
    for (int i = 0; i < d; i++) U[i * d + i] += 1.0;
    for (int k = 0; k < d; k++) {
        int at = k;
        double largest = fabs(U[k * d + k]);
        for (int i = k + 1; i < d; i++) {
            if (!(fabs(U[i * d + k]) > largest)) continue;
            largest = fabs(U[i * d + k]);
            at = i;
        }
        for (int j = k; j < d && at != k; j++) {
            const double swap = U[k * d + j];
            U[k * d + j] = U[at * d + j];
            U[at * d + j] = swap;
        }
        const double swap = e[k];
        e[k] = e[at];
        e[at] = swap;
        if (!(largest > 0.0)) return 0;
        const double scale = 1.0 / U[k * d + k];
        for (int i = k + 1; i < d; i++) {
            const double factor = U[i * d + k] * scale;
            mk_row_subtract_f64(d - k - 1, factor, U + k * d + k + 1, U + i * d + k + 1);
            e[i] -= factor * e[k];
        }
    }
    for (int k = d - 1; k >= 0; k--) {
        double sum = e[k];
        for (int j = k + 1; j < d; j++) sum -= U[k * d + j] * e[j];
        e[k] = sum / U[k * d + k];
    }
    return 1;
}

static double norm(int count, const double *values) {
    /* Four chains of additions, not one. */
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    for (int i = 0; i + 4 <= count; i += 4)
        for (int j = 0; j < 4; j++) sum[j] += values[i + j] * values[i + j];
    for (int i = count / 4 * 4; i < count; i++) sum[0] += values[i] * values[i];
    return sqrt((sum[0] + sum[1]) + (sum[2] + sum[3]));
}

/* C := B B, d x d in rows of `stride` >= d, a multiple of 8; B has an even number of rows, zero beyond d. Two rows and eight columns at a
   time stay in registers. */
MK_KERNEL void square(int d, int stride, const double *MK_RESTRICT B, double *MK_RESTRICT C) {
    for (int i = 0; i < d; i += 2)
        for (int j = 0; j < stride; j += 8) {
            double upper[8] = {0.0}, lower[8] = {0.0};
            for (int k = 0; k < d; k++) {
                mk_row_add_f64(8, B[i * stride + k], B + k * stride + j, upper);
                mk_row_add_f64(8, B[(i + 1) * stride + k], B + k * stride + j, lower);
            }
            mk_row_copy_f64(8, upper, C + i * stride + j);
            mk_row_copy_f64(8, lower, C + (i + 1) * stride + j);
        }
}

/* 1 if a power 2^k of J is below 1/2. Spoils J. */
MK_KERNEL int contracts(int n, newton_t *w) {
    const int d = MK_AT(n, 0);
    const int stride = MK_FIXED_POINT_STRIDE(n), rows = d + d % 2;
    double size = norm(d * d, w->J), *from = w->J, *to = w->power;
    for (int i = rows - 1; i >= 0; i--) {
        for (int j = stride - 1; j >= 0; j--) from[i * stride + j] = i < d && j < d ? from[i * d + j] : 0.0;
    }
    for (int k = 0; k < 14 && size >= 0.5 && size < 1e100; k++) {
        square(d, stride, from, to);
        double *const swap = from;
        from = to;
        to = swap;
        size = norm(rows * stride, from);
    }
    return size < 0.5;
}

MK_KERNEL int find(int n, mk_recursion_t *r, const double *earlier, double *work) {
    const int d = MK_AT(n, 0);
    newton_t w = divide(n, work);
    memcpy(w.P, r->P, (size_t)d * sizeof *w.P);
    double last = 2.0, size = 1.0;
    for (int i = 0; i < 8 && size > 1e-8; i++, last = size) {
        if (!linearise(n, r, &w) || !solve(n, &w)) return 0;
        size = norm(d, w.e);
        /* Below 1/2, P stays positive definite. */
        if (!(size <= 0.25 * last || size <= 1e-8)) return 0;
        correct(n, w.L, w.e, w.K, w.A, w.P);
    }
    if (!(size <= 1e-8)) return 0;
    for (int i = 0; i < d; i++) {
        w.T[i] = earlier[i] - w.P[i];
        w.Z[i] = r->P[i] - w.P[i];
    }
    whiten(n, w.B, w.T, w.A, w.e);
    const double before = norm(d, w.e);
    whiten(n, w.B, w.Z, w.A, w.e);
    if (!(norm(d, w.e) <= 0.5 * before) || !contracts(n, &w)) return 0;
    /* The recursion's own step has the last word. */
    if (mk_sized_information(n, w.P, r->tolerance, w.W, &w.theta, w.robust) != MK_OK) return 0;
    for (int i = 0; i < d; i++) w.Y[i] = w.W[i] + r->S[i];
    if (mk_sized_predict(n, r->A, r->Q, w.Y, w.A, w.T) != MK_OK) return 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            if (!(fabs(w.T[MK_AT(i, j)] - w.P[MK_AT(i, j)]) <= 1e-12 * sqrt(w.P[MK_AT(i, i)] * w.P[MK_AT(j, j)]))) return 0;
    if (mk_sized_information(n, w.T, r->tolerance, w.W, &w.theta, w.robust) != MK_OK) return 0;
    memcpy(r->P, w.T, (size_t)d * sizeof *w.T);
    memcpy(r->W, w.W, (size_t)d * sizeof *w.W);
    r->theta = w.theta;
    return 1;
}

static int find_2(mk_recursion_t *r, const double *earlier, double *work) { return find(2, r, earlier, work); }
static int find_4(mk_recursion_t *r, const double *earlier, double *work) { return find(4, r, earlier, work); }
static int find_6(mk_recursion_t *r, const double *earlier, double *work) { return find(6, r, earlier, work); }
static int find_any(mk_recursion_t *r, const double *earlier, double *work) { return find(r->n, r, earlier, work); }

int mk_fixed_point(mk_recursion_t *r, const double *earlier, double *work) {
    switch (r->n) {
    case 2: return find_2(r, earlier, work);
    case 4: return find_4(r, earlier, work);
    case 6: return find_6(r, earlier, work);
    default: return find_any(r, earlier, work);
    }
}
