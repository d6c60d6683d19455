/* SPDX-License-Identifier: MIT */
#include "playback/playback.h"

#include <meshkal/network/bytes.h>
#include <stdlib.h>
#include <string.h>

/* One precision's player of items. Functions return 1, or 0 and the playback's reason: nothing further can be read. */
typedef struct {
    void *(*open)(const uint8_t *content, size_t length, mk_error_t *error);
    void (*close)(void *player);
    /* The next state: MK_BEGIN_SEAMLESS or MK_BEGIN_GAP, or -1 and an error. */
    int (*restore)(void *player, const mk_item_t *item, mk_error_t *error);
    uint32_t (*step)(const void *player);
    /* Bytes of content that an item of this kind and status can have: from `least` to `most`, or one of the two. */
    void (*lengths)(const void *player, const mk_item_t *item, size_t *least, size_t *most);
    /* An item of a length within these; 1 if something differs, then described but for its place. */
    int (*play)(void *player, const mk_item_t *item, mk_difference_t *difference);
} mk_player_t;

typedef struct {
    mk_playback_t *p;
    const mk_item_t *given; /* configuration from elsewhere */
    const mk_player_t *player;
    void *node;
    mk_host_facts_t facts;
    const uint8_t *content; /* of its configuration */
    size_t content_length;
    int has_state, other; /* a state has been restored; with this configuration none has, but with an earlier one */
    uint32_t stood;
} mk_playing_t;

static const char *const names[MK_ITEM_KINDS] = {NULL,      "configuration", "state",     "measure", "frame", "incremental",
                                                 "diffuse", "advance",       "tolerance", "restart", "drop"};

const char *mk_item_name(int kind) { return kind > 0 && kind < MK_ITEM_KINDS ? names[kind] : NULL; }

double mk_bits_value(int bits, uint64_t value) {
    double wide;
    float narrow;
    const uint32_t half = (uint32_t)value;
    memcpy(&wide, &value, sizeof wide);
    memcpy(&narrow, &half, sizeof narrow);
    return bits == 32 ? (double)narrow : bits == 64 ? wide : (double)value;
}

/* Place of a number among all of its precision, 0 for both zeros. */
static int64_t place(int bits, uint64_t value) {
    const uint64_t sign = (uint64_t)1 << (bits - 1);
    return value & sign ? -(int64_t)(value & (sign - 1)) : (int64_t)value;
}

uint64_t mk_difference_ulp(const mk_difference_t *d) {
    if (d->bits == 0) return d->recorded > d->replayed ? d->recorded - d->replayed : d->replayed - d->recorded;
    const double a = mk_bits_value(d->bits, d->recorded), b = mk_bits_value(d->bits, d->replayed);
    if (!(a <= b || a >= b)) return UINT64_MAX;
    const int64_t one = place(d->bits, d->recorded), other = place(d->bits, d->replayed);
    return one > other ? (uint64_t)one - (uint64_t)other : (uint64_t)other - (uint64_t)one;
}

