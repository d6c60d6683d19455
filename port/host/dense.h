/* SPDX-License-Identifier: MIT */
/* Dense float64 algebra of the central unit, on LAPACKE. Symmetric matrices are packed as in <meshkal/base.h>. */
#ifndef MESHKAL_HOST_DENSE_H
#define MESHKAL_HOST_DENSE_H

/* S as a full n x n matrix. */
void mk_unpack(int n, const double *S, double *full);

/* C = A B, A B' and A' B, all n x n; C is neither A nor B. */
void mk_multiply(int n, const double *A, const double *B, double *C);
void mk_multiply_transposed(int n, const double *A, const double *B, double *C);
void mk_multiply_left_transposed(int n, const double *A, const double *B, double *C);

/* Eigenvalues of S, ascending, and, where vectors is not null, eigenvectors as its rows (n x n). 1, or 0 if LAPACK gives up. */
int mk_eigen_symmetric(int n, const double *S, double *values, double *vectors);

/* Eigenvalues of B^-1 S, S symmetric, B symmetric positive definite. 1 or 0. */
int mk_eigen_generalised(int n, const double *S, const double *B, double *values);

/* Dimension of the largest A-invariant subspace on which the symmetric positive semidefinite G vanishes: the states that an
   observer with information G does not see. Rank decisions at 1e-8 of the norm of G, then of A. -1 if LAPACK gives up. */
int mk_unobservable(int n, const double *A, const double *G);

#endif
