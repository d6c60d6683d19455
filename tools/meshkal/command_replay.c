/* SPDX-License-Identifier: MIT */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "json_out.h"
#include "playback/playback.h"

/* States that the summary names one by one. */
#define MOST_BEGINS 10

typedef struct {
    const char *configuration, *json;
    int all;
    json_t *list; /* of all differences; null: not asked for */
} arguments_t;

/* The first item CONFIGURATION of a record. 1, or 0 and an error. */
static int find_configuration(const char *path, const uint8_t *bytes, size_t length, mk_item_t *item, mk_error_t *error) {
    int damaged = 0;
    for (size_t at = 0, size; (size = mk_item_read(bytes + at, length - at, item, &damaged)) > 0; at += size)
        if (item->kind == MK_ITEM_CONFIGURATION) return 1;
    return mk_fail(error, "%s: %s", path, damaged ? "not a record, or damaged before its configuration" : "no configuration in it");
}

static const char *status_name(uint64_t status) { return status < MK_STATUS_COUNT ? mk_status_name((mk_status_t)status) : "unknown"; }

/* A value of a difference as text: a name, an integer, or decimal and hexadecimal. */
static void value_text(const mk_difference_t *d, uint64_t value, char *text, size_t room) {
    const double number = mk_bits_value(d->bits, value);
    if (strcmp(d->what, "status") == 0) (void)snprintf(text, room, "%s (%" PRIu64 ")", status_name(value), value);
    else if (d->bits == 0) (void)snprintf(text, room, "%" PRIu64, value);
    else (void)snprintf(text, room, "%-24.*g %a", d->bits == 32 ? 9 : 17, number, number);
}

/* "psi[3]" */
static void place_text(const mk_difference_t *d, char *text, size_t room) {
    if (d->element < 0) (void)snprintf(text, room, "%s", d->what);
    else (void)snprintf(text, room, "%s[%d]", d->what, d->element);
}

static json_t *value_json(const mk_difference_t *d, uint64_t value) {
    char text[64];
    json_t *object = json_object();
    if (d->bits == 0) {
        mk_json_set(object, "value", json_integer((json_int_t)value));
        if (strcmp(d->what, "status") == 0) mk_json_set(object, "name", json_string(status_name(value)));
        return object;
    }
    mk_json_set(object, "value", mk_json_number(mk_bits_value(d->bits, value)));
    (void)snprintf(text, sizeof text, "%a", mk_bits_value(d->bits, value));
    mk_json_set(object, "hexadecimal", json_string(text));
    (void)snprintf(text, sizeof text, "0x%0*" PRIx64, d->bits / 4, value);
    mk_json_set(object, "bits", json_string(text));
    return object;
}

static json_t *difference_json(const mk_difference_t *d) {
    char text[64];
    json_t *object = json_object();
    const uint64_t ulp = mk_difference_ulp(d);
    mk_json_set(object, "item", json_integer((json_int_t)d->item));
    mk_json_set(object, "byte", json_integer((json_int_t)d->offset));
    mk_json_set(object, "kind", json_string(mk_item_name(d->kind)));
    mk_json_set(object, "step", json_integer(d->step));
    place_text(d, text, sizeof text);
    mk_json_set(object, "what", json_string(text));
    mk_json_set(object, "recorded", value_json(d, d->recorded));
    mk_json_set(object, "replayed", value_json(d, d->replayed));
    if (d->bits) mk_json_set(object, "ulp", ulp == UINT64_MAX ? json_null() : mk_json_number((double)ulp));
    return object;
}

static void print_difference(const char *title, const mk_difference_t *d) {
    char what[64], recorded[96], replayed[96];
    const uint64_t ulp = mk_difference_ulp(d);
    place_text(d, what, sizeof what);
    value_text(d, d->recorded, recorded, sizeof recorded);
    value_text(d, d->replayed, replayed, sizeof replayed);
    (void)printf("%s: item %zu (%s) at byte %zu, step %" PRIu32 ": %s\n    recorded  %s\n    replayed  %s\n", title, d->item, mk_item_name(d->kind),
                 d->offset, d->step, what, recorded, replayed);
    if (d->bits && ulp == UINT64_MAX) (void)printf("    distance  none: not a number\n");
    else if (d->bits) (void)printf("    distance  %" PRIu64 " ulp%s\n", ulp, ulp == 0 ? " (zeros of other sign)" : "");
}

