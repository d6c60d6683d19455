/* SPDX-License-Identifier: MIT */

typedef struct {
    MK_F_T(mk_host_monitor) host;
    MK_F_T(mk_monitor) core;
} MK_F_T(monitor_head);

MK_F_T(mk_host_monitor) * MK_F(mk_host_monitor_open)(const mk_monitor_settings_t *settings, int m, int places) {
    const size_t N = (size_t)(m * places), window = (size_t)settings->window, P = (size_t)places;
    const size_t numbers = N + 2 * (size_t)m + (window + 1) * (MK_PACKED(N) + N);
    /* Each type where it is aligned. */
    MK_F_T(monitor_head) *const head = mk_allocate(1, sizeof *head + P * sizeof(MK_F_T(mk_watched)) + N * sizeof(MK_F_T(mk_fault)) +
                                                          numbers * sizeof(MK_REAL) + window * sizeof(uint32_t));
    MK_F_T(mk_host_monitor) *const h = &head->host;
    MK_F_T(mk_watched) *const sensor = (MK_F_T(mk_watched) *)(void *)(head + 1);
    MK_F_T(mk_fault) *const fault = (MK_F_T(mk_fault) *)(void *)(sensor + P);
    MK_REAL *const threshold = (MK_REAL *)(void *)(fault + N), *const zero = threshold + N, *const back = zero + m;
    h->m = m;
    h->places = places;
    h->window = settings->window;
    h->config.m = (uint16_t)m;
    h->config.places = (uint16_t)places;
    h->config.window = (uint16_t)settings->window;
    h->config.threshold = threshold;
    h->config.jump = (MK_REAL)settings->jump;
    h->config.separation = (MK_REAL)settings->separation;
    h->config.evidence = (MK_REAL)settings->evidence;
    h->config.zero = zero;
    h->config.back = back;
    h->config.level = (MK_REAL)settings->level;
    h->config.slope = (MK_REAL)settings->slope;
    h->config.most = (uint16_t)(settings->most < places ? settings->most : places);
    h->config.patience = (uint16_t)settings->patience;
    h->config.scheme = (uint8_t)settings->scheme;
    h->view.core = &head->core;
    h->view.sensor = sensor;
    h->view.fault = fault;
    h->view.information = back + m;
    h->view.v = h->view.information + (window + 1) * MK_PACKED(N);
    h->view.seen = (uint32_t *)(void *)(h->view.v + (window + 1) * N);
    (void)MK_F(mk_gate_thresholds)(settings->false_alarm, (int)N, threshold);
    (void)MK_F(mk_gate_thresholds)(1e-3, m, zero);
    (void)MK_F(mk_gate_thresholds)(0.1, m, back);
    MK_F(mk_host_monitor_start)(h);
    return h;
}

void MK_F(mk_host_monitor_start)(MK_F_T(mk_host_monitor) * h) {
    (void)MK_F(mk_monitor_start)(h->m, h->places, h->window, &h->view, &h->config);
}

mk_status_t MK_F(mk_host_monitor_watch)(MK_F_T(mk_host_monitor) * h, int sensors, const uint16_t *id, const uint8_t *rows, const MK_REAL *r,
                                        const MK_REAL *S) {
    MK_REAL work[MK_MONITOR_WORK(MK_MONITOR_ROWS)];
    MK_F_T(mk_monitor_view) view = h->view;
    view.work = work;
    return MK_F(mk_monitor_watch)(&view, sensors, id, rows, r, S);
}

void MK_F(mk_host_monitor_look)(const MK_F_T(mk_host_monitor) * h, const uint16_t *id, int slots, int e, size_t first,
                                mk_monitor_snapshot_t *snapshot) {
    const MK_F_T(mk_monitor) *const core = h->view.core;
    const int alone = h->config.scheme == MK_MONITOR_RCTM || core->quiet > 0, rows = alone ? core->rows : core->window_rows;
    MK_REAL *const rctm = snapshot->rctm, *const aime = snapshot->aime, *const threshold = snapshot->threshold, *const rho = snapshot->rho;
    MK_REAL *const median = snapshot->median, *const isolation = snapshot->isolation, *const end_ratio = snapshot->end_ratio;
    rctm[e] = core->rctm;
    aime[e] = core->aime;
    threshold[e] = rows > 0 ? h->config.threshold[rows - 1] : MK_R(0.0);
    rho[e] = core->rho;
    median[e] = core->median;
    snapshot->rctm_rows[e] = core->rows;
    snapshot->aime_rows[e] = core->window_rows;
    snapshot->alarm[e] = core->alarm;
    snapshot->ended[e] = core->ended;
    for (int l = 0; l < slots; l++) {
        const size_t i = first + (size_t)l;
        snapshot->excluded[i] = 0;
        isolation[i] = end_ratio[i] = MK_R(0.0);
        for (int p = 0; p < h->places; p++) {
            const MK_F_T(mk_watched) *const sensor = &h->view.sensor[p];
            if (!sensor->used || sensor->id != id[l]) continue;
            snapshot->excluded[i] = sensor->faulty;
            isolation[i] = sensor->w;
            end_ratio[i] = sensor->ratio;
        }
    }
}
