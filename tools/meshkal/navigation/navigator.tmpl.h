/* SPDX-License-Identifier: MIT */
/* The filter over the error of the estimate, and the monitor of its innovations. */

typedef struct {
    const mk_nav_setting_t *setting;
    MK_F_T(mk_unscented) core;
    MK_F_T(mk_unscented_view) view;
    MK_F_T(mk_unscented_config) config;
    MK_F_T(mk_row_weights) weights;
    MK_F_T(mk_sensor) * sensor;
    MK_REAL *A, *Q, *H;            /* of the present epoch: the model's, which the configuration points to */
    MK_REAL *r, *S, *weight, *statistic;
    MK_REAL *numbers;
    uint8_t *rows, *have;
    uint16_t *id;
    MK_F_T(mk_host_monitor) * monitor; /* null: none */
} MK_F(filter);

static mk_status_t MK_F(row_function)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const MK_REAL *const row = context;
    (void)dt;
    for (int c = 0; c < count; c++) {
        y[c] = MK_R(0.0);
        for (int i = 0; i < MK_NAV_STATES; i++) y[c] += row[i] * x[c * MK_NAV_STATES + i];
    }
    return MK_OK;
}

static mk_status_t MK_F(row_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    (void)dt;
    (void)x;
    memcpy(J, context, MK_NAV_STATES * sizeof *J);
    return MK_OK;
}

static void MK_F(close)(void *filter) {
    MK_F(filter) *const f = filter;
    free(f->monitor);
    free(f->sensor);
    free(f->numbers);
    free(f->view.record);
    free(f->have);
    free(f->id);
    free(f);
}

/* Thresholds of the weights for 1, 2, .. rows. 1, or 0 and an error. */
static int MK_F(set_weights)(MK_F(filter) * f, MK_REAL *k0, MK_REAL *k1, mk_error_t *error) {
    const mk_navigation_t *const nav = f->setting->scenario->navigation;
    const int nodes = f->setting->scenario->nodes, student = f->setting->filter == MK_NAV_REKF_T;
    f->weights.k0 = k0;
    f->weights.k1 = k1;
    f->weights.weight = f->weight;
    f->weights.statistic = f->statistic;
    f->weights.kind = student ? MK_STATISTIC_STUDENT : MK_STATISTIC_NORMAL;
    f->config.weights = &f->weights;
    for (int i = 0; i < nodes; i++) {
        k0[i] = (MK_REAL)nav->k0;
        k1[i] = (MK_REAL)nav->k1;
    }
    if (!student) return 1;
    for (int i = 0; i < 2; i++)
        if (MK_F(mk_weight_thresholds)(MK_STATISTIC_STUDENT, nav->significance[i], nodes, i ? k1 : k0) != MK_OK)
            return mk_fail(error, "model.navigation.weights.significance: %g has no quantile", nav->significance[i]);
    return 1;
}

static mk_status_t MK_F(start)(void *filter) {
    MK_F(filter) *const f = filter;
    if (f->monitor) MK_F(mk_host_monitor_start)(f->monitor);
    memset(f->H, 0, (size_t)f->setting->scenario->nodes * MK_NAV_STATES * sizeof *f->H);
    return MK_F(mk_unscented_start)(MK_NAV_STATES, 1, f->setting->scenario->nodes, &f->view, &f->config);
}

