/* SPDX-License-Identifier: MIT */
/* The seals of port/host and of port/monocypher: against the example of RFC 8439, 2.8.2, against each other, and in frames. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>
#include <sodium.h>

#include "aead_monocypher.h"
#include "aead_sodium.h"

enum { KEY = MK_AEAD_KEY, NONCE = 12, TAG = 16, LONGEST = 300, GUARD = 32, MESSAGES = 6020 };

/* One message. Header and text begin at any alignment, with guards around text and tag. */
typedef struct {
    uint8_t key[KEY], nonce[NONCE], header_room[LONGEST + 8], text_room[LONGEST + 8 + 2 * GUARD], tag_room[TAG + 2 * GUARD];
    uint8_t *header, *text, *tag;
    size_t header_length, length;
} message_t;

static void place(message_t *m, size_t header_length, size_t length, unsigned alignment) {
    m->header = m->header_room + alignment % 8;
    m->text = m->text_room + GUARD + alignment / 8 % 8;
    m->tag = m->tag_room + GUARD;
    m->header_length = header_length;
    m->length = length;
}

/* Everything from the generator of libsodium, another message for each number. */
static void draw(message_t *m, uint32_t number) {
    uint8_t seed[randombytes_SEEDBYTES] = {0}, shape[3];
    memcpy(seed, &number, sizeof number);
    randombytes_buf_deterministic(m, offsetof(message_t, header), seed);
    seed[31] = 1;
    randombytes_buf_deterministic(shape, sizeof shape, seed);
    place(m, number % 3 ? shape[0] % 64u : (shape[0] * 256u + shape[1]) % (LONGEST + 1), number % (LONGEST + 1), shape[2]);
}

static void copy(message_t *to, const message_t *from) {
    *to = *from;
    to->header = to->header_room + (from->header - from->header_room);
    to->text = to->text_room + (from->text - from->text_room);
    to->tag = to->tag_room + (from->tag - from->tag_room);
}

static void assert_same(const message_t *a, const message_t *b) { assert_memory_equal(a, b, offsetof(message_t, header)); }

typedef void maker_t(mk_aead_t *aead, const uint8_t *key);

static void sodium(mk_aead_t *aead, const uint8_t *key) {
    mk_error_t error;
    assert_true(mk_aead_sodium(aead, key, &error));
}

static int seal(maker_t *make, message_t *m) {
    mk_aead_t aead;
    make(&aead, m->key);
    return aead.seal(aead.context, m->nonce, m->header, m->header_length, m->text, m->length, m->tag);
}

static int open(maker_t *make, message_t *m) {
    mk_aead_t aead;
    make(&aead, m->key);
    return aead.open(aead.context, m->nonce, m->header, m->header_length, m->text, m->length, m->tag);
}

static const uint8_t vector_nonce[NONCE] = {0x07, 0, 0, 0, 0x40, 0x41, 0x42, 0x43, 0x44, 0x45, 0x46, 0x47};
static const uint8_t vector_header[12] = {0x50, 0x51, 0x52, 0x53, 0xc0, 0xc1, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7};
static const char vector_text[] =
    "Ladies and Gentlemen of the class of '99: If I could offer you only one tip for the future, sunscreen would be it.";
static const uint8_t vector_sealed[sizeof vector_text - 1] = {
    0xd3, 0x1a, 0x8d, 0x34, 0x64, 0x8e, 0x60, 0xdb, 0x7b, 0x86, 0xaf, 0xbc, 0x53, 0xef, 0x7e, 0xc2, 0xa4, 0xad, 0xed, 0x51, 0x29, 0x6e, 0x08,
    0xfe, 0xa9, 0xe2, 0xb5, 0xa7, 0x36, 0xee, 0x62, 0xd6, 0x3d, 0xbe, 0xa4, 0x5e, 0x8c, 0xa9, 0x67, 0x12, 0x82, 0xfa, 0xfb, 0x69, 0xda, 0x92,
    0x72, 0x8b, 0x1a, 0x71, 0xde, 0x0a, 0x9e, 0x06, 0x0b, 0x29, 0x05, 0xd6, 0xa5, 0xb6, 0x7e, 0xcd, 0x3b, 0x36, 0x92, 0xdd, 0xbd, 0x7f, 0x2d,
    0x77, 0x8b, 0x8c, 0x98, 0x03, 0xae, 0xe3, 0x28, 0x09, 0x1b, 0x58, 0xfa, 0xb3, 0x24, 0xe4, 0xfa, 0xd6, 0x75, 0x94, 0x55, 0x85, 0x80, 0x8b,
    0x48, 0x31, 0xd7, 0xbc, 0x3f, 0xf4, 0xde, 0xf0, 0x8e, 0x4b, 0x7a, 0x9d, 0xe5, 0x76, 0xd2, 0x65, 0x86, 0xce, 0xc6, 0x4b, 0x61, 0x16};
static const uint8_t vector_tag[TAG] = {0x1a, 0xe1, 0x0b, 0x59, 0x4f, 0x09, 0xe2, 0x6a, 0x7e, 0x90, 0x2e, 0xcb, 0xd0, 0x60, 0x06, 0x91};

static void vector(maker_t *make) {
    message_t m;
    memset(&m, 0, sizeof m);
    place(&m, sizeof vector_header, sizeof vector_sealed, 0);
    for (int i = 0; i < KEY; i++) m.key[i] = (uint8_t)(0x80 + i);
    memcpy(m.nonce, vector_nonce, NONCE);
    memcpy(m.header, vector_header, sizeof vector_header);
    memcpy(m.text, vector_text, m.length);
    assert_int_equal(seal(make, &m), 1);
    assert_memory_equal(m.text, vector_sealed, m.length);
    assert_memory_equal(m.tag, vector_tag, TAG);
    assert_int_equal(open(make, &m), 1);
    assert_memory_equal(m.text, vector_text, m.length);
}

