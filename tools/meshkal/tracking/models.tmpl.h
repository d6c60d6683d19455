/* SPDX-License-Identifier: MIT */
/* Numbers are kept in float64 by the scenario and rounded once. */

typedef MK_F_T(mk_plugin_context) MK_F(context_t);

/* Stands for the sensor of a node that has none: the first state. */
static mk_status_t MK_F(first_state)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const int n = ((const MK_F(context_t) *)context)->n;
    (void)dt;
    for (int i = 0; i < count; i++) y[i] = x[i * n];
    return MK_OK;
}

static mk_status_t MK_F(first_state_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const int n = ((const MK_F(context_t) *)context)->n;
    (void)dt;
    (void)x;
    for (int i = 0; i < n; i++) J[i] = i == 0 ? MK_R(1.0) : MK_R(0.0);
    return MK_OK;
}

static MK_REAL *MK_F(put)(MK_REAL **next, const double *values, int count) {
    MK_REAL *const begin = *next;
    for (int i = 0; i < count; i++) begin[i] = (MK_REAL)values[i];
    *next += count;
    return begin;
}

static void MK_F(bind_own)(const MK_F_T(mk_plugin_functions) * own, MK_F(context_t) * context, MK_F_T(mk_model) * model, MK_F_T(mk_space) * space) {
    space->difference = own->difference;
    space->mean = own->mean;
    space->context = context;
    model->function = own->function;
    model->jacobian = own->jacobian;
    model->context = context;
    model->space = own->difference ? space : NULL;
}

/* What a motion or sensor knows of the scenario. */
static void MK_F(fill_context)(MK_F(context_t) * context, const mk_scenario_t *s, int rows, const mk_own_model_t *own, MK_REAL **next) {
    context->site.motion = &s->tracking->motion;
    context->n = s->n;
    context->rows = rows;
    context->parameters = own->parameters;
    context->parameter = MK_F(put)(next, own->parameter, own->parameters);
}

static int MK_F(bind_motion)(MK_F_T(mk_models) * models, const mk_plugin_t *plugin, MK_REAL **next, mk_error_t *error) {
    const mk_scenario_t *s = models->scenario;
    const mk_tracking_t *tracking = s->tracking;
    MK_F_T(mk_model) *const model = &models->transition.model;
    const mk_plugin_model_t *own;
    if (!find_own(plugin, MK_PLUGIN_MOTION, &tracking->own, "model.name", s->n, MK_BITS, &own, error)) return 0;
    MK_F(fill_context)(models->context, s, s->n, &tracking->own, next);
    if (own) {
        MK_F(bind_own)(&own->MK_OWN, models->context, model, models->space);
        models->noise = tracking->has_Q ? NULL : own->MK_OWN.noise;
        if (!tracking->has_Q && !models->noise)
            return mk_fail(error, "model: key \"Q\" is missing: the own model %s does not bring its noise", tracking->own.name);
    } else {
        const int turns = tracking->motion_kind == MK_MOTION_CONSTANT_TURN;
        model->function = turns ? MK_F(mk_constant_turn) : MK_F(mk_constant_velocity);
        model->jacobian = turns ? MK_F(mk_constant_turn_jacobian) : MK_F(mk_constant_velocity_jacobian);
        model->context = &tracking->motion;
    }
    MK_REAL *const Q = *next;
    *next += MK_PACKED(s->n);
    models->transition.Q = Q;
    return MK_F(mk_models_noise)(models, s->dt_s, Q, error);
}