static void *MK_F(open)(const mk_nav_setting_t *setting, mk_error_t *error) {
    const mk_scenario_t *const s = setting->scenario;
    const size_t n = MK_NAV_STATES, nodes = (size_t)s->nodes;
    const size_t own = n * n + 2 * MK_NAV_PACKED + nodes * n + (size_t)MK_PACKED(nodes) + nodes * 6 + n;
    const size_t filter = n + MK_NAV_PACKED + nodes + MK_UNSCENTED_WORK(n, 1, nodes);
    MK_F(filter) *const f = mk_allocate(1, sizeof *f);
    MK_REAL *next = f->numbers = mk_allocate(own + filter, sizeof *next), *k0, *k1, *P0, *x0, *R;
    f->setting = setting;
#define MK_TAKE(part, size) \
    part = next; \
    next += size
    MK_TAKE(f->A, n * n);
    MK_TAKE(f->Q, MK_NAV_PACKED);
    MK_TAKE(P0, MK_NAV_PACKED);
    MK_TAKE(f->H, nodes * n);
    MK_TAKE(f->S, (size_t)MK_PACKED(nodes));
    MK_TAKE(f->r, nodes);
    MK_TAKE(f->weight, nodes);
    MK_TAKE(f->statistic, nodes);
    MK_TAKE(k0, nodes);
    MK_TAKE(k1, nodes);
    MK_TAKE(R, nodes);
    MK_TAKE(x0, n);
    MK_TAKE(f->view.x, n);
    MK_TAKE(f->view.L, MK_NAV_PACKED);
    MK_TAKE(f->view.z, nodes);
    f->view.work = next;
#undef MK_TAKE
    f->rows = mk_allocate(2 * nodes, 1);
    f->have = f->rows;
    f->rows += nodes;
    f->id = mk_allocate(nodes, sizeof *f->id);
    f->view.core = &f->core;
    f->view.have = f->have;
    f->view.record = mk_allocate(nodes, sizeof *f->view.record);
    f->sensor = mk_allocate(nodes, sizeof *f->sensor);
    for (int i = 0; i < MK_NAV_PACKED; i++) P0[i] = (MK_REAL)s->P0[i];
    for (size_t i = 0; i < n; i++) f->A[(n + 1) * i] = MK_R(1.0);
    for (size_t k = 0; k < nodes; k++) {
        R[k] = (MK_REAL)s->sensor[k].R[0];
        f->id[k] = (uint16_t)s->navigation->satellite[k].number;
        f->sensor[k].model.function = MK_F(row_function);
        f->sensor[k].model.jacobian = MK_F(row_jacobian);
        f->sensor[k].model.context = f->H + k * n;
        f->sensor[k].R = R + k;
        f->sensor[k].rows = 1;
    }
    f->config.n = MK_NAV_STATES;
    f->config.m = 1;
    f->config.slots = (uint16_t)nodes;
    f->config.transition.A = f->A;
    f->config.sensor = f->sensor;
    f->config.x0 = x0;
    f->config.P0 = P0;
    f->config.increments = 1;
    f->config.update = MK_UPDATE_EXTENDED;
    mk_status_t status = MK_OK;
    if (setting->monitor->scheme != MK_MONITOR_NONE) f->monitor = MK_F(mk_host_monitor_open)(setting->monitor, 1, s->nodes);
    if (setting->filter == MK_NAV_EKF || MK_F(set_weights)(f, k0, k1, error)) {
        status = MK_F(start)(f);
        if (status == MK_OK) return f;
        (void)mk_fail(error, "%s in float%d: its configuration is refused (%s)", mk_nav_filter_name(setting->filter), MK_BITS, mk_status_name(status));
    }
    MK_F(close)(f);
    return NULL;
}

/* Innovations to the look and to the monitor; readings of satellites that it holds faulty are dropped. */
static void MK_F(watch)(MK_F(filter) * f, mk_nav_look_t *look) {
    const int nodes = f->setting->scenario->nodes;
    int first = 0;
    mk_status_t status = MK_F(mk_unscented_innovations)(MK_NAV_STATES, 1, nodes, &f->view, f->r, f->S, f->rows);
    if (status != MK_OK) {
        look->count[MK_NAV_COUNT_FAILED + (int)status]++;
        return;
    }
    for (int k = 0; k < nodes; k++) {
        int second = 0;
        if (!f->rows[k]) continue;
        look->innovation[k] = (double)f->r[first];
        for (int l = 0; l <= k; l++)
            if (f->rows[l]) look->S[MK_PACKED(k) + l] = (double)f->S[MK_PACKED(first) + second++];
        first++;
    }
    if (!f->monitor) return;
    status = MK_F(mk_host_monitor_watch)(f->monitor, nodes, f->id, f->rows, f->r, f->S);
    if (status != MK_OK) look->count[MK_NAV_COUNT_FAILED + (int)status]++;
    MK_F(mk_host_monitor_look)(f->monitor, f->id, nodes, 0, 0, &look->monitor);
    for (int k = 0; k < nodes; k++) {
        if (!look->monitor.excluded[k] || !look->arrived[k]) continue;
        (void)MK_F(mk_unscented_drop)(nodes, &f->view, k);
        look->decision[k] = MK_NAV_REFUSED;
    }
}

