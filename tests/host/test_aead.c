/* SPDX-License-Identifier: MIT */
/* The host's seal against the example of RFC 8439, 2.8.2, and in frames. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "aead_sodium.h"

static const uint8_t vector_nonce[12] = {0x07, 0, 0, 0, 0x40, 0x41, 0x42, 0x43, 0x44, 0x45, 0x46, 0x47};
static const uint8_t vector_header[12] = {0x50, 0x51, 0x52, 0x53, 0xc0, 0xc1, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7};
static const char vector_text[] =
    "Ladies and Gentlemen of the class of '99: If I could offer you only one tip for the future, sunscreen would be it.";
static const uint8_t vector_sealed[114] = {
    0xd3, 0x1a, 0x8d, 0x34, 0x64, 0x8e, 0x60, 0xdb, 0x7b, 0x86, 0xaf, 0xbc, 0x53, 0xef, 0x7e, 0xc2, 0xa4, 0xad, 0xed, 0x51, 0x29, 0x6e, 0x08,
    0xfe, 0xa9, 0xe2, 0xb5, 0xa7, 0x36, 0xee, 0x62, 0xd6, 0x3d, 0xbe, 0xa4, 0x5e, 0x8c, 0xa9, 0x67, 0x12, 0x82, 0xfa, 0xfb, 0x69, 0xda, 0x92,
    0x72, 0x8b, 0x1a, 0x71, 0xde, 0x0a, 0x9e, 0x06, 0x0b, 0x29, 0x05, 0xd6, 0xa5, 0xb6, 0x7e, 0xcd, 0x3b, 0x36, 0x92, 0xdd, 0xbd, 0x7f, 0x2d,
    0x77, 0x8b, 0x8c, 0x98, 0x03, 0xae, 0xe3, 0x28, 0x09, 0x1b, 0x58, 0xfa, 0xb3, 0x24, 0xe4, 0xfa, 0xd6, 0x75, 0x94, 0x55, 0x85, 0x80, 0x8b,
    0x48, 0x31, 0xd7, 0xbc, 0x3f, 0xf4, 0xde, 0xf0, 0x8e, 0x4b, 0x7a, 0x9d, 0xe5, 0x76, 0xd2, 0x65, 0x86, 0xce, 0xc6, 0x4b, 0x61, 0x16};
static const uint8_t vector_tag[16] = {0x1a, 0xe1, 0x0b, 0x59, 0x4f, 0x09, 0xe2, 0x6a, 0x7e, 0x90, 0x2e, 0xcb, 0xd0, 0x60, 0x06, 0x91};

static void make(mk_aead_t *aead, uint8_t key[MK_AEAD_KEY], uint8_t first) {
    mk_error_t error;
    for (int i = 0; i < MK_AEAD_KEY; i++) key[i] = (uint8_t)(first + i);
    assert_true(mk_aead_sodium(aead, key, &error));
}

static void test_vector(void **state) {
    uint8_t key[MK_AEAD_KEY], text[114], tag[16];
    mk_aead_t aead;
    (void)state;
    make(&aead, key, 0x80);
    memcpy(text, vector_text, sizeof text);
    assert_int_equal(aead.seal(aead.context, vector_nonce, vector_header, sizeof vector_header, text, sizeof text, tag), 1);
    assert_memory_equal(text, vector_sealed, sizeof text);
    assert_memory_equal(tag, vector_tag, sizeof tag);
    assert_int_equal(aead.open(aead.context, vector_nonce, vector_header, sizeof vector_header, text, sizeof text, tag), 1);
    assert_memory_equal(text, vector_text, sizeof text);
}

static void test_any_change_is_seen(void **state) {
    uint8_t key[MK_AEAD_KEY], other_key[MK_AEAD_KEY];
    mk_aead_t aead, other;
    (void)state;
    make(&aead, key, 0x80);
    make(&other, other_key, 0x81);
    for (int i = 0; i < 12 + 12 + 114 + 16; i++) {
        uint8_t nonce[12], header[12], text[114], tag[16];
        memcpy(nonce, vector_nonce, sizeof nonce);
        memcpy(header, vector_header, sizeof header);
        memcpy(text, vector_sealed, sizeof text);
        memcpy(tag, vector_tag, sizeof tag);
        *(i < 12 ? nonce + i : i < 24 ? header + i - 12 : i < 138 ? text + i - 24 : tag + i - 138) ^= (uint8_t)(1 << i % 8);
        assert_int_equal(aead.open(aead.context, nonce, header, sizeof header, text, sizeof text, tag), 0);
    }
    uint8_t text[114];
    memcpy(text, vector_sealed, sizeof text);
    assert_int_equal(other.open(other.context, vector_nonce, vector_header, sizeof vector_header, text, sizeof text, vector_tag), 0);
    /* Nothing to encrypt is possible, too. */
    uint8_t tag[16];
    assert_int_equal(aead.seal(aead.context, vector_nonce, vector_header, sizeof vector_header, text, 0, tag), 1);
    assert_int_equal(aead.open(aead.context, vector_nonce, vector_header, sizeof vector_header, text, 0, tag), 1);
}

static void test_frames(void **state) {
    uint8_t key[MK_AEAD_KEY], bytes[64], text[16];
    mk_aead_t aead;
    mk_frame_t frame, found;
    mk_replay_t window = {0, 0};
    (void)state;
    make(&aead, key, 7);
    memset(&frame, 0, sizeof frame);
    frame.model = 0x01020304;
    frame.step = 5;
    frame.node = 6;
    frame.stage = MK_STAGE_ESTIMATE;
    frame.sealed = 1;
    frame.length = 16;
    memset(mk_frame_payload(bytes, 1), 0x5a, 16);
    const size_t length = mk_frame_write(&frame, bytes, &aead, (uint64_t)9 << 32);
    assert_int_equal(length, MK_FRAME_SEALED + 16);
    assert_int_equal(mk_frame_read(bytes, length, &found), MK_OK);
    assert_int_equal(mk_frame_open(bytes, &found, &aead, &window, text), MK_OK);
    for (int i = 0; i < 16; i++) assert_int_equal(text[i], 0x5a);
    assert_int_equal(mk_frame_read(bytes, length, &found), MK_OK);
    assert_int_equal(mk_frame_open(bytes, &found, &aead, &window, text), MK_ERROR_REPLAYED);
    mk_aead_forget(key);
    for (int i = 0; i < MK_AEAD_KEY; i++) assert_int_equal(key[i], 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_vector), cmocka_unit_test(test_any_change_is_seen), cmocka_unit_test(test_frames)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
