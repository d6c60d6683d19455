/* SPDX-License-Identifier: MIT */

typedef struct {
    MK_F_T(mk_node_config) config;
    MK_F_T(mk_rkfd_steady) steady;
    MK_REAL *limit; /* its arrays; null: the gain is never frozen */
    MK_F_T(mk_host_node) * host;
    mk_recorder_t recorder;
    uint8_t *frame[2]; /* of stage 1 and 2, and their lengths */
    size_t length[2];
} MK_F_T(recorded);

static MK_F_T(recorded) * MK_F(recorded_node)(const mk_node_records_t *r, int k) { return (MK_F_T(recorded) *)r->node + k; }

static void MK_F(close)(mk_node_records_t *r, int k) {
    MK_F_T(recorded) *const one = MK_F(recorded_node)(r, k);
    if (!one->host) return;
    MK_F(mk_node_config_free)(&one->config);
    free(one->host);
    free(one->limit);
    free(one->recorder.bytes);
    free(one->frame[0]);
    free(one->frame[1]);
}

/* Room for what begins a record, and for two steps at least: all items of one are there when it is written out. */
static size_t MK_F(room)(const mk_node_records_t *r, const MK_F_T(mk_host_node) * h) {
    const size_t n = (size_t)h->n, m = (size_t)h->m, slots = (size_t)h->slots, size = sizeof(MK_REAL);
    const size_t step = 2 * (slots - 1) * (MK_ITEM_OVERHEAD + MK_FRAME_HEADER) + (slots - 1) * (m + n) * size + 4 * MK_ITEM_OVERHEAD +
                        (1 + m + 3 * n) * size + 4;
    const size_t numbers = MK_MODEL_NUMBERS(n) + MK_CONFIG_NUMBERS(n, m, slots) + 1 + MK_STEADY_NUMBERS(n, m, slots) + 3;
    const size_t begin = h->blob_most + 2 * MK_ITEM_OVERHEAD + 20 + 4 * slots + size * numbers;
    size_t share = ALL_ROOM / (size_t)r->nodes;
    if (share < LEAST_ROOM) share = LEAST_ROOM;
    if (share > MOST_ROOM) share = MOST_ROOM;
    if (share < begin) share = begin;
    return share > 2 * step ? share : 2 * step;
}

/* The steady part, where the simulated node has one. */
static void MK_F(freeze)(mk_node_records_t *r, int k, MK_F_T(recorded) * one) {
    MK_F_T(mk_rkfd_config) *const filter = &one->config.filter;
    const char *why;
    if (!(r->c->frozen > 0.0) || r->c->filter->mode == MK_TOLERANCE_SCHEDULE) return;
    one->limit = mk_allocate(MK_STEADY_NUMBERS((size_t)filter->n, (size_t)filter->m, (size_t)filter->slots), sizeof *one->limit);
    if (MK_F(mk_steady_make)(&one->steady, one->limit, filter, r->c->scenario, r->topology, k, r->tolerance[k], r->c->frozen, &why))
        filter->steady = &one->steady;
}

static void MK_F(open)(mk_node_records_t *r, int k) {
    MK_F_T(recorded) *const one = MK_F(recorded_node)(r, k);
    MK_F(mk_node_config_make)(&one->config, r->c->scenario, r->topology, k, r->tolerance[k]);
    MK_F(freeze)(r, k, one);
    one->host = MK_F(mk_host_node_open)(one->config.filter.n, one->config.filter.m, one->config.filter.slots);
    one->recorder.capacity = MK_F(room)(r, one->host);
    one->recorder.bytes = mk_allocate(one->recorder.capacity, 1);
    one->recorder.with_configuration = 1;
    one->frame[0] = mk_allocate(one->host->frame_most, 1);
    one->frame[1] = mk_allocate(one->host->frame_most, 1);
    const MK_F_T(mk_host_node) *const h = one->host;
    mk_status_t status = MK_F(mk_node_start)(h->n, h->m, h->slots, &h->view, &one->config);
    if (status == MK_OK) status = MK_F(mk_node_record)(h->n, h->m, h->slots, &h->view, &one->recorder);
    if (status != MK_OK) fail_node(r, k, "node %d: its node object cannot be started: %s", k, mk_status_name(status));
}

