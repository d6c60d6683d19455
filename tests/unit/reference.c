/* SPDX-License-Identifier: MIT */
#include "reference.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <lapacke.h>

#define LARGEST (LARGEST_STACK > LARGEST_N ? LARGEST_STACK : LARGEST_N)

/* result (rows x columns) := A (rows x inner) B (inner x columns); B is read transposed if `transposed`. */
static void multiply(int rows, int inner, int columns, const double *A, const double *B, int transposed, double *result) {
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            double sum = 0.0;
            for (int k = 0; k < inner; k++) sum += A[i * inner + k] * (transposed ? B[j * inner + k] : B[k * columns + j]);
            result[i * columns + j] = sum;
        }
    }
}

static void transpose(int rows, int columns, const double *A, double *result) {
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) result[j * rows + i] = A[i * columns + j];
}

void reference_inverse(int n, const double *S, double *result) {
    memcpy(result, S, (size_t)(n * n) * sizeof *S);
    int info = LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, result, n);
    if (info == 0) info = LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', n, result, n);
    if (info != 0) {
        fprintf(stderr, "reference: a matrix that should be positive definite is not (LAPACK info %d)\n", info);
        abort();
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) result[j * n + i] = result[i * n + j];
}

void reference_eigenvalues(int n, const double *S, double *eigenvalues) {
    double copy[LARGEST_N * LARGEST_N];
    memcpy(copy, S, (size_t)(n * n) * sizeof *S);
    if (LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'N', 'L', n, copy, n, eigenvalues) != 0) abort();
}

/* t - log(1 + t) for t = w / (1 - w), 0 <= w < 1. The power series in w, sum over k of (k - 1) / k w^k, has positive terms only:
   nothing cancels where both parts of the closed form are nearly equal. */
static double gap(double w) {
    if (w > 0.25) return w / (1.0 - w) + log1p(-w);
    double sum = 0.0;
    for (int k = 32; k >= 2; k--) sum = sum * w + (k - 1.0) / k;
    return sum * w * w;
}

double reference_gamma(int n, const double *eigenvalues, double theta, double *slope) {
    double sum = 0.0, rise = 0.0;
    for (int i = 0; i < n; i++) {
        const double w = theta * eigenvalues[i], t = w / (1.0 - w);
        sum += gap(w > 0.0 ? w : 0.0);
        rise += t * t;
    }
    if (slope) *slope = rise;
    return sum;
}

double reference_theta(int n, const double *P, double c) {
    if (c == 0.0) return 0.0;
    double scaled[LARGEST_N * LARGEST_N], eigenvalues[LARGEST_N], largest = 0.0;
    int exponent;
    /* A power of two, which rounds nothing, keeps every scale away from overflow. */
    for (int i = 0; i < n; i++) largest = fmax(largest, P[i * n + i]);
    frexp(largest, &exponent);
    for (int i = 0; i < n * n; i++) scaled[i] = ldexp(P[i], -exponent);
    reference_eigenvalues(n, scaled, eigenvalues);
    double low = 0.0, high = 1.0 / eigenvalues[n - 1];
    for (;;) {
        /* Below the first bound the root may lie many decades down: halve the exponent there, the number later. */
        const double middle = low > 0.0 ? 0.5 * (low + high) : high * 0x1p-8;
        if (!(middle > low && middle < high)) break;
        const int below = eigenvalues[n - 1] * middle < 1.0 && reference_gamma(n, eigenvalues, middle, NULL) < c;
        if (below) low = middle;
        else high = middle;
    }
    return ldexp(low, -exponent);
}

void reference_start(const model_t *model, reference_t *state) {
    memset(state, 0, sizeof *state);
    memcpy(state->x, model->x0, sizeof state->x);
    memcpy(state->V, model->P0, sizeof state->V);
}

/* C and R of everything that arrived, one below the other, and the innovation y - C x. Returns the rows. */
static int stack(const model_t *model, const double *const *y, const double *x, double *C, double *R, double *e) {
    const int n = model->n;
    int rows = 0, place = 0;
    for (int l = 0; l < model->slots; l++)
        if (y[l]) rows += model->rows[l];
    memset(R, 0, (size_t)(rows * rows) * sizeof *R);
    for (int l = 0; l < model->slots; l++) {
        if (!y[l]) continue;
        for (int i = 0; i < model->rows[l]; i++, place++) {
            e[place] = y[l][i];
            for (int j = 0; j < n; j++) {
                C[place * n + j] = model->C[l][i * n + j];
                e[place] -= C[place * n + j] * x[j];
            }
            for (int j = 0; j < model->rows[l]; j++) R[place * rows + place - i + j] = model->R[l][i * model->rows[l] + j];
        }
    }
    return rows;
}

/* result (rows x rows) := C V C' + R */
static void innovation_variance(int rows, int n, const double *C, const double *V, const double *R, double *result) {
    double CV[LARGEST_STACK * LARGEST_N];
    multiply(rows, n, n, C, V, 0, CV);
    multiply(rows, n, rows, CV, C, 1, result);
    for (int i = 0; i < rows * rows; i++) result[i] += R[i];
}

void reference_variance(const model_t *model, const reference_t *state, int slot, double *result) {
    innovation_variance(model->rows[slot], model->n, model->C[slot], state->V, model->R[slot], result);
}

int reference_innovations(const model_t *model, const reference_t *state, const double *const *y, double *e, double *result) {
    double C[LARGEST_STACK * LARGEST_N], R[LARGEST * LARGEST];
    const int rows = stack(model, y, state->x, C, R, e);
    innovation_variance(rows, model->n, C, state->V, R, result);
    return rows;
}

