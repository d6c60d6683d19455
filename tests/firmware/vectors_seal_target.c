/* SPDX-License-Identifier: MIT */
#include "vectors_seal.h"

#include "aead_monocypher.h"

void vectors_aead(mk_aead_t *aead) { mk_aead_monocypher(aead, vectors_key); }
