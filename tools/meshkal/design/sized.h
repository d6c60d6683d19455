/* SPDX-License-Identifier: MIT */
/* The library's hot kernels for dimensions known at run time, with the common ones compiled in: the same bits as the shared kernels, several
   times faster, which a network of thousands of nodes feels. */
#ifndef MESHKAL_SIZED_H
#define MESHKAL_SIZED_H

#include <meshkal/rkfd.h>

mk_status_t mk_sized_incremental_f32(int n, int m, int slots, const mk_rkfd_view_f32_t *view);
mk_status_t mk_sized_incremental_f64(int n, int m, int slots, const mk_rkfd_view_f64_t *view);

/* mk_robust_predict and mk_robust_information of the filter's step. work: MK_ROBUST_WORK(n) numbers. */
mk_status_t mk_sized_predict(int n, const double *A, const double *Q, double *Y, double *X, double *P);
mk_status_t mk_sized_information(int n, const double *P, double c, double *Z, double *theta, double *work);

/* mk_inverse of the kernels: Z := S^-1, S and K (packed) spoilt. 1, or 0: S is not positive definite. */
int mk_sized_inverse(int n, double *S, double *K, double *Z);

#endif