static void test_example_of_the_rfc(void **state) {
    (void)state;
    vector(mk_aead_monocypher);
    vector(sodium);
}

/* Each seals to the same bytes, touches nothing else, and opens what the other sealed. */
static void test_random_messages(void **state) {
    message_t plain, here, there;
    int lengths[LONGEST + 1] = {0}, headers[LONGEST + 1] = {0};
    (void)state;
    for (uint32_t i = 0; i < MESSAGES; i++) {
        draw(&plain, i);
        copy(&here, &plain);
        copy(&there, &plain);
        assert_int_equal(seal(mk_aead_monocypher, &here), 1);
        assert_int_equal(seal(sodium, &there), 1);
        assert_same(&here, &there);
        assert_int_equal(open(sodium, &here), 1);
        assert_int_equal(open(mk_aead_monocypher, &there), 1);
        memcpy(plain.tag, here.tag, TAG);
        assert_same(&here, &plain);
        assert_same(&there, &plain);
        lengths[plain.length]++;
        headers[plain.header_length]++;
    }
    for (int k = 0; k <= LONGEST; k++) assert_in_range(lengths[k], 1, MESSAGES);
    for (int k = 0; k < 64; k++) assert_in_range(headers[k], 1, MESSAGES);
}

/* Any one bit of nonce, header, text, tag or key: neither opens it, and text stays as it was. */
static void test_any_changed_bit_is_refused(void **state) {
    message_t sealed, changed, before;
    (void)state;
    for (uint32_t i = 0; i < 40; i++) {
        draw(&sealed, MESSAGES + i * 23);
        assert_int_equal(seal(mk_aead_monocypher, &sealed), 1);
        const struct {
            ptrdiff_t offset;
            size_t size;
        } part[] = {{sealed.nonce - (uint8_t *)&sealed, NONCE},
                    {sealed.key - (uint8_t *)&sealed, KEY},
                    {sealed.tag - (uint8_t *)&sealed, TAG},
                    {sealed.header - (uint8_t *)&sealed, sealed.header_length},
                    {sealed.text - (uint8_t *)&sealed, sealed.length}};
        for (size_t p = 0; p < sizeof part / sizeof part[0]; p++)
            for (size_t bit = 0; bit < 8 * part[p].size; bit++) {
                copy(&changed, &sealed);
                ((uint8_t *)&changed)[(size_t)part[p].offset + bit / 8] ^= (uint8_t)(1u << bit % 8);
                copy(&before, &changed);
                assert_int_equal(open(mk_aead_monocypher, &changed), 0);
                assert_same(&changed, &before);
                assert_int_equal(open(sodium, &changed), 0);
            }
        assert_int_equal(open(mk_aead_monocypher, &sealed), 1);
    }
}

/* A byte that moves from the header to the text, or a zero that is added to either, is another message. */
static void test_lengths_are_authenticated(void **state) {
    message_t m;
    (void)state;
    draw(&m, 100);
    memset(m.header_room, 0, sizeof m.header_room);
    m.header_length = 20;
    assert_int_equal(seal(mk_aead_monocypher, &m), 1);
    for (size_t k = 0; k < 64; k++) {
        if (k == 20) continue;
        m.header_length = k;
        assert_int_equal(open(mk_aead_monocypher, &m), 0);
    }
    m.header_length = 20;
    for (size_t k = 0; k < 116; k++) {
        if (k == 100) continue;
        m.length = k;
        assert_int_equal(open(mk_aead_monocypher, &m), 0);
    }
    m.length = 100;
    assert_int_equal(open(mk_aead_monocypher, &m), 1);
}

static void test_nothing_to_encrypt_or_to_authenticate(void **state) {
    static const uint8_t key[KEY] = {1}, nonce[NONCE] = {2};
    uint8_t tag[TAG], reference[TAG], none[1]; /* libsodium must not be given null */
    mk_aead_t aead, other;
    (void)state;
    mk_aead_monocypher(&aead, key);
    assert_int_equal(aead.seal(aead.context, nonce, NULL, 0, NULL, 0, tag), 1);
    sodium(&other, key);
    assert_int_equal(other.seal(other.context, nonce, none, 0, none, 0, reference), 1);
    assert_memory_equal(tag, reference, TAG);
    assert_int_equal(aead.open(aead.context, nonce, NULL, 0, NULL, 0, tag), 1);
    tag[15] ^= 0x80;
    assert_int_equal(aead.open(aead.context, nonce, NULL, 0, NULL, 0, tag), 0);
}

static void test_frames(void **state) {
    uint8_t key[KEY] = {7, 8, 9}, bytes[64], text[16];
    mk_aead_t aead;
    mk_frame_t frame, found;
    mk_replay_t window = {0, 0};
    (void)state;
    sodium(&aead, key);
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
    for (int i = 0; i < KEY; i++) assert_int_equal(key[i], 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_example_of_the_rfc), cmocka_unit_test(test_random_messages),
                                       cmocka_unit_test(test_any_changed_bit_is_refused), cmocka_unit_test(test_lengths_are_authenticated),
                                       cmocka_unit_test(test_nothing_to_encrypt_or_to_authenticate), cmocka_unit_test(test_frames)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
