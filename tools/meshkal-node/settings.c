/* SPDX-License-Identifier: MIT */
#include "settings.h"

#include <jansson.h>
#include <math.h>
#include <meshkal/frame.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "design/node_config.h"
#include "file.h"
#include "scenario_read.h"

static const char *const top_keys[] = {"scenario", "design", "node", "real", "numbers", "clock", "listen", "peers", "multicast",
                                       "security", "gate", "catch_up", "state", "readings", "telemetry", NULL};
static const char *const clock_keys[] = {"period_ms", "split", "epoch_s", NULL};
static const char *const multicast_keys[] = {"group", "interface", "hops", NULL};
static const char *const security_keys[] = {"key_file", "boot_file", NULL};
static const char *const gate_keys[] = {"reading", "estimate", "patience", NULL};
static const char *const state_keys[] = {"file", "every_s", NULL};

/* "key.name", or "name" at the top. */
static const char *place_of(const char *key, const char *name, char place[160]) {
    (void)snprintf(place, 160, "%.70s%s%.80s", key, *key ? "." : "", name);
    return place;
}

static int read_text(mk_reader_t *r, json_t *object, const char *key, const char *name, int required, const char **text) {
    char place[160];
    json_t *value = mk_read_member(r, object, key, name, required);
    if (!value) return !required;
    if (!json_is_string(value) || json_string_length(value) == 0)
        return mk_read_bad(r, place_of(key, name, place), "must be a text that is not empty");
    *text = json_string_value(value);
    return 1;
}

/* A path, made complete: relative ones start where the settings are. */
static const char *complete(mk_settings_t *s, const char *path) {
    const char *end = strrchr(s->path, '/');
    const int folder = *path == '/' || !end ? 0 : (int)(end + 1 - s->path);
    const size_t room = (size_t)folder + strlen(path) + 1;
    char *file = mk_allocate(room, 1);
    (void)snprintf(file, room, "%.*s%s", folder, s->path, path);
    s->file[s->files++] = file;
    return file;
}

static int read_path(mk_reader_t *r, mk_settings_t *s, json_t *object, const char *key, const char *name, int required, const char **path) {
    if (!read_text(r, object, key, name, required, path)) return 0;
    if (*path) *path = complete(s, *path);
    return 1;
}

/* Absent: as it is. */
static int read_integer(mk_reader_t *r, json_t *object, const char *key, const char *name, int least, int most, int *number) {
    char place[160];
    json_t *value = json_object_get(object, name);
    if (!value) return 1;
    if (!json_is_integer(value) || json_integer_value(value) < least || json_integer_value(value) > most)
        return mk_read_bad(r, place_of(key, name, place), "must be an integer from %d to %d", least, most);
    *number = (int)json_integer_value(value);
    return 1;
}

static int read_real(mk_reader_t *r, json_t *object, const char *key, const char *name, double least, double most, double *number) {
    char place[160];
    json_t *value = json_object_get(object, name);
    if (!value) return 1;
    *number = json_is_number(value) ? json_number_value(value) : (double)NAN;
    return (*number >= least && *number <= most) || mk_read_bad(r, place_of(key, name, place), "must be a number from %g to %g", least, most);
}

/* One of the words of a null-terminated list; *index is its place. */
static int read_word(mk_reader_t *r, json_t *object, const char *name, const char *const *words, int *index) {
    json_t *value = json_object_get(object, name);
    if (!value) return 1;
    for (int i = 0; words[i] && json_is_string(value); i++)
        if (strcmp(words[i], json_string_value(value)) == 0) {
            *index = i;
            return 1;
        }
    char known[160] = "";
    for (int i = 0; words[i]; i++) (void)snprintf(known + strlen(known), sizeof known - strlen(known), "%s%s", i ? ", " : "", words[i]);
    return mk_read_bad(r, name, "must be one of: %s", known);
}

/* Section `name`, with no keys but the known; null if it is not there. */
static int read_section(mk_reader_t *r, json_t *root, const char *name, const char *const *known, json_t **section) {
    *section = json_object_get(root, name);
    return !*section || mk_read_keys(r, *section, name, known);
}