/* What the update made of the readings that the monitor left. */
static void MK_F(settle)(const MK_F(filter) * f, mk_nav_look_t *look) {
    const int nodes = f->setting->scenario->nodes;
    for (int k = 0; k < nodes; k++) {
        if (look->decision[k] != MK_NAV_USED) continue;
        look->weight[k] = f->config.weights ? (double)f->weight[k] : 1.0;
        look->statistic[k] = f->config.weights ? (double)f->statistic[k] : 0.0;
        look->decision[k] = look->weight[k] >= 1.0 ? MK_NAV_USED : look->weight[k] > 0.0 ? MK_NAV_WEIGHTED : MK_NAV_REFUSED;
    }
    look->count[MK_NAV_COUNT_UNUSED] += f->config.weights && f->core.measurements > 0 && f->core.unused_rows == f->core.measurements;
    look->nis = (double)f->core.nis;
    look->nis_rows = f->core.nis_rows;
}

static void MK_F(step)(void *filter, const mk_nav_input_t *input, mk_nav_look_t *look) {
    MK_F(filter) *const f = filter;
    const int nodes = f->setting->scenario->nodes, n = MK_NAV_STATES;
    MK_REAL back[MK_NAV_STATES];
    for (int i = 0; i < n * n; i++) f->A[i] = (MK_REAL)input->Phi[i];
    for (int i = 0; i < MK_NAV_PACKED; i++) f->Q[i] = (MK_REAL)input->Q[i];
    for (int i = 0; i < nodes * n; i++) f->H[i] = (MK_REAL)input->H[i];
    mk_status_t status = MK_F(mk_unscented_predict)(n, &f->view, (MK_REAL)input->dt, f->Q);
    if (status != MK_OK) look->count[MK_NAV_COUNT_FAILED + (int)status]++;
    for (int k = 0; k < nodes; k++) {
        const MK_REAL z = (MK_REAL)input->z[k];
        if (!input->have[k]) continue;
        status = fabs(input->z[k]) <= MK_NAV_ABSURD_M ? MK_F(mk_unscented_put)(1, nodes, &f->view, k, &z) : MK_ERROR_DOMAIN;
        look->decision[k] = status == MK_OK ? MK_NAV_USED : MK_NAV_REFUSED;
        if (status != MK_OK) look->count[MK_NAV_COUNT_FAILED + (int)status]++;
    }
    MK_F(watch)(f, look);
    look->nis = 0.0;
    look->nis_rows = 0;
    int waiting = 0;
    for (int k = 0; k < nodes; k++) waiting += f->have[k];
    status = waiting ? MK_F(mk_unscented_update)(n, 1, nodes, &f->view) : MK_OK;
    if (status != MK_OK) {
        look->count[MK_NAV_COUNT_FAILED + (int)status]++;
        for (int k = 0; k < nodes; k++) {
            (void)MK_F(mk_unscented_drop)(nodes, &f->view, k);
            if (look->decision[k] == MK_NAV_USED) look->decision[k] = MK_NAV_REFUSED;
        }
    } else if (waiting) {
        MK_F(settle)(f, look);
    }
    for (int i = 0; i < n; i++) {
        look->correction[i] = (double)f->view.x[i];
        back[i] = -f->view.x[i];
    }
    (void)MK_F(mk_unscented_move)(n, &f->view, back);
    for (int i = 0; i < MK_NAV_PACKED; i++) look->root[i] = (double)f->view.L[i];
}

const mk_nav_precision_t MK_F(mk_nav) = {sizeof(MK_REAL), MK_BITS == 32 ? "float32" : "float64", MK_F(open), MK_F(close), MK_F(start), MK_F(step)};
