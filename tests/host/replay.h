/* SPDX-License-Identifier: MIT */
/* Records of a node that lives through everything, for the tests of replay; each includes this once. */
#ifndef MESHKAL_TEST_REPLAY_H
#define MESHKAL_TEST_REPLAY_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/unrolled.h>

#include "aead_sodium.h"
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

/* The seal, with a key that all nodes have. */
static mk_aead_t aead;

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
    static const uint8_t key[MK_AEAD_KEY] = {1, 2, 3};
    mk_error_t error;
    assert_true(mk_aead_sodium(&aead, key, &error));
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

static void put16(uint8_t *to, unsigned value) {
    to[0] = (uint8_t)(value & 255);
    to[1] = (uint8_t)(value >> 8);
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

/* When all tests are done. */
static int free_records(void **unused) {
    (void)unused;
    free(record.bytes);
    free(changed.bytes);
    return 0;
}

#endif
