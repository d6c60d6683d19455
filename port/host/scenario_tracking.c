/* SPDX-License-Identifier: MIT */
#include "scenario_tracking.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const node_keys[] = {"sensor", "name", "parameters", "position_m", "reference_m", "R", "range_limit_m", "loss", "fault", NULL};
static const char *const sensor_names[] = {"none", "range", "bearing", "range-bearing", "range-rate", "tdoa", "plugin", NULL};
static const char *const protocol_names[] = {"paper", "perron", "metropolis", "ratio", NULL};
static const char *const filter_names[] = MK_TRACKING_FILTERS;
static const char probability[] = "a probability, from 0 to 1";

const char *mk_sensor_kind_name(mk_sensor_kind_t kind) { return sensor_names[kind]; }
const char *mk_protocol_name(mk_protocol_t protocol) { return protocol_names[protocol]; }

int mk_tracking_gates(const mk_tracking_t *tracking, const char *filter) {
    for (int i = 0; i < MK_TRACKING_FILTER_COUNT && tracking->gate.exists; i++)
        if (strcmp(filter, filter_names[i]) == 0) return (int)(tracking->gate.filters >> i & 1u);
    return 0;
}

/* --- a node ---------------------------------------------------------------------------------------------------------------- */

/* Rows that R must have; -1 and an error. */
static int find_rows(mk_reader_t *reader, json_t *R, const char *at, const mk_tracking_t *tracking, mk_sensor_kind_t kind) {
    const int dimensions = tracking->motion.dimensions;
    char place[80];
    (void)snprintf(place, sizeof place, "%.60s.sensor", at);
    if (kind == MK_SENSOR_PLUGIN) {
        place[strlen(place) - strlen("sensor")] = 'R';
        place[strlen(place) - strlen("sensor") + 1] = 0;
        if (!json_is_array(R) || json_array_size(R) < 1 || json_array_size(R) > MK_LARGEST_STATE)
            return mk_read_bad(reader, place, "must be an array of 1 to %d rows", MK_LARGEST_STATE) - 1;
        return (int)json_array_size(R);
    }
    if (dimensions == 0) return mk_read_bad(reader, place, "%s needs px and py among model.states", sensor_names[kind]) - 1;
    if (kind == MK_SENSOR_RANGE_RATE && !tracking->has_velocity)
        return mk_read_bad(reader, place, "range-rate needs vx and vy%s among model.states", dimensions == 3 ? " and vz" : "") - 1;
    return kind == MK_SENSOR_BEARING ? dimensions - 1 : kind == MK_SENSOR_RANGE_BEARING ? dimensions : 1;
}

static int read_reference(mk_reader_t *reader, json_t *node, const char *at, int dimensions, const mk_sensor_t *sensor, mk_tracking_node_t *more) {
    json_t *reference = json_object_get(node, "reference_m");
    char place[80];
    (void)snprintf(place, sizeof place, "%.60s.reference_m", at);
    if (!reference) return more->kind != MK_SENSOR_TDOA || mk_read_member(reader, node, at, "reference_m", 1);
    if (more->kind != MK_SENSOR_TDOA && more->kind != MK_SENSOR_PLUGIN) return mk_read_bad(reader, place, "is for tdoa and own models only");
    const size_t count = json_array_size(reference);
    const int wanted = dimensions > 0 ? dimensions : count == 3 ? 3 : 2;
    if (!mk_read_vector(reader, reference, place, wanted, more->reference_m)) return 0;
    return more->kind != MK_SENSOR_TDOA || memcmp(more->reference_m, sensor->position_m, sizeof more->reference_m) != 0 ||
           mk_read_bad(reader, place, "is position_m itself: the difference would always be 0");
}

static int read_fault(mk_reader_t *reader, json_t *node, const char *at, int rows, mk_tracking_node_t *more) {
    static const char *const keys[] = {"probability", "sigma", NULL};
    json_t *fault = json_object_get(node, "fault");
    char place[80], sigma_place[96];
    if (!fault) return 1;
    (void)snprintf(place, sizeof place, "%.60s.fault", at);
    (void)snprintf(sigma_place, sizeof sigma_place, "%s.sigma", place);
    if (!mk_read_keys(reader, fault, place, keys)) return 0;
    json_t *sigma = mk_read_member(reader, fault, place, "probability", 1) ? mk_read_member(reader, fault, place, "sigma", 1) : NULL;
    if (!sigma || !mk_read_between(reader, fault, place, "probability", 0.0, 1.0, probability, &more->fault_probability)) return 0;
    more->fault_sigma = mk_allocate((size_t)rows, sizeof *more->fault_sigma);
    if (!json_is_array(sigma)) {
        if (!mk_read_between(reader, fault, place, "sigma", DBL_MIN, DBL_MAX, "a number above 0, or one for each row", more->fault_sigma)) return 0;
        for (int r = 1; r < rows; r++) more->fault_sigma[r] = more->fault_sigma[0];
        return 1;
    }
    if (!mk_read_vector(reader, sigma, sigma_place, rows, more->fault_sigma)) return 0;
    for (int r = 0; r < rows; r++)
        if (more->fault_sigma[r] < 0.0) return mk_read_bad(reader, sigma_place, "entry %d is negative", r);
    return 1;
}

