/* SPDX-License-Identifier: MIT */
/* One filter of meshkal/unscented.h at a centre, a slot for each node. */

struct MK_F(unit) {
    MK_F_T(mk_unscented_config) config;
    MK_F_T(mk_unscented) core;
    MK_F_T(mk_unscented_view) view;
};

/* Arrays of a filter and its configuration. work stays the caller's. */
static void MK_F(open_view)(MK_F_T(mk_unscented_view) * view, MK_F_T(mk_unscented) * core, int n, int m, int slots) {
    view->core = core;
    view->x = mk_allocate((size_t)(n + MK_PACKED(n) + m * slots), sizeof *view->x);
    view->L = view->x + n;
    view->z = view->L + MK_PACKED(n);
    view->have = mk_allocate((size_t)slots, 1);
    view->record = mk_allocate((size_t)slots, sizeof *view->record);
}

static void MK_F(close_view)(MK_F_T(mk_unscented_view) * view) {
    free(view->x);
    free(view->have);
    free(view->record);
}

static void MK_F(central_open)(MK_F(tracker) * t) {
    const int slots = t->models->slots;
    struct MK_F(unit) *const unit = t->unit = mk_allocate(1, sizeof *unit);
    MK_F(mk_models_config)(t->models, t->setting->filter->name, 0, slots, &unit->config);
    unit->config.x0 = t->x0;
    MK_F(open_view)(&unit->view, &unit->core, t->n, t->m, slots);
    unit->view.work = mk_allocate((size_t)MK_UNSCENTED_WORK(t->n, t->m, slots), sizeof *unit->view.work);
}

static void MK_F(central_close)(MK_F(tracker) * t) {
    MK_F(close_view)(&t->unit->view);
    free(t->unit->view.work);
    free(t->unit);
}

static mk_status_t MK_F(central_start)(MK_F(tracker) * t) {
    return MK_F(mk_unscented_start)(t->n, t->m, t->models->slots, &t->unit->view, &t->unit->config);
}

static mk_status_t MK_F(central_predict)(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q) {
    (void)e;
    return MK_F(mk_unscented_predict)(t->n, &t->unit->view, dt, Q);
}

static mk_status_t MK_F(central_restart)(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q) {
    (void)e;
    (void)dt;
    (void)Q;
    return MK_F(mk_unscented_restart)(t->n, t->models->slots, &t->unit->view, t->unit->view.x, t->unit->config.P0);
}

/* The readings that reach the centre. */
static void MK_F(central_hear)(MK_F(tracker) * t, long step, const mk_instant_t *instant) {
    const int slots = t->models->slots;
    mk_random_t random;
    mk_track_links(t->setting, t->run, 0, step, &random);
    for (int l = 0; l < slots; l++) t->look.arrived[l] = (uint8_t)mk_track_arrives(t->setting, &random);
    const mk_reading_t *reading = instant->reading, *const end = reading + instant->count;
    for (int l = 0; l < slots; l++) {
        const int link = t->look.arrived[l];
        t->look.arrived[l] = 0;
        if (reading == end || reading->node != l) continue;
        if (link) {
            const mk_status_t status = MK_F(mk_unscented_put)(t->m, slots, &t->unit->view, l, MK_F(rows_of)(t, reading));
            if (status != MK_OK) MK_F(failed)(t, status);
            t->look.arrived[l] = 1;
            t->look.decision[l] = status == MK_OK ? MK_READING_ACCEPTED : MK_READING_REFUSED;
        } else {
            t->own_count[MK_TRACK_LOST]++;
        }
        reading++;
    }
}

static int MK_F(central_step)(MK_F(tracker) * t, long step, const mk_instant_t *instant, mk_error_t *error) {
    const int slots = t->models->slots;
    const MK_F_T(mk_unscented_view) *const view = &t->unit->view;
    if (!MK_F(predict_all)(t, instant->dt, MK_F(central_predict), MK_F(central_restart), error)) return 0;
    MK_F(central_hear)(t, step, instant);
    const uint32_t judged = MK_F(judged)(&t->unit->core);
    mk_status_t status = MK_F(mk_unscented_update)(t->n, t->m, slots, view);
    for (int left = slots; status != MK_OK && left > 0; left--) {
        MK_F(failed)(t, status);
        const int bad = t->unit->core.failed, one = bad < slots && view->have[bad];
        for (int l = one ? bad : 0; l < (one ? bad + 1 : slots); l++) {
            if (view->have[l]) t->look.decision[l] = MK_READING_REFUSED;
            (void)MK_F(mk_unscented_drop)(slots, view, l);
        }
        status = MK_F(mk_unscented_update)(t->n, t->m, slots, view);
    }
    MK_F(settle)(t, view, 0, 0, slots, judged);
    return 1;
}

static void MK_F(central_look)(MK_F(tracker) * t) {
    const MK_F_T(mk_unscented) *const core = &t->unit->core;
    (void)MK_F(mk_unscented_covariance)(t->n, &t->unit->view, t->V);
    MK_F(look_at)(t, 0, t->unit->view.x, t->V);
    t->look.count[MK_TRACK_UPDATES] = core->updates;
    t->look.count[MK_TRACK_RULE] = core->rule_fired;
    t->look.count[MK_TRACK_REINITIALISED] += core->reinitialised;
}