static int read_clock(mk_reader_t *r, json_t *root, mk_settings_t *s, double dt_s) {
    json_t *clock;
    double period_ms = 1000.0 * dt_s, epoch_s = 0.0;
    s->split = 0.5;
    if (!read_section(r, root, "clock", clock_keys, &clock) ||
        !read_real(r, clock, "clock", "period_ms", 1.0, 86400000.0, &period_ms) ||
        !read_real(r, clock, "clock", "split", 0.05, 0.95, &s->split) || !read_real(r, clock, "clock", "epoch_s", 0.0, 4e9, &epoch_s))
        return 0;
    if (!(period_ms >= 1.0 && period_ms <= 86400000.0))
        return mk_read_bad(r, "clock", "key \"period_ms\" is missing, and the scenario's dt_s, %g s, is not from 1 ms to a day", dt_s);
    s->period_ns = (int64_t)llround(period_ms * 1e6);
    s->epoch_ns = (int64_t)llround(epoch_s * 1e9);
    return 1;
}

static int read_security(mk_reader_t *r, json_t *root, mk_settings_t *s) {
    json_t *security;
    return read_section(r, root, "security", security_keys, &security) &&
           (!security || (read_path(r, s, security, "security", "key_file", 1, &s->key) &&
                          read_path(r, s, security, "security", "boot_file", 1, &s->boots)));
}

static int read_gate(mk_reader_t *r, json_t *root, mk_settings_t *s) {
    json_t *gate;
    s->catch_up = MK_CATCH_UP;
    return read_section(r, root, "gate", gate_keys, &gate) &&
           read_real(r, gate, "gate", "reading", 0.5, 1.0 - 1e-12, &s->gate_reading) &&
           read_real(r, gate, "gate", "estimate", 0.0, 1e30, &s->gate_estimate) &&
           read_integer(r, gate, "gate", "patience", 0, 65535, &s->patience) &&
           read_integer(r, root, "", "catch_up", 0, 65535, &s->catch_up);
}

/* "-", "udp:HOST:PORT", "unix:PATH", or a path where files are possible. */
static int read_channel(mk_reader_t *r, json_t *root, const char *name, int files, mk_settings_t *s, mk_channel_t *channel) {
    const char *text = NULL;
    if (!read_text(r, root, "", name, 0, &text)) return 0;
    if (!text || strcmp(text, "none") == 0) return 1;
    const int udp = strncmp(text, "udp:", 4) == 0, local = strncmp(text, "unix:", 5) == 0, standard = strcmp(text, "-") == 0;
    if (!udp && !local && !standard && !files) return mk_read_bad(r, name, "must be -, udp:HOST:PORT, unix:PATH or none");
    channel->kind = udp ? MK_CHANNEL_UDP : local ? MK_CHANNEL_UNIX : standard ? MK_CHANNEL_STANDARD : MK_CHANNEL_FILE;
    channel->text = udp ? text + 4 : standard ? text : complete(s, local ? text + 5 : text);
    return 1;
}

static int read_files(mk_reader_t *r, json_t *root, mk_settings_t *s) {
    json_t *state;
    s->state_every_s = 60.0;
    return read_section(r, root, "state", state_keys, &state) && (!state || read_path(r, s, state, "state", "file", 1, &s->state)) &&
           read_real(r, state, "state", "every_s", 0.01, 1e6, &s->state_every_s) && read_channel(r, root, "readings", 0, s, &s->readings) &&
           read_channel(r, root, "telemetry", 1, s, &s->telemetry);
}

/* --- who is spoken to ------------------------------------------------------------------------------------------------------ */

static int is_neighbour(const mk_scenario_t *scenario, int k, int other) {
    for (int i = scenario->first[k] + 1; i < scenario->first[k + 1]; i++)
        if (scenario->slot[i] == other) return 1;
    return 0;
}

static int read_peers(mk_reader_t *r, json_t *peers, mk_settings_t *s, const mk_scenario_t *scenario) {
    char place[160];
    if (!json_is_object(peers)) return mk_read_bad(r, "peers", "must be an object: numbers of neighbours, each with its host:port");
    s->peer = mk_allocate(json_object_size(peers), sizeof *s->peer);
    for (void *entry = json_object_iter(peers); entry; entry = json_object_iter_next(peers, entry)) {
        char *end;
        const char *name = json_object_iter_key(entry);
        const long node = strtol(name, &end, 10);
        if (end == name || *end || node < 0 || node >= scenario->nodes || !is_neighbour(scenario, s->node, (int)node)) {
            return mk_read_bad(r, place_of("peers", name, place), "%.60s is not the number of a neighbour of node %d", name, s->node);
        }
        for (int i = 0; i < s->peers; i++)
            if (s->peer[i].node == node) return mk_read_bad(r, "peers", "node %ld stands there twice", node);
        s->peer[s->peers].node = (int)node;
        if (!read_text(r, peers, "peers", name, 1, &s->peer[s->peers++].text)) return 0;
    }
    for (int i = scenario->first[s->node] + 1; i < scenario->first[s->node + 1]; i++) {
        int there = 0;
        for (int p = 0; p < s->peers; p++) there |= s->peer[p].node == scenario->slot[i];
        if (!there) return mk_read_bad(r, "peers", "node %d, a neighbour of node %d, is missing", scenario->slot[i], s->node);
    }
    return 1;
}

