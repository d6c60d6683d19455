/* SPDX-License-Identifier: MIT */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_tracking.h"

static const char *const motion_keys[] = {"motion", "name", "parameters", "states", "dt_s",  "acceleration_psd", "turn_rate_psd",
                                          "Q",      "x0",   "P0",         "start",  "start_s", NULL};
static const char *const motion_names[] = {"constant-velocity", "constant-turn", "plugin", NULL};
static const char *const start_names[] = {"truth", "estimate", NULL};
static const char *const known_states[] = {"px", "py", "pz", "vx", "vy", "vz", "omega"};
enum { POSITION = 0, VELOCITY = 3, OMEGA = 6, KNOWN_STATES = 7 };

/* index: of the state with each known name; -1: none. */
static int read_states(mk_reader_t *reader, json_t *states, mk_scenario_t *s, int *index) {
    mk_tracking_t *tracking = s->tracking;
    if (!json_is_array(states) || json_array_size(states) < 1 || json_array_size(states) > MK_LARGEST_STATE)
        return mk_read_bad(reader, "model.states", "must be an array of 1 to %d names", MK_LARGEST_STATE);
    s->n = (int)json_array_size(states);
    tracking->state = mk_allocate((size_t)s->n, sizeof *tracking->state);
    for (int i = 0; i < s->n; i++) {
        const char *name = json_string_value(json_array_get(states, (size_t)i));
        char place[64];
        (void)snprintf(place, sizeof place, "model.states[%d]", i);
        if (!name || !*name) return mk_read_bad(reader, place, "must be a name");
        for (int j = 0; j < i; j++)
            if (strcmp(name, tracking->state[j]) == 0) return mk_read_bad(reader, place, "is %.40s again, as entry %d", name, j);
        tracking->state[i] = mk_allocate(strlen(name) + 1, 1);
        memcpy(tracking->state[i], name, strlen(name));
        for (int j = 0; j < KNOWN_STATES; j++)
            if (strcmp(name, known_states[j]) == 0) index[j] = i;
    }
    return 1;
}

/* Which state is what. */
static int find_states(mk_reader_t *reader, mk_scenario_t *s, const int *index) {
    mk_tracking_t *tracking = s->tracking;
    mk_motion_t *motion = &tracking->motion;
    const char *motion_name = motion_names[tracking->motion_kind];
    const int own = tracking->motion_kind == MK_MOTION_PLUGIN, positions = (index[0] >= 0) + (index[1] >= 0) + (index[2] >= 0);
    if (positions > 0 && (index[0] < 0 || index[1] < 0)) return mk_read_bad(reader, "model.states", "a position needs px and py");
    if (!own && positions == 0) return mk_read_bad(reader, "model.states", "%s needs px, py, vx and vy, or also pz and vz", motion_name);
    motion->n = (uint8_t)s->n;
    motion->dimensions = (uint8_t)positions;
    tracking->has_velocity = positions > 0;
    s->position_count = positions;
    for (int axis = 0; axis < positions; axis++) {
        const int velocity = index[VELOCITY + axis];
        s->position_states[axis] = index[POSITION + axis];
        motion->position[axis] = (uint8_t)index[POSITION + axis];
        motion->velocity[axis] = (uint8_t)(velocity >= 0 ? velocity : 0);
        tracking->has_velocity &= velocity >= 0;
        if (!own && velocity < 0) return mk_read_bad(reader, "model.states", "%s needs %s", motion_name, known_states[VELOCITY + axis]);
    }
    if (!own && positions == 2 && index[VELOCITY + 2] >= 0) return mk_read_bad(reader, "model.states", "name vz without pz");
    motion->turn_rate = (uint8_t)(index[OMEGA] >= 0 ? index[OMEGA] : 0);
    return tracking->motion_kind != MK_MOTION_CONSTANT_TURN || index[OMEGA] >= 0 ||
           mk_read_bad(reader, "model.states", "%s needs omega", motion_name);
}

static int read_densities(mk_reader_t *reader, json_t *model, mk_tracking_t *tracking) {
    static const char must[] = "a number, 0 or above";
    json_t *psd = json_object_get(model, "acceleration_psd");
    if (json_is_array(psd)) {
        if (!mk_read_vector(reader, psd, "model.acceleration_psd", tracking->motion.dimensions, tracking->acceleration_psd)) return 0;
        for (int axis = 0; axis < tracking->motion.dimensions; axis++)
            if (tracking->acceleration_psd[axis] < 0.0) return mk_read_bad(reader, "model.acceleration_psd", "entry %d must be %s", axis, must);
    } else {
        double *const q = tracking->acceleration_psd;
        if (!mk_read_between(reader, model, "model", "acceleration_psd", 0.0, DBL_MAX, "a number, 0 or above, or one for each axis", q)) return 0;
        q[1] = q[2] = q[0];
    }
    tracking->has_psd = 1;
    return mk_read_between(reader, model, "model", "turn_rate_psd", 0.0, DBL_MAX, must, &tracking->turn_rate_psd);
}