static int MK_F(bind_sensor)(MK_F_T(mk_models) * models, int k, const mk_plugin_t *plugin, MK_REAL **next, mk_error_t *error) {
    static const struct {
        MK_F_T(mk_function) function;
        MK_F_T(mk_jacobian) jacobian;
        void (*difference)(const void *context, const MK_REAL *a, const MK_REAL *b, MK_REAL *d);
    } ready[] = {
        [MK_SENSOR_NONE] = {MK_F(first_state), MK_F(first_state_jacobian), NULL},
        [MK_SENSOR_RANGE] = {MK_F(mk_range), MK_F(mk_range_jacobian), NULL},
        [MK_SENSOR_BEARING] = {MK_F(mk_bearing), MK_F(mk_bearing_jacobian), MK_F(mk_bearing_difference)},
        [MK_SENSOR_RANGE_BEARING] = {MK_F(mk_range_bearing), MK_F(mk_range_bearing_jacobian), MK_F(mk_range_bearing_difference)},
        [MK_SENSOR_RANGE_RATE] = {MK_F(mk_range_rate), MK_F(mk_range_rate_jacobian), NULL},
        [MK_SENSOR_TDOA] = {MK_F(mk_tdoa), MK_F(mk_tdoa_jacobian), NULL},
    };
    static const double one = 1.0;
    const mk_scenario_t *s = models->scenario;
    const mk_sensor_t *given = &s->sensor[k];
    const mk_tracking_node_t *node = &s->tracking->node[k];
    MK_F_T(mk_sensor) *const sensor = &models->sensor[k];
    MK_F(context_t) *const context = &models->context[k + 1];
    const mk_plugin_model_t *own;
    char at[64];
    (void)snprintf(at, sizeof at, "nodes[%d].name", k);
    if (!find_own(plugin, MK_PLUGIN_SENSOR, &node->own, at, given->rows, MK_BITS, &own, error)) return 0;
    sensor->rows = (uint8_t)(given->rows > 0 ? given->rows : 1);
    sensor->R = MK_F(put)(next, given->rows > 0 ? given->R : &one, MK_PACKED(sensor->rows));
    MK_F(fill_context)(context, s, sensor->rows, &node->own, next);
    for (int i = 0; i < 3; i++) {
        context->site.position[i] = (MK_REAL)given->position_m[i];
        context->site.reference[i] = (MK_REAL)node->reference_m[i];
    }
    if (own) {
        MK_F(bind_own)(&own->MK_OWN, context, &sensor->model, &models->space[k + 1]);
        return 1;
    }
    sensor->model.function = ready[node->kind].function;
    sensor->model.jacobian = ready[node->kind].jacobian;
    sensor->model.context = context;
    if (!ready[node->kind].difference) return 1;
    models->space[k + 1].difference = ready[node->kind].difference;
    models->space[k + 1].context = &s->tracking->motion;
    sensor->model.space = &models->space[k + 1];
    return 1;
}

static int MK_F(make_gate)(MK_F_T(mk_models) * models, MK_REAL **next, mk_error_t *error) {
    const mk_gate_settings_t *settings = &models->scenario->tracking->gate;
    const int count[2] = {models->m, models->slots * models->m};
    const MK_REAL **const threshold[2] = {&models->gate.sensor, &models->gate.stacked};
    models->gate.patience = (uint16_t)settings->patience;
    models->gate.policy = (uint8_t)settings->policy;
    for (int i = 0; i < 2 && settings->exists; i++) {
        if (!(i == 0 ? settings->sensor : settings->stacked)) continue;
        const mk_status_t status = MK_F(mk_gate_thresholds)(settings->significance, count[i], *next);
        if (status != MK_OK) return mk_fail(error, "tracking.gate.significance %g: %s", settings->significance, mk_status_name(status));
        *threshold[i] = *next;
        *next += count[i];
    }
    return 1;
}

