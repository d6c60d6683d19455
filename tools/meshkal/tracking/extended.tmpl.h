/* SPDX-License-Identifier: MIT */
/* rekfd: the robust filter of each node, linearised at its own estimate (meshkal/extended.h). */

struct MK_F(extended_node) {
    MK_F_T(mk_rkfd_config) config;
    MK_F_T(mk_rkfd) core;
    MK_F_T(mk_rkfd_view) view;
    MK_F_T(mk_extended) model;
    MK_F_T(mk_sensor) * sensor;
    MK_F_T(mk_gate_record) record; /* the last judgement */
    uint8_t *rows;
    MK_REAL *room;
    MK_REAL *arrays;
    uint32_t gated; /* gated_updates of meshkal/unscented.h */
};

static void MK_F(extended_open_node)(MK_F(tracker) * t, int e) {
    const mk_topology_t *const topology = &t->setting->topology;
    const int n = t->n, m = t->m, first = topology->first[e], slots = topology->first[e + 1] - first, packed = MK_PACKED(n);
    struct MK_F(extended_node) *const node = &t->extended[e];
    node->sensor = mk_allocate((size_t)slots, sizeof *node->sensor);
    node->rows = mk_allocate((size_t)(3 * slots), 1);
    MK_REAL *next = node->room = mk_allocate((size_t)(n * n + packed + slots * (1 + 2 * m * n + packed + MK_PACKED(m))), sizeof *node->room);
    node->model.transition = &t->models->transition;
    node->model.sensor = node->sensor;
    node->model.A = next;
    node->model.Q = node->model.A + n * n;
    node->model.C = node->model.Q + packed;
    node->model.F = node->model.C + slots * m * n;
    node->model.S = node->model.F + slots * m * n;
    node->model.R_inverse = node->model.S + slots * packed;
    MK_REAL *const weight = node->model.R_inverse + slots * MK_PACKED(m);
    for (int l = 0; l < slots; l++) {
        node->sensor[l] = t->models->sensor[topology->slot[first + l]];
        node->rows[l] = node->sensor[l].rows;
        weight[l] = (MK_REAL)topology->weight[first + l];
    }
    const MK_REAL c = (MK_REAL)t->setting->scenario->tolerance;
    const MK_F_T(mk_rkfd_config) config = {(uint16_t)n,   (uint16_t)m,   (uint16_t)slots, node->model.A,         node->model.Q, NULL, t->x0, t->models->P0,
                                           weight,        node->rows,    node->model.C,   node->model.F,         node->model.S, node->model.R_inverse,
                                           c,             NULL};
    node->config = config;
    node->view.core = &node->core;
    const int work = MK_EXTENDED_WORK(n, m) + MK_RKFD_PREDICT_WORK(n, m) + m + MK_PACKED(m);
    node->arrays = mk_allocate((size_t)(n + packed + slots * (m + n) + work), sizeof *node->arrays);
    node->view.x = node->arrays;
    node->view.W = node->view.x + n;
    node->view.y = node->view.W + packed;
    node->view.psi = node->view.y + slots * m;
    node->view.work = node->view.psi + slots * n;
    node->view.have_y = node->rows + slots;
    node->view.have_psi = node->view.have_y + slots;
}

static void MK_F(extended_open)(MK_F(tracker) * t) {
    t->extended = mk_allocate((size_t)t->E, sizeof *t->extended);
    for (int e = 0; e < t->E; e++) MK_F(extended_open_node)(t, e);
}

static void MK_F(extended_close)(MK_F(tracker) * t) {
    for (int e = 0; e < t->E; e++) {
        free(t->extended[e].sensor);
        free(t->extended[e].rows);
        free(t->extended[e].room);
        free(t->extended[e].arrays);
    }
    free(t->extended);
}

static mk_status_t MK_F(extended_start)(MK_F(tracker) * t) {
    for (int e = 0; e < t->E; e++) {
        struct MK_F(extended_node) *const node = &t->extended[e];
        const mk_status_t status = MK_F(mk_rkfd_start)(t->n, t->m, node->config.slots, &node->view, &node->config);
        if (status != MK_OK) return status;
        node->gated = 0;
    }
    return MK_OK;
}

static mk_status_t MK_F(extended_predict)(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q) {
    struct MK_F(extended_node) *const node = &t->extended[e];
    return MK_F(mk_extended_propagate)(t->n, t->m, node->config.slots, &node->view, &node->model, dt, Q);
}

