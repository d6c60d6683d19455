/* SPDX-License-Identifier: MIT */

typedef struct {
    int n, estimators;
    const mk_scenario_t *scenario;
    const mk_topology_t *topology;
    MK_F_T(mk_rkfd_config) * config;
    MK_F_T(mk_rkfd) * core;
    MK_F_T(mk_rkfd_view) * view;
    MK_REAL *reals, *work;
    uint8_t *flags;
} MK_F_T(network);

static void *MK_F(open)(const mk_scenario_t *s, const mk_topology_t *topology, const double *tolerance) {
    const int n = s->n, estimators = topology->estimators;
    MK_F_T(network) *net = mk_allocate(1, sizeof *net);
    net->n = n;
    net->estimators = estimators;
    net->scenario = s;
    net->topology = topology;
    net->config = mk_allocate((size_t)estimators, sizeof *net->config);
    net->core = mk_allocate((size_t)estimators, sizeof *net->core);
    net->view = mk_allocate((size_t)estimators, sizeof *net->view);
    size_t reals = 0, work = 0;
    for (int e = 0; e < estimators; e++) {
        MK_F(mk_config_make)(&net->config[e], s, topology, e, tolerance[e]);
        const size_t m = net->config[e].m, slots = net->config[e].slots;
        reals += (size_t)n + (size_t)MK_PACKED(n) + slots * (m + (size_t)n);
        if (MK_RKFD_WORK((size_t)n, m) > work) work = MK_RKFD_WORK((size_t)n, m);
    }
    net->work = mk_allocate(work, sizeof *net->work);
    net->reals = mk_allocate(reals, sizeof *net->reals);
    net->flags = mk_allocate(2 * (size_t)topology->first[estimators], 1);
    MK_REAL *next = net->reals;
    uint8_t *flag = net->flags;
    for (int e = 0; e < estimators; e++) {
        MK_F_T(mk_rkfd_view) *view = &net->view[e];
        const int m = net->config[e].m, slots = net->config[e].slots;
        view->core = &net->core[e];
        view->x = next;
        view->W = view->x + n;
        view->y = view->W + MK_PACKED(n);
        view->psi = view->y + slots * m;
        next = view->psi + slots * n;
        view->have_y = flag;
        view->have_psi = flag + slots;
        flag += 2 * slots;
        view->work = net->work;
    }
    return net;
}

static void MK_F(close)(void *network) {
    MK_F_T(network) *net = network;
    for (int e = 0; e < net->estimators; e++) MK_F(mk_config_free)(&net->config[e]);
    free(net->config);
    free(net->core);
    free(net->view);
    free(net->reals);
    free(net->work);
    free(net->flags);
    free(net);
}

static mk_status_t MK_F(start)(void *network, int *bad) {
    MK_F_T(network) *net = network;
    mk_status_t status = MK_OK;
    for (int e = 0; e < net->estimators && status == MK_OK; e++) {
        const MK_F_T(mk_rkfd_config) *config = &net->config[e];
        status = MK_F(mk_rkfd_start)(config->n, config->m, config->slots, &net->view[e], config);
        *bad = e;
    }
    return status;
}

static mk_status_t MK_F(set_tolerance)(void *network, const double *tolerance, int *bad) {
    MK_F_T(network) *net = network;
    mk_status_t status = MK_OK;
    for (int e = 0; e < net->estimators && status == MK_OK; e++) {
        status = MK_F(mk_rkfd_set_tolerance)(&net->core[e], (MK_REAL)tolerance[e]);
        *bad = e;
    }
    return status;
}

static mk_status_t MK_F(incremental)(void *network, const double *y, const int *row_first, uint8_t *arrived, int *bad) {
    MK_F_T(network) *net = network;
    for (int e = 0; e < net->estimators; e++) {
        const MK_F_T(mk_rkfd_config) *config = &net->config[e];
        const int base = net->topology->first[e];
        *bad = e;
        for (int l = 0; l < config->slots; l++) {
            const int node = net->topology->slot[base + l], rows = config->rows[l];
            const double *reading = y + row_first[node];
            MK_REAL values[MK_LARGEST_STATE];
            if (isnan(reading[0])) arrived[base + l] = 0;
            if (!arrived[base + l]) continue;
            for (int r = 0; r < rows; r++) values[r] = (MK_REAL)reading[r];
            const mk_status_t status = MK_F(mk_rkfd_put)(config->n, config->m, &net->view[e], l, values, 0);
            if (status != MK_OK) return status;
        }
        const mk_status_t status = MK_F(mk_sized_incremental)(config->n, config->m, config->slots, &net->view[e]);
        if (status != MK_OK) return status;
    }
    return MK_OK;
}

