/* SPDX-License-Identifier: MIT */
#include "aead_monocypher.h"

#include <monocypher.h>

/* Monocypher's own sequence of messages gives each a new key; RFC 8439 is its first message, so every message begins a sequence. */

static int seal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                uint8_t tag[16]) {
    crypto_aead_ctx message;
    crypto_aead_init_ietf(&message, context, nonce);
    crypto_aead_write(&message, text, tag, header, header_length, text, length);
    crypto_wipe(&message, sizeof message);
    return 1;
}

static int open(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                const uint8_t tag[16]) {
    crypto_aead_ctx message;
    crypto_aead_init_ietf(&message, context, nonce);
    const int mismatch = crypto_aead_read(&message, text, tag, header, header_length, text, length);
    crypto_wipe(&message, sizeof message);
    return !mismatch;
}

void mk_aead_monocypher(mk_aead_t *aead, const uint8_t key[MK_MONOCYPHER_KEY]) {
    /* The context is not const, because other implementations keep state there. */
    union {
        const uint8_t *constant;
        void *context;
    } place;
    place.constant = key;
    aead->seal = seal;
    aead->open = open;
    aead->context = place.context;
}