int mk_read_tracking_node(mk_reader_t *reader, json_t *node, const char *at, const mk_tracking_t *tracking, mk_sensor_t *sensor,
                          mk_tracking_node_t *more, json_t **R) {
    static const char *const relay_keys[] = {"sensor", "position_m", NULL};
    char place[80];
    if (!mk_read_keys(reader, node, at, node_keys)) return -1;
    json_t *kind = mk_read_member(reader, node, at, "sensor", 1), *position = json_object_get(node, "position_m");
    (void)snprintf(place, sizeof place, "%.60s.sensor", at);
    const int index = kind ? mk_read_word(reader, kind, place, sensor_names) : -1;
    if (index < 0) return -1;
    more->kind = (mk_sensor_kind_t)index;
    more->range_limit_m = (double)INFINITY;
    if (more->kind == MK_SENSOR_NONE && !mk_read_keys(reader, node, at, relay_keys)) return -1;
    if (position && !mk_read_position(reader, position, at, tracking->motion.dimensions, sensor->position_m, &sensor->position_count)) return -1;
    if (more->kind == MK_SENSOR_NONE) return 0;
    if (!position && more->kind != MK_SENSOR_PLUGIN) {
        (void)mk_read_member(reader, node, at, "position_m", 1);
        return -1;
    }
    *R = mk_read_member(reader, node, at, "R", 1);
    const int rows = *R ? find_rows(reader, *R, at, tracking, more->kind) : -1;
    if (rows < 0 || !mk_read_own_model(reader, node, at, more->kind == MK_SENSOR_PLUGIN, &more->own) ||
        !read_reference(reader, node, at, tracking->motion.dimensions, sensor, more) || !read_fault(reader, node, at, rows, more) ||
        !mk_read_between(reader, node, at, "loss", 0.0, 1.0, probability, &more->loss) ||
        !mk_read_between(reader, node, at, "range_limit_m", DBL_MIN, DBL_MAX, "a number of metres above 0", &more->range_limit_m))
        return -1;
    (void)snprintf(place, sizeof place, "%.60s.range_limit_m", at);
    if (more->range_limit_m <= DBL_MAX && !(position && tracking->motion.dimensions > 0))
        return mk_read_bad(reader, place, "needs %s", position ? "px and py among model.states" : "position_m") - 1;
    return rows;
}

/* --- settings of the filters ----------------------------------------------------------------------------------------------- */

static int read_transform(mk_reader_t *reader, json_t *transform, int n, mk_tracking_t *tracking) {
    static const char key[] = "tracking.transform";
    static const char *const keys[] = {"kind", "kappa", "alpha", "beta", NULL}, *const kinds[] = {"julier", "cubature", "scaled", NULL};
    tracking->transform = MK_TRANSFORM_KIND_JULIER;
    tracking->kappa = 3.0 - n;
    tracking->alpha = 1.0;
    tracking->beta = 2.0;
    if (!transform) return n + tracking->kappa > 0.0;
    if (!mk_read_keys(reader, transform, key, keys)) return 0;
    json_t *kind = mk_read_member(reader, transform, key, "kind", 1);
    const int index = kind ? mk_read_word(reader, kind, "tracking.transform.kind", kinds) : -1;
    if (index < 0) return 0;
    tracking->transform = (mk_transform_kind_t)index;
    if (index != MK_TRANSFORM_KIND_JULIER) tracking->kappa = 0.0;
    for (int i = 1; keys[i]; i++) {
        char place[64];
        (void)snprintf(place, sizeof place, "%s.%s", key, keys[i]);
        if (json_object_get(transform, keys[i]) && (index == MK_TRANSFORM_KIND_CUBATURE || (i > 1 && index == MK_TRANSFORM_KIND_JULIER)))
            return mk_read_bad(reader, place, "does not go with kind %s", kinds[index]);
    }
    if (!mk_read_between(reader, transform, key, "kappa", -DBL_MAX, DBL_MAX, "a number", &tracking->kappa) ||
        !mk_read_between(reader, transform, key, "alpha", DBL_MIN, DBL_MAX, "a number above 0", &tracking->alpha) ||
        !mk_read_between(reader, transform, key, "beta", -DBL_MAX, DBL_MAX, "a number", &tracking->beta))
        return 0;
    return n + tracking->kappa > 0.0 || mk_read_bad(reader, "tracking.transform.kappa", "must be above -%d, the number of states", n);
}

static int read_flag(mk_reader_t *reader, json_t *value, const char *key, int *flag) {
    if (value && !json_is_boolean(value)) return mk_read_bad(reader, key, "must be true or false");
    *flag = !value || json_is_true(value);
    return 1;
}

