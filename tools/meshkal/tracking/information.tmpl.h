/* SPDX-License-Identifier: MIT */
/* duif and kcf: the node objects of meshkal/duif.h, which exchange their frames, plain, numbers in their own precision. Without iterations
   (duif, L = 0) there is one, of which nothing arrives: each node then uses its own readings only. epsilon of kcf: 1 / (1 + most neighbours),
   below which the pull towards the neighbours' estimates is stable. */

struct MK_F(node) {
    MK_F_T(mk_duif_config) config;
    MK_F_T(mk_duif) core;
    MK_F_T(mk_unscented) filter;
    MK_F_T(mk_consensus) consensus;
    MK_F_T(mk_duif_view) view;
    MK_REAL *room;
    uint16_t *nodes; /* then degrees */
};

static void MK_F(information_open_node)(MK_F(tracker) * t, int e) {
    static const uint8_t protocol[4] = {MK_CONSENSUS_PAPER, MK_CONSENSUS_PERRON, MK_CONSENSUS_METROPOLIS, MK_CONSENSUS_RATIO};
    const mk_track_setting_t *const setting = t->setting;
    const mk_topology_t *const topology = &setting->topology;
    const mk_tracking_t *const tracking = setting->scenario->tracking;
    const int n = t->n, first = topology->first[e], slots = topology->first[e + 1] - first, kalman = setting->filter->kind == MK_TRACK_CONSENSUS;
    struct MK_F(node) *const node = &t->node[e];
    MK_F_T(mk_duif_config) *const config = &node->config;
    const size_t row = (size_t)MK_DUIF_VALUES(n) + 1, rows = (size_t)(2 * slots + 1), work = (size_t)MK_DUIF_WORK(n, t->m);
    int most = 0;
    for (int k = 0; k < t->E; k++)
        if (topology->first[k + 1] - topology->first[k] - 1 > most) most = topology->first[k + 1] - topology->first[k] - 1;
    node->nodes = mk_allocate((size_t)(2 * slots), sizeof *node->nodes);
    for (int l = 0; l < slots; l++) {
        const int k = topology->slot[first + l];
        node->nodes[l] = (uint16_t)k;
        node->nodes[slots + l] = (uint16_t)(topology->first[k + 1] - topology->first[k] - 1);
    }
    MK_F(mk_models_config)(t->models, setting->filter->name, e, 1, &config->filter);
    config->filter.x0 = t->x0;
    config->consensus.values = (uint16_t)(n + MK_PACKED(n) + (kalman ? n : 0));
    config->consensus.slots = (uint16_t)slots;
    config->consensus.iterations = (uint16_t)(kalman || setting->iterations == 0 ? 1 : setting->iterations);
    config->consensus.network = (uint16_t)t->E;
    config->consensus.protocol = kalman ? MK_CONSENSUS_SUM : protocol[tracking->protocol];
    config->consensus.degree = node->nodes + slots;
    config->nodes = node->nodes;
    config->numbers = MK_BITS == 64 ? MK_NUMBERS_F64 : MK_NUMBERS_F32;
    config->paper_information = (uint8_t)tracking->without_residual;
    config->epsilon = kalman ? MK_R(1.0) / (MK_REAL)(1 + most) : MK_R(0.0);
    node->view.core = &node->core;
    MK_F(open_view)(&node->view.filter, &node->filter, n, t->m, 1);
    node->room = mk_allocate(rows * row + work, sizeof *node->room);
    node->view.consensus.core = &node->consensus;
    node->view.consensus.now = node->room;
    node->view.consensus.next = node->view.consensus.now + (size_t)slots * row;
    node->view.consensus.sum = node->view.consensus.next + (size_t)slots * row;
    node->view.work = node->view.filter.work = node->view.consensus.work = node->view.consensus.sum + row;
    node->view.heard = mk_allocate((size_t)slots, sizeof *node->view.heard);
    node->view.seen = mk_allocate((size_t)(2 * slots), 1);
    node->view.consensus.have = node->view.seen + slots;
}

static void MK_F(information_open)(MK_F(tracker) * t) {
    t->node = mk_allocate((size_t)t->E, sizeof *t->node);
    for (int e = 0; e < t->E; e++) MK_F(information_open_node)(t, e);
    t->frame_most = MK_FRAME_SEALED + MK_CONSENSUS_HEADER + sizeof(MK_REAL) * MK_DUIF_VALUES((size_t)t->n);
    t->frames = mk_allocate((size_t)t->E, t->frame_most);
    t->frame_length = mk_allocate((size_t)t->E, sizeof *t->frame_length);
    t->watched = mk_allocate((size_t)(t->E + 1) * (size_t)MK_PACKED(t->n), sizeof *t->watched);
}

static void MK_F(information_close)(MK_F(tracker) * t) {
    for (int e = 0; e < t->E; e++) {
        MK_F(close_view)(&t->node[e].view.filter);
        free(t->node[e].room);
        free(t->node[e].nodes);
        free(t->node[e].view.heard);
        free(t->node[e].view.seen);
    }
    free(t->node);
    free(t->frames);
    free(t->frame_length);
    free(t->watched);
}

static mk_status_t MK_F(information_start)(MK_F(tracker) * t) {
    mk_status_t status = MK_OK;
    for (int e = 0; e < t->E && status == MK_OK; e++)
        status = MK_F(mk_duif_start)(t->n, t->m, t->node[e].config.consensus.slots, &t->node[e].view, &t->node[e].config);
    return status;
}

static mk_status_t MK_F(information_predict)(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q) {
    return MK_F(mk_duif_predict)(t->n, &t->node[e].view, dt, Q);
}