static mk_status_t MK_F(extended_restart)(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q) {
    struct MK_F(extended_node) *const node = &t->extended[e];
    (void)dt;
    (void)Q;
    return MK_F(mk_rkfd_restart)(t->n, node->config.slots, &node->view, node->view.x, node->config.P0);
}

/* The gate for each sensor; one for all readings together this filter does not have. Inflation: R := (f - 1) (E - R) + f R = f E - (E - R). */
static uint8_t MK_F(extended_gate)(MK_F(tracker) * t, struct MK_F(extended_node) * node, int slot, double *ratio) {
    const MK_F_T(mk_gate) *const gate = &t->models->gate;
    const int n = t->n, m = t->m, rows = node->rows[slot], packed = MK_PACKED(m);
    if (!gate->sensor || !mk_tracking_gates(t->setting->scenario->tracking, t->setting->filter->name)) return MK_READING_ACCEPTED;
    MK_REAL *const e = node->view.work + MK_RKFD_PREDICT_WORK(n, m), *const E = e + m, *const L = node->view.work;
    if (MK_F(mk_rkfd_predict)(n, m, &node->view, slot, e, E) != MK_OK) return MK_READING_REFUSED;
    MK_REAL d2 = MK_R(0.0);
    for (int i = 0; i < MK_PACKED(rows); i++) L[i] = E[i];
    if (!MK_F(mk_positive_definite)(rows, E, L)) return MK_READING_REFUSED;
    /* Forward substitution on E = L D L', which mk_positive_definite leaves as L and 1 / D: e' E^-1 e. */
    for (int r = 0; r < rows; r++) {
        for (int s = 0; s < r; s++) e[r] -= L[r * (r + 1) / 2 + s] * e[s];
        d2 += e[r] * e[r] * L[r * (r + 1) / 2 + r];
    }
    const MK_REAL f = MK_F(mk_gate_judge)(gate->policy, gate->sensor[rows - 1], d2, &node->record);
    *ratio = (double)node->record.ratio;
    if (!(f > MK_R(0.0))) return MK_READING_REJECTED;
    if (f == MK_R(1.0)) return MK_READING_ACCEPTED;
    const MK_REAL *const R = node->sensor[slot].R;
    for (int i = 0; i < MK_PACKED(rows); i++) E[i] = (f - MK_R(1.0)) * (E[i] - R[i]) + f * R[i];
    return MK_F(mk_rkfd_sensor)(n, m, rows, node->model.C + slot * m * n, E, node->model.F + slot * m * n, node->model.S + slot * MK_PACKED(n),
                                node->model.R_inverse + slot * packed, L) == MK_OK
               ? MK_READING_INFLATED
               : MK_READING_REFUSED;
}

/* A reading in a slot: linearised, judged. */
static void MK_F(extended_hear)(MK_F(tracker) * t, int e, int slot, const mk_reading_t *reading) {
    struct MK_F(extended_node) *const node = &t->extended[e];
    const int place = t->setting->topology.first[e] + slot;
    const mk_status_t status = MK_F(mk_extended_observe)(t->n, t->m, &node->view, &node->model, slot, MK_F(rows_of)(t, reading));
    t->look.arrived[place] = 1;
    if (status != MK_OK) MK_F(failed)(t, status);
    t->look.decision[place] = status == MK_OK ? MK_F(extended_gate)(t, node, slot, &t->look.ratio[place]) : MK_READING_REFUSED;
    if (t->look.decision[place] >= MK_READING_REJECTED && t->look.decision[place] != MK_READING_INFLATED) node->view.have_y[slot] = 0;
}

/* The way back of meshkal/gate.h. */
static void MK_F(extended_look_back)(MK_F(tracker) * t, int e, const mk_reading_t *const *reading) {
    struct MK_F(extended_node) *const node = &t->extended[e];
    const int first = t->setting->topology.first[e], slots = node->config.slots;
    int present = 0, beyond = 0;
    for (int l = 0; l < slots; l++) {
        present += t->look.arrived[first + l];
        beyond += t->look.decision[first + l] == MK_READING_REJECTED || t->look.decision[first + l] == MK_READING_INFLATED;
    }
    if (2 * beyond <= present) {
        if (present && node->gated > 0) node->gated--;
        return;
    }
    const uint32_t patience = t->models->gate.patience;
    if (patience == 0 || node->gated < patience) {
        node->gated++;
        return;
    }
    node->gated = 0;
    if (MK_F(extended_restart)(t, e, MK_R(0.0), NULL) != MK_OK) return;
    t->own_count[MK_TRACK_REINITIALISED]++;
    for (int l = 0; l < slots; l++) {
        if (!t->look.arrived[first + l]) continue;
        const mk_status_t status =
            MK_F(mk_extended_observe)(t->n, t->m, &node->view, &node->model, l, MK_F(rows_of)(t, reading[t->setting->topology.slot[first + l]]));
        t->look.decision[first + l] = status == MK_OK ? MK_READING_ACCEPTED : MK_READING_REFUSED;
    }
}

