/* SPDX-License-Identifier: MIT */
/* Records of a node that lives through everything, replayed: equal; and changed in every way, what is then said of them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/unrolled.h>
#include <sodium.h>

#include "playback/playback.h"
#include "random.h"

enum { N = 3, M = 2, SLOTS = 3, PACKED_N = MK_PACKED(N), PACKED_M = MK_PACKED(M), CATCH_UP = 6, START = 3 };
enum { ITEM_HEAD = 6 };
#define MODEL 0x8badf00du
static const uint16_t number[SLOTS] = {7, 9, 400};

/* What a life has in it. */
enum { GATE = 1, FOREIGN = 2, SEALED = 4, TROUBLE = 8, TIGHT = 16, BARE = 32, NO_INPUT = 64, STEADY = 128 };

MK_NODE_UNROLLED(live_f32, f32, N, M, SLOTS);
MK_NODE_UNROLLED(live_f64, f64, N, M, SLOTS);

static mk_random_t source;
static int frozen_steps;
static int draw(int below) { return (int)(mk_random_uniform(&source) * below); }

/* --- a key that all nodes have --------------------------------------------------------------------------------------------- */

static const unsigned char key[crypto_aead_chacha20poly1305_ietf_KEYBYTES] = {1, 2, 3};

static int seal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t size, uint8_t *text, size_t length, uint8_t tag[16]) {
    (void)context;
    return crypto_aead_chacha20poly1305_ietf_encrypt_detached(text, tag, NULL, text, length, header, size, NULL, nonce, key) == 0;
}

static int unseal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t size, uint8_t *text, size_t length, const uint8_t tag[16]) {
    (void)context;
    return crypto_aead_chacha20poly1305_ietf_decrypt_detached(text, NULL, text, length, tag, header, size, nonce, key) == 0;
}

static const mk_aead_t aead = {seal, unseal, NULL};

/* --- records --------------------------------------------------------------------------------------------------------------- */

typedef struct {
    uint8_t *bytes;
    size_t used, room;
} stream_t;

static stream_t record, changed;

static void append(stream_t *out, const void *bytes, size_t length) {
    while (out->room - out->used < length) {
        out->room = out->room ? 2 * out->room : 4096;
        out->bytes = realloc(out->bytes, out->room);
        assert_non_null(out->bytes);
    }
    memcpy(out->bytes + out->used, bytes, length);
    out->used += length;
}

static void drain(mk_recorder_t *recorder, stream_t *out) {
    append(out, recorder->bytes, recorder->used);
    recorder->used = 0;
}

#define MK_BITS 32
#include <meshkal/real.h>
#define LIVE_T live_f32_t
#define LIVE(name) live_f32_##name
#include "replay.tmpl.h"
#undef LIVE_T
#undef LIVE
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#define LIVE_T live_f64_t
#define LIVE(name) live_f64_##name
#include "replay.tmpl.h"
#undef MK_BITS

static void make(int bits, unsigned life, int steps, uint32_t seed) {
    if (bits == 32) live_f32(life, steps, seed, &record);
    else live_f64(life, steps, seed, &record);
    changed.used = 0;
    append(&changed, record.bytes, record.used);
}

/* Of exactly these bytes: a copy of its own, so that the sanitizer sees what is read beyond. Frees what the playback holds. */
static mk_playback_t play(const stream_t *stream, size_t length, const mk_item_t *configuration) {
    mk_playback_t p;
    uint8_t *bytes = malloc(length ? length : 1);
    assert_non_null(bytes);
    memcpy(bytes, stream->bytes, length);
    memset(&p, 0, sizeof p);
    mk_playback_run(&p, bytes, length, configuration);
    free(bytes);
    mk_playback_free(&p);
    return p;
}

typedef struct {
    size_t at, size;
    mk_item_t item;
} place_t;

/* Items of a record, read here by themselves; how many. */
static size_t list(const stream_t *stream, place_t *place, size_t most) {
    size_t at = 0, count = 0;
    while (at < stream->used) {
        const uint8_t *b = stream->bytes + at;
        const uint32_t length = (uint32_t)b[2] | (uint32_t)b[3] << 8 | (uint32_t)b[4] << 16 | (uint32_t)b[5] << 24;
        assert_true(count < most && length <= stream->used - at - MK_ITEM_OVERHEAD);
        const place_t found = {at, length + MK_ITEM_OVERHEAD, {b[0], b[1], length, b + ITEM_HEAD}};
        place[count++] = found;
        at += found.size;
    }
    return count;
}

