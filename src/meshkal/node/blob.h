/* SPDX-License-Identifier: MIT */
/* One walk through a saved state for both directions, so that they cannot come apart. */
#ifndef MESHKAL_NODE_BLOB_H
#define MESHKAL_NODE_BLOB_H

#include <string.h>

#include "../network/bytes.h"

#define MK_BLOB_VERSION 1
#define MK_BLOB_HEADER 20 /* "MKS", version, bits, flags, n, m, slots, node, model, 2 free */

typedef struct {
    const uint8_t *from; /* null: save */
    uint8_t *to;
    size_t at;
} mk_blob_t;

static void mk_blob_u32(mk_blob_t *blob, uint32_t *value) {
    if (blob->from) *value = mk_get_u32(blob->from + blob->at);
    else mk_put_u32(blob->to + blob->at, *value);
    blob->at += 4;
}

static void mk_blob_u16(mk_blob_t *blob, uint16_t *value) {
    if (blob->from) *value = mk_get_u16(blob->from + blob->at);
    else mk_put_u16(blob->to + blob->at, *value);
    blob->at += 2;
}

static void mk_blob_u8(mk_blob_t *blob, uint8_t *value) {
    if (blob->from) *value = blob->from[blob->at];
    else blob->to[blob->at] = *value;
    blob->at++;
}

#endif