static void take_difference(void *context, const mk_difference_t *d) {
    const arguments_t *a = context;
    if (a->all) print_difference("difference", d);
    if (a->list) (void)json_array_append_new(a->list, difference_json(d));
}

static const char *begin_name(const mk_begin_t *begin) {
    return begin->kind == MK_BEGIN_FIRST ? "first" : begin->kind == MK_BEGIN_SEAMLESS ? "seamless" : begin->kind == MK_BEGIN_GAP ? "gap" : "other";
}

/* Where the record goes on from another state than the replay was in; seamless ones only add up. */
static void print_begins(const mk_playback_t *p) {
    size_t seamless = 0, shown = 0;
    for (size_t i = 1; i < p->begins; i++) {
        const mk_begin_t *b = &p->begin[i];
        if (b->kind == MK_BEGIN_SEAMLESS) {
            seamless++;
            continue;
        }
        if (++shown > MOST_BEGINS) continue;
        (void)printf("%-12s item %zu at byte %zu goes on ", b->kind == MK_BEGIN_GAP ? "gap" : "other node", b->item, b->offset);
        if (b->kind == MK_BEGIN_OTHER) (void)printf("with another configuration at step %" PRIu32 "\n", b->step);
        else if (b->step == b->from) (void)printf("at step %" PRIu32 " from another state than the replay's\n", b->step);
        else (void)printf("at step %" PRIu32 ", the replay was at step %" PRIu32 "\n", b->step, b->from);
    }
    if (shown > MOST_BEGINS) (void)printf("             and %zu more\n", shown - MOST_BEGINS);
    if (seamless) (void)printf("%-12s %zu states in it are those of the replay\n", "seamless", seamless);
}

static void print_summary(const mk_playback_t *p) {
    uint64_t frames = 0;
    (void)printf("%-12s %u of model 0x%08" PRIx32 ": %d states, at most %d rows, %d slots, float%d\n", "node", p->facts.node, p->facts.model, p->facts.n,
                 p->facts.m, p->facts.slots, p->facts.bits);
    (void)printf("%-12s %zu in %zu bytes, %s", "items", p->total, p->end_offset,
                 p->end == MK_END_WHOLE ? "whole\n" : p->end == MK_END_CUT ? "then one that is cut off\n" : "then one that cannot be read\n");
    (void)printf("%-12s %" PRIu64 ", from %" PRIu32 " to %" PRIu32 "\n", "steps", p->steps, p->first_step, p->last_step);
    (void)printf("%-12s %" PRIu64 "\n", "readings", p->readings);
    for (int i = 0; i < 256; i++) frames += p->frames[i];
    (void)printf("%-12s %" PRIu64, "frames", frames);
    for (int i = 0, shown = 0; i < 256; i++)
        if (p->frames[i]) (void)printf("%s%" PRIu64 " %s", shown++ ? ", " : ": ", p->frames[i], status_name((uint64_t)i));
    (void)printf("\n");
    print_begins(p);
    if (p->differences == 0) (void)printf("%-12s none: every status, step, psi and x has the recorded bits\n", "differences");
    else (void)printf("%-12s in %" PRIu64 " of %zu items\n", "differences", p->differences, p->total);
}

