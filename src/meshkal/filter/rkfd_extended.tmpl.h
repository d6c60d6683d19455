/* SPDX-License-Identifier: MIT */
/* The robust filter linearised at its own estimate: meshkal/extended.h. */

/* The result of a function and its derivative at x; finite, or a status. */
static mk_status_t MK_F(mk_extended_linearise)(int n, int rows, const MK_F_T(mk_model) * model, MK_REAL dt, const MK_REAL *x, MK_REAL *y,
                                                  MK_REAL *J) {
    if (!model->function || !model->jacobian) return MK_ERROR_ARGUMENT;
    return MK_F(mk_derive)(n, rows, model, dt, x, y, J);
}

mk_status_t MK_F(mk_extended_observe)(int n, int m, const MK_F_T(mk_rkfd_view) * view, const MK_F_T(mk_extended) * model, int slot,
                                      const MK_REAL *z) {
    const MK_F_T(mk_rkfd) *const core = view->core;
    if (core->stage != 1) return MK_ERROR_ORDER;
    if (!model || slot < 0 || slot >= core->config->slots) return MK_ERROR_ARGUMENT;
    const MK_F_T(mk_sensor) *const sensor = &model->sensor[slot];
    const int rows = sensor->rows, packed = MK_AT(n, 0);
    if (!z || rows < 1 || rows > m || rows != core->config->rows[slot]) return MK_ERROR_ARGUMENT;
    if (view->have_y[slot] || !MK_F(mk_all_finite)(rows, z)) return MK_F(mk_rkfd_put)(n, m, view, slot, z, 1); /* which counts it */
    MK_REAL *const C = view->work, *const h = C + m * n, *const e = h + m, *const work = e + m;
    mk_status_t status = MK_F(mk_extended_linearise)(n, rows, &sensor->model, MK_R(0.0), view->x, h, C);
    if (status != MK_OK) return status;
    for (int i = rows * n; i < m * n; i++) C[i] = MK_R(0.0);
    MK_F(mk_space_difference)(sensor->model.space, rows, z, h, e);
    if (!MK_F(mk_all_finite)(rows, e)) return MK_ERROR_NOT_FINITE;
    status = MK_F(mk_rkfd_sensor)(n, m, rows, C, sensor->R, model->F + slot * m * n, model->S + slot * packed,
                                  model->R_inverse + slot * MK_AT(m, 0), work);
    if (status != MK_OK) return status;
    for (int i = 0; i < m * n; i++) model->C[slot * m * n + i] = C[i];
    return MK_F(mk_rkfd_put)(n, m, view, slot, e, 1);
}

mk_status_t MK_F(mk_extended_correct)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_F_T(mk_extended) * model) {
    MK_F_T(mk_rkfd) *const core = view->core;
    if (core->stage != 1) return MK_ERROR_ORDER;
    if (!model) return MK_ERROR_ARGUMENT;
    for (int i = 0; i < n * n; i++) model->A[i] = i % (n + 1) ? MK_R(0.0) : MK_R(1.0);
    for (int i = 0; i < MK_AT(n, 0); i++) model->Q[i] = MK_R(0.0);
    /* Nothing is predicted here, so there is no model to mistrust. */
    const MK_REAL tolerance = core->tolerance, theta = core->theta;
    core->tolerance = MK_R(0.0);
    const mk_status_t status = MK_F(mk_rkfd_incremental)(n, m, slots, view, 0);
    core->tolerance = tolerance;
    core->theta = theta;
    return status;
}

mk_status_t MK_F(mk_extended_propagate)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_F_T(mk_extended) * model, MK_REAL dt,
                                        const MK_REAL *Q) {
    MK_F_T(mk_rkfd) *const core = view->core;
    if (core->stage != 1) return MK_ERROR_ORDER;
    if (!model || !(dt >= MK_R(0.0))) return MK_ERROR_ARGUMENT;
    for (int l = 0; l < slots; l++)
        if (view->have_y[l]) return MK_ERROR_ORDER;
    const MK_F_T(mk_transition) *const transition = model->transition;
    if (!Q) Q = transition->Q;
    if (!Q) return MK_ERROR_ARGUMENT;
    if (!MK_F(mk_all_finite)(MK_AT(n, 0), Q)) return MK_ERROR_NOT_FINITE;
    MK_REAL *const J = view->work + MK_RKFD_WORK(n, m), *const g = J + n * n, *const input = g + n;
    if (transition->A) {
        for (int i = 0; i < n * n; i++) J[i] = transition->A[i];
    } else {
        const mk_status_t status = MK_F(mk_extended_linearise)(n, n, &transition->model, dt, view->x, g, J);
        if (status != MK_OK) return status;
    }
    for (int i = 0; i < n * n; i++) model->A[i] = J[i];
    for (int i = 0; i < MK_AT(n, 0); i++) model->Q[i] = Q[i];
    for (int i = 0; i < n; i++) {
        MK_REAL linear = MK_R(0.0);
        for (int j = 0; j < n; j++) linear += J[i * n + j] * view->x[j];
        input[i] = transition->A ? MK_R(0.0) : g[i] - linear;
    }
    const MK_F_T(mk_rkfd) before = *core;
    const mk_status_t status = MK_F(mk_rkfd_incremental)(n, m, slots, view, input);
    if (status != MK_OK) return status;
    for (int i = 0; i < n; i++) view->x[i] = view->psi[i];
    view->have_psi[0] = 0;
    core->stage = 1;
    core->nis = before.nis;
    core->nis_rows = before.nis_rows;
    core->measurements = before.measurements;
    core->steps_since_measurement = before.steps_since_measurement;
    core->faults = before.faults;
    core->rejected_now = before.rejected_now;
    return MK_OK;
}