MK_F_T(mk_models) * MK_F(mk_models_open)(const mk_scenario_t *s, const mk_plugin_t *plugin, mk_error_t *error) {
    const mk_tracking_t *tracking = s->tracking;
    const size_t nodes = (size_t)s->nodes;
    const double n = s->n, alpha2 = tracking->alpha * tracking->alpha;
    if (s->nodes > UINT16_MAX) {
        (void)mk_fail(error, "nodes: %d of them; a filter takes at most %d", s->nodes, UINT16_MAX);
        return NULL;
    }
    MK_F_T(mk_models) *models = mk_allocate(1, sizeof *models);
    size_t numbers = (size_t)(s->n + 2 * MK_PACKED(s->n) + tracking->own.parameters);
    models->scenario = s;
    models->n = s->n;
    models->m = most_rows(s);
    models->slots = s->nodes;
    for (int k = 0; k < s->nodes; k++) numbers += (size_t)(MK_PACKED(s->sensor[k].rows) + 1 + tracking->node[k].own.parameters);
    numbers += tracking->gate.exists ? (nodes + 1) * (size_t)models->m : 0;
    MK_REAL *next = models->numbers = mk_allocate(numbers, sizeof *next);
    models->sensor = mk_allocate(nodes, sizeof *models->sensor);
    models->space = mk_allocate(nodes + 1, sizeof *models->space);
    models->context = mk_allocate(nodes + 1, sizeof *models->context);
    models->x0 = MK_F(put)(&next, s->x0, s->n);
    models->P0 = MK_F(put)(&next, s->P0, MK_PACKED(s->n));
    models->transform.spread = (MK_REAL)(tracking->transform == MK_TRANSFORM_KIND_SCALED ? alpha2 * (n + tracking->kappa) : n + tracking->kappa);
    models->transform.correction = (MK_REAL)(tracking->transform == MK_TRANSFORM_KIND_SCALED ? tracking->beta - alpha2 : -1.0);
    int good = MK_F(bind_motion)(models, plugin, &next, error);
    for (int k = 0; k < s->nodes && good; k++) good = MK_F(bind_sensor)(models, k, plugin, &next, error);
    if (good && MK_F(make_gate)(models, &next, error)) return models;
    MK_F(mk_models_close)(models);
    return NULL;
}

void MK_F(mk_models_close)(MK_F_T(mk_models) * models) {
    if (!models) return;
    free(models->numbers);
    free(models->sensor);
    free(models->space);
    free(models->context);
    free(models);
}

int MK_F(mk_models_noise)(const MK_F_T(mk_models) * models, double dt, MK_REAL *Q, mk_error_t *error) {
    const mk_scenario_t *s = models->scenario;
    const mk_tracking_t *tracking = s->tracking;
    mk_status_t status = MK_OK;
    if (tracking->has_Q) {
        for (int i = 0; i < MK_PACKED(s->n); i++) Q[i] = (MK_REAL)(s->Q[i] * (dt / s->dt_s));
    } else if (models->noise) {
        status = models->noise(models->context, (MK_REAL)dt, Q);
    } else {
        const double *given = tracking->acceleration_psd;
        const MK_REAL q[3] = {(MK_REAL)given[0], (MK_REAL)given[1], (MK_REAL)given[2]};
        status = tracking->motion_kind == MK_MOTION_CONSTANT_TURN
                     ? MK_F(mk_constant_turn_noise)(&tracking->motion, (MK_REAL)dt, q, (MK_REAL)tracking->turn_rate_psd, Q)
                     : MK_F(mk_constant_velocity_noise)(&tracking->motion, (MK_REAL)dt, q, Q);
    }
    return status == MK_OK || mk_fail(error, "model: the noise Q of a step of %g s cannot be had: %s", dt, mk_status_name(status));
}

int MK_F(mk_models_differentiable)(const MK_F_T(mk_models) * models, mk_error_t *error) {
    const mk_tracking_t *tracking = models->scenario->tracking;
    if (!models->transition.model.jacobian)
        return mk_fail(error, "model.name: the own model %s has no Jacobian, which this filter needs", tracking->own.name);
    for (int k = 0; k < models->slots; k++)
        if (!models->sensor[k].model.jacobian)
            return mk_fail(error, "nodes[%d].name: the own model %s has no Jacobian, which this filter needs", k, tracking->node[k].own.name);
    return 1;
}

void MK_F(mk_models_config)(const MK_F_T(mk_models) * models, const char *filter, int first, int count, MK_F_T(mk_unscented_config) * config) {
    const mk_tracking_t *tracking = models->scenario->tracking;
    memset(config, 0, sizeof *config);
    config->n = (uint16_t)models->n;
    config->m = (uint16_t)models->m;
    config->slots = (uint16_t)count;
    config->transition = models->transition;
    config->sensor = models->sensor + first;
    config->x0 = models->x0;
    config->P0 = models->P0;
    config->transform = models->transform;
    config->gate = mk_tracking_gates(tracking, filter) ? &models->gate : NULL;
    config->increments = (uint16_t)tracking->increments;
    config->update = (uint8_t)update_of(filter);
    config->rule = (uint8_t)(strcmp(filter, "mpukf") == 0 ? tracking->rule : MK_RULE_NONE);
}
