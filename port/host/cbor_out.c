/* SPDX-License-Identifier: MIT */
#include "cbor_out.h"

#include <cbor.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static unsigned char *reserve(mk_cbor_t *out, size_t more) {
    if (out->used + more > out->room) {
        while (out->used + more > out->room) out->room = out->room ? 2 * out->room : 4096;
        unsigned char *larger = realloc(out->buffer, out->room);
        if (!larger) {
            (void)fputs("meshkal: out of memory\n", stderr);
            exit(1);
        }
        out->buffer = larger;
    }
    return out->buffer + out->used;
}

#define HEAD 16 /* more than any CBOR item head */
void mk_cbor_map(mk_cbor_t *out, size_t count) { out->used += cbor_encode_map_start(count, reserve(out, HEAD), HEAD); }
void mk_cbor_array(mk_cbor_t *out, size_t count) { out->used += cbor_encode_array_start(count, reserve(out, HEAD), HEAD); }
void mk_cbor_uint(mk_cbor_t *out, uint64_t value) { out->used += cbor_encode_uint(value, reserve(out, HEAD), HEAD); }
void mk_cbor_double(mk_cbor_t *out, double value) { out->used += cbor_encode_double(value, reserve(out, HEAD), HEAD); }

void mk_cbor_append(mk_cbor_t *out, const void *bytes, size_t length) {
    memcpy(reserve(out, length), bytes, length);
    out->used += length;
}

void mk_cbor_text(mk_cbor_t *out, const char *text, size_t length) {
    out->used += cbor_encode_string_start(length, reserve(out, HEAD), HEAD);
    mk_cbor_append(out, text, length);
}

void mk_cbor_key(mk_cbor_t *out, const char *key) { mk_cbor_text(out, key, strlen(key)); }

void mk_cbor_pair(mk_cbor_t *out, const char *key, const char *text) {
    mk_cbor_key(out, key);
    mk_cbor_key(out, text);
}

void mk_cbor_count(mk_cbor_t *out, const char *key, uint64_t value) {
    mk_cbor_key(out, key);
    mk_cbor_uint(out, value);
}

void mk_cbor_typed(mk_cbor_t *out, const char *key, int tag, const void *values, size_t size, size_t count) {
    const uint16_t probe = 1;
    unsigned char low;
    memcpy(&low, &probe, 1);
    mk_cbor_key(out, key);
    out->used += cbor_encode_tag((uint64_t)tag, reserve(out, HEAD), HEAD);
    out->used += cbor_encode_bytestring_start(size * count, reserve(out, HEAD), HEAD);
    const size_t start = out->used;
    mk_cbor_append(out, values, size * count);
    if (low == 1) return;
    /* Big-endian host: the tags promise little-endian elements. */
    for (size_t i = 0; i < count; i++)
        for (size_t a = 0, b = size - 1; a < b; a++, b--) {
            unsigned char *element = out->buffer + start + i * size, swap = element[a];
            element[a] = element[b];
            element[b] = swap;
        }
}