static json_t *summary_json(const char *path, const mk_playback_t *p, json_t *list) {
    char text[32];
    json_t *object = json_object(), *items = json_object(), *frames = json_object(), *begins = json_array(), *end = json_object();
    mk_json_set(object, "record", json_string(path));
    mk_json_set(object, "node", json_integer(p->facts.node));
    (void)snprintf(text, sizeof text, "0x%08" PRIx32, p->facts.model);
    mk_json_set(object, "model", json_string(text));
    mk_json_set(object, "states", json_integer(p->facts.n));
    mk_json_set(object, "rows", json_integer(p->facts.m));
    mk_json_set(object, "slots", json_integer(p->facts.slots));
    mk_json_set(object, "real", json_string(p->facts.bits == 32 ? "float32" : "float64"));
    for (int kind = 1; kind < MK_ITEM_KINDS; kind++) mk_json_set(items, mk_item_name(kind), json_integer((json_int_t)p->items[kind]));
    mk_json_set(object, "items", items);
    mk_json_set(object, "steps", json_integer((json_int_t)p->steps));
    mk_json_set(object, "first_step", json_integer(p->first_step));
    mk_json_set(object, "last_step", json_integer(p->last_step));
    mk_json_set(object, "readings", json_integer((json_int_t)p->readings));
    for (int i = 0; i < 256; i++)
        if (p->frames[i]) {
            (void)snprintf(text, sizeof text, "%d", i);
            mk_json_set(frames, i < MK_STATUS_COUNT ? mk_status_name((mk_status_t)i) : text, json_integer((json_int_t)p->frames[i]));
        }
    mk_json_set(object, "frames", frames);
    for (size_t i = 0; i < p->begins; i++) {
        json_t *begin = json_object();
        mk_json_set(begin, "kind", json_string(begin_name(&p->begin[i])));
        mk_json_set(begin, "item", json_integer((json_int_t)p->begin[i].item));
        mk_json_set(begin, "byte", json_integer((json_int_t)p->begin[i].offset));
        mk_json_set(begin, "step", json_integer(p->begin[i].step));
        mk_json_set(begin, "replay_at", json_integer(p->begin[i].from));
        (void)json_array_append_new(begins, begin);
    }
    mk_json_set(object, "states_restored", begins);
    mk_json_set(end, "kind", json_string(p->end == MK_END_WHOLE ? "whole" : p->end == MK_END_CUT ? "cut" : "unreadable"));
    mk_json_set(end, "item", json_integer((json_int_t)p->end_item));
    mk_json_set(end, "byte", json_integer((json_int_t)p->end_offset));
    if (p->end == MK_END_UNREADABLE) mk_json_set(end, "reason", json_string(p->reason.text));
    mk_json_set(object, "end", end);
    mk_json_set(object, "differences", json_integer((json_int_t)p->differences));
    mk_json_set(object, "first_difference", p->differences ? difference_json(&p->first) : json_null());
    if (list) mk_json_set(object, "all_differences", json_incref(list));
    return object;
}

static int replay(const char *path, const uint8_t *bytes, size_t length, const mk_item_t *configuration, arguments_t *a, mk_error_t *error) {
    mk_playback_t p;
    mk_output_t file;
    memset(&p, 0, sizeof p);
    if (a->json && !mk_open_output(&file, a->json, error)) return mk_complain(error, MK_EXIT_INPUT);
    a->list = a->json && a->all ? json_array() : NULL;
    p.each = a->all ? take_difference : NULL;
    p.context = a;
    mk_playback_run(&p, bytes, length, configuration);
    /* With nothing replayed there is nothing to say but why. */
    int status = p.end == MK_END_UNREADABLE ? MK_EXIT_INPUT : p.differences ? MK_EXIT_FAILED : 0;
    if (p.begins) {
        print_summary(&p);
        if (p.differences && !a->all) print_difference("first difference", &p.first);
    }
    if (a->json) {
        if (p.begins) mk_json_put(file.stream, summary_json(path, &p, a->list));
        if (!mk_close_output(&file, p.begins > 0, error)) status = mk_complain(error, MK_EXIT_FAILED);
    }
    if (p.end == MK_END_UNREADABLE) {
        (void)mk_fail(error, "%s: item %zu at byte %zu: %s", path, p.end_item, p.end_offset, p.reason.text);
        (void)mk_complain(error, status);
    }
    json_decref(a->list);
    mk_playback_free(&p);
    return status;
}

int mk_command_replay(int argc, char **argv) {
    arguments_t a;
    mk_error_t error;
    mk_item_t configuration;
    const char *path;
    size_t length = 0, other_length = 0;
    char *bytes = NULL, *other = NULL;
    int status = MK_EXIT_INPUT;
    memset(&a, 0, sizeof a);
    const mk_option_t options[] = {{"configuration", &a.configuration, NULL}, {"json", &a.json, NULL}, {"all", NULL, &a.all}, {NULL, NULL, NULL}};
    int good = mk_parse_options(argc, argv, options, "the record", &path, &error);
    good = good && (bytes = mk_read_file(path, &length, &error)) != NULL;
    if (good && a.configuration) {
        good = (other = mk_read_file(a.configuration, &other_length, &error)) != NULL &&
               find_configuration(a.configuration, (uint8_t *)other, other_length, &configuration, &error);
    }
    status = good ? replay(path, (uint8_t *)bytes, length, a.configuration ? &configuration : NULL, &a, &error) : mk_complain(&error, status);
    free(bytes);
    free(other);
    return status;
}