/* What a step whose matrices do not allow it comes to: without readings, then from P0. */
static void MK_F(extended_correct)(MK_F(tracker) * t, int e) {
    struct MK_F(extended_node) *const node = &t->extended[e];
    const int slots = node->config.slots, first = t->setting->topology.first[e];
    for (int attempt = 0; attempt < 3; attempt++) {
        const mk_status_t status = MK_F(mk_extended_correct)(t->n, t->m, slots, &node->view, &node->model);
        if (status == MK_OK) break;
        MK_F(failed)(t, status);
        if (attempt == 1 && MK_F(extended_restart)(t, e, MK_R(0.0), NULL) == MK_OK) t->own_count[MK_TRACK_REINITIALISED]++;
        for (int l = 0; l < slots; l++) {
            if (node->view.have_y[l]) t->look.decision[first + l] = MK_READING_REFUSED;
            node->view.have_y[l] = 0;
        }
    }
    t->look.nis[e] = (double)node->core.nis;
    t->look.nis_rows[e] = node->core.nis_rows;
    t->own_count[MK_TRACK_UPDATES] += node->core.measurements > 0;
}

static int MK_F(extended_step)(MK_F(tracker) * t, long step, const mk_instant_t *instant, mk_error_t *error) {
    const mk_topology_t *const topology = &t->setting->topology;
    if (!MK_F(predict_all)(t, instant->dt, MK_F(extended_predict), MK_F(extended_restart), error)) return 0;
    const mk_reading_t *const *const reading = MK_F(readings)(t, instant);
    for (int e = 0; e < t->E; e++) {
        const int first = topology->first[e], slots = topology->first[e + 1] - first;
        mk_track_links(t->setting, t->run, e, step, &t->random[e]);
        for (int l = 0; l < slots; l++) {
            const int link = l == 0 || mk_track_arrives(t->setting, &t->random[e]);
            const mk_reading_t *const r = reading[topology->slot[first + l]];
            if (r && link) MK_F(extended_hear)(t, e, l, r);
            else if (r) t->own_count[MK_TRACK_LOST]++;
        }
        MK_F(extended_look_back)(t, e, reading);
        MK_F(extended_correct)(t, e);
    }
    for (int e = 0; e < t->E; e++) {
        const int first = topology->first[e], slots = topology->first[e + 1] - first;
        struct MK_F(extended_node) *const node = &t->extended[e];
        for (int l = 1; l < slots; l++) {
            if (!mk_track_arrives(t->setting, &t->random[e])) continue;
            const mk_status_t status = MK_F(mk_rkfd_put_estimate)(t->n, &node->view, l, t->extended[topology->slot[first + l]].view.psi);
            if (status != MK_OK) MK_F(failed)(t, status);
            t->look.messages[first + l] = status == MK_OK;
        }
        const mk_status_t status = MK_F(mk_rkfd_diffuse)(t->n, slots, &node->view);
        if (status == MK_OK) continue;
        MK_F(failed)(t, status);
        if (MK_F(extended_restart)(t, e, MK_R(0.0), NULL) == MK_OK) t->own_count[MK_TRACK_REINITIALISED]++;
    }
    return 1;
}

static void MK_F(extended_look)(MK_F(tracker) * t) {
    for (int e = 0; e < t->E; e++) {
        struct MK_F(extended_node) *const node = &t->extended[e];
        if (MK_F(mk_rkfd_covariance)(t->n, &node->view, t->V) != MK_OK)
            for (int i = 0; i < MK_PACKED(t->n); i++) t->V[i] = (MK_REAL)NAN;
        MK_F(look_at)(t, e, node->view.x, t->V);
        t->look.theta[e] = (double)node->core.theta;
    }
}