static void put_crc(uint8_t *bytes, size_t length) {
    const uint32_t crc = mk_crc32(0, bytes, length - 4);
    for (int i = 0; i < 4; i++) bytes[length - 4 + (size_t)i] = (uint8_t)(crc >> 8 * i);
}

static void repair(stream_t *stream, const place_t *place) { put_crc(stream->bytes + place->at, place->size); }

/* Of a state, which has a CRC inside. */
static void repair_state(stream_t *stream, const place_t *place) {
    put_crc(stream->bytes + place->at + ITEM_HEAD, place->item.length);
    repair(stream, place);
}

enum { MOST = 20000 };
static place_t place[MOST];

/* --- equal ----------------------------------------------------------------------------------------------------------------- */

static void equal_records(void **unused) {
    static const unsigned lives[] = {0, NO_INPUT, GATE, FOREIGN, SEALED, TROUBLE, GATE | TROUBLE, FOREIGN | TROUBLE, GATE | FOREIGN | SEALED | TROUBLE,
                                     STEADY, STEADY | GATE | TROUBLE};
    size_t kinds[MK_ITEM_KINDS] = {0};
    uint64_t frames[MK_STATUS_COUNT] = {0};
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32)
        for (size_t i = 0; i < sizeof lives / sizeof *lives; i++)
            for (uint32_t seed = 1; seed <= 10; seed++) {
                make(bits, lives[i], 60, seed);
                const mk_playback_t p = play(&record, record.used, NULL);
                if (p.differences || p.end != MK_END_WHOLE)
                    fail_msg("float%d, life %u, seed %u: item %zu, %s[%d]: %s", bits, lives[i], seed, p.first.item, p.first.what, p.first.element,
                             p.reason.text);
                assert_int_equal(p.total, list(&record, place, MOST));
                assert_int_equal(p.facts.bits, bits);
                assert_int_equal(p.facts.node, number[0]);
                assert_true(p.first_step >= START && p.last_step > p.first_step);
                for (int k = 0; k < MK_ITEM_KINDS; k++) kinds[k] += p.items[k];
                for (int k = 0; k < MK_STATUS_COUNT; k++) frames[k] += p.frames[k];
            }
    /* Nothing of what was to be shown was absent. */
    assert_true(frozen_steps > 100);
    for (int k = 1; k < MK_ITEM_KINDS; k++) assert_true(kinds[k] > 20);
    static const int seen[] = {MK_OK, MK_ERROR_NOT_FINITE, MK_ERROR_REPEATED, MK_ERROR_LENGTH, MK_ERROR_TYPE, MK_ERROR_LATE, MK_ERROR_AHEAD, MK_ERROR_IMPLAUSIBLE};
    for (size_t i = 0; i < sizeof seen / sizeof *seen; i++) assert_true(frames[seen[i]] > 0);
    assert_int_equal(frames[MK_ERROR_CHECKSUM] + frames[MK_ERROR_FORGED], 0);
}

/* A recorder that was too small and started again, and one that started again for nothing. */
static void states_within(void **unused) {
    size_t gaps = 0, seamless = 0;
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32)
        for (uint32_t seed = 1; seed <= 20; seed++) {
            mk_playback_t p;
            make(bits, TIGHT | (seed % 2 ? TROUBLE : STEADY), 120, seed);
            memset(&p, 0, sizeof p);
            mk_playback_run(&p, record.bytes, record.used, NULL);
            assert_int_equal(p.end, MK_END_WHOLE);
            assert_int_equal(p.differences, 0);
            assert_int_equal(p.begins, p.items[MK_ITEM_STATE]);
            assert_int_equal(p.begin[0].kind, MK_BEGIN_FIRST);
            for (size_t i = 1; i < p.begins; i++) {
                assert_true(p.begin[i].kind == MK_BEGIN_GAP || p.begin[i].kind == MK_BEGIN_SEAMLESS);
                if (p.begin[i].kind == MK_BEGIN_SEAMLESS) assert_int_equal(p.begin[i].step, p.begin[i].from);
                gaps += p.begin[i].kind == MK_BEGIN_GAP;
                seamless += p.begin[i].kind == MK_BEGIN_SEAMLESS;
            }
            mk_playback_free(&p);
        }
    assert_true(gaps > 10 && seamless > 10);
    /* The same step, but x[0], the tolerance or its stage is another. */
    static const size_t other[] = {20 + 8 * PACKED_N, 20 + 8 * (PACKED_N + N + SLOTS * (M + N)), 0};
    for (int i = 0; i < 3; i++) {
        mk_playback_t p;
        make(64, 0, 8, 1);
        (void)list(&record, place, MOST);
        changed.bytes[place[1].at + ITEM_HEAD + (other[i] ? other[i] : place[1].item.length - 4 - 3 * SLOTS - 2)] ^= other[i] ? 1 : 3;
        repair_state(&changed, &place[1]);
        append(&record, changed.bytes + place[1].at, place[1].size);
        memmove(record.bytes + place[2].at, record.bytes + record.used - place[1].size, place[1].size);
        memset(&p, 0, sizeof p);
        mk_playback_run(&p, record.bytes, place[2].at + place[1].size, NULL);
        assert_int_equal(p.end, MK_END_WHOLE);
        assert_int_equal(p.begins, 2);
        assert_int_equal(p.begin[1].kind, MK_BEGIN_GAP);
        assert_int_equal(p.begin[1].step, p.begin[1].from);
        mk_playback_free(&p);
    }
}

