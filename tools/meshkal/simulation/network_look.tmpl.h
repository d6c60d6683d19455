/* SPDX-License-Identifier: MIT */
/* network.tmpl.h: what a network tells of itself. */

static void MK_F(intermediate)(void *network, const int *estimator, int count, void *psi) {
    MK_F_T(network) *net = network;
    MK_REAL *next = psi;
    for (int i = 0; i < count; i++, next += net->n) memcpy(next, net->psi + (size_t)estimator[i] * (size_t)net->n, (size_t)net->n * sizeof *next);
}

static void MK_F(estimate)(void *network, int begin, int end, double *estimate) {
    const MK_F_T(network) *net = network;
    const MK_REAL *const x = net->x + (size_t)begin * (size_t)net->n;
    const size_t count = (size_t)(end - begin) * (size_t)net->n;
    for (size_t i = 0; i < count; i++) estimate[i] = (double)x[i];
}

static void MK_F(nees)(void *network, const double *x, double *nees) {
    MK_F_T(network) *net = network;
    for (int e = 0; e < net->estimators; e++) {
        const MK_REAL *xh = net->x + (size_t)e * (size_t)net->n, *W = net->W + (size_t)e * (size_t)MK_PACKED(net->n);
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
    for (int e = 0; e < net->estimators; e++) {
        const MK_F_T(mk_rkfd_view) view = MK_F(view)(net, 0, e);
        MK_F(mk_look_before)(net->scenario, &view, e, snapshot);
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
        snapshot->frozen[e] = core->frozen;
    }
}

static void MK_F(look_monitor)(void *network, int begin, int end, mk_monitor_snapshot_t *snapshot, uint32_t *rejected) {
    const MK_F_T(network) *net = network;
    const int *first = net->topology->first;
    for (int e = begin; e < end; e++) {
        MK_F(mk_host_monitor_look)(net->monitor[e], slot_number, first[e + 1] - first[e], e, (size_t)first[e], snapshot);
        rejected[e] = net->monitor[e]->view.core->rejected;
    }
}

static void MK_F(add)(void *network, int begin, int end, mk_exact_t *sums) {
    const MK_F_T(network) *net = network;
    uint64_t rows = 0;
    for (int e = begin; e < end; e++) {
        const MK_F_T(mk_rkfd) *core = &net->core[e];
        mk_exact_add(&sums[MK_THETA], (double)core->theta);
        mk_exact_add(&sums[MK_TOLERANCE], (double)core->tolerance);
        mk_exact_add(&sums[MK_NIS], (double)core->nis);
        rows += core->nis_rows;
    }
    mk_exact_add(&sums[MK_NIS_ROWS], (double)rows);
}
