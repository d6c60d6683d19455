/* SPDX-License-Identifier: MIT */
/* The programs that tests/fuzz/target.c runs. */
#ifndef FUZZ_TARGET_H
#define FUZZ_TARGET_H

#include <stddef.h>
#include <stdint.h>

/* Bits of the first byte. */
enum { SETTING_WIDE = 1, SETTING_GATE = 2, SETTING_FOREIGN = 4, SETTING_SEALED = 8, SETTING_MODEL = 16, SETTING_RECORD = 32,
       SETTING_STEADY = 64 /* not with FOREIGN */ };

enum {
    CALL_BYTES,       /* accept of these bytes */
    CALL_FRAME,       /* accept of a frame with a good header and CRC or seal: type, slot, step relative to the node's, payload */
    CALL_REPAIRED,    /* accept of these bytes with a good CRC */
    CALL_RECORDED,    /* accept_recorded of these bytes */
    CALL_MEASURE,     /* numbers */
    CALL_STEP,        /* incremental or diffuse, what is next */
    CALL_ADVANCE,     /* steps */
    CALL_SEND,        /* frames of both stages */
    CALL_SAVE,        /* save, spoil these places (2 bytes, and 1 to xor; with 0 the next 8 become 0xff), repair the CRC, restore */
    CALL_RESTORE,     /* restore of these bytes */
    CALL_ITEMS,       /* a record */
    CALL_WRONG_ORDER, /* incremental or diffuse, what is not next */
    CALL_RESTART,
    CALL_TOLERANCE,
    CALL_WHOLE,       /* ends a step, and begins one with readings in all slots: what a frozen gain needs */
    CALL_DROP,        /* slot: innovations, then drop */
    CALL_COUNT
};

/* Steps with a frozen gain so far. */
extern long frozen_steps;

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#endif
