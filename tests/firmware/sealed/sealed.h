/* SPDX-License-Identifier: MIT */
/*
 * Sealed frames between a target and a host. write.c, on the host, runs two nodes that talk in frames sealed by libsodium, and
 * writes what they sent; sealed.c, the image, is node 0 on Monocypher: it must open what node 1 sent, and send what node 0 sent, to
 * the byte.
 * The file begins with SEALED_MESSAGES messages without a node:
 *     lengths of header and text (2 + 2), nonce (12), header, text, text encrypted, tag (16)
 * then for each step frames of reading and of estimate, of each the one of node 1 and the one of node 0: length (2), bytes.
 */
#ifndef MESHKAL_TESTS_SEALED_H
#define MESHKAL_TESTS_SEALED_H

#include <meshkal/frame.h>

#include "node_00.h"
#include "node_01.h"

enum { SEALED_STEPS = 50, SEALED_MESSAGES = 100, SEALED_HEADER = 60, SEALED_TEXT = 300, SEALED_FRAME = node00_frame_max };

/* No four bytes of it are likely to stand in memory for another reason. */
static const uint8_t sealed_key[32] = {0x9d, 0x21, 0xe7, 0x5b, 0x83, 0x6c, 0xf4, 0x1e, 0xb8, 0x47, 0xd2, 0x95, 0x3a, 0xcf, 0x68, 0x71,
                                       0xe5, 0x1b, 0x96, 0x4d, 0xa3, 0xfc, 0x58, 0x27, 0xc1, 0x7e, 0xb9, 0x32, 0x8f, 0x64, 0xda, 0x15};
/* The first sequence number: third start of either node. */
static const uint64_t sealed_sequence = (uint64_t)3 << 32;

/* A reading that both sides calculate with the same bits: multiples of 1/32. */
static void sealed_reading(int node, uint32_t step, mk_f32_t y[2]) {
    for (uint32_t row = 0; row < 2; row++) {
        const uint32_t mixed = (step * 4u + (uint32_t)node * 2u + row + 1u) * UINT32_C(2654435761);
        y[row] = (mk_f32_t)((int32_t)(mixed >> 24) - 128) * 0.03125f;
    }
}

#endif
