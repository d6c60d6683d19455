/* SPDX-License-Identifier: MIT */
/* The functions of mk_object_t for one MK_REAL. */
#include "simulation/look.tmpl.h"

typedef struct {
    int n, m, slots, own_first[2];
    const mk_scenario_t *scenario;
    MK_F_T(mk_node_config) config;
    MK_F_T(mk_node_gate) gate;
    MK_F_T(mk_host_node) * host;
    const MK_F_T(mk_node_view) * view; /* the host's */
    MK_REAL *threshold;
    mk_secure_t secure;
    mk_moment_t moment;
} MK_F(object);

static void MK_F(put_gate)(MK_F(object) * o, const mk_object_facts_t *facts) {
    if (!(facts->gate_reading > 0.0) && !(facts->gate_estimate > 0.0)) return;
    o->threshold = mk_allocate((size_t)o->slots, sizeof *o->threshold);
    for (int l = 0; facts->gate_reading > 0.0 && l < o->slots; l++)
        o->threshold[l] = (MK_REAL)mk_chi2_quantile(1.0 - facts->gate_reading, o->config.filter.rows[l]);
    o->gate.reading = o->threshold;
    o->gate.estimate = (MK_REAL)facts->gate_estimate;
    o->gate.patience = (uint16_t)facts->patience;
    o->config.gate = &o->gate;
}

static void MK_F(put_secure)(MK_F(object) * o) {
    const size_t most = sizeof(double) * (size_t)MK_NODE_NUMBERS(o->n, o->m);
    o->secure.window = mk_allocate((size_t)o->slots, sizeof *o->secure.window);
    o->secure.capacity = (uint16_t)(most < UINT16_MAX ? most : UINT16_MAX);
    o->secure.text = mk_allocate(o->secure.capacity, 1);
}

static void *MK_F(open)(const mk_scenario_t *s, const mk_object_facts_t *facts) {
    MK_F(object) *o = mk_allocate(1, sizeof *o);
    const mk_topology_t topology = mk_distributed_topology(s);
    MK_F(mk_node_config_make)(&o->config, s, &topology, facts->node, facts->tolerance);
    o->n = o->config.filter.n;
    o->m = o->config.filter.m;
    o->slots = o->config.filter.slots;
    o->scenario = s;
    o->own_first[1] = s->sensor[facts->node].rows;
    o->config.catch_up = (uint16_t)facts->catch_up;
    o->config.numbers = (uint8_t)facts->numbers;
    MK_F(put_gate)(o, facts);
    MK_F(put_secure)(o);
    o->host = MK_F(mk_host_node_open)(o->n, o->m, o->slots);
    o->view = &o->host->view;
    o->moment.seen = mk_snapshot_make(&MK_NETWORK, 1, s, o->own_first);
    o->moment.y = mk_allocate((size_t)(o->slots * o->m), sizeof *o->moment.y);
    o->moment.have_y = mk_allocate(2 * (size_t)o->slots, 1);
    o->moment.have_psi = o->moment.have_y + o->slots;
    return o;
}

static void MK_F(close)(void *object) {
    MK_F(object) *o = object;
    MK_F(mk_node_config_free)(&o->config);
    mk_snapshot_free(&o->moment.seen);
    free(o->moment.y);
    free(o->moment.have_y);
    free(o->host);
    free(o->threshold);
    free(o->secure.window);
    free(o->secure.text);
    free(o);
}

static size_t MK_F(blob_max)(const void *object) { return ((const MK_F(object) *)object)->host->blob_most; }

static size_t MK_F(frame_max)(const void *object) { return ((const MK_F(object) *)object)->host->frame_most; }

static mk_status_t MK_F(start)(void *object) {
    MK_F(object) *o = object;
    return MK_F(mk_node_start)(o->n, o->m, o->slots, o->view, &o->config);
}

static mk_status_t MK_F(restore)(void *object, const uint8_t *blob, size_t length) {
    MK_F(object) *o = object;
    return MK_F(mk_node_restore)(o->n, o->m, o->slots, o->view, &o->config, blob, length);
}

static mk_status_t MK_F(secure)(void *object, const mk_aead_t *aead, uint64_t sequence) {
    MK_F(object) *o = object;
    o->secure.aead = aead;
    o->secure.sequence = sequence;
    return MK_F(mk_node_secure)(o->view, &o->secure, o->slots);
}

static mk_status_t MK_F(measure)(void *object, const double *y) {
    MK_F(object) *o = object;
    MK_REAL values[MK_LARGEST_STATE];
    for (int r = 0; r < o->config.filter.rows[0]; r++) values[r] = (MK_REAL)y[r];
    return MK_F(mk_node_measure)(o->m, o->view, values);
}