static mk_status_t MK_F(diffuse)(void *network, const uint8_t *arrived, int *bad) {
    MK_F_T(network) *net = network;
    /* A node's own psi stands in its slot 0 until its own diffuse, which does not move it. */
    for (int e = 0; e < net->estimators; e++) {
        const int base = net->topology->first[e], slots = net->config[e].slots;
        *bad = e;
        for (int l = 1; l < slots && arrived; l++) {
            if (!arrived[base + l]) continue;
            const MK_REAL *psi = net->view[net->topology->slot[base + l]].psi;
            const mk_status_t status = MK_F(mk_rkfd_put_estimate)(net->n, &net->view[e], l, psi);
            if (status != MK_OK) return status;
        }
        const mk_status_t status = MK_F(mk_rkfd_diffuse)(net->n, slots, &net->view[e]);
        if (status != MK_OK) return status;
    }
    return MK_OK;
}

static void MK_F(estimate)(void *network, double *estimate) {
    MK_F_T(network) *net = network;
    for (int e = 0; e < net->estimators; e++)
        for (int i = 0; i < net->n; i++) estimate[e * net->n + i] = (double)net->view[e].x[i];
}

static void MK_F(nees)(void *network, const double *x, double *nees) {
    MK_F_T(network) *net = network;
    for (int e = 0; e < net->estimators; e++) {
        const MK_REAL *xh = net->view[e].x, *W = net->view[e].W;
        nees[e] = 0.0;
        for (int i = 0; i < net->n; i++) {
            double below = 0.0;
            for (int j = 0; j < i; j++) below += (double)W[MK_AT(i, j)] * (x[j] - (double)xh[j]);
            nees[e] += (x[i] - (double)xh[i]) * (2.0 * below + (double)W[MK_AT(i, i)] * (x[i] - (double)xh[i]));
        }
    }
}

static void MK_F(look_before)(void *network, mk_snapshot_t *snapshot) {
    MK_F_T(network) *net = network;
    const int *position = net->scenario->position_states, positions = net->scenario->position_count;
    MK_REAL *estimate = snapshot->estimate, *trace = snapshot->trace_covariance, *block = snapshot->position_covariance;
    MK_REAL V[MK_PACKED(MK_LARGEST_STATE)];
    for (int e = 0; e < net->estimators; e++) {
        memcpy(estimate + e * net->n, net->view[e].x, (size_t)net->n * sizeof *estimate);
        /* W is the inverse of a positive definite matrix that the step has just factored, or of P0: it inverts. */
        if (MK_F(mk_rkfd_covariance)(net->n, &net->view[e], V) != MK_OK) memset(V, 0, sizeof V);
        trace[e] = MK_R(0.0);
        for (int i = 0; i < net->n; i++) trace[e] += V[MK_AT(i, i)];
        for (int i = 0; i < positions; i++)
            for (int j = 0; j <= i; j++) {
                const int a = position[i], b = position[j];
                *block++ = V[a > b ? MK_AT(a, b) : MK_AT(b, a)];
            }
    }
}

static void MK_F(look_after)(void *network, mk_snapshot_t *snapshot) {
    MK_F_T(network) *net = network;
    MK_REAL *theta = snapshot->theta, *tolerance = snapshot->tolerance, *nis = snapshot->nis;
    for (int e = 0; e < net->estimators; e++) {
        const MK_F_T(mk_rkfd) *core = &net->core[e];
        theta[e] = core->theta;
        tolerance[e] = core->tolerance;
        nis[e] = core->nis;
        snapshot->nis_rows[e] = core->nis_rows;
        snapshot->faults[e] = core->faults;
    }
}

static void MK_F(means)(void *network, double *theta, double *tolerance, double *nis_ratio) {
    MK_F_T(network) *net = network;
    double nis = 0.0, rows = 0.0;
    *theta = *tolerance = 0.0;
    for (int e = 0; e < net->estimators; e++) {
        *theta += (double)net->core[e].theta / net->estimators;
        *tolerance += (double)net->core[e].tolerance / net->estimators;
        nis += (double)net->core[e].nis;
        rows += net->core[e].nis_rows;
    }
    *nis_ratio = rows > 0.0 ? nis / rows : 0.0;
}

const mk_network_t MK_F(mk_network) = {
    sizeof(MK_REAL),  MK_REAL_NAME,    MK_F(open),     MK_F(close),       MK_F(start),      MK_F(set_tolerance),
    MK_F(incremental), MK_F(diffuse), MK_F(estimate), MK_F(nees), MK_F(look_before), MK_F(look_after), MK_F(means)};
