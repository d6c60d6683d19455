/* SPDX-License-Identifier: MIT */
/* Frames of meshkal/frame.h: every byte that arrives is hostile until its check has passed. Part of the shared build. */
#ifndef MESHKAL_NETWORK_FRAME_H
#define MESHKAL_NETWORK_FRAME_H

#include <meshkal/frame.h>

#include "bytes.h"

#define MK_TYPE_STAGE 3u
#define MK_TYPE_NUMBERS 2 /* bits to the right of them */
#define MK_TYPE_MODEL 16u
#define MK_TYPE_SEALED 32u
#define MK_TYPE_RESERVED 192u

uint32_t mk_crc32(uint32_t crc, const uint8_t *bytes, size_t length) {
    /* Four bits at a time: a table of 64 bytes, not of 1024. */
    static const uint32_t table[16] = {
        UINT32_C(0x00000000), UINT32_C(0x1db71064), UINT32_C(0x3b6e20c8), UINT32_C(0x26d930ac), UINT32_C(0x76dc4190), UINT32_C(0x6b6b51f4),
        UINT32_C(0x4db26158), UINT32_C(0x5005713c), UINT32_C(0xedb88320), UINT32_C(0xf00f9344), UINT32_C(0xd6d6a3e8), UINT32_C(0xcb61b38c),
        UINT32_C(0x9b64c2b0), UINT32_C(0x86d3d2d4), UINT32_C(0xa00ae278), UINT32_C(0xbdbdf21c)};
    crc = ~crc;
    for (size_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        crc = crc >> 4 ^ table[crc & 15u];
        crc = crc >> 4 ^ table[crc & 15u];
    }
    return ~crc;
}

int mk_replay_new(const mk_replay_t *window, uint64_t sequence) {
    if (window->seen == 0 || sequence > window->last) return 1;
    const uint64_t age = window->last - sequence;
    return age < 64 && !(window->seen >> age & 1u);
}

void mk_replay_mark(mk_replay_t *window, uint64_t sequence) {
    if (window->seen == 0 || sequence > window->last) {
        const uint64_t step = sequence - window->last;
        window->seen = window->seen != 0 && step < 64 ? window->seen << step | 1u : 1u;
        window->last = sequence;
    } else if (window->last - sequence < 64) {
        window->seen |= (uint64_t)1 << (window->last - sequence);
    }
}

/* The header's fields; what follows it is left to the caller. TYPE. */
static mk_status_t mk_frame_header(const uint8_t *bytes, mk_frame_t *frame) {
    const unsigned type = bytes[1], stage = type & MK_TYPE_STAGE, numbers = type >> MK_TYPE_NUMBERS & 3u;
    if (type & MK_TYPE_RESERVED || stage < MK_STAGE_MEASUREMENT || stage > MK_STAGE_CONSENSUS || numbers > MK_NUMBERS_F16 ||
        (type & MK_TYPE_MODEL && stage != MK_STAGE_MEASUREMENT))
        return MK_ERROR_TYPE;
    frame->model = mk_get_u32(bytes + 4);
    frame->step = mk_get_u32(bytes + 8);
    frame->node = mk_get_u16(bytes + 2);
    frame->stage = (uint8_t)stage;
    frame->numbers = (uint8_t)numbers;
    frame->with_model = (type & MK_TYPE_MODEL) != 0;
    frame->sealed = (type & MK_TYPE_SEALED) != 0;
    return MK_OK;
}

mk_status_t mk_frame_read(const uint8_t *bytes, size_t length, mk_frame_t *frame) {
    if (!bytes || !frame) return MK_ERROR_ARGUMENT;
    if (length < MK_FRAME_PLAIN) return MK_ERROR_LENGTH;
    if (bytes[0] != MK_FRAME_VERSION) return MK_ERROR_VERSION;
    const int sealed = (bytes[1] & MK_TYPE_SEALED) != 0;
    const size_t overhead = sealed ? MK_FRAME_SEALED : MK_FRAME_PLAIN;
    if (length < overhead || length - overhead > UINT16_MAX) return MK_ERROR_LENGTH;
    /* A damaged plain frame is called damaged, whatever its damaged fields say. */
    if (!sealed && mk_crc32(0, bytes, length - 4) != mk_get_u32(bytes + length - 4)) return MK_ERROR_CHECKSUM;
    mk_frame_t found;
    const mk_status_t status = mk_frame_header(bytes, &found);
    if (status != MK_OK) return status;
    found.length = (uint16_t)(length - overhead);
    found.payload = bytes + MK_FRAME_HEADER + (sealed ? MK_FRAME_SEQUENCE : 0);
    *frame = found;
    return MK_OK;
}

/* Node and sequence, which make it unique as long as no node uses a sequence number twice with one key. */
static void mk_frame_nonce(const uint8_t *bytes, uint8_t nonce[12]) {
    nonce[0] = bytes[2];
    nonce[1] = bytes[3];
    nonce[2] = nonce[3] = 0;
    for (int i = 0; i < MK_FRAME_SEQUENCE; i++) nonce[4 + i] = bytes[MK_FRAME_HEADER + i];
}

mk_status_t mk_frame_open(const uint8_t *bytes, mk_frame_t *frame, const mk_aead_t *aead, mk_replay_t *window, uint8_t *text) {
    const uint64_t sequence = mk_get_bytes(bytes + MK_FRAME_HEADER, MK_FRAME_SEQUENCE);
    uint8_t nonce[12];
    if (!mk_replay_new(window, sequence)) return MK_ERROR_REPLAYED;
    mk_frame_nonce(bytes, nonce);
    for (int i = 0; i < frame->length; i++) text[i] = frame->payload[i];
    if (!aead->open(aead->context, nonce, bytes, MK_FRAME_HEADER + MK_FRAME_SEQUENCE, text, frame->length, frame->payload + frame->length))
        return MK_ERROR_FORGED;
    mk_replay_mark(window, sequence);
    frame->payload = text;
    return MK_OK;
}

uint8_t *mk_frame_payload(uint8_t *bytes, int sealed) { return bytes + MK_FRAME_HEADER + (sealed ? MK_FRAME_SEQUENCE : 0); }

size_t mk_frame_write(const mk_frame_t *frame, uint8_t *bytes, const mk_aead_t *aead, uint64_t sequence) {
    const size_t length = frame->length;
    bytes[0] = MK_FRAME_VERSION;
    bytes[1] = (uint8_t)((unsigned)frame->stage | (unsigned)frame->numbers << MK_TYPE_NUMBERS | (frame->with_model ? MK_TYPE_MODEL : 0u) |
                         (frame->sealed ? MK_TYPE_SEALED : 0u));
    mk_put_u16(bytes + 2, frame->node);
    mk_put_u32(bytes + 4, frame->model);
    mk_put_u32(bytes + 8, frame->step);
    if (!frame->sealed) {
        mk_put_u32(bytes + MK_FRAME_HEADER + length, mk_crc32(0, bytes, MK_FRAME_HEADER + length));
        return MK_FRAME_PLAIN + length;
    }
    uint8_t nonce[12];
    mk_put_bytes(bytes + MK_FRAME_HEADER, MK_FRAME_SEQUENCE, sequence);
    mk_frame_nonce(bytes, nonce);
    uint8_t *const text = mk_frame_payload(bytes, 1);
    if (!aead->seal(aead->context, nonce, bytes, MK_FRAME_HEADER + MK_FRAME_SEQUENCE, text, length, text + length)) return 0;
    return MK_FRAME_SEALED + length;
}

#endif
