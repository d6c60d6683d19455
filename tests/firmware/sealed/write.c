/* SPDX-License-Identifier: MIT */
/* On the host: writes what sealed.h describes, every frame opened by the node it is for. Usage: sealed_write > FILE */
#include "sealed.h"

#include <sodium.h>
#include <stdio.h>
#include <stdlib.h>

#include "aead_sodium.h"

static void put(const void *bytes, size_t length) {
    if (length && fwrite(bytes, length, 1, stdout) != 1) {
        perror("sealed_write");
        exit(1);
    }
}

static void put_length(size_t length) {
    const uint8_t bytes[2] = {(uint8_t)length, (uint8_t)(length >> 8)};
    put(bytes, sizeof bytes);
}

static void expect(int good, const char *what) {
    if (good) return;
    (void)fprintf(stderr, "sealed_write: %s\n", what);
    exit(1);
}

static void messages(const mk_aead_t *aead) {
    for (uint32_t i = 0; i < SEALED_MESSAGES; i++) {
        struct {
            uint8_t nonce[12], header[SEALED_HEADER], text[SEALED_TEXT];
        } m;
        uint8_t seed[randombytes_SEEDBYTES] = {(uint8_t)i}, tag[MK_FRAME_TAG];
        const size_t header_length = i * 7 % (SEALED_HEADER + 1), length = i * 3;
        randombytes_buf_deterministic(&m, sizeof m, seed);
        put_length(header_length);
        put_length(length);
        put(m.nonce, sizeof m.nonce);
        put(m.header, header_length);
        put(m.text, length);
        expect(aead->seal(aead->context, m.nonce, m.header, header_length, m.text, length, tag), "a message cannot be sealed");
        put(m.text, length);
        put(tag, sizeof tag);
    }
}

static void frames(const mk_aead_t *aead) {
    static node00_t here;
    static node01_t there;
    static node00_secure_t here_secure;
    static node01_secure_t there_secure;
    expect(node00_start(&here, &node00_config) == MK_OK && node01_start(&there, &node01_config) == MK_OK, "a node does not start");
    expect(node00_secure(&here, &here_secure, aead, sealed_sequence) == MK_OK, "node 0 cannot be made secure");
    expect(node01_secure(&there, &there_secure, aead, sealed_sequence) == MK_OK, "node 1 cannot be made secure");
    for (uint32_t step = 0; step < SEALED_STEPS; step++) {
        mk_f32_t y[2];
        sealed_reading(0, step, y);
        expect(node00_measure(&here, y) == MK_OK, "reading of node 0");
        sealed_reading(1, step, y);
        expect(node01_measure(&there, y) == MK_OK, "reading of node 1");
        for (int stage = MK_STAGE_MEASUREMENT; stage <= MK_STAGE_ESTIMATE; stage++) {
            uint8_t bytes[2][SEALED_FRAME];
            const size_t length[2] = {node01_frame(&there, stage, bytes[0]), node00_frame(&here, stage, bytes[1])};
            expect(length[0] && length[1], "a frame cannot be sealed");
            expect(node00_accept(&here, bytes[0], length[0]) == MK_OK, "node 0 refuses a frame");
            expect(node01_accept(&there, bytes[1], length[1]) == MK_OK, "node 1 refuses a frame");
            for (int k = 0; k < 2; k++) {
                put_length(length[k]);
                put(bytes[k], length[k]);
            }
            const int reading = stage == MK_STAGE_MEASUREMENT;
            expect((reading ? node00_incremental(&here) : node00_diffuse(&here)) == MK_OK, "a step of node 0 fails");
            expect((reading ? node01_incremental(&there) : node01_diffuse(&there)) == MK_OK, "a step of node 1 fails");
        }
    }
}

int main(void) {
    mk_aead_t aead;
    mk_error_t error;
    expect(mk_aead_sodium(&aead, sealed_key, &error), "libsodium does not start");
    messages(&aead);
    frames(&aead);
    return fflush(stdout) != 0;
}
