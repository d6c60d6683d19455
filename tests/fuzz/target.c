/* SPDX-License-Identifier: MIT */
/* A node object that is handed whatever bytes there are: frames plain and sealed, recorded ones, saved states, records, and calls between
   them. One input is a program: a byte of settings, then calls, each a byte of kind, a byte of length, and that many bytes. For
   libFuzzer and for the generator of tests/fuzz/generate.c.

   What must hold: a refused frame or state changes nothing but what the headers say; estimates are finite whatever was taken; a saved state
   can be restored and is saved again as the same bytes; every call returns. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MUST(condition)                                                                                                       \
    do {                                                                                                                      \
        if (!(condition)) {                                                                                                   \
            fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition);                                    \
            abort();                                                                                                          \
        }                                                                                                                     \
    } while (0)
/* For tests/unit/node_bench.tmpl.h, which is written for CMocka. */
#define assert_int_equal(a, b) MUST((a) == (b))
#define assert_non_null(a) MUST((a) != NULL)
#define assert_true(a) MUST(a)
#define assert_memory_equal(a, b, size) MUST(memcmp(a, b, size) == 0)
#define fail_msg(...) (fprintf(stderr, __VA_ARGS__), abort())

#include "node_names.h"
#include "target.h"
#include "wire.h"

/* A seal that a mutation passes now and then: the tag is the sum of all bytes. */
static uint8_t sum_of(const uint8_t nonce[12], const uint8_t *header, size_t header_length, const uint8_t *text, size_t length) {
    unsigned sum = 0;
    for (int i = 0; i < 12; i++) sum += nonce[i];
    for (size_t i = 0; i < header_length; i++) sum += header[i];
    for (size_t i = 0; i < length; i++) sum += text[i];
    return (uint8_t)(sum & 3u);
}

static int weak_seal(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                     uint8_t tag[16]) {
    (void)context;
    memset(tag, 0, 16);
    tag[0] = sum_of(nonce, header, header_length, text, length);
    return 1;
}

static int weak_open(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                     const uint8_t tag[16]) {
    (void)context;
    return (tag[0] & 3u) == sum_of(nonce, header, header_length, text, length);
}

long frozen_steps;

static const mk_aead_t weak = {weak_seal, weak_open, NULL};

#define KIND shared
#define DECLARE MK_NODE_OF
#define PRECISION f32
#define REAL float
#define BITS 32
#include "node_bench.tmpl.h"
#include "target.tmpl.h"
#undef PRECISION
#undef REAL
#undef BITS
#define PRECISION f64
#define REAL double
#define BITS 64
#include "node_bench.tmpl.h"
#include "target.tmpl.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size == 0) return 0;
    if (data[0] & SETTING_WIDE) run_shared_f64(data[0], data + 1, size - 1);
    else run_shared_f32(data[0], data + 1, size - 1);
    return 0;
}
