/* SPDX-License-Identifier: MIT */
#include "scenario.h"

#include <jansson.h>
#include <math.h>
#include <sodium.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "file.h"
#include "json_place.h"
#include "scenario_faults.h"
#include "scenario_graph.h"
#include "scenario_monitor.h"
#include "scenario_navigation.h"
#include "scenario_nodes.h"
#include "scenario_read.h"
#include "scenario_tracking.h"

static const char *const top_keys[] = {"name", "model", "nodes", "edges", "weights", "tolerance",
                                       "steps", "seed", "faults", "monitor", NULL};
static const char *const tracking_keys[] = {"name", "model", "nodes",        "edges",    "weights", "tolerance",
                                            "steps", "seed", "faults", "monitor", "reading_loss", "tracking", NULL};
static const char *const model_keys[] = {"A", "Q", "input", "x0", "P0", "dt_s", "position_states", NULL};

static int read_model(mk_reader_t *reader, json_t *root, mk_scenario_t *s) {
    json_t *model = mk_read_member(reader, root, "", "model", 1);
    if (!model) return 0;
    if (json_object_get(model, "motion")) return mk_read_motion(reader, model, s);
    if (json_object_get(model, "navigation")) return mk_read_navigation(reader, model, s);
    if (!mk_read_keys(reader, model, "model", model_keys)) return 0;
    json_t *A = mk_read_member(reader, model, "model", "A", 1), *Q = mk_read_member(reader, model, "model", "Q", 1);
    if (!A || !Q) return 0;
    if (!json_is_array(A) || json_array_size(A) == 0) return mk_read_bad(reader, "model.A", "must be an array of rows");
    if (json_array_size(A) > MK_LARGEST_STATE)
        return mk_read_bad(reader, "model.A", "has %zu rows; at most %d states", json_array_size(A), MK_LARGEST_STATE);
    s->n = (int)json_array_size(A);
    const int n = s->n;
    s->A = mk_allocate((size_t)(n * n), sizeof *s->A);
    s->Q = mk_allocate((size_t)(n * (n + 1) / 2), sizeof *s->Q);
    if (!mk_read_matrix(reader, A, "model.A", n, n, s->A) || !mk_read_symmetric(reader, Q, "model.Q", n, 0, s->Q)) return 0;
    json_t *input = json_object_get(model, "input"), *x0 = json_object_get(model, "x0"), *P0 = json_object_get(model, "P0");
    s->input = mk_allocate((size_t)n, sizeof *s->input);
    s->x0 = mk_allocate((size_t)n, sizeof *s->x0);
    s->P0 = mk_allocate((size_t)(n * (n + 1) / 2), sizeof *s->P0);
    for (int i = 0; i < n; i++) s->P0[i * (i + 1) / 2 + i] = 1.0;
    if ((input && !mk_read_vector(reader, input, "model.input", n, s->input)) || (x0 && !mk_read_vector(reader, x0, "model.x0", n, s->x0)) ||
        (P0 && !mk_read_symmetric(reader, P0, "model.P0", n, 1, s->P0)))
        return 0;
    s->dt_s = 1.0;
    json_t *dt = json_object_get(model, "dt_s"), *states = json_object_get(model, "position_states");
    if (dt && (!mk_read_number(reader, dt, "model.dt_s", &s->dt_s) || !(s->dt_s > 0.0)))
        return mk_read_bad(reader, "model.dt_s", "must be a number of seconds above 0");
    if (!states) return 1;
    if (!json_is_array(states) || json_array_size(states) < 1 || json_array_size(states) > 3)
        return mk_read_bad(reader, "model.position_states", "must be an array of 1 to 3 state numbers");
    s->position_count = (int)json_array_size(states);
    for (int i = 0; i < s->position_count; i++) {
        json_t *state = json_array_get(states, (size_t)i);
        if (!json_is_integer(state) || json_integer_value(state) < 0 || json_integer_value(state) >= n)
            return mk_read_bad(reader, "model.position_states", "entry %d must be a state number from 0 to %d", i, n - 1);
        s->position_states[i] = (int)json_integer_value(state);
        for (int j = 0; j < i; j++)
            if (s->position_states[j] == s->position_states[i])
                return mk_read_bad(reader, "model.position_states", "names state %d twice", s->position_states[i]);
    }
    return 1;
}

