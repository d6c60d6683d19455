/* SPDX-License-Identifier: MIT */
/* The node's part of the steps: gates before them, the count of steps and the way back from being behind after them. */

/* e' E^-1 e of a reading, the largest number where it cannot be had. */
static MK_REAL MK_F(mk_node_distance)(int n, int m, const MK_F_T(mk_node_view) * view, int slot) {
    const int rows = view->filter.core->config->rows[slot];
    MK_REAL *const e = view->filter.work + MK_RKFD_PREDICT_WORK(n, m), *const E = e + m;
    if (MK_F(mk_rkfd_predict)(n, m, &view->filter, slot, e, E) != MK_OK || !MK_F(mk_ldl)(rows, E)) return MK_LARGEST;
    MK_F(mk_ldl_forward)(rows, 1, E, e);
    MK_REAL sum = MK_R(0.0);
    for (int r = 0; r < rows; r++) sum += e[r] * e[r] * E[MK_AT(r, r)];
    return sum <= MK_LARGEST ? sum : MK_LARGEST;
}

void MK_F(mk_node_judge_readings)(int n, int m, int slots, const MK_F_T(mk_node_view) * view) {
    MK_F_T(mk_node) *const node = view->node;
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    const MK_F_T(mk_node_gate) *const gate = node->config->gate;
    if (filter->core->stage != 1) return;
    node->gated = 0;
    int judged = 0, refused = 0;
    for (int l = 0; l < slots; l++) {
        if (!filter->have_y[l] || !(gate->reading[l] > MK_R(0.0)) || filter->core->config->rows[l] == 0) continue;
        MK_F_T(mk_gate_record) unseen = {0, 0, 0, 0, 0, 0}, *const record = gate->record ? gate->record + l : &unseen;
        judged++;
        if (MK_F(mk_gate_judge)(MK_GATE_SKIP, gate->reading[l], MK_F(mk_node_distance)(n, m, view, l), record) > MK_R(0.0)) continue;
        refused++;
        filter->have_y[l] |= 4; /* until all have been judged */
    }
    node->gated_steps = 2 * refused > judged ? (uint16_t)(node->gated_steps + 1) : judged ? 0 : node->gated_steps;
    const int back = gate->patience && node->gated_steps > gate->patience &&
                     MK_F(mk_invert)(n, filter->core->config->P0, filter->W, filter->work) == MK_OK;
    for (int l = 0; l < slots; l++) {
        if (!(filter->have_y[l] & 4)) continue;
        filter->have_y[l] = back ? filter->have_y[l] & 3 : 0;
    }
    if (back) {
        filter->core->steady = 0; /* W is another */
        node->gated_steps = 0;
        node->reinitialised++;
    } else {
        node->gated = (uint16_t)refused;
        node->counts[MK_ERROR_GATED] += (uint32_t)refused;
    }
}

void MK_F(mk_node_judge_estimates)(int n, int slots, const MK_F_T(mk_node_view) * view) {
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    const MK_REAL limit = view->node->config->gate->estimate;
    if (filter->core->stage != 2 || !(limit > MK_R(0.0))) return;
    for (int l = 1; l < slots; l++) {
        if (!filter->have_psi[l]) continue;
        const MK_REAL *const psi = filter->psi + l * n;
        MK_REAL sum = MK_R(0.0);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                sum += (psi[i] - filter->psi[i]) * filter->W[MK_PLACE(i, j)] * (psi[j] - filter->psi[j]);
        if (sum <= limit) continue;
        filter->have_psi[l] = 0;
        view->node->gated++;
        view->node->counts[MK_ERROR_GATED]++;
    }
}

void MK_F(mk_node_end_step)(int slots, const MK_F_T(mk_node_view) * view) {
    MK_F_T(mk_node) *const node = view->node;
    node->step++;
    node->behind = mk_link_behind(slots, node->step, MK_NODE_LEFT_BEHIND, view->heard, view->seen, &node->left_behind);
}

int MK_F(mk_node_recover)(int n, int slots, const MK_F_T(mk_node_view) * view, mk_status_t status, const MK_REAL *input, int attempt) {
    MK_F_T(mk_node) *const node = view->node;
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    if (status != MK_ERROR_NOT_POSITIVE_DEFINITE && status != MK_ERROR_NOT_FINITE && status != MK_ERROR_TOLERANCE) return 0;
    if (input && !MK_F(mk_all_finite)(n, input)) return 0; /* the caller's error */
    const MK_F_T(mk_rkfd_config) *const config = &node->config->filter;
    if (MK_F(mk_invert)(n, config->P0, filter->W, filter->work) != MK_OK) return 0;
    for (int i = 0; i < n && attempt > 0; i++) filter->x[i] = config->x0[i];
    for (int l = 0; l < slots; l++) filter->have_y[l] = 0;
    filter->core->steady = 0;
    if (attempt == 0) node->reinitialised++;
    return 1;
}

int MK_F(mk_node_drop_estimates)(int slots, const MK_F_T(mk_node_view) * view, mk_status_t status) {
    if (status != MK_ERROR_NOT_FINITE) return 0;
    for (int l = 1; l < slots; l++) {
        view->node->counts[MK_ERROR_IMPLAUSIBLE] += view->filter.have_psi[l] != 0;
        view->filter.have_psi[l] = 0;
    }
    return 1;
}