static size_t MK_F(frame)(void *object, int stage, uint8_t *bytes) {
    MK_F(object) *o = object;
    return MK_F(mk_node_frame)(o->n, o->view, stage, bytes);
}

static mk_status_t MK_F(accept)(void *object, const uint8_t *bytes, size_t length) {
    MK_F(object) *o = object;
    return MK_F(mk_node_accept)(o->n, o->m, o->slots, o->view, bytes, length);
}

/* Those that are used: some may have been dropped. */
static void MK_F(look_at_readings)(MK_F(object) * o) {
    const MK_F_T(mk_rkfd_view) *const filter = &o->view->filter;
    for (int l = 0; l < o->slots; l++) {
        o->moment.have_y[l] = filter->have_y[l] != 0;
        for (int r = 0, i = l * o->m; r < o->m; r++, i++)
            o->moment.y[i] = filter->have_y[l] && r < o->config.filter.rows[l] ? (double)filter->y[i] : (double)NAN;
    }
}

static mk_status_t MK_F(incremental)(void *object) {
    MK_F(object) *o = object;
    MK_F(mk_look_before)(o->scenario, &o->view->filter, 0, &o->moment.seen);
    MK_F(mk_look_innovations)(&o->view->filter, 0, &o->moment.seen);
    /* In two parts, because the readings that are used are known between them only. */
    if (o->config.gate) MK_F(mk_node_judge_readings)(o->n, o->m, o->slots, o->view);
    MK_F(look_at_readings)(o);
    const uint32_t before = o->view->node->reinitialised;
    const mk_status_t status = MK_F(mk_node_step)(o->n, o->m, o->slots, o->view, NULL);
    /* Then it has dropped them all. */
    if (o->view->node->reinitialised != before) MK_F(look_at_readings)(o);
    return status;
}

static mk_status_t MK_F(diffuse)(void *object) {
    MK_F(object) *o = object;
    const mk_snapshot_t *seen = &o->moment.seen;
    const MK_F_T(mk_rkfd) *const core = o->view->filter.core;
    MK_REAL *theta = seen->theta, *tolerance = seen->tolerance, *nis = seen->nis;
    /* The diffusion judges once more, and refuses nothing more. */
    if (o->config.gate) MK_F(mk_node_judge_estimates)(o->n, o->slots, o->view);
    memcpy(o->moment.have_psi, o->view->filter.have_psi, (size_t)o->slots);
    *theta = core->theta;
    *tolerance = core->tolerance;
    *nis = core->nis;
    *seen->nis_rows = core->nis_rows;
    *seen->faults = core->faults;
    for (int l = 0; l < o->slots; l++)
        if (!o->moment.have_psi[l]) *seen->faults |= MK_FAULT_ESTIMATE_MISSING;
    return MK_F(mk_node_diffuse)(o->n, o->m, o->slots, o->view);
}

static mk_status_t MK_F(advance)(void *object, uint32_t step) {
    MK_F(object) *o = object;
    return MK_F(mk_node_advance)(o->n, o->m, o->slots, o->view, step);
}

static mk_status_t MK_F(restart)(void *object) {
    MK_F(object) *o = object;
    return MK_F(mk_node_restart)(o->n, o->slots, o->view, o->config.filter.x0, o->config.filter.P0);
}

static size_t MK_F(save)(void *object, uint8_t *blob) {
    MK_F(object) *o = object;
    return MK_F(mk_node_save)(o->n, o->m, o->slots, o->view, blob);
}

static mk_object_look_t MK_F(look)(const void *object) {
    const MK_F(object) *o = object;
    const MK_F_T(mk_node) *const node = o->view->node;
    const mk_object_look_t look = {node->step,      o->view->filter.core->stage, node->counts,        node->early,
                                   node->caught_up, node->restarts,              node->reinitialised, node->unsent};
    return look;
}

static const mk_moment_t *MK_F(moment)(const void *object) { return &((const MK_F(object) *)object)->moment; }

const mk_object_t MK_F(mk_object) = {
    sizeof(MK_REAL),    MK_REAL_NAME,    MK_F(open),    MK_F(close),       MK_F(blob_max), MK_F(frame_max), MK_F(start),   MK_F(restore), MK_F(secure),
    MK_F(measure),      MK_F(frame),     MK_F(accept),  MK_F(incremental), MK_F(diffuse),  MK_F(advance),   MK_F(restart), MK_F(save),    MK_F(look),
    MK_F(moment)};