static int read_rest(mk_reader_t *reader, json_t *root, mk_scenario_t *s) {
    json_t *name = json_object_get(root, "name"), *tolerance = json_object_get(root, "tolerance");
    json_t *steps = json_object_get(root, "steps"), *seed = json_object_get(root, "seed");
    if (name && !json_is_string(name)) return mk_read_bad(reader, "name", "must be a string");
    const char *text = name ? json_string_value(name) : "";
    s->name = mk_allocate(strlen(text) + 1, 1);
    memcpy(s->name, text, strlen(text));
    if (tolerance && (!mk_read_number(reader, tolerance, "tolerance", &s->tolerance) || s->tolerance < 0.0))
        return mk_read_bad(reader, "tolerance", "must be a number, 0 or above (twice the Kullback-Leibler divergence in nats)");
    s->steps = 100;
    if (steps) {
        if (!json_is_integer(steps) || json_integer_value(steps) < 1 || json_integer_value(steps) > 1000000000)
            return mk_read_bad(reader, "steps", "must be an integer from 1 to 1e9");
        s->steps = (int)json_integer_value(steps);
    }
    s->seed = 1;
    if (seed) {
        if (!json_is_integer(seed) || json_integer_value(seed) < 0) return mk_read_bad(reader, "seed", "must be an integer, 0 or above");
        s->seed = (uint64_t)json_integer_value(seed);
    }
    return mk_read_faults(reader, root, s) && mk_read_monitor(reader, root, s) && (!s->tracking || mk_read_tracking(reader, root, s));
}

static int hash_text(mk_scenario_t *s, mk_error_t *error) {
    unsigned char digest[crypto_hash_sha256_BYTES];
    if (sodium_init() < 0) return mk_fail(error, "libsodium does not start");
    (void)crypto_hash_sha256(digest, (const unsigned char *)s->text, s->text_length);
    (void)sodium_bin2hex(s->sha256, sizeof s->sha256, digest, sizeof digest);
    return 1;
}

int mk_scenario_load(mk_scenario_t *s, const char *path, mk_error_t *error) {
    if (!mk_scenario_load_any(s, path, error)) return 0;
    if (!s->tracking && !s->navigation) return 1;
    mk_reader_t reader = {path, s->text, error, 0};
    (void)mk_read_bad(&reader, s->tracking ? "model.motion" : "model.navigation", "a scenario of %s: here the model must be linear, with A and Q",
                      s->tracking ? "tracking" : "navigation");
    mk_scenario_free(s);
    return 0;
}

int mk_scenario_load_any(mk_scenario_t *s, const char *path, mk_error_t *error) {
    memset(s, 0, sizeof *s);
    s->text = mk_read_file(path, &s->text_length, error);
    if (!s->text) return 0;
    if (strlen(s->text) != s->text_length) {
        mk_scenario_free(s);
        return mk_fail(error, "%s: a zero byte: not a JSON text", path);
    }
    /* Nodes and edges are parsed one by one: a tree of them all takes twenty times the memory of the scenario. */
    static const char *const lists[2] = {"nodes", "edges"};
    mk_elements_t elements[2];
    json_error_t place;
    mk_reader_t reader = {path, s->text, error, 0};
    json_t *root = mk_read_outline(s->text, s->text_length, lists, elements, 2, &place);
    const char *const *known = json_object_get(json_object_get(root, "model"), "motion") ? tracking_keys : top_keys;
    const int good = root && mk_read_keys(&reader, root, "", known) && read_model(&reader, root, s) &&
                     mk_read_nodes(&reader, root, &elements[0], s) && mk_read_graph(&reader, root, &elements[1], s) &&
                     (!s->navigation || mk_check_navigation(&reader, s)) && read_rest(&reader, root, s) && hash_text(s, error);
    mk_elements_close(&elements[0]);
    mk_elements_close(&elements[1]);
    if (!root || reader.no_json) {
        /* Where exactly, jansson knows when it has the whole text. */
        json_decref(root);
        root = json_loadb(s->text, s->text_length, JSON_REJECT_DUPLICATES, &place);
        (void)mk_fail(error, "%s:%d:%d: %s", path, place.line, place.column, root ? "cannot be cut into its elements" : place.text);
    }
    json_decref(root);
    if (!good) mk_scenario_free(s);
    return good;
}

void mk_scenario_drop_text(mk_scenario_t *s) {
    free(s->text);
    s->text = NULL;
    s->text_length = 0;
}

void mk_scenario_free(mk_scenario_t *s) {
    for (int i = 0; s->block && i < s->blocks; i++) free(s->block[i]);
    free(s->block);
    mk_tracking_free(s->tracking, s->n, s->nodes);
    mk_navigation_free(s->navigation);
    free(s->name);
    free(s->fault);
    free(s->A);
    free(s->Q);
    free(s->input);
    free(s->x0);
    free(s->P0);
    free(s->sensor);
    free(s->first);
    free(s->slot);
    free(s->weight);
    free(s->text);
    memset(s, 0, sizeof *s);
}
