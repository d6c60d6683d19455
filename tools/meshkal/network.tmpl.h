/* SPDX-License-Identifier: MIT */

typedef struct {
    int n, estimators;
    const mk_scenario_t *scenario;
    const mk_topology_t *topology;
    MK_F_T(mk_rkfd_config) * config;
    MK_F_T(mk_rkfd) * core;
    MK_F_T(mk_rkfd_view) * view;
    MK_REAL *reals, *work; /* work: work_size numbers for each thread */
    uint8_t *flags;
    const double *tolerance;
    int threads;
    size_t work_size;
    chunk_t *chunk;
} MK_F_T(network);

static void MK_F(make_config)(void *context, int worker, long e) {
    MK_F_T(network) *net = context;
    (void)worker;
    MK_F(mk_config_make)(&net->config[e], net->scenario, net->topology, (int)e, net->tolerance[e]);
}

static void *MK_F(open)(const mk_scenario_t *s, const mk_topology_t *topology, const double *tolerance, int threads) {
    const int n = s->n, estimators = topology->estimators;
    MK_F_T(network) *net = mk_allocate(1, sizeof *net);
    net->n = n;
    net->estimators = estimators;
    net->scenario = s;
    net->topology = topology;
    net->tolerance = tolerance;
    net->threads = threads;
    net->config = mk_allocate((size_t)estimators, sizeof *net->config);
    net->core = mk_allocate((size_t)estimators, sizeof *net->core);
    net->view = mk_allocate((size_t)estimators, sizeof *net->view);
    net->chunk = mk_allocate((size_t)(estimators / CHUNK + 1), sizeof *net->chunk);
    mk_parallel(threads, estimators, MK_F(make_config), net);
    size_t reals = 0;
    for (int e = 0; e < estimators; e++) {
        const size_t m = net->config[e].m, slots = net->config[e].slots;
        reals += (size_t)n + (size_t)MK_PACKED(n) + slots * (m + (size_t)n);
        if (MK_RKFD_WORK((size_t)n, m) > net->work_size) net->work_size = MK_RKFD_WORK((size_t)n, m);
    }
    net->work = mk_allocate((size_t)threads * net->work_size, sizeof *net->work);
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
    free(net->chunk);
    free(net);
}

static mk_status_t MK_F(start)(void *network, int *bad) {
    MK_F_T(network) *net = network;
    mk_status_t first = MK_OK;
    for (int e = 0; e < net->estimators; e++) {
        const MK_F_T(mk_rkfd_config) *config = &net->config[e];
        const mk_status_t status = MK_F(mk_rkfd_start)(config->n, config->m, config->slots, &net->view[e], config);
        if (!is_worse(net->topology, status, e, first, *bad)) continue;
        first = status;
        *bad = e;
    }
    return first;
}

static mk_status_t MK_F(set_tolerance)(void *network, const double *tolerance, int *bad) {
    MK_F_T(network) *net = network;
    mk_status_t first = MK_OK;
    for (int e = 0; e < net->estimators; e++) {
        const mk_status_t status = MK_F(mk_rkfd_set_tolerance)(&net->core[e], (MK_REAL)tolerance[e]);
        if (!is_worse(net->topology, status, e, first, *bad)) continue;
        first = status;
        *bad = e;
    }
    return first;
}

/* One estimator's step with its thread's scratch memory. */
static mk_status_t MK_F(incremental_one)(const phase_t *phase, MK_REAL *work, int e) {
    MK_F_T(network) *net = phase->network;
    const MK_F_T(mk_rkfd_config) *config = &net->config[e];
    const int base = net->topology->first[e];
    MK_F_T(mk_rkfd_view) view = net->view[e];
    view.work = work;
    for (int l = 0; l < config->slots; l++) {
        const int node = net->topology->slot[base + l], rows = config->rows[l];
        const double *reading = phase->y + phase->row_first[node];
        MK_REAL values[MK_LARGEST_STATE];
        if (isnan(reading[0])) phase->arrived[base + l] = 0;
        if (!phase->arrived[base + l]) continue;
        for (int r = 0; r < rows; r++) values[r] = (MK_REAL)reading[r];
        const mk_status_t status = MK_F(mk_rkfd_put)(config->n, config->m, &view, l, values, 0);
        if (status != MK_OK) return status;
    }
    return MK_F(mk_sized_incremental)(config->n, config->m, config->slots, &view);
}

