/* SPDX-License-Identifier: MIT */
#include "design/sized.h"

#include <meshkal/kernels.h>

#if defined(__clang__)
/* Loops over dimensions that are known at run time only stay loops, as they should. */
#pragma clang diagnostic ignored "-Wpass-failed"
#endif

#define ROWS(real, states)                                                                              \
    case states:                                                                                        \
        if (m == 1) return mk_inline_rkfd_incremental_##real(states, 1, slots, view, 0);                \
        if (m == 2) return mk_inline_rkfd_incremental_##real(states, 2, slots, view, 0);                \
        if (m == 3) return mk_inline_rkfd_incremental_##real(states, 3, slots, view, 0);                \
        break;

mk_status_t mk_sized_incremental_f32(int n, int m, int slots, const mk_rkfd_view_f32_t *view) {
    switch (n) {
        ROWS(f32, 2)
        ROWS(f32, 4)
        ROWS(f32, 6)
    default: break;
    }
    return mk_rkfd_incremental_f32(n, m, slots, view, 0);
}

mk_status_t mk_sized_incremental_f64(int n, int m, int slots, const mk_rkfd_view_f64_t *view) {
    switch (n) {
        ROWS(f64, 2)
        ROWS(f64, 4)
        ROWS(f64, 6)
    default: break;
    }
    return mk_rkfd_incremental_f64(n, m, slots, view, 0);
}

/* Not unrolled for the rest: the count is an argument, and loops stay loops. */
mk_status_t mk_sized_predict(int n, const double *A, const double *Q, double *Y, double *X, double *P) {
    switch (n) {
    case 2: return mk_robust_predict_f64(2, A, Q, Y, X, P);
    case 4: return mk_robust_predict_f64(4, A, Q, Y, X, P);
    case 6: return mk_robust_predict_f64(6, A, Q, Y, X, P);
    default: return mk_robust_predict_f64(n, A, Q, Y, X, P);
    }
}

mk_status_t mk_sized_information(int n, const double *P, double c, double *Z, double *theta, double *work) {
    int iterations;
    switch (n) {
    case 2: return mk_robust_information_f64(2, P, c, Z, theta, &iterations, work);
    case 4: return mk_robust_information_f64(4, P, c, Z, theta, &iterations, work);
    case 6: return mk_robust_information_f64(6, P, c, Z, theta, &iterations, work);
    default: return mk_robust_information_f64(n, P, c, Z, theta, &iterations, work);
    }
}

int mk_sized_inverse(int n, double *S, double *K, double *Z) {
    switch (n) {
    case 2: return mk_inverse_f64(2, S, K, Z);
    case 4: return mk_inverse_f64(4, S, K, Z);
    case 6: return mk_inverse_f64(6, S, K, Z);
    default: return mk_inverse_f64(n, S, K, Z);
    }
}