static int differs(mk_difference_t *d, const char *what, int element, int bits, uint64_t recorded, uint64_t replayed) {
    if (recorded == replayed) return 0;
    d->what = what;
    d->element = element;
    d->bits = bits;
    d->recorded = recorded;
    d->replayed = replayed;
    return 1;
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "playback/playback.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "playback/playback.tmpl.h"
#undef MK_BITS

/* --- items ----------------------------------------------------------------------------------------------------------------- */

static int configure(mk_playing_t *g, const uint8_t *content, size_t length) {
    /* A recorder that starts again writes what was there before. */
    if (g->node && length == g->content_length && memcmp(content, g->content, length) == 0) return 1;
    mk_host_facts_t facts;
    if (!mk_host_facts(content, length, length, &facts, &g->p->reason)) return 0;
    const mk_player_t *const player = facts.bits == 32 ? &player_f32 : &player_f64;
    void *const node = player->open(content, length, &g->p->reason);
    if (!node) return 0;
    if (g->node) {
        g->stood = g->player->step(g->node);
        g->player->close(g->node);
    }
    g->other = g->p->begins > 0;
    g->has_state = 0;
    g->player = player;
    g->node = node;
    g->facts = facts;
    g->content = content;
    g->content_length = length;
    return 1;
}

static int restore(mk_playing_t *g, const mk_item_t *item, size_t offset) {
    mk_playback_t *const p = g->p;
    if (!g->node) return mk_fail(&p->reason, "no configuration comes before this state; --configuration names a record that holds it");
    const uint32_t stood = g->has_state ? g->player->step(g->node) : g->stood;
    const int kind = g->player->restore(g->node, item, &p->reason);
    if (kind < 0) return 0;
    if (p->begins == p->begins_room) {
        const size_t room = p->begins_room ? 2 * p->begins_room : 16;
        mk_begin_t *const larger = mk_allocate(room, sizeof *larger);
        if (p->begins) memcpy(larger, p->begin, p->begins * sizeof *larger);
        free(p->begin);
        p->begin = larger;
        p->begins_room = room;
    }
    mk_begin_t *const begin = &p->begin[p->begins];
    begin->kind = p->begins == 0 ? MK_BEGIN_FIRST : g->other ? MK_BEGIN_OTHER : kind;
    begin->item = p->total;
    begin->offset = offset;
    begin->step = g->player->step(g->node);
    begin->from = p->begins == 0 ? begin->step : stood;
    if (p->begins++ == 0) {
        p->facts = g->facts;
        p->first_step = begin->step;
    }
    g->has_state = 1;
    g->other = 0;
    return 1;
}

/* Can an item of this kind have so much content? `known` bytes of it are there. */
static int is_plausible(mk_playing_t *g, const mk_item_t *item, size_t known) {
    mk_error_t *const reason = &g->p->reason;
    if (!mk_item_name(item->kind)) return mk_fail(reason, "kind %d: no item of a record has it (simulate --record makes records, --out a log)", item->kind);
    if (item->kind == MK_ITEM_CONFIGURATION) {
        mk_host_facts_t facts;
        /* What a cut leaves of one may say nothing. */
        return item->length > known && known < 22 ? 1 : mk_host_facts(item->content, known, item->length, &facts, reason);
    }
    if (!g->node) return 1;
    size_t least, most;
    g->player->lengths(g->node, item, &least, &most);
    const int between = item->kind == MK_ITEM_STATE || item->kind == MK_ITEM_FRAME;
    if (item->length == least || item->length == most || (between && item->length > least && item->length < most)) return 1;
    return mk_fail(reason, "an item %s of this node has %zu %s %zu bytes of content, not %u", mk_item_name(item->kind), least, between ? "to" : "or", most,
                   (unsigned)item->length);
}

static void count(mk_playback_t *p, const mk_item_t *item) {
    if (item->kind == MK_ITEM_MEASURE) p->readings += item->status == MK_OK;
    if (item->kind == MK_ITEM_FRAME) p->frames[item->status]++;
    if (item->kind == MK_ITEM_DIFFUSE) p->steps += item->status == MK_OK;
}

static int play(mk_playing_t *g, const mk_item_t *item, size_t offset) {
    mk_playback_t *const p = g->p;
    if (!is_plausible(g, item, item->length)) return 0;
    if (item->kind == MK_ITEM_CONFIGURATION) return g->given || configure(g, item->content, item->length);
    if (item->kind == MK_ITEM_STATE) return restore(g, item, offset);
    if (!g->has_state) return mk_fail(&p->reason, "an item %s before the first state", mk_item_name(item->kind));
    mk_difference_t d;
    memset(&d, 0, sizeof d);
    d.item = p->total;
    d.offset = offset;
    d.kind = item->kind;
    d.step = g->player->step(g->node);
    count(p, item);
    if (!g->player->play(g->node, item, &d)) return 1;
    if (p->differences++ == 0) p->first = d;
    if (p->each) p->each(p->context, &d);
    return 1;
}

/* Why no item could be read at the end of what was: 1 if the rest is the beginning of one. */
static int is_cut(mk_playing_t *g, const uint8_t *bytes, size_t left, int damaged) {
    mk_error_t *const reason = &g->p->reason;
    const size_t head = MK_ITEM_OVERHEAD - 4;
    mk_item_t item = {bytes[0], 0, 0, bytes + head};
    if (!mk_item_name(item.kind)) return is_plausible(g, &item, 0);
    if (left < head) return 1;
    item.status = bytes[1];
    item.length = mk_get_u32(bytes + 2);
    if (!is_plausible(g, &item, left - head < item.length ? left - head : item.length)) return 0;
    return !damaged || mk_fail(reason, "its CRC is wrong");
}

void mk_playback_run(mk_playback_t *p, const uint8_t *bytes, size_t length, const mk_item_t *configuration) {
    mk_playing_t g;
    memset(&g, 0, sizeof g);
    g.p = p;
    g.given = configuration;
    size_t at = 0;
    int good = !configuration || configure(&g, configuration->content, configuration->length);
    while (good && at < length) {
        mk_item_t item;
        int damaged;
        const size_t size = mk_item_read(bytes + at, length - at, &item, &damaged);
        if (!size) {
            if (is_cut(&g, bytes + at, length - at, damaged)) p->end = MK_END_CUT;
            else good = 0;
            break;
        }
        good = play(&g, &item, at);
        if (!good) break;
        p->items[item.kind]++;
        p->total++;
        at += size;
    }
    if (good && p->begins == 0) good = mk_fail(&p->reason, "no whole state: there is nothing to start from");
    if (!good) p->end = MK_END_UNREADABLE;
    p->end_item = p->total;
    p->end_offset = at;
    if (!g.node) return;
    p->last_step = g.has_state ? g.player->step(g.node) : g.stood;
    g.player->close(g.node);
}

void mk_playback_free(mk_playback_t *p) {
    free(p->begin);
    p->begin = NULL;
    p->begins = p->begins_room = 0;
}
