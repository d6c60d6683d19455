/* SPDX-License-Identifier: MIT */
/* Items of a record (meshkal/record.h). Part of the shared build. */
#ifndef MESHKAL_NODE_RECORD_H
#define MESHKAL_NODE_RECORD_H

#include <meshkal/record.h>
#include <string.h>

#include "../network/frame.h"

#define MK_ITEM_HEADER 6

/* Room for an item with that much content, or null: then the recorder is closed. */
static uint8_t *mk_item_begin(mk_recorder_t *recorder, int kind, mk_status_t status, size_t length) {
    if (recorder->lost || recorder->capacity - recorder->used < length + MK_ITEM_OVERHEAD) {
        recorder->lost++;
        return 0;
    }
    uint8_t *const item = recorder->bytes + recorder->used;
    item[0] = (uint8_t)kind;
    item[1] = (uint8_t)status;
    mk_put_u32(item + 2, (uint32_t)length);
    return item + MK_ITEM_HEADER;
}

static void mk_item_end(mk_recorder_t *recorder) {
    uint8_t *const item = recorder->bytes + recorder->used;
    const size_t length = MK_ITEM_HEADER + mk_get_u32(item + 2);
    mk_put_u32(item + length, mk_crc32(0, item, length));
    recorder->used += length + 4;
}

size_t mk_item_read(const uint8_t *bytes, size_t length, mk_item_t *item, int *damaged) {
    *damaged = 0;
    if (length < MK_ITEM_OVERHEAD) return 0;
    const size_t content = mk_get_u32(bytes + 2);
    if (content > length - MK_ITEM_OVERHEAD) return 0;
    if (mk_crc32(0, bytes, MK_ITEM_HEADER + content) != mk_get_u32(bytes + MK_ITEM_HEADER + content)) {
        *damaged = 1;
        return 0;
    }
    item->kind = bytes[0];
    item->status = bytes[1];
    item->length = (uint32_t)content;
    item->content = bytes + MK_ITEM_HEADER;
    return content + MK_ITEM_OVERHEAD;
}

static void mk_note_frame(mk_recorder_t *recorder, mk_status_t status, const uint8_t *bytes, const mk_frame_t *frame) {
    uint8_t *const content = mk_item_begin(recorder, MK_ITEM_FRAME, status, (size_t)MK_FRAME_HEADER + frame->length);
    if (!content) return;
    memcpy(content, bytes, MK_FRAME_HEADER);
    content[1] &= (uint8_t)~MK_TYPE_SEALED;
    memcpy(content + MK_FRAME_HEADER, frame->payload, frame->length);
    mk_item_end(recorder);
}

/* A frame of a record: header and payload, nothing else; plain, however it came. */
static mk_status_t mk_frame_parse(const uint8_t *content, size_t length, mk_frame_t *frame) {
    if (!content || length < MK_FRAME_HEADER || length - MK_FRAME_HEADER > UINT16_MAX) return MK_ERROR_LENGTH;
    if (content[0] != MK_FRAME_VERSION) return MK_ERROR_VERSION;
    const mk_status_t status = mk_frame_header(content, frame);
    frame->length = (uint16_t)(length - MK_FRAME_HEADER);
    frame->payload = content + MK_FRAME_HEADER;
    return status == MK_OK && frame->sealed ? MK_ERROR_TYPE : status;
}

#endif