/* What the object says must be what the simulation says: the first number that is not. */
static void MK_F(compare)(mk_node_records_t *r, int k, const char *what, const MK_REAL *object, const MK_REAL *simulated) {
    for (int i = 0; i < r->c->scenario->n; i++) {
        if (memcmp(object + i, simulated + i, sizeof *object) == 0) continue;
        fail_node(r, k, "step %d, node %d: %s[%d] is %a in the node object, %a in the simulation: an internal error, please report it", r->t, k, what, i,
                  (double)object[i], (double)simulated[i]);
        return;
    }
}

static void MK_F(measure)(mk_node_records_t *r, int k) {
    MK_F_T(recorded) *const one = MK_F(recorded_node)(r, k);
    const MK_F_T(mk_host_node) *const h = one->host;
    const double *const reading = r->y + r->row_first[k];
    MK_REAL y[MK_LARGEST_STATE];
    if (r->schedule) (void)MK_F(mk_node_set_tolerance)(&h->view, (MK_REAL)r->schedule[k]);
    for (int i = 0; i < one->config.filter.rows[0]; i++) y[i] = (MK_REAL)reading[i];
    if (!isnan(reading[0])) (void)MK_F(mk_node_measure)(h->m, &h->view, y);
    one->length[0] = MK_F(mk_node_frame)(h->n, &h->view, MK_STAGE_MEASUREMENT, one->frame[0]);
}

/* Frames of a stage that arrive. */
static void MK_F(hear)(mk_node_records_t *r, int k, int stage) {
    const MK_F_T(mk_host_node) *const h = MK_F(recorded_node)(r, k)->host;
    const int base = r->topology->first[k];
    for (int l = 1; l < h->slots; l++) {
        const MK_F_T(recorded) *const from = MK_F(recorded_node)(r, r->topology->slot[base + l]);
        if (!r->arrived[base + l]) continue;
        const mk_status_t status =
            MK_F(mk_node_accept)(h->n, h->m, h->slots, &h->view, from->frame[stage - MK_STAGE_MEASUREMENT], from->length[stage - MK_STAGE_MEASUREMENT]);
        if (status != MK_OK && r->good)
            fail_node(r, k, "step %d, node %d: it refuses the frame of node %d: %s: an internal error, please report it", r->t, k,
                      r->topology->slot[base + l], mk_status_name(status));
    }
}

static void MK_F(increment)(mk_node_records_t *r, int k) {
    MK_F_T(recorded) *const one = MK_F(recorded_node)(r, k);
    const MK_F_T(mk_host_node) *const h = one->host;
    MK_F(hear)(r, k, MK_STAGE_MEASUREMENT);
    for (int l = 0; l < h->slots && r->excluded; l++)
        if (r->excluded[r->topology->first[k] + l]) (void)MK_F(mk_node_drop)(&h->view, l);
    (void)MK_F(mk_node_incremental)(h->n, h->m, h->slots, &h->view, NULL);
    if (r->good) MK_F(compare)(r, k, "psi", h->view.filter.psi, (const MK_REAL *)r->psi + (size_t)k * (size_t)h->n);
    one->length[1] = MK_F(mk_node_frame)(h->n, &h->view, MK_STAGE_ESTIMATE, one->frame[1]);
}

static void MK_F(diffuse)(mk_node_records_t *r, int k) {
    MK_F_T(recorded) *const one = MK_F(recorded_node)(r, k);
    const MK_F_T(mk_host_node) *const h = one->host;
    MK_REAL x[MK_LARGEST_STATE];
    MK_F(hear)(r, k, MK_STAGE_ESTIMATE);
    (void)MK_F(mk_node_diffuse)(h->n, h->m, h->slots, &h->view);
    for (int i = 0; i < h->n; i++) x[i] = (MK_REAL)r->x[(size_t)k * (size_t)h->n + (size_t)i];
    if (r->good) MK_F(compare)(r, k, "x", h->view.filter.x, x);
    if (one->recorder.lost) fail_node(r, k, "step %d, node %d: %u items did not fit: an internal error, please report it", r->t, k, (unsigned)one->recorder.lost);
    if (one->recorder.used > one->recorder.capacity / 2) write_out(r, k, &one->recorder);
}

static void MK_F(flush)(mk_node_records_t *r, int k) { write_out(r, k, &MK_F(recorded_node)(r, k)->recorder); }