static int read_filters(mk_reader_t *reader, json_t *list, unsigned *filters) {
    const char *words[MK_TRACKING_FILTER_COUNT + 1] = MK_TRACKING_FILTERS;
    *filters = (1u << MK_TRACKING_FILTER_COUNT) - 1;
    if (!list) return 1;
    if (!json_is_array(list) || json_array_size(list) == 0) return mk_read_bad(reader, "tracking.gate.filters", "must be an array of filters");
    *filters = 0;
    for (size_t i = 0; i < json_array_size(list); i++) {
        char place[64];
        (void)snprintf(place, sizeof place, "tracking.gate.filters[%zu]", i);
        const int index = mk_read_word(reader, json_array_get(list, i), place, words);
        if (index < 0) return 0;
        *filters |= 1u << index;
    }
    return 1;
}

static int read_gate(mk_reader_t *reader, json_t *gate, mk_gate_settings_t *settings) {
    static const char key[] = "tracking.gate";
    static const char *const keys[] = {"significance", "sensor", "stacked", "policy", "patience", "filters", NULL}, *const policies[] = {"skip", "inflate", NULL};
    if (!gate) return 1;
    settings->exists = 1;
    settings->patience = MK_TRACKING_PATIENCE;
    if (!mk_read_keys(reader, gate, key, keys) || !mk_read_member(reader, gate, key, "significance", 1) ||
        !mk_read_between(reader, gate, key, "significance", DBL_MIN, 1.0 - DBL_EPSILON / 2, "between 0 and 1", &settings->significance) ||
        !read_flag(reader, json_object_get(gate, "sensor"), "tracking.gate.sensor", &settings->sensor) ||
        !read_flag(reader, json_object_get(gate, "stacked"), "tracking.gate.stacked", &settings->stacked) ||
        !mk_read_integer(reader, gate, key, "patience", 0, 65535, &settings->patience) ||
        !read_filters(reader, json_object_get(gate, "filters"), &settings->filters))
        return 0;
    if (!settings->sensor && !settings->stacked) return mk_read_bad(reader, key, "judges nothing: sensor and stacked are both false");
    json_t *policy = json_object_get(gate, "policy");
    settings->policy = policy ? mk_read_word(reader, policy, "tracking.gate.policy", policies) : 0;
    return settings->policy >= 0;
}

static int read_consensus(mk_reader_t *reader, json_t *consensus, mk_tracking_t *tracking) {
    static const char key[] = "tracking.consensus";
    static const char *const keys[] = {"protocol", "iterations", "information", NULL}, *const kinds[] = {"residual", "paper", NULL};
    tracking->protocol = MK_PROTOCOL_METROPOLIS;
    tracking->iterations = 10;
    if (!consensus) return 1;
    if (!mk_read_keys(reader, consensus, key, keys) || !mk_read_integer(reader, consensus, key, "iterations", 0, 65535, &tracking->iterations)) return 0;
    json_t *protocol = json_object_get(consensus, "protocol"), *information = json_object_get(consensus, "information");
    const int index = protocol ? mk_read_word(reader, protocol, "tracking.consensus.protocol", protocol_names) : MK_PROTOCOL_METROPOLIS;
    if (index < 0) return 0;
    tracking->protocol = (mk_protocol_t)index;
    tracking->without_residual = information ? mk_read_word(reader, information, "tracking.consensus.information", kinds) : 0;
    return tracking->without_residual >= 0;
}

int mk_read_tracking(mk_reader_t *reader, json_t *root, mk_scenario_t *s) {
    static const char *const keys[] = {"transform", "increments", "rule", "gate", "consensus", NULL};
    static const char *const rules[] = {"none", "innovation", "mahalanobis", NULL};
    mk_tracking_t *tracking = s->tracking;
    json_t *settings = json_object_get(root, "tracking"), *rule = json_object_get(settings, "rule");
    tracking->increments = 30;
    if (!mk_read_between(reader, root, "", "reading_loss", 0.0, 1.0, probability, &tracking->reading_loss) ||
        (settings && !mk_read_keys(reader, settings, "tracking", keys)))
        return 0;
    tracking->rule = rule ? mk_read_word(reader, rule, "tracking.rule", rules) : 1;
    return tracking->rule >= 0 && mk_read_integer(reader, settings, "tracking", "increments", 1, 65535, &tracking->increments) &&
           read_transform(reader, json_object_get(settings, "transform"), s->n, tracking) &&
           read_gate(reader, json_object_get(settings, "gate"), &tracking->gate) &&
           read_consensus(reader, json_object_get(settings, "consensus"), tracking);
}

static void free_own(mk_own_model_t *own) {
    free(own->name);
    free(own->parameter);
}

void mk_tracking_free(mk_tracking_t *tracking, int n, int nodes) {
    if (!tracking) return;
    for (int i = 0; i < n && tracking->state; i++) free(tracking->state[i]);
    for (int k = 0; k < nodes && tracking->node; k++) {
        free_own(&tracking->node[k].own);
        free(tracking->node[k].fault_sigma);
    }
    free_own(&tracking->own);
    free(tracking->state);
    free(tracking->node);
    free(tracking);
}