static int read_noise(mk_reader_t *reader, json_t *model, mk_scenario_t *s) {
    mk_tracking_t *tracking = s->tracking;
    const mk_motion_kind_t kind = tracking->motion_kind;
    json_t *Q = json_object_get(model, "Q"), *psd = json_object_get(model, "acceleration_psd"), *turn = json_object_get(model, "turn_rate_psd");
    s->Q = mk_allocate((size_t)(s->n * (s->n + 1) / 2), sizeof *s->Q);
    if (turn && kind != MK_MOTION_CONSTANT_TURN) return mk_read_bad(reader, "model.turn_rate_psd", "goes with motion constant-turn");
    if (psd && kind == MK_MOTION_PLUGIN) return mk_read_bad(reader, "model.acceleration_psd", "an own model's noise is Q, or its own");
    if (Q && (psd || turn)) return mk_read_bad(reader, psd ? "model.acceleration_psd" : "model.turn_rate_psd", "is Q already: give one of them");
    tracking->has_Q = Q != NULL;
    if (Q) return mk_read_symmetric(reader, Q, "model.Q", s->n, 0, s->Q);
    if (kind == MK_MOTION_PLUGIN) return 1;
    if (!psd) return mk_read_bad(reader, "model", "key \"acceleration_psd\" or \"Q\" is missing");
    if (!read_densities(reader, model, tracking)) return 0;
    const mk_status_t status =
        kind == MK_MOTION_CONSTANT_TURN
            ? mk_constant_turn_noise_f64(&tracking->motion, s->dt_s, tracking->acceleration_psd, tracking->turn_rate_psd, s->Q)
            : mk_constant_velocity_noise_f64(&tracking->motion, s->dt_s, tracking->acceleration_psd, s->Q);
    return status == MK_OK || mk_read_bad(reader, "model.acceleration_psd", "makes noise beyond all numbers in dt_s (%s)", mk_status_name(status));
}

int mk_read_own_model(mk_reader_t *reader, json_t *object, const char *at, int is_own, mk_own_model_t *own) {
    char place[80];
    json_t *name = json_object_get(object, "name"), *parameters = json_object_get(object, "parameters");
    if (!is_own && (name || parameters)) {
        (void)snprintf(place, sizeof place, "%.60s.%s", at, name ? "name" : "parameters");
        return mk_read_bad(reader, place, "is for own models only, \"plugin\"");
    }
    if (!is_own) return 1;
    if (!mk_read_member(reader, object, at, "name", 1)) return 0;
    (void)snprintf(place, sizeof place, "%.60s.name", at);
    const char *text = json_string_value(name);
    if (!text || !*text) return mk_read_bad(reader, place, "must be the name of an own model");
    own->name = mk_allocate(strlen(text) + 1, 1);
    memcpy(own->name, text, strlen(text));
    if (!parameters) return 1;
    (void)snprintf(place, sizeof place, "%.60s.parameters", at);
    if (!json_is_array(parameters) || json_array_size(parameters) > 1000000) return mk_read_bad(reader, place, "must be an array of numbers");
    own->parameters = (int)json_array_size(parameters);
    own->parameter = mk_allocate((size_t)own->parameters, sizeof *own->parameter);
    return mk_read_vector(reader, parameters, place, own->parameters, own->parameter);
}

static int read_start(mk_reader_t *reader, json_t *model, mk_scenario_t *s) {
    mk_tracking_t *tracking = s->tracking;
    json_t *x0 = mk_read_member(reader, model, "model", "x0", 1), *P0 = x0 ? mk_read_member(reader, model, "model", "P0", 1) : NULL;
    json_t *start = json_object_get(model, "start");
    if (!P0) return 0;
    s->x0 = mk_allocate((size_t)s->n, sizeof *s->x0);
    s->P0 = mk_allocate((size_t)(s->n * (s->n + 1) / 2), sizeof *s->P0);
    if (!mk_read_vector(reader, x0, "model.x0", s->n, s->x0) || !mk_read_symmetric(reader, P0, "model.P0", s->n, 1, s->P0)) return 0;
    tracking->estimate_is_drawn = start ? mk_read_word(reader, start, "model.start", start_names) : 1;
    tracking->has_start_s = json_object_get(model, "start_s") != NULL;
    return tracking->estimate_is_drawn >= 0 &&
           mk_read_between(reader, model, "model", "start_s", -DBL_MAX, DBL_MAX, "a number of seconds", &tracking->start_s);
}

int mk_read_motion(mk_reader_t *reader, json_t *model, mk_scenario_t *s) {
    int index[KNOWN_STATES] = {-1, -1, -1, -1, -1, -1, -1};
    mk_tracking_t *const tracking = s->tracking = mk_allocate(1, sizeof *s->tracking);
    if (!mk_read_keys(reader, model, "model", motion_keys)) return 0;
    const int kind = mk_read_word(reader, json_object_get(model, "motion"), "model.motion", motion_names);
    json_t *states = kind < 0 ? NULL : mk_read_member(reader, model, "model", "states", 1);
    if (!states) return 0;
    tracking->motion_kind = (mk_motion_kind_t)kind;
    s->dt_s = 1.0;
    return mk_read_own_model(reader, model, "model", kind == MK_MOTION_PLUGIN, &tracking->own) && read_states(reader, states, s, index) &&
           find_states(reader, s, index) &&
           mk_read_between(reader, model, "model", "dt_s", DBL_MIN, DBL_MAX, "a number of seconds above 0", &s->dt_s) &&
           read_noise(reader, model, s) && read_start(reader, model, s);
}
