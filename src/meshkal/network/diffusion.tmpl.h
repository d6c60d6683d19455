/* SPDX-License-Identifier: MIT */
/* The diffusion step of spec 1.4: a convex combination of the intermediate estimates that arrived. */

MK_KERNEL mk_status_t MK_F(mk_inline_rkfd_diffuse)(int n, int slots, const MK_F_T(mk_rkfd_view) * view) {
    MK_F_T(mk_rkfd) *const core = view->core;
    if (core->stage != 2) return MK_ERROR_ORDER;
    const MK_REAL *const weight = core->config->weight;
    MK_REAL *const MK_RESTRICT x = view->work; /* until it is known to be finite */
    const MK_REAL *const MK_RESTRICT psi = view->psi;
    MK_REAL total = MK_R(0.0);
    unsigned used = 0;
    for (int l = 0; l < slots; l++) {
        if (!view->have_psi[l]) continue;
        total += weight[l];
        used++;
    }
    if (total > MK_R(0.0)) {
        /* With everything there the weights already sum to one: dividing by their rounded sum would only add an error. */
        const MK_REAL scale = used == (unsigned)slots ? MK_R(1.0) : MK_R(1.0) / total;
        MK_UNROLL for (int i = 0; i < n; i++) x[i] = MK_R(0.0);
        for (int l = 0; l < slots; l++) {
            if (!view->have_psi[l]) continue;
            MK_F(mk_load_add)(n, weight[l] * scale, psi + l * n, x);
        }
    } else {
        MK_F(mk_load)(n, psi, x);
    }
    MK_REAL probe = x[0] * MK_R(0.0);
    MK_UNROLL for (int i = 1; i < n; i++) probe += x[i] * MK_R(0.0);
    if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    MK_UNROLL for (int i = 0; i < n; i++) view->x[i] = x[i];
    for (int l = 0; l < slots; l++) view->have_psi[l] = 0;
    core->estimates = (uint16_t)used;
    if (used < (unsigned)slots) core->faults |= MK_FAULT_ESTIMATE_MISSING;
    if (core->rejected_now) core->faults |= MK_FAULT_REJECTED;
    core->rejected_now = 0;
    core->steps++;
    core->stage = 1;
    return MK_OK;
}