/* --- changed --------------------------------------------------------------------------------------------------------------- */

/* Where in the record what an input changes is to be seen first. */
static size_t consequence(size_t items, size_t from) {
    const place_t *p = &place[from];
    const int estimate = p->item.kind == MK_ITEM_FRAME && (p->item.content[1] & 3) == MK_STAGE_ESTIMATE;
    for (size_t i = from; i < items; i++)
        if (place[i].item.kind == (estimate ? MK_ITEM_DIFFUSE : MK_ITEM_INCREMENTAL)) return i;
    return items;
}

/* Every bit of status and content of a small record, CRC repaired. An output is named to the element; an input at its own item or where
   its step ends. */
static void every_bit(void **unused) {
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32) {
        const size_t size = (size_t)bits / 8;
        size_t inputs = 0, seen = 0;
        make(bits, 0, 8, 5);
        const size_t items = list(&record, place, MOST);
        for (size_t k = 0; k < items; k++) {
            const mk_item_t *item = &place[k].item;
            for (size_t bit = 8; bit < 8 * (ITEM_HEAD + item->length); bit++) {
                if (bit == 16) bit = 8 * ITEM_HEAD; /* not its length */
                uint8_t *const byte = changed.bytes + place[k].at + bit / 8;
                *byte ^= (uint8_t)(1u << bit % 8);
                repair(&changed, &place[k]);
                const mk_playback_t p = play(&changed, changed.used, NULL);
                *byte ^= (uint8_t)(1u << bit % 8);
                repair(&changed, &place[k]);
                const size_t at = bit / 8 < ITEM_HEAD ? 0 : bit / 8 - ITEM_HEAD;
                const int is_status = bit < 16, input = item->kind == MK_ITEM_MEASURE || item->kind == MK_ITEM_FRAME;
                if (item->kind == MK_ITEM_CONFIGURATION || (item->kind == MK_ITEM_STATE && is_status)) continue; /* no status; it may stand for much */
                if (item->kind == MK_ITEM_STATE) { /* its own CRC */
                    assert_int_equal(p.end, MK_END_UNREADABLE);
                    assert_int_equal(p.end_item, k);
                    continue;
                }
                if (item->kind == MK_ITEM_INCREMENTAL && is_status && item->length > N * size) { /* too long for a failure */
                    assert_int_equal(p.end, MK_END_UNREADABLE);
                    continue;
                }
                assert_int_equal(p.end, MK_END_WHOLE);
                if (item->kind == MK_ITEM_FRAME && at < MK_FRAME_HEADER) { /* refused now */
                    assert_int_equal(p.first.item, k);
                    assert_string_equal(p.first.what, "status");
                    continue;
                }
                if (input && !is_status) {
                    inputs++;
                    if (!p.differences) continue;
                    seen++;
                    if (p.first.item == k) assert_string_equal(p.first.what, "status");
                    else assert_int_equal(p.first.item, consequence(items, k));
                    continue;
                }
                const size_t x = item->kind == MK_ITEM_DIFFUSE ? 4 : item->length - N * size;
                if (item->kind == MK_ITEM_INCREMENTAL && at < x && !is_status) continue; /* the input given */
                assert_true(p.differences >= 1);
                assert_int_equal(p.first.item, k);
                assert_int_equal(p.first.offset, place[k].at);
                assert_int_equal(p.first.kind, item->kind);
                assert_string_equal(p.first.what, is_status ? "status" : at < x ? "step" : item->kind == MK_ITEM_DIFFUSE ? "x" : "psi");
                assert_int_equal(p.first.element, is_status || at < x ? -1 : (int)((at - x) / size));
                if (is_status || at < x) continue;
                assert_int_equal(p.first.recorded ^ p.first.replayed, (uint64_t)1 << (8 * ((at - x) % size) + bit % 8));
                /* Below the exponent a bit is worth itself in units of the last place. */
                if (8 * ((at - x) % size) + bit % 8 < (bits == 32 ? 23 : 52)) assert_int_equal(mk_difference_ulp(&p.first), p.first.recorded ^ p.first.replayed);
            }
        }
        assert_true(seen > inputs / 2);
    }
}

