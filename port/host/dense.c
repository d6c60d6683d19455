/* SPDX-License-Identifier: MIT */
#include "dense.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

static double *doubles(int count) { return mk_allocate((size_t)count, sizeof(double)); }

void mk_unpack(int n, const double *S, double *full) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) full[i * n + j] = full[j * n + i] = S[i * (i + 1) / 2 + j];
}

void mk_multiply(int n, const double *A, const double *B, double *C) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += A[i * n + k] * B[k * n + j];
            C[i * n + j] = sum;
        }
}

void mk_multiply_transposed(int n, const double *A, const double *B, double *C) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += A[i * n + k] * B[j * n + k];
            C[i * n + j] = sum;
        }
}

void mk_multiply_left_transposed(int n, const double *A, const double *B, double *C) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += A[k * n + i] * B[k * n + j];
            C[i * n + j] = sum;
        }
}

int mk_eigen_symmetric(int n, const double *S, double *values, double *vectors) {
    double *full = vectors ? vectors : doubles(n * n);
    mk_unpack(n, S, full);
    /* Column order: the columns of the result are the rows of `vectors`. */
    const lapack_int info = LAPACKE_dsyev(LAPACK_COL_MAJOR, vectors ? 'V' : 'N', 'L', n, full, n, values);
    if (!vectors) free(full);
    return info == 0;
}

int mk_eigen_generalised(int n, const double *S, const double *B, double *values) {
    double *full = doubles(2 * n * n);
    mk_unpack(n, S, full);
    mk_unpack(n, B, full + n * n);
    const lapack_int info = LAPACKE_dsygv(LAPACK_COL_MAJOR, 1, 'N', 'L', n, full, n, full + n * n, n, values);
    free(full);
    return info == 0;
}

/* Orthonormal basis (rows, count of them returned) of the null space of the rows x n matrix M, which is overwritten: singular values up
   to 1e-8 of `size` count as 0. -1 if LAPACK gives up. */
static int null_space(int rows, int n, double *M, double size, double *basis) {
    const int few = rows < n ? rows : n;
    double *values = doubles(few), *right = doubles(n * n), *spare = doubles(few);
    const lapack_int info = LAPACKE_dgesvd(LAPACK_ROW_MAJOR, 'N', 'A', rows, n, M, n, values, NULL, 1, right, n, spare);
    int rank = 0;
    if (info == 0) {
        while (rank < few && values[rank] > 1e-8 * size) rank++;
        memcpy(basis, right + rank * n, (size_t)((n - rank) * n) * sizeof *basis);
    }
    free(values);
    free(right);
    free(spare);
    return info == 0 ? n - rank : -1;
}

static double norm(int count, const double *values) {
    double largest = 0.0, sum = 0.0;
    for (int i = 0; i < count; i++) largest = fmax(largest, fabs(values[i]));
    for (int i = 0; i < count && largest > 0.0; i++) sum += (values[i] / largest) * (values[i] / largest);
    return largest * sqrt(sum);
}

int mk_unobservable(int n, const double *A, const double *G) {
    double *basis = doubles(n * n), *image = doubles(n * n), *inner = doubles(n * n), *next = doubles(n * n), *along = doubles(n);
    mk_unpack(n, G, image);
    int count = null_space(n, n, image, norm(n * n, image), basis);
    /* Shrink the null space to the part that A maps into it, until A maps all of it into itself. */
    while (count > 0) {
        /* Columns of `image`: the part of A b outside the space, for each basis vector b. */
        for (int b = 0; b < count; b++) {
            for (int i = 0; i < n; i++) {
                double sum = 0.0;
                for (int j = 0; j < n; j++) sum += A[i * n + j] * basis[b * n + j];
                image[i * count + b] = sum;
            }
            for (int c = 0; c < count; c++) {
                along[c] = 0.0;
                for (int i = 0; i < n; i++) along[c] += basis[c * n + i] * image[i * count + b];
            }
            for (int i = 0; i < n; i++)
                for (int c = 0; c < count; c++) image[i * count + b] -= along[c] * basis[c * n + i];
        }
        const int kept = null_space(n, count, image, norm(n * n, A), inner);
        if (kept < 0 || kept == count) {
            count = kept;
            break;
        }
        for (int b = 0; b < kept; b++)
            for (int j = 0; j < n; j++) {
                next[b * n + j] = 0.0;
                for (int c = 0; c < count; c++) next[b * n + j] += inner[b * count + c] * basis[c * n + j];
            }
        memcpy(basis, next, (size_t)(kept * n) * sizeof *basis);
        count = kept;
    }
    free(basis);
    free(image);
    free(inner);
    free(next);
    free(along);
    return count;
}
