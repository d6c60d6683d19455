/* SPDX-License-Identifier: MIT */
/* Frames written from the format page of <meshkal/frame.h> and nothing else, for tests: shares no code with src/meshkal. For machines
   whose own numbers are little-endian IEEE. */
#ifndef UNIT_WIRE_H
#define UNIT_WIRE_H

#include <stddef.h>
#include <stdint.h>

#include <meshkal/frame.h>

typedef struct {
    uint8_t bytes[2048];
    size_t length;
} wire_t;

/* Header only; numbers follow, then one of the endings. */
void wire_begin(wire_t *wire, int version, unsigned type, unsigned node, uint32_t model, uint32_t step);
void wire_numbers(wire_t *wire, int format, int count, const double *values);
void wire_crc(wire_t *wire);

/* Rewrites the CRC of a frame that was changed. */
void wire_repair(uint8_t *bytes, size_t length);

/* A whole plain frame of version 1 with numbers in a format; flags: bits of the type byte beside stage and format. */
void wire_plain(wire_t *wire, int stage, int format, unsigned flags, unsigned node, uint32_t model, uint32_t step, int count, const double *values);

/* The same, sealed with ChaCha20-Poly1305 under a key of 32 bytes. */
void wire_sealed(wire_t *wire, int stage, int format, unsigned flags, unsigned node, uint32_t model, uint32_t step, int count, const double *values,
                 const uint8_t *key, uint64_t sequence);

/* Anything, after wire_begin. */
void wire_bytes(wire_t *wire, const void *bytes, size_t count);

/* A whole plain frame of stage consensus; flags: protocol and whether the sender has a reading. */
void wire_consensus(wire_t *wire, int format, unsigned flags, unsigned node, uint32_t model, uint32_t step, unsigned iteration, int count,
                    const double *values);

/* CRC-32 bit by bit. */
uint32_t wire_crc_of(const uint8_t *bytes, size_t length);

/* ChaCha20-Poly1305 as the library wants it; context is the key. */
int wire_aead_seal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length, uint8_t tag[16]);
int wire_aead_open(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                   const uint8_t tag[16]);

#endif