static void every_cut(void **unused) {
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32) {
        make(bits, TROUBLE, 12, 3);
        const size_t items = list(&record, place, MOST);
        size_t whole = 0; /* items before the cut */
        for (size_t cut = 0; cut <= record.used; cut++) {
            while (whole < items && place[whole].at + place[whole].size <= cut) whole++;
            const size_t end = whole ? place[whole - 1].at + place[whole - 1].size : 0;
            const mk_playback_t p = play(&record, cut, NULL);
            assert_int_equal(p.total, whole);
            assert_int_equal(p.end_offset, end);
            assert_int_equal(p.differences, 0);
            assert_int_equal(p.end, whole < 2 ? MK_END_UNREADABLE : cut == end ? MK_END_WHOLE : MK_END_CUT);
        }
    }
}

/* Bits of CRC and length: the item is unreadable, those before it count. Only at the end can a length look like a cut. */
static void damaged_items(void **unused) {
    (void)unused;
    make(64, 0, 8, 4);
    const size_t items = list(&record, place, MOST);
    for (size_t k = 0; k < items; k++)
        for (size_t bit = 0; bit < 8 * place[k].size; bit++) {
            changed.bytes[place[k].at + bit / 8] ^= (uint8_t)(1u << bit % 8);
            const mk_playback_t p = play(&changed, changed.used, NULL);
            changed.bytes[place[k].at + bit / 8] ^= (uint8_t)(1u << bit % 8);
            const int is_length = bit >= 16 && bit < 48;
            if (!(is_length && record.used - place[k].at < MK_FRAME_HEADER + 8 * 64)) assert_int_equal(p.end, MK_END_UNREADABLE);
            assert_true(p.end != MK_END_WHOLE);
            assert_int_equal(p.end_item, k);
            assert_int_equal(p.end_offset, place[k].at);
            assert_int_equal(p.differences, 0);
        }
}

/* --- hostile --------------------------------------------------------------------------------------------------------------- */

static void put16(uint8_t *to, unsigned value) {
    to[0] = (uint8_t)(value & 255);
    to[1] = (uint8_t)(value >> 8);
}

static void hostile_sizes(void **unused) {
    static const unsigned sizes[] = {0, 1, 2, 4, 5, 1023, 1024, 1025, 32767, 32768, 46341, 65535};
    enum { SIZES = sizeof sizes / sizeof *sizes };
    (void)unused;
    make(64, 0, 8, 4);
    (void)list(&record, place, MOST);
    for (int i = 0; i < SIZES * SIZES * SIZES; i++) {
        uint8_t *const content = changed.bytes + ITEM_HEAD;
        put16(content, sizes[i % SIZES]);
        put16(content + 2, sizes[i / SIZES % SIZES]);
        put16(content + 4, sizes[i / SIZES / SIZES]);
        repair(&changed, &place[0]);
        const mk_playback_t p = play(&changed, changed.used, NULL);
        assert_int_equal(p.end, MK_END_UNREADABLE);
        assert_int_equal(p.end_item, 0);
    }
    /* The same item cut, so that its length cannot be compared with what is there. */
    const mk_playback_t p = play(&changed, 40, NULL);
    assert_int_equal(p.end, MK_END_UNREADABLE);
}

