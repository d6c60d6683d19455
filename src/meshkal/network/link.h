/* SPDX-License-Identifier: MIT */
/* What node objects have in common: whose frame is it, may it be read, how is one sent, and are the neighbours ahead? Part of the shared build. */
#ifndef MESHKAL_NETWORK_LINK_H
#define MESHKAL_NETWORK_LINK_H

#include "frame.h"

static mk_status_t mk_link_secure(mk_secure_t *secure, int slots) {
    if (!secure || !secure->aead || !secure->aead->seal || !secure->aead->open || !secure->window || !secure->text) return MK_ERROR_ARGUMENT;
    /* What a neighbour sent before this node started could be played to it again; only its step number stands against that. */
    for (int l = 0; l < slots; l++) secure->window[l].seen = 0;
    return MK_OK;
}

static int mk_link_named_twice(int slots, const uint16_t *nodes) {
    for (int l = 0; l < slots; l++)
        for (int k = 0; k < l; k++)
            if (nodes[k] == nodes[l]) return 1;
    return 0;
}

/* The neighbour's slot, or 0. */
static int mk_link_slot(int slots, const uint16_t *nodes, uint16_t node) {
    for (int l = 1; l < slots; l++)
        if (nodes[l] == node) return l;
    return 0;
}

/* A frame up to its content: *frame has a payload that may be read, of the neighbour in *slot. secure is null where frames are plain. */
static mk_status_t mk_link_receive(const uint8_t *bytes, size_t length, int slots, const uint16_t *nodes, uint32_t model, mk_secure_t *secure,
                                   mk_frame_t *frame, int *slot) {
    const mk_status_t status = mk_frame_read(bytes, length, frame);
    if (status != MK_OK) return status;
    if (frame->sealed != (secure != 0)) return MK_ERROR_SECURITY;
    if (frame->model != model) return MK_ERROR_MODEL;
    *slot = mk_link_slot(slots, nodes, frame->node);
    if (!*slot) return MK_ERROR_STRANGER;
    if (!secure) return MK_OK;
    if (frame->length > secure->capacity) return MK_ERROR_LENGTH;
    return mk_frame_open(bytes, frame, secure->aead, secure->window + *slot, secure->text);
}

/* May another frame be sent? Its payload goes into its place then, and mk_link_send ends it. */
static int mk_link_can_send(const mk_secure_t *secure) { return !(secure && secure->sequence == UINT64_MAX); }

/* The sequence number is used up even if the seal fails. */
static size_t mk_link_send(const mk_frame_t *frame, uint8_t *bytes, mk_secure_t *secure) {
    return mk_frame_write(frame, bytes, secure ? secure->aead : 0, secure ? secure->sequence++ : 0);
}

/* A neighbour is ahead, and will be in step `next` when this node ends its own. heard, seen: of its slot. */
static void mk_link_ahead(uint32_t next, uint32_t *heard, uint8_t *seen) {
    if (*seen != 2 || next - *heard < 0x80000000u) *heard = next;
    *seen = 2;
}

/* A neighbour sent in this step or before it. */
static void mk_link_heard(uint32_t step, int late, uint32_t *heard, uint8_t *seen) {
    if (*seen == 0) *seen = 1;
    if (!late && *seen == 1) *heard = step;
}

/* `step` begins. How many steps farther the neighbours are that it should follow, or 0; the rule is that of meshkal/node.h. */
static uint32_t mk_link_behind(int slots, uint32_t step, unsigned patience, const uint32_t *heard, uint8_t *seen, uint16_t *left_behind) {
    uint32_t least = 0;
    int known = 0, ahead = 0;
    for (int l = 1; l < slots; l++) {
        const uint32_t lead = heard[l] - step;
        known += seen[l] != 0;
        if (seen[l] == 2 && lead > 0 && lead < 0x80000000u) {
            if (ahead == 0 || lead < least) least = lead;
            ahead++;
        }
        seen[l] = 0;
    }
    if (ahead > 0) ++*left_behind;
    else if (known > 0) *left_behind = 0;
    return ahead > 0 && (2 * ahead >= known || *left_behind >= patience) ? least : 0;
}

#endif
