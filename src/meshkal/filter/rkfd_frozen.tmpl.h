/* SPDX-License-Identifier: MIT */
/* The incremental step, full or frozen. With the gain of the limit (spec 1.4) stored, all that is left of a step is

       psi = Phi x + r + sum G_l y_l,     Phi = A - sum G_l C_l. */

/* 1 if every slot holds a reading, not an innovation. Four flags at a time: every byte of the word is 1, whatever the byte order. */
MK_KERNEL int MK_F(mk_rkfd_complete)(int slots, const uint8_t *have_y) {
    uint32_t missing = 0;
    int l = 0;
    MK_UNROLL for (; l + 4 <= slots; l += 4) {
        uint32_t four;
        memcpy(&four, have_y + l, sizeof four);
        missing |= four ^ UINT32_C(0x01010101);
    }
    MK_UNROLL for (; l < slots; l++) missing |= have_y[l] ^ 1u;
    return missing == 0;
}

MK_KERNEL mk_status_t MK_F(mk_rkfd_frozen)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *input) {
    MK_F_T(mk_rkfd) *const core = view->core;
    const MK_F_T(mk_rkfd_steady) *const steady = core->config->steady;
    MK_REAL *const MK_RESTRICT psi = view->work;
    MK_F(mk_columns)(n, input ? input : core->config->input, n, view->x, steady->Phi, slots * m, view->y, steady->G, psi);
    MK_REAL probe = psi[0] * MK_R(0.0);
    MK_UNROLL for (int i = 1; i < n; i++) probe += psi[i] * MK_R(0.0);
    if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;

    MK_UNROLL for (int i = 0; i < n; i++) view->psi[i] = psi[i];
    view->have_psi[0] = 1;
    for (int l = 0; l < slots; l++) view->have_y[l] = 0;
    core->theta = steady->theta;
    core->trace_P = steady->trace_P;
    core->nis = MK_R(0.0);
    core->nis_rows = 0;
    core->iterations = 0;
    core->measurements = (uint16_t)slots;
    core->steps_since_measurement = 0;
    core->faults = (uint16_t)(core->rejected_now * MK_FAULT_REJECTED);
    core->rejected_now = 0;
    core->stage = 2;
    core->steady--;
    core->frozen = 1;
    return MK_OK;
}

/* Whether the step to come is frozen: then its stage is right, too. */
MK_KERNEL int MK_F(mk_rkfd_is_frozen)(int slots, const MK_F_T(mk_rkfd) * core, const uint8_t *have_y) {
    return core->steady && core->stage == 1 && MK_F(mk_rkfd_complete)(slots, have_y);
}

/* Whether mk_rkfd_settle is to be called after the full step to come. */
MK_KERNEL int MK_F(mk_rkfd_may_freeze)(const MK_F_T(mk_rkfd) * core) { return core->stage == 1 && core->config->steady; }

MK_KERNEL mk_status_t MK_F(mk_inline_rkfd_incremental)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view,
                                                       const MK_REAL *input) {
    if (MK_F(mk_rkfd_is_frozen)(slots, view->core, view->have_y)) return MK_F(mk_rkfd_frozen)(n, m, slots, view, input);
    const int may_freeze = MK_F(mk_rkfd_may_freeze)(view->core), complete = may_freeze && MK_F(mk_rkfd_complete)(slots, view->have_y);
    const mk_status_t status = MK_F(mk_rkfd_robust)(n, m, slots, view, input);
    if (may_freeze && status == MK_OK) MK_F(mk_rkfd_settle)(n, complete, view->core, view->W, view->work);
    return status;
}