/* Some bytes of some items anew, CRC repaired; also that of a state, which it has inside. */
static void mutations(void **unused) {
    static const uint8_t liked[] = {0, 1, 2, 127, 128, 255};
    int unreadable = 0, different = 0;
    (void)unused;
    for (int round = 0; round < 6000; round++) {
        if (round % 100 == 0) {
            static const unsigned lives[] = {0, GATE | STEADY | TROUBLE, FOREIGN | TROUBLE};
            make(round / 100 % 2 ? 32 : 64, lives[round / 200 % 3], 10, (uint32_t)round + 1);
        }
        const size_t items = list(&record, place, MOST);
        memcpy(changed.bytes, record.bytes, record.used);
        mk_random_start(&source, (uint64_t)round, 1, 2, 3, 4);
        for (int i = draw(3); i >= 0; i--) {
            const size_t k = draw(3) ? (size_t)draw((int)items) : (size_t)draw(2);
            uint8_t *const b = changed.bytes + place[k].at;
            for (int j = draw(4); j >= 0 && place[k].item.length; j--) {
                const int at = draw(12) == 0 ? draw(2) : ITEM_HEAD + draw((int)place[k].item.length);
                b[at] = draw(2) ? liked[draw((int)sizeof liked)] : (uint8_t)draw(256);
            }
            if (place[k].item.kind == MK_ITEM_STATE) repair_state(&changed, &place[k]);
            else repair(&changed, &place[k]);
        }
        const mk_playback_t p = play(&changed, draw(10) ? changed.used : (size_t)draw((int)changed.used), NULL);
        unreadable += p.end == MK_END_UNREADABLE;
        different += p.differences > 0;
    }
    assert_true(unreadable > 500 && different > 500);
}

/* --- configurations -------------------------------------------------------------------------------------------------------- */

static void other_configuration(void **unused) {
    stream_t other = {NULL, 0, 0};
    mk_item_t configuration;
    int damaged;
    (void)unused;
    make(64, BARE, 12, 1);
    mk_playback_t p = play(&record, record.used, NULL);
    assert_int_equal(p.end, MK_END_UNREADABLE);
    assert_non_null(strstr(p.reason.text, "configuration"));
    append(&other, record.bytes, record.used);
    make(64, 0, 12, 1);
    (void)list(&record, place, MOST);
    const place_t *const own = &place[0];
    uint8_t *const content = changed.bytes + ITEM_HEAD;
    assert_true(mk_item_read(changed.bytes, changed.used, &configuration, &damaged) > 0);
    p = play(&other, other.used, &configuration);
    assert_int_equal(p.end, MK_END_WHOLE);
    assert_int_equal(p.differences, 0);
    assert_true(p.steps > 5);
    /* Another node, another model, a tolerance that the state overrules, another A. */
    put16(content + 18, 8);
    assert_non_null(strstr(play(&other, other.used, &configuration).reason.text, "of another node"));
    put16(content + 18, number[0]);
    content[14] ^= 1;
    assert_non_null(strstr(play(&other, other.used, &configuration).reason.text, "of another model"));
    content[14] ^= 1;
    content[18 + 4 * SLOTS + 6] ^= 16; /* A[0] */
    p = play(&other, other.used, &configuration);
    assert_int_equal(p.end, MK_END_WHOLE);
    assert_true(p.differences > 5);
    assert_string_equal(p.first.what, "psi");
    assert_int_equal(p.first.element, 0);
    content[13] |= 64; /* a part of a later version */
    repair(&changed, own);
    assert_non_null(strstr(play(&changed, changed.used, NULL).reason.text, "does not know"));
    /* Another precision. */
    make(32, 0, 12, 1);
    assert_true(mk_item_read(changed.bytes, changed.used, &configuration, &damaged) > 0);
    assert_non_null(strstr(play(&other, other.used, &configuration).reason.text, "precision"));
    /* In place of the record's own it counts, too: two nodes one after the other, then one with the other's. */
    append(&other, record.bytes, record.used);
    p = play(&other, other.used, &configuration);
    assert_int_equal(p.end, MK_END_UNREADABLE);
    assert_int_equal(p.end_item, 0);
    make(64, 0, 12, 2);
    other.used = 0;
    append(&other, record.bytes, record.used);
    make(32, GATE, 12, 2);
    append(&other, record.bytes, record.used);
    memset(&p, 0, sizeof p);
    mk_playback_run(&p, other.bytes, other.used, NULL);
    assert_int_equal(p.end, MK_END_WHOLE);
    assert_int_equal(p.differences, 0);
    assert_int_equal(p.begins, 2);
    assert_int_equal(p.begin[1].kind, MK_BEGIN_OTHER);
    mk_playback_free(&p);
    free(other.bytes);
}

int main(void) {
    if (sodium_init() < 0) return 1;
    const struct CMUnitTest tests[] = {cmocka_unit_test(equal_records), cmocka_unit_test(states_within), cmocka_unit_test(every_bit),
                                       cmocka_unit_test(every_cut),     cmocka_unit_test(damaged_items), cmocka_unit_test(hostile_sizes),
                                       cmocka_unit_test(mutations),     cmocka_unit_test(other_configuration)};
    const int failed = cmocka_run_group_tests_name("replay", tests, NULL, NULL);
    free(record.bytes);
    free(changed.bytes);
    return failed;
}
