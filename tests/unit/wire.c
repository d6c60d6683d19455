/* SPDX-License-Identifier: MIT */
#include "wire.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <sodium.h>

static void append(wire_t *wire, const void *bytes, size_t count) {
    if (wire->length + count > sizeof wire->bytes) abort();
    memcpy(wire->bytes + wire->length, bytes, count);
    wire->length += count;
}

uint32_t wire_crc_of(const uint8_t *bytes, size_t length) {
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < length; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = crc & 1u ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    }
    return ~crc;
}

void wire_begin(wire_t *wire, int version, unsigned type, unsigned node, uint32_t model, uint32_t step) {
    const uint8_t start[2] = {(uint8_t)version, (uint8_t)type};
    const uint16_t sender = (uint16_t)node;
    wire->length = 0;
    append(wire, start, 2);
    append(wire, &sender, 2);
    append(wire, &model, 4);
    append(wire, &step, 4);
}

/* To the nearest, ties to even, by arithmetic. */
static uint16_t half(double value) {
    const uint16_t sign = signbit(value) ? 0x8000u : 0;
    int exponent;
    value = fabs(value);
    if (isnan(value)) return 0x7e00u;
    if (value >= 65520.0) return sign | 0x7c00u;
    frexp(value, &exponent);
    if (value == 0.0 || exponent < -13) exponent = -13;
    /* The hidden bit adds the one that the biased exponent lacks. */
    const double units = rint(ldexp(value, 11 - exponent));
    return (uint16_t)(sign | ((unsigned)units + ((unsigned)(exponent + 13) << 10)));
}

void wire_numbers(wire_t *wire, int format, int count, const double *values) {
    for (int i = 0; i < count; i++) {
        const float single = (float)values[i];
        const uint16_t two = half(values[i]);
        if (format == 0) append(wire, &single, 4);
        else if (format == 1) append(wire, values + i, 8);
        else append(wire, &two, 2);
    }
}

void wire_crc(wire_t *wire) {
    const uint32_t crc = wire_crc_of(wire->bytes, wire->length);
    append(wire, &crc, 4);
}

void wire_repair(uint8_t *bytes, size_t length) {
    const uint32_t crc = wire_crc_of(bytes, length - 4);
    memcpy(bytes + length - 4, &crc, 4);
}

void wire_plain(wire_t *wire, int stage, int format, unsigned flags, unsigned node, uint32_t model, uint32_t step, int count, const double *values) {
    wire_begin(wire, 1, (unsigned)stage | (unsigned)format << 2 | flags, node, model, step);
    wire_numbers(wire, format, count, values);
    wire_crc(wire);
}

void wire_sealed(wire_t *wire, int stage, int format, unsigned flags, unsigned node, uint32_t model, uint32_t step, int count, const double *values,
                 const uint8_t *key, uint64_t sequence) {
    uint8_t nonce[12] = {(uint8_t)node, (uint8_t)(node >> 8)}, tag[16];
    unsigned long long size;
    wire_begin(wire, 1, (unsigned)stage | (unsigned)format << 2 | 32u | flags, node, model, step);
    append(wire, &sequence, 8);
    memcpy(nonce + 4, &sequence, 8);
    wire_numbers(wire, format, count, values);
    crypto_aead_chacha20poly1305_ietf_encrypt_detached(wire->bytes + 20, tag, &size, wire->bytes + 20, wire->length - 20, wire->bytes, 20, NULL, nonce,
                                                       key);
    append(wire, tag, 16);
}

int wire_aead_seal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length, uint8_t tag[16]) {
    unsigned long long size;
    return crypto_aead_chacha20poly1305_ietf_encrypt_detached(text, tag, &size, text, length, header, header_length, NULL, nonce, context) == 0;
}

int wire_aead_open(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                   const uint8_t tag[16]) {
    return crypto_aead_chacha20poly1305_ietf_decrypt_detached(text, NULL, text, length, tag, header, header_length, nonce, context) == 0;
}

void wire_bytes(wire_t *wire, const void *bytes, size_t count) { append(wire, bytes, count); }

void wire_consensus(wire_t *wire, int format, unsigned flags, unsigned node, uint32_t model, uint32_t step, unsigned iteration, int count,
                    const double *values) {
    const uint8_t start[3] = {(uint8_t)iteration, (uint8_t)(iteration >> 8), (uint8_t)flags};
    wire_begin(wire, 1, 3u | (unsigned)format << 2, node, model, step);
    append(wire, start, 3);
    wire_numbers(wire, format, count, values);
    wire_crc(wire);
}