void reference_incremental(const model_t *model, reference_t *state, const double *const *y, const double *input, double c) {
    const int n = model->n;
    double C[LARGEST_STACK * LARGEST_N], R[LARGEST * LARGEST], e[LARGEST_STACK];
    double Ct[LARGEST_N * LARGEST_STACK], R_inverse[LARGEST * LARGEST], F[LARGEST_N * LARGEST_STACK], E[LARGEST * LARGEST];
    double M[LARGEST_N * LARGEST_N], W[LARGEST_N * LARGEST_N], AM[LARGEST_N * LARGEST_N], b[LARGEST_N] = {0.0}, gain[LARGEST_N];
    const int rows = stack(model, y, state->x, C, R, e);

    reference_inverse(n, state->V, W);
    state->nis = state->square = 0.0;
    state->nis_rows = rows;
    if (rows > 0) {
        double S[LARGEST_N * LARGEST_N];
        transpose(rows, n, C, Ct);
        reference_inverse(rows, R, R_inverse);
        multiply(n, rows, rows, Ct, R_inverse, 0, F);
        multiply(n, rows, n, F, C, 0, S);
        multiply(n, rows, 1, F, e, 0, b);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) W[i * n + j] += 0.5 * (S[i * n + j] + S[j * n + i]);
        double E_inverse[LARGEST * LARGEST];
        innovation_variance(rows, n, C, state->V, R, E);
        reference_inverse(rows, E, E_inverse);
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < rows; j++) state->nis += e[i] * E_inverse[i * rows + j] * e[j];
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < rows; j++) state->square += e[i] * R_inverse[i * rows + j] * e[j];
    }
    reference_inverse(n, W, M);

    multiply(n, n, n, model->A, M, 0, AM);
    multiply(n, n, 1, AM, b, 0, gain);
    multiply(n, n, 1, model->A, state->x, 0, state->psi);
    for (int i = 0; i < n; i++) state->psi[i] += (input ? input[i] : model->r[i]) + gain[i];

    multiply(n, n, n, AM, model->A, 1, state->P);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            state->P[i * n + j] = state->P[j * n + i] = 0.5 * (state->P[i * n + j] + state->P[j * n + i]) + model->Q[i * n + j];

    state->theta = reference_theta(n, state->P, c);
    reference_inverse(n, state->P, W);
    for (int i = 0; i < n; i++) W[i * n + i] -= state->theta;
    reference_inverse(n, W, state->V);
}

void reference_diffuse(const model_t *model, reference_t *state, const double *const *psi) {
    double total = model->weight[0];
    for (int l = 1; l < model->slots; l++)
        if (psi[l]) total += model->weight[l];
    for (int i = 0; i < model->n; i++) {
        double sum = model->weight[0] * state->psi[i];
        for (int l = 1; l < model->slots; l++)
            if (psi[l]) sum += model->weight[l] * psi[l][i];
        state->x[i] = total > 0.0 ? sum / total : state->psi[i];
    }
}

void reference_kalman(const model_t *model, const double *const *y, const double *input, double *x, double *V) {
    const int n = model->n;
    double C[LARGEST_STACK * LARGEST_N], R[LARGEST * LARGEST], e[LARGEST_STACK], E[LARGEST * LARGEST], E_inverse[LARGEST * LARGEST];
    double VC[LARGEST_N * LARGEST_STACK] = {0.0}, K[LARGEST_N * LARGEST_STACK], KC[LARGEST_N * LARGEST_N], M[LARGEST_N * LARGEST_N];
    double corrected[LARGEST_N], AM[LARGEST_N * LARGEST_N];
    const int rows = stack(model, y, x, C, R, e);
    memcpy(corrected, x, (size_t)n * sizeof *x);
    memcpy(M, V, (size_t)(n * n) * sizeof *V);
    if (rows > 0) {
        innovation_variance(rows, n, C, V, R, E);
        reference_inverse(rows, E, E_inverse);
        multiply(n, n, rows, V, C, 1, VC);
        multiply(n, rows, rows, VC, E_inverse, 0, K);
        multiply(n, rows, n, K, C, 0, KC);
        for (int i = 0; i < n; i++) {
            for (int k = 0; k < rows; k++) corrected[i] += K[i * rows + k] * e[k];
            for (int j = 0; j < n; j++)
                for (int k = 0; k < n; k++) M[i * n + j] -= KC[i * n + k] * V[k * n + j];
        }
    }
    multiply(n, n, 1, model->A, corrected, 0, x);
    for (int i = 0; i < n; i++) x[i] += input ? input[i] : model->r[i];
    multiply(n, n, n, model->A, M, 0, AM);
    multiply(n, n, n, AM, model->A, 1, V);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            V[i * n + j] = V[j * n + i] = 0.5 * (V[i * n + j] + V[j * n + i]) + model->Q[i * n + j];
}

double relative_error(int count, const double *a, const double *b, double floor) {
    double worst = 0.0, size = floor;
    for (int i = 0; i < count; i++) {
        const double error = fabs(a[i] - b[i]);
        if (!isfinite(error)) return HUGE_VAL;
        worst = fmax(worst, error);
        size = fmax(size, fabs(b[i]));
    }
    return size > 0.0 ? worst / size : worst;
}

void pack(int n, const double *full, double *packed) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) packed[i * (i + 1) / 2 + j] = full[i * n + j];
}

void unpack(int n, const double *packed, double *full) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) full[i * n + j] = full[j * n + i] = packed[i * (i + 1) / 2 + j];
}
