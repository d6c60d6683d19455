/* SPDX-License-Identifier: MIT */
/* mk_tracker_<real>: the kinds under one interface. */

static void *MK_F(open_models)(const mk_scenario_t *scenario, const mk_plugin_t *plugin, mk_error_t *error) {
    return MK_F(mk_models_open)(scenario, plugin, error);
}

static void MK_F(close_models)(void *models) { MK_F(mk_models_close)(models); }

static mk_status_t MK_F(start)(void *tracker, int run, const double *estimate) {
    MK_F(tracker) *const t = tracker;
    t->run = run;
    for (int i = 0; i < t->n; i++) t->x0[i] = (MK_REAL)estimate[i];
    for (int e = 0; e < t->E; e++) t->owed[e] = 0.0;
    memset(t->own_count, 0, sizeof t->own_count);
    MK_F(clear_look)(t);
    switch (t->setting->filter->kind) {
    case MK_TRACK_CENTRAL: return MK_F(central_start)(t);
    case MK_TRACK_EXTENDED: return MK_F(extended_start)(t);
    default: return MK_F(information_start)(t);
    }
}

static void MK_F(close)(void *tracker) {
    MK_F(tracker) *const t = tracker;
    switch (t->setting->filter->kind) {
    case MK_TRACK_CENTRAL: MK_F(central_close)(t); break;
    case MK_TRACK_EXTENDED: MK_F(extended_close)(t); break;
    default: MK_F(information_close)(t);
    }
    mk_track_look_close(&t->look);
    free(t->Q);
    free(t->owed);
    free(t->random);
    free(t->reading);
    free(t);
}

static void *MK_F(open)(const void *models, const mk_track_setting_t *setting, mk_error_t *error) {
    MK_F(tracker) *const t = mk_allocate(1, sizeof *t);
    t->models = models;
    t->setting = setting;
    t->n = t->models->n;
    t->m = t->models->m;
    t->E = setting->topology.estimators;
    t->Q_dt = -1.0;
    t->Q = mk_allocate((size_t)(2 * MK_PACKED(t->n) + t->m + t->n), sizeof *t->Q);
    t->V = t->Q + MK_PACKED(t->n);
    t->z = t->V + MK_PACKED(t->n);
    t->x0 = t->z + t->m;
    t->owed = mk_allocate((size_t)t->E, sizeof *t->owed);
    t->random = mk_allocate((size_t)t->E, sizeof *t->random);
    t->reading = mk_allocate((size_t)t->models->slots, sizeof *t->reading);
    mk_track_look_open(&t->look, setting);
    switch (setting->filter->kind) {
    case MK_TRACK_CENTRAL: MK_F(central_open)(t); break;
    case MK_TRACK_EXTENDED: MK_F(extended_open)(t); break;
    default: MK_F(information_open)(t);
    }
    const int derivative = setting->filter->kind == MK_TRACK_EXTENDED || strcmp(setting->filter->name, "ekf") == 0;
    const char *const name = setting->filter->name;
    mk_error_t why;
    mk_status_t status = MK_OK;
    if (derivative && !MK_F(mk_models_differentiable)(t->models, &why)) {
        (void)mk_fail(error, "%s needs derivatives: %s", name, why.text);
    } else {
        status = MK_F(start)(t, 0, setting->scenario->x0);
        if (status == MK_OK) return t;
        (void)mk_fail(error, "%s in float%d: its configuration is refused (%s)%s", name, MK_BITS, mk_status_name(status),
                      status == MK_ERROR_NOT_POSITIVE_DEFINITE ? ": P0, or some R, is not positive definite in this precision" : "");
    }
    MK_F(close)(t);
    return NULL;
}

static int MK_F(step)(void *tracker, long step, const mk_instant_t *instant, mk_error_t *error) {
    MK_F(tracker) *const t = tracker;
    int good;
    MK_F(clear_look)(t);
    switch (t->setting->filter->kind) {
    case MK_TRACK_CENTRAL: good = MK_F(central_step)(t, step, instant, error); break;
    case MK_TRACK_EXTENDED: good = MK_F(extended_step)(t, step, instant, error); break;
    default: good = MK_F(information_step)(t, step, instant, error);
    }
    MK_F(count_decisions)(t);
    return good;
}

static const mk_track_look_t *MK_F(look)(void *tracker) {
    MK_F(tracker) *const t = tracker;
    memcpy(t->look.count, t->own_count, sizeof t->look.count);
    switch (t->setting->filter->kind) {
    case MK_TRACK_CENTRAL: MK_F(central_look)(t); break;
    case MK_TRACK_EXTENDED: MK_F(extended_look)(t); break;
    default: MK_F(information_look)(t);
    }
    return &t->look;
}

const mk_tracker_t MK_F(mk_tracker) = {sizeof(MK_REAL),     MK_BITS == 32 ? "float32" : "float64", MK_F(open_models), MK_F(close_models), MK_F(open),
                                       MK_F(close),         MK_F(start),                           MK_F(step),        MK_F(look)};