mk_status_t MK_F(mk_node_begin_advance)(int n, int slots, const MK_F_T(mk_node_view) * view, uint32_t step) {
    MK_F_T(mk_node) *const node = view->node;
    if (!node->config || view->filter.core->stage != 1) return MK_ERROR_ORDER;
    const uint32_t steps = step - node->step;
    if (steps == 0 || steps >= 0x80000000u) return MK_ERROR_ARGUMENT;
    node->behind = 0;
    node->left_behind = 0;
    if (steps <= node->config->catch_up) {
        node->caught_up += steps;
        return MK_OK;
    }
    const mk_status_t status = MK_F(mk_rkfd_restart)(n, slots, &view->filter, node->config->filter.x0, node->config->filter.P0);
    if (status != MK_OK) return status;
    node->step = step;
    node->restarts++;
    return MK_OK;
}

/* --- the same as the typed functions of meshkal/node.h, for run-time dimensions -------------------------------------------- */

mk_status_t MK_F(mk_node_step)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const MK_REAL *input) {
    mk_status_t status = MK_F(mk_rkfd_incremental)(n, m, slots, &view->filter, input);
    for (int attempt = 0; attempt < 2 && status != MK_OK && MK_F(mk_node_recover)(n, slots, view, status, input, attempt); attempt++)
        status = MK_F(mk_rkfd_incremental)(n, m, slots, &view->filter, input);
    return status;
}

static mk_status_t MK_F(mk_node_run_incremental)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const MK_REAL *input) {
    if (view->node->config && view->node->config->gate) MK_F(mk_node_judge_readings)(n, m, slots, view);
    return MK_F(mk_node_step)(n, m, slots, view, input);
}

static mk_status_t MK_F(mk_node_run_diffuse)(int n, int slots, const MK_F_T(mk_node_view) * view) {
    if (view->node->config && view->node->config->gate) MK_F(mk_node_judge_estimates)(n, slots, view);
    mk_status_t status = MK_F(mk_rkfd_diffuse)(n, slots, &view->filter);
    if (status != MK_OK && MK_F(mk_node_drop_estimates)(slots, view, status)) status = MK_F(mk_rkfd_diffuse)(n, slots, &view->filter);
    if (status == MK_OK) MK_F(mk_node_end_step)(slots, view);
    return status;
}

static mk_status_t MK_F(mk_node_run_advance)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, uint32_t step) {
    mk_status_t status = MK_F(mk_node_begin_advance)(n, slots, view, step);
    while (status == MK_OK && view->node->step != step) {
        status = MK_F(mk_node_run_incremental)(n, m, slots, view, 0);
        if (status == MK_OK) status = MK_F(mk_node_run_diffuse)(n, slots, view);
    }
    return status;
}

mk_status_t MK_F(mk_node_incremental)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const MK_REAL *input) {
    const mk_status_t status = MK_F(mk_node_run_incremental)(n, m, slots, view, input);
    MK_F(mk_node_note)(n, view, MK_ITEM_INCREMENTAL, status, 0, input);
    return status;
}

mk_status_t MK_F(mk_node_diffuse)(int n, int m, int slots, const MK_F_T(mk_node_view) * view) {
    mk_status_t status = MK_F(mk_node_run_diffuse)(n, slots, view);
    if (status == MK_OK && view->node->behind) status = MK_F(mk_node_run_advance)(n, m, slots, view, view->node->step + view->node->behind);
    MK_F(mk_node_note)(n, view, MK_ITEM_DIFFUSE, status, 0, 0);
    return status;
}

mk_status_t MK_F(mk_node_advance)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, uint32_t step) {
    const mk_status_t status = MK_F(mk_node_run_advance)(n, m, slots, view, step);
    MK_F(mk_node_note)(n, view, MK_ITEM_ADVANCE, status, step, 0);
    return status;
}

mk_status_t MK_F(mk_node_set_tolerance)(const MK_F_T(mk_node_view) * view, MK_REAL tolerance) {
    if (!view->node->config) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_rkfd_set_tolerance)(view->filter.core, tolerance);
    if (view->node->recorder) MK_F(mk_note_numbers)(view, MK_ITEM_TOLERANCE, status, 1, &tolerance);
    return status;
}

mk_status_t MK_F(mk_node_drop)(const MK_F_T(mk_node_view) * view, int slot) {
    if (!view->node->config) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_rkfd_drop)(&view->filter, slot);
    uint8_t *const content = view->node->recorder ? mk_item_begin(view->node->recorder, MK_ITEM_DROP, status, 2) : 0;
    if (content) {
        mk_put_u16(content, slot < 0 || slot > UINT16_MAX ? UINT16_MAX : (uint16_t)slot); /* no slot either */
        mk_item_end(view->node->recorder);
    }
    return status;
}

mk_status_t MK_F(mk_node_restart)(int n, int slots, const MK_F_T(mk_node_view) * view, const MK_REAL *x0, const MK_REAL *P0) {
    const mk_status_t status = MK_F(mk_rkfd_restart)(n, slots, &view->filter, x0, P0);
    if (view->node->recorder && x0 && P0) MK_F(mk_note_restart)(n, view, status, x0, P0);
    return status;
}