static int read_network(mk_reader_t *r, json_t *root, mk_settings_t *s, const mk_scenario_t *scenario) {
    json_t *multicast, *peers = json_object_get(root, "peers");
    s->hops = 1;
    if (!read_section(r, root, "multicast", multicast_keys, &multicast)) return 0;
    if (!peers == !multicast)
        return mk_read_bad(r, "peers", "%s", peers ? "stand beside \"multicast\": one of the two" : "are missing, and there is no \"multicast\"");
    if (!read_text(r, root, "", "listen", !multicast, &s->listen)) return 0;
    if (peers) return read_peers(r, peers, s, scenario);
    return read_text(r, multicast, "multicast", "group", 1, &s->group) && read_text(r, multicast, "multicast", "interface", 1, &s->interface) &&
           read_integer(r, multicast, "multicast", "hops", 0, 255, &s->hops);
}

/* --- all of it ------------------------------------------------------------------------------------------------------------- */

static int read_all(mk_reader_t *r, json_t *root, mk_settings_t *s, mk_scenario_t *scenario) {
    static const char *const reals[] = {"float32", "float64", NULL}, *const numbers[] = {"float32", "float64", "float16", NULL};
    int real = 1, format = -1;
    s->node = -1;
    if (!mk_read_keys(r, root, "", top_keys) || !read_path(r, s, root, "", "scenario", 1, &s->scenario) ||
        !read_path(r, s, root, "", "design", 0, &s->design) || !mk_read_member(r, root, "", "node", 1) ||
        !read_word(r, root, "real", reals, &real) || !read_word(r, root, "numbers", numbers, &format) || !read_security(r, root, s) ||
        !read_gate(r, root, s) || !read_files(r, root, s))
        return 0;
    s->bits = real ? 64 : 32;
    s->numbers = format < 0 ? (real ? MK_NUMBERS_F64 : MK_NUMBERS_F32) : format;
    if (s->bits == 32 && s->numbers == MK_NUMBERS_F64) return mk_read_bad(r, "numbers", "are float64, more than the node's own float32");
    if (!mk_scenario_load(scenario, s->scenario, r->error)) return 0;
    const int few = scenario->nodes <= MK_MOST_FRAMED ||
                    mk_read_bad(r, "scenario", "has %d nodes, but frames have 16 bits for the number of a node", scenario->nodes);
    const int good = few && read_integer(r, root, "", "node", 0, scenario->nodes - 1, &s->node) && read_clock(r, root, s, scenario->dt_s) &&
                     read_network(r, root, s, scenario);
    if (!good) mk_scenario_free(scenario);
    return good;
}

int mk_settings_load(mk_settings_t *s, mk_scenario_t *scenario, const char *path, mk_error_t *error) {
    size_t length;
    json_error_t place;
    memset(s, 0, sizeof *s);
    s->path = path;
    s->text = mk_read_file(path, &length, error);
    if (!s->text) return 0;
    mk_reader_t reader = {path, s->text, error, 0};
    s->root = json_loadb(s->text, length, JSON_REJECT_DUPLICATES, &place);
    const int good = s->root ? read_all(&reader, s->root, s, scenario) : mk_fail(error, "%s:%d:%d: %s", path, place.line, place.column, place.text);
    if (!good) mk_settings_free(s);
    return good;
}

void mk_settings_free(mk_settings_t *s) {
    for (int i = 0; i < s->files; i++) free(s->file[i]);
    free(s->peer);
    free(s->text);
    json_decref(s->root);
    memset(s, 0, sizeof *s);
}

int mk_settings_bad(const mk_settings_t *s, const char *key, mk_error_t *error, const char *format, ...) {
    char message[512];
    mk_reader_t reader = {s->path, s->text, error, 0};
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    return mk_read_bad(&reader, key, "%s", message);
}
