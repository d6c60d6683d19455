/* SPDX-License-Identifier: MIT */
/* Sealed frames on a host: ChaCha20-Poly1305 of RFC 8439 by libsodium, as mk_aead_t of <meshkal/frame.h> wants it. */
#ifndef MESHKAL_HOST_AEAD_SODIUM_H
#define MESHKAL_HOST_AEAD_SODIUM_H

#include <meshkal/frame.h>

#include "error.h"

enum { MK_AEAD_KEY = 32 };

/* The key of `aead` is `key` itself, which must stay. 1, or 0 and *error: libsodium does not start. */
int mk_aead_sodium(mk_aead_t *aead, const uint8_t key[MK_AEAD_KEY], mk_error_t *error);
/* Zeroes a key that is no longer needed, which memset may not. */
void mk_aead_forget(uint8_t key[MK_AEAD_KEY]);

#endif
