/* SPDX-License-Identifier: MIT */
/* The public functions of <meshkal/gamma.h>. */

int MK_F(mk_gamma_root)(int n, const MK_REAL *P, MK_REAL c, MK_REAL *theta, MK_REAL *work) {
    return MK_F(mk_inline_gamma_root)(n, P, c, theta, work);
}

int MK_F(mk_gamma)(int n, const MK_REAL *P, MK_REAL theta, MK_REAL *gamma, MK_REAL *slope, MK_REAL *work) {
    const MK_REAL *const a = work + MK_AT(n, 0), *const b2 = a + n;
    const MK_REAL scale = MK_F(mk_scaled_tridiagonal)(n, P, work);
    MK_REAL value, rise;
    if (!(scale > MK_R(0.0) && theta >= MK_R(0.0))) return 0;
    if (!MK_F(mk_gamma_tridiagonal)(n, a, b2, theta / scale, &value, &rise)) return 0;
    *gamma = value;
    if (slope) *slope = rise;
    return 1;
}
