/* SPDX-License-Identifier: MIT */
#include "vectors_seal.h"

#include <stdlib.h>

#include "aead_sodium.h"

void vectors_aead(mk_aead_t *aead) {
    mk_error_t error;
    if (!mk_aead_sodium(aead, vectors_key, &error)) abort();
}