static mk_status_t MK_F(information_restart)(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q) {
    (void)dt;
    (void)Q;
    return MK_F(mk_duif_restart)(t->n, &t->node[e].view, t->node[e].view.filter.x, t->node[e].config.filter.P0);
}

/* A node's own reading becomes its contribution; what the model or the arithmetic refuses is left out, at last by way of P0. */
static void MK_F(information_contribute)(MK_F(tracker) * t, int e, const mk_reading_t *reading) {
    struct MK_F(node) *const node = &t->node[e];
    const int place = t->setting->topology.first[e];
    const uint32_t judged = MK_F(judged)(&node->filter);
    if (reading) {
        const mk_status_t status = MK_F(mk_duif_measure)(t->m, &node->view, MK_F(rows_of)(t, reading));
        if (status != MK_OK) MK_F(failed)(t, status);
        t->look.arrived[place] = 1;
        t->look.decision[place] = status == MK_OK ? MK_READING_ACCEPTED : MK_READING_REFUSED;
    }
    for (int attempt = 0; attempt < 3; attempt++) {
        const mk_status_t status = MK_F(mk_duif_contribute)(t->n, t->m, &node->view);
        if (status == MK_OK) break;
        MK_F(failed)(t, status);
        if (reading) t->look.decision[place] = MK_READING_REFUSED;
        (void)MK_F(mk_duif_drop)(&node->view);
        if (attempt == 1 && MK_F(information_restart)(t, e, MK_R(0.0), NULL) == MK_OK) t->own_count[MK_TRACK_REINITIALISED]++;
    }
    MK_F(settle)(t, &node->view.filter, e, place, 1, judged);
}

static void MK_F(information_watch)(MK_F(tracker) * t, int iteration) {
    const int n = t->n, packed = MK_PACKED(n);
    double *const mean = t->watched + t->E * packed;
    for (int e = 0; e < t->E; e++) {
        MK_REAL *const values = t->node[e].view.work;
        const int known = MK_F(mk_consensus_average)(&t->node[e].view.consensus, values) == MK_OK;
        for (int i = 0; i < packed; i++) t->watched[e * packed + i] = known ? (double)values[n + i] : 0.0;
    }
    t->look.disagreement[iteration] = disagreement(n, t->E, (size_t)packed, t->watched, mean);
}

static void MK_F(information_exchange)(MK_F(tracker) * t, int deaf) {
    const mk_topology_t *const topology = &t->setting->topology;
    for (int e = 0; e < t->E; e++) t->frame_length[e] = MK_F(mk_duif_frame)(&t->node[e].view, t->frames + (size_t)e * t->frame_most);
    for (int e = 0; e < t->E; e++)
        for (int i = topology->first[e] + 1; i < topology->first[e + 1] && !deaf; i++) {
            const int k = topology->slot[i];
            if (!mk_track_arrives(t->setting, &t->random[e])) continue;
            const mk_status_t status = MK_F(mk_duif_accept)(t->n, &t->node[e].view, t->frames + (size_t)k * t->frame_most, t->frame_length[k]);
            if (status == MK_OK) t->look.messages[i]++;
            else MK_F(failed)(t, status);
        }
    for (int e = 0; e < t->E; e++) {
        const mk_status_t status = MK_F(mk_duif_iterate)(t->n, &t->node[e].view);
        if (status != MK_OK) MK_F(failed)(t, status);
    }
}

static int MK_F(information_step)(MK_F(tracker) * t, long step, const mk_instant_t *instant, mk_error_t *error) {
    const int deaf = t->setting->filter->kind == MK_TRACK_INFORMATION && t->setting->iterations == 0;
    const int watch = t->setting->watch && t->setting->filter->kind == MK_TRACK_INFORMATION;
    if (!MK_F(predict_all)(t, instant->dt, MK_F(information_predict), MK_F(information_restart), error)) return 0;
    const mk_reading_t *const *const reading = MK_F(readings)(t, instant);
    for (int e = 0; e < t->E; e++) {
        mk_track_links(t->setting, t->run, e, step, &t->random[e]);
        MK_F(information_contribute)(t, e, reading[e]);
    }
    if (watch) MK_F(information_watch)(t, 0);
    for (int l = 0; l < t->node[0].config.consensus.iterations; l++) {
        MK_F(information_exchange)(t, deaf);
        if (watch && !deaf) MK_F(information_watch)(t, l + 1);
    }
    for (int e = 0; e < t->E; e++) {
        const mk_status_t status = MK_F(mk_duif_fuse)(t->n, &t->node[e].view);
        const unsigned flags = t->node[e].core.flags;
        if (status != MK_OK) MK_F(failed)(t, status);
        t->own_count[MK_TRACK_ISOLATED] += (flags & MK_DUIF_ISOLATED) != 0;
        t->own_count[MK_TRACK_UNINFORMED] += (flags & MK_DUIF_UNINFORMED) != 0;
        t->own_count[MK_TRACK_UNFUSED] += (flags & MK_DUIF_UNFUSED) != 0;
    }
    return 1;
}

static void MK_F(information_look)(MK_F(tracker) * t) {
    t->look.count[MK_TRACK_UPDATES] = 0.0;
    for (int e = 0; e < t->E; e++) {
        const struct MK_F(node) *const node = &t->node[e];
        (void)MK_F(mk_unscented_covariance)(t->n, &node->view.filter, t->V);
        MK_F(look_at)(t, e, node->view.filter.x, t->V);
        t->look.count[MK_TRACK_UPDATES] += node->filter.updates;
        t->look.count[MK_TRACK_REINITIALISED] += node->filter.reinitialised;
    }
}
