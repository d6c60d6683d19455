/* SPDX-License-Identifier: MIT */
/* What the readings of meshkal/unscented.h say, for others than its own update: as innovations, and as information. */

mk_status_t MK_F(mk_unscented_innovations)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, MK_REAL *r, MK_REAL *S, uint8_t *rows) {
    MK_F_T(mk_updating) u;
    if (!r || !S || !rows) return MK_ERROR_ARGUMENT;
    if (!view->core->started) return MK_ERROR_ORDER;
    const MK_F_T(mk_unscented_kernels) kernels = MK_F(mk_shared_kernels)();
    MK_F(mk_updating_open)(n, m, slots, view, &kernels, &u);
    const mk_status_t status = MK_F(mk_stack_prior)(&u);
    if (status != MK_OK) return status;
    for (int l = 0; l < slots; l++) rows[l] = view->have[l] ? u.config->sensor[l].rows : 0;
    for (int i = 0; i < u.rows; i++) {
        r[i] = u.e[i];
        for (int j = 0; j <= i; j++) S[MK_AT(i, j)] = u.noise[MK_AT(i, j)] + MK_F(mk_stack_spread)(n, &u, i, j);
    }
    return MK_F(mk_all_finite)(MK_AT(u.rows, 0), S) ? MK_OK : MK_ERROR_NOT_FINITE;
}

mk_status_t MK_F(mk_unscented_contribution)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, int without_residual, MK_REAL *s,
                                            MK_REAL *S) {
    MK_F_T(mk_updating) u;
    if (!s || !S) return MK_ERROR_ARGUMENT;
    if (!view->core->started) return MK_ERROR_ORDER;
    const MK_F_T(mk_unscented_kernels) kernels = MK_F(mk_shared_kernels)();
    MK_F(mk_updating_open)(n, m, slots, view, &kernels, &u);
    const mk_status_t status = MK_F(mk_prepare)(&u);
    if (status != MK_OK) return status;
    if (u.rows > 0 && u.nis < MK_R(0.0)) u.nis = MK_F(mk_stack_distance)(&u, 0, u.rows);
    if (!MK_F(mk_stack_whiten)(n, &u, 0, u.rows, MK_R(1.0), !without_residual)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    /* Rows of B: H = D L^-1, whitened; b: nu + H x. */
    for (int r = 0; r < u.rows; r++) {
        MK_REAL *const h = u.B + r * n;
        MK_F(mk_solve_right)(n, u.L0, h);
        for (int i = 0; i < n; i++) u.b[r] += h[i] * u.x[i];
    }
    MK_REAL probe = MK_R(0.0);
    for (int pass = 0; pass < 2; pass++) /* looks before it writes */
        for (int i = 0; i < n; i++)
            for (int j = -1; j <= i; j++) {
                MK_REAL sum = MK_R(0.0);
                for (int r = 0; r < u.rows; r++) sum += u.B[r * n + i] * (j < 0 ? u.b[r] : u.B[r * n + j]);
                if (pass == 0) probe += sum * MK_R(0.0);
                else if (j < 0) s[i] = sum;
                else S[MK_AT(i, j)] = sum;
                if (pass == 1 && !(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
            }
    MK_F(mk_unscented_commit)(&u, 0, 0);
    return MK_OK;
}
