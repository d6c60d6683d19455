/* SPDX-License-Identifier: MIT */
/*
 * Records: what a node was given and what came of it, so that the host can run it again and compare every bit
 * (`meshkal replay RECORD`). The same format on a node and on the host.
 *
 * A record is a sequence of items, little-endian:
 *
 *     0      1   kind, MK_ITEM_
 *     1      1   status of the call (mk_status_t)
 *     2      4   bytes of content, k
 *     6      k   content; numbers in the node's own precision
 *     6 + k  4   CRC-32 of all before
 *
 * Recorded is every call that can change an estimate: readings, refused ones too; frames whose seal or checksum was good, whatever became
 * of them (others change nothing but counters); steps, advance, tolerance, restart. Not recorded: what is put into member `filter` past
 * the node object, such as innovations. A replay's counters are those of the recorded calls.
 *
 * Everything before a cut can be read. An item CONFIGURATION (or, from elsewhere, the same configuration) and an item STATE must come
 * before the rest. A further STATE says where a recorder was started again: where items were lost before it, the replay shows the gap.
 */
#ifndef MESHKAL_RECORD_H
#define MESHKAL_RECORD_H

#include <meshkal/base.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    MK_ITEM_CONFIGURATION = 1, /* see below */
    MK_ITEM_STATE = 2,         /* name_save: state before the next item */
    MK_ITEM_MEASURE = 3,       /* y, rows of the node's own sensor */
    MK_ITEM_FRAME = 4,         /* a frame that came from a neighbour and passed its seal or checksum, as a plain frame without CRC */
    MK_ITEM_INCREMENTAL = 5,   /* input r if one was given (n), then psi (n); no psi after a failure */
    MK_ITEM_DIFFUSE = 6,       /* step afterwards (4 bytes), x (n) */
    MK_ITEM_ADVANCE = 7,       /* step asked for, step afterwards (4 bytes each), x (n) */
    MK_ITEM_TOLERANCE = 8,     /* c */
    MK_ITEM_RESTART = 9,       /* x0 (n), P0 packed */
    MK_ITEM_DROP = 10          /* slot (2 bytes) whose reading was dropped */
};

/* Content of CONFIGURATION: n, m, slots, catch_up, patience (2 bytes each); bits of a number, MK_NUMBERS_ of its frames, with_model, flags
   (1 byte each; flags 1: input, 2: gate, 4: foreign, 8: steady); model (4); for each slot its node (2), rows (1), foreign (1); then
   numbers: A, Q, input (with its flag), x0, P0, weight, C, F, S, R_inverse, tolerance; with a gate its thresholds for readings and for
   estimates; with foreign its limit; with a steady part Phi, G, W, theta, trace_P, close and the period (2 bytes). */

/* Bytes of an item beside its content. */
#define MK_ITEM_OVERHEAD 10

/* A bounded buffer for items, owned by the application, which sets bytes, capacity and with_configuration. For a stream, take out
   the first `used` bytes and set used = 0 whenever you like between calls. An item that does not fit closes the recorder: this and
   all later items are lost, until name_record starts it again with the state of that moment. */
typedef struct {
    uint8_t *bytes;
    size_t capacity, used;
    uint32_t lost;              /* items */
    uint8_t with_configuration; /* 1: name_record writes the configuration first, so that the record can be replayed by itself */
} mk_recorder_t;

/* An item read from a record. */
typedef struct {
    uint8_t kind, status;
    uint32_t length;
    const uint8_t *content;
} mk_item_t;

/* Reads the item at the start of `bytes` and returns its size, or 0: truncated (*damaged 0) or its CRC is wrong (*damaged 1). */
size_t mk_item_read(const uint8_t *bytes, size_t length, mk_item_t *item, int *damaged);

#ifdef __cplusplus
}
#endif

#endif
