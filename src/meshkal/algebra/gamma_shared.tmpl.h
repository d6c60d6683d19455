/* SPDX-License-Identifier: MIT */
/* The public functions of <meshkal/gamma.h>. */

MK_REAL MK_F(mk_log_gap_far)(MK_REAL t) { return t - MK_F(mk_log)(MK_R(1.0) + t); }

int MK_F(mk_positive_definite)(int n, const MK_REAL *S, MK_REAL *work) {
    for (int i = 0; i < MK_AT(n, 0); i++) work[i] = S[i];
    return MK_F(mk_ldl)(n, work);
}

int MK_F(mk_gamma_search)(int n, const MK_REAL *P, MK_REAL c, MK_REAL *theta, MK_REAL *work) {
    return MK_F(mk_inline_gamma_root)(n, P, c, theta, work);
}

int MK_F(mk_gamma_root)(int n, const MK_REAL *P, MK_REAL c, MK_REAL *theta, MK_REAL *work) {
    /* Below the pole the search itself cannot tell. */
    if (!MK_F(mk_positive_definite)(n, P, work)) return 0;
    return MK_F(mk_gamma_search)(n, P, c, theta, work);
}

int MK_F(mk_gamma)(int n, const MK_REAL *P, MK_REAL theta, MK_REAL *gamma, MK_REAL *slope, MK_REAL *work) {
    const MK_REAL *const a = work + MK_AT(n, 0), *const b2 = a + n;
    if (!MK_F(mk_positive_definite)(n, P, work)) return 0;
    const MK_REAL scale = MK_F(mk_scaled_tridiagonal)(n, P, work);
    MK_REAL value, rise, sum;
    if (!(scale > MK_R(0.0) && theta >= MK_R(0.0))) return 0;
    if (!MK_F(mk_gamma_tridiagonal)(n, a, b2, theta / scale, &value, &rise, &sum)) return 0;
    *gamma = value;
    if (slope) *slope = rise;
    return 1;
}
