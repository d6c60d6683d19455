/* SPDX-License-Identifier: MIT */
/* Runs a node again from its record (meshkal/record.h) and compares what comes of it, bit for bit. */
#ifndef MESHKAL_PLAYBACK_H
#define MESHKAL_PLAYBACK_H

#include <meshkal/record.h>

#include "host_node.h"

enum { MK_ITEM_KINDS = MK_ITEM_DROP + 1 };

/* Where an item of the record is and what it says; the first value in it that differs. */
typedef struct {
    size_t item, offset; /* from 0; of its first byte in the record */
    int kind;            /* MK_ITEM_ */
    uint32_t step;       /* that the node worked on when it came */
    const char *what;    /* "status", "step", "psi", "x"; static */
    int element;         /* of psi and x; -1: a single number */
    int bits;            /* 32, 64: numbers of that precision by their bits; 0: integers */
    uint64_t recorded, replayed;
} mk_difference_t;

/* Numbers between both, 1 for neighbours; UINT64_MAX where one is not a number. For integers their distance. */
uint64_t mk_difference_ulp(const mk_difference_t *difference);
/* A number of `bits` by its bits. */
double mk_bits_value(int bits, uint64_t value);
/* "incremental" for MK_ITEM_INCREMENTAL; null: no such kind. */
const char *mk_item_name(int kind);

enum {
    MK_BEGIN_FIRST,
    MK_BEGIN_SEAMLESS, /* the replay was in this very state */
    MK_BEGIN_GAP,      /* it was not: items are missing, or the node was started again */
    MK_BEGIN_OTHER     /* of another configuration than before */
};

/* A state in the record, from which the replay goes on. */
typedef struct {
    int kind; /* MK_BEGIN_ */
    size_t item, offset;
    uint32_t step, from; /* of the state; where the replay stood */
} mk_begin_t;

typedef struct {
    mk_host_facts_t facts;              /* of the first state's configuration */
    size_t items[MK_ITEM_KINDS], total; /* that were replayed */
    uint64_t steps;                     /* done, those that were made up for not among them */
    uint32_t first_step, last_step;     /* of the first state; reached at the end */
    uint64_t readings;                  /* own ones taken */
    uint64_t frames[256];               /* by status, as recorded */
    mk_begin_t *begin;                  /* states; mk_playback_free */
    size_t begins, begins_room;
    uint64_t differences; /* items in which something differs */
    mk_difference_t first;
    enum { MK_END_WHOLE, MK_END_CUT, MK_END_UNREADABLE } end;
    size_t end_item, end_offset; /* the item that is cut or unreadable */
    mk_error_t reason;           /* why */
    /* Is told of every item that differs, the first included; or null. */
    void (*each)(void *context, const mk_difference_t *difference);
    void *context;
} mk_playback_t;

/* Replays `length` bytes into *playback, zeroed before but for `each` and `context`. configuration: content of an item CONFIGURATION that
   counts in place of the record's own; null: none. What follows an unreadable item is not looked at. */
void mk_playback_run(mk_playback_t *playback, const uint8_t *bytes, size_t length, const mk_item_t *configuration);
void mk_playback_free(mk_playback_t *playback);

#endif
