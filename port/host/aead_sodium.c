/* SPDX-License-Identifier: MIT */
#include "aead_sodium.h"

#include <sodium.h>

static int seal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                uint8_t tag[16]) {
    return crypto_aead_chacha20poly1305_ietf_encrypt_detached(text, tag, NULL, text, length, header, header_length, NULL, nonce,
                                                              context) == 0;
}

static int open(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                const uint8_t tag[16]) {
    return crypto_aead_chacha20poly1305_ietf_decrypt_detached(text, NULL, text, length, tag, header, header_length, nonce, context) == 0;
}

int mk_aead_sodium(mk_aead_t *aead, const uint8_t key[MK_AEAD_KEY], mk_error_t *error) {
    /* The context is not const, because other implementations keep state there. */
    union {
        const uint8_t *constant;
        void *context;
    } place;
    place.constant = key;
    aead->seal = seal;
    aead->open = open;
    aead->context = place.context;
    return sodium_init() >= 0 || mk_fail(error, "libsodium does not start");
}

void mk_aead_forget(uint8_t key[MK_AEAD_KEY]) { sodium_memzero(key, MK_AEAD_KEY); }