static mk_status_t MK_F(diffuse_one)(const phase_t *phase, MK_REAL *work, int e) {
    MK_F_T(network) *net = phase->network;
    const mk_topology_t *topology = net->topology;
    const int base = topology->first[e], slots = net->config[e].slots;
    const MK_REAL *halo = phase->halo;
    MK_F_T(mk_rkfd_view) view = net->view[e];
    view.work = work;
    /* A node's own psi stands in its slot 0 and its diffuse does not move it: neighbours may read it before and after. */
    for (int l = 1; l < slots && phase->arrived; l++) {
        if (!phase->arrived[base + l]) continue;
        const int origin = topology->origin ? topology->origin[base + l] : topology->slot[base + l];
        const MK_REAL *psi = origin >= 0 ? net->view[origin].psi : halo + (size_t)(-1 - origin) * (size_t)net->n;
        const mk_status_t status = MK_F(mk_rkfd_put_estimate)(net->n, &view, l, psi);
        if (status != MK_OK) return status;
    }
    return MK_F(mk_rkfd_diffuse)(net->n, slots, &view);
}

static void MK_F(run_chunk)(void *context, int worker, long index) {
    const phase_t *phase = context;
    MK_F_T(network) *net = phase->network;
    chunk_t *chunk = &net->chunk[index];
    const int begin = phase->begin + (int)index * CHUNK, end = begin + CHUNK < phase->end ? begin + CHUNK : phase->end;
    MK_REAL *work = net->work + (size_t)worker * net->work_size;
    chunk->status = MK_OK;
    for (int e = begin; e < end; e++) {
        const mk_status_t status = phase->y ? MK_F(incremental_one)(phase, work, e) : MK_F(diffuse_one)(phase, work, e);
        if (!is_worse(net->topology, status, e, chunk->status, chunk->bad)) continue;
        chunk->status = status;
        chunk->bad = e;
    }
}

static mk_status_t MK_F(run_phase)(phase_t *phase, int *bad) {
    MK_F_T(network) *net = phase->network;
    const int chunks = (phase->end - phase->begin + CHUNK - 1) / CHUNK;
    mk_parallel(net->threads, chunks, MK_F(run_chunk), phase);
    mk_status_t first = MK_OK;
    for (int i = 0; i < chunks; i++) {
        const chunk_t *chunk = &net->chunk[i];
        if (!is_worse(net->topology, chunk->status, chunk->bad, first, *bad)) continue;
        first = chunk->status;
        *bad = chunk->bad;
    }
    return first;
}

static mk_status_t MK_F(incremental)(void *network, int begin, int end, const double *y, const int *row_first, uint8_t *arrived, int *bad) {
    phase_t phase = {network, begin, end, y, row_first, arrived, NULL};
    return MK_F(run_phase)(&phase, bad);
}

static mk_status_t MK_F(diffuse)(void *network, int begin, int end, uint8_t *arrived, const void *halo, int *bad) {
    phase_t phase = {network, begin, end, NULL, NULL, arrived, halo};
    return MK_F(run_phase)(&phase, bad);
}

static void MK_F(intermediate)(void *network, const int *estimator, int count, void *psi) {
    MK_F_T(network) *net = network;
    MK_REAL *next = psi;
    for (int i = 0; i < count; i++, next += net->n) memcpy(next, net->view[estimator[i]].psi, (size_t)net->n * sizeof *next);
}

static void MK_F(estimate)(void *network, double *estimate) {
    MK_F_T(network) *net = network;
    for (int e = 0; e < net->estimators; e++)
        for (int i = 0; i < net->n; i++) estimate[(size_t)e * (size_t)net->n + (size_t)i] = (double)net->view[e].x[i];
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
        memcpy(estimate + (size_t)e * (size_t)net->n, net->view[e].x, (size_t)net->n * sizeof *estimate);
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

static void MK_F(add)(void *network, mk_step_sums_t *sums) {
    MK_F_T(network) *net = network;
    uint64_t rows = 0;
    for (int e = 0; e < net->estimators; e++) {
        const MK_F_T(mk_rkfd) *core = &net->core[e];
        mk_exact_add(&sums->theta, (double)core->theta);
        mk_exact_add(&sums->tolerance, (double)core->tolerance);
        mk_exact_add(&sums->nis, (double)core->nis);
        rows += core->nis_rows;
    }
    mk_exact_add(&sums->nis_rows, (double)rows);
}

const mk_network_t MK_F(mk_network) = {
    sizeof(MK_REAL), MK_REAL_NAME,       MK_F(open),     MK_F(close),       MK_F(start),      MK_F(set_tolerance), MK_F(incremental),
    MK_F(diffuse),   MK_F(intermediate), MK_F(estimate), MK_F(nees), MK_F(look_before), MK_F(look_after), MK_F(add)};
