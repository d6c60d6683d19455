/* SPDX-License-Identifier: MIT */
/* Little-endian numbers at any address, whatever the processor's own order. */
#ifndef MESHKAL_BYTES_H
#define MESHKAL_BYTES_H

#include <stdint.h>

#include "../inline.h"

/* Small and called often: left to the compiler to inline. */
#if defined(__GNUC__) || defined(__clang__)
#define MK_SMALL static __attribute__((unused))
#else
#define MK_SMALL static
#endif

MK_SMALL uint64_t mk_get_bytes(const uint8_t *bytes, int count) {
    uint64_t value = 0;
    for (int i = count; i-- > 0;) value = value << 8 | bytes[i];
    return value;
}

MK_SMALL void mk_put_bytes(uint8_t *bytes, int count, uint64_t value) {
    for (int i = 0; i < count; i++) bytes[i] = (uint8_t)(value >> 8 * i);
}

MK_SMALL uint32_t mk_get_u32(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

MK_SMALL void mk_put_u32(uint8_t *bytes, uint32_t value) {
    for (int i = 0; i < 4; i++) bytes[i] = (uint8_t)(value >> 8 * i);
}

MK_SMALL uint16_t mk_get_u16(const uint8_t *bytes) { return (uint16_t)(bytes[0] | bytes[1] << 8); }

MK_SMALL void mk_put_u16(uint8_t *bytes, uint16_t value) {
    bytes[0] = (uint8_t)(value & 0xffu);
    bytes[1] = (uint8_t)(value >> 8);
}

#endif
