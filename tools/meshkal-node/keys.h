/* SPDX-License-Identifier: MIT */
/*
 * Key and sequence numbers of sealed frames.
 *
 * The key file holds 64 hexadecimal digits, the same on all nodes, and is readable by its owner only.
 *
 * A sequence number must never be used twice with one key. Its upper 32 bits count starts: each takes what is higher, one more than
 * the last start, which the boot file tells, or the seconds since 1970. So a lost boot file does no harm while the clock is right, and a clock
 * that was set back does none while the boot file is there. The lower 32 bits count frames. The file is written before the first frame
 * goes out, and stays locked: two daemons cannot share it.
 */
#ifndef MESHKAL_NODE_KEYS_H
#define MESHKAL_NODE_KEYS_H

#include "aead_sodium.h"
#include "settings.h"

typedef struct {
    uint8_t key[MK_AEAD_KEY];
    mk_aead_t aead;
    int boots; /* descriptor of the boot file */
    uint64_t sequence;
} mk_keys_t;

/* 1, or 0 and an error that names the key of the settings. */
int mk_keys_open(mk_keys_t *keys, const mk_settings_t *settings, mk_error_t *error);
void mk_keys_close(mk_keys_t *keys);

#endif
