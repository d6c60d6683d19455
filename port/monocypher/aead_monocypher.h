/* SPDX-License-Identifier: MIT */
/*
 * Sealed frames on a target: ChaCha20-Poly1305 of RFC 8439, as mk_aead_t of <meshkal/frame.h> wants it, on Monocypher 4 (two files,
 * monocypher.c and monocypher.h, no heap, no writable static data; compile with -ffunction-sections and link with --gc-sections). The
 * same bytes as libsodium's crypto_aead_chacha20poly1305_ietf.
 *
 *     static const uint8_t key[MK_MONOCYPHER_KEY] = {...};
 *     static mk_aead_t aead;
 *     mk_aead_monocypher(&aead, key);
 *     node00_secure(&node, &secure, &aead, boots << 32);
 *
 * seal   Encrypts text in place, writes tag. Always 1.
 * open   1: tag belongs to nonce, header and text; text is decrypted in place. 0: it does not; text is as it was. Tags are compared in
 *        a time that does not depend on them.
 *
 * Both may be given null for a header or a text of length 0. text and tag overlap neither each other nor header, nonce or key. No
 * branch and no address depends on the key or on what is encrypted; whether the time does is up to the processor's multiplication (that of
 * Cortex-M3 depends on the numbers). Afterwards nothing of the key is left on the stack; of what was made of it for this one message (key
 * stream, key of Poly1305) single words that the compiler saved from registers may be. Reentrant.
 *
 * Stack and instructions for 20 bytes of header and 40 of text: make sealed-size.
 */
#ifndef MESHKAL_MONOCYPHER_AEAD_H
#define MESHKAL_MONOCYPHER_AEAD_H

#include <meshkal/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MK_MONOCYPHER_KEY = 32 };

/* The key of `aead` is `key` itself, which must stay, in RAM or flash. crypto_wipe of Monocypher zeroes one that is no longer needed. */
void mk_aead_monocypher(mk_aead_t *aead, const uint8_t key[MK_MONOCYPHER_KEY]);

#ifdef __cplusplus
}
#endif

#endif
