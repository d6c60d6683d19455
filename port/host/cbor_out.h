/* SPDX-License-Identifier: MIT */
/* CBOR items put together in memory (RFC 8949), number arrays as RFC 8746 little-endian typed arrays. */
#ifndef MESHKAL_HOST_CBOR_OUT_H
#define MESHKAL_HOST_CBOR_OUT_H

#include <stddef.h>
#include <stdint.h>

/* Zeroed: empty. Free buffer. */
typedef struct {
    unsigned char *buffer;
    size_t used, room;
} mk_cbor_t;

void mk_cbor_map(mk_cbor_t *out, size_t pairs);
void mk_cbor_array(mk_cbor_t *out, size_t count);
void mk_cbor_uint(mk_cbor_t *out, uint64_t value);
void mk_cbor_double(mk_cbor_t *out, double value);
void mk_cbor_text(mk_cbor_t *out, const char *text, size_t length);
void mk_cbor_key(mk_cbor_t *out, const char *key);
/* Key and value. */
void mk_cbor_pair(mk_cbor_t *out, const char *key, const char *text);
void mk_cbor_count(mk_cbor_t *out, const char *key, uint64_t value);
/* tag: one of the kinds below; size: of an element. */
enum { MK_CBOR_UINT8 = 64, MK_CBOR_UINT32 = 70, MK_CBOR_FLOAT32 = 85, MK_CBOR_FLOAT64 = 86 };
void mk_cbor_typed(mk_cbor_t *out, const char *key, int tag, const void *values, size_t size, size_t count);
/* Bytes of whole items. */
void mk_cbor_append(mk_cbor_t *out, const void *bytes, size_t length);

#endif
