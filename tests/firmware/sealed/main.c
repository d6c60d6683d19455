/* SPDX-License-Identifier: MIT */
/* Node 0 of sealed.h on the target. Command line: NAME FILE. Writes the stack that sealing and opening need, and how much agreed.
   size.py counts instructions between the markers. */
#include "sealed.h"

#include <string.h>

#include <monocypher.h>

#include "aead_monocypher.h"
#include "semihost.h"
#include "stack.h"

#define MARKER(name) \
    void name(void); \
    __attribute__((noinline)) void name(void) { __asm__ volatile("" : : "i"(#name)); }
MARKER(sealed_begin_nothing)
MARKER(sealed_begin_seal)
MARKER(sealed_begin_open)
MARKER(sealed_begin_forged)
MARKER(sealed_end)

static mk_aead_t aead;
static int file;
static const char *part = "messages";
static uint32_t number;

static void check(int good, const char *what) {
    if (good) return;
    mk_write(part);
    mk_write(" ");
    mk_write_number(number);
    mk_write(": ");
    mk_write(what);
    mk_write("\n");
    mk_exit(1);
}

static void get(void *bytes, uint32_t length) { check(mk_file_read(file, bytes, length) == length, "the file ends here"); }

static uint32_t get_length(uint32_t most) {
    uint8_t bytes[2];
    get(bytes, sizeof bytes);
    const uint32_t length = bytes[0] + bytes[1] * 256u;
    check(length <= most, "length in the file");
    return length;
}

/* --- messages -------------------------------------------------------------------------------------------------------------- */

static void messages(void) {
    static uint8_t nonce[12], header[SEALED_HEADER], text[SEALED_TEXT], plain[SEALED_TEXT], sealed[SEALED_TEXT], altered[SEALED_TEXT];
    uint8_t tag[MK_FRAME_TAG], wanted[MK_FRAME_TAG];
    for (number = 0; number < SEALED_MESSAGES; number++) {
        const uint32_t header_length = get_length(SEALED_HEADER), length = get_length(SEALED_TEXT);
        get(nonce, sizeof nonce);
        get(header, header_length);
        get(plain, length);
        get(sealed, length);
        get(wanted, sizeof wanted);
        memcpy(text, plain, length);
        check(aead.seal(aead.context, nonce, header, header_length, text, length, tag), "cannot be sealed");
        check(memcmp(text, sealed, length) == 0, "encrypted text differs");
        check(memcmp(tag, wanted, sizeof tag) == 0, "tag differs");
        check(aead.open(aead.context, nonce, header, header_length, text, length, wanted), "cannot be opened");
        check(memcmp(text, plain, length) == 0, "decrypted text differs");
        for (int where = 0; where < 4; where++) {
            const uint32_t size = where == 0 ? sizeof nonce : where == 1 ? header_length : where == 2 ? length : sizeof tag;
            uint8_t *const bytes = where == 0 ? nonce : where == 1 ? header : where == 2 ? altered : tag;
            if (size == 0) continue;
            memcpy(altered, sealed, length);
            bytes[number % size] ^= (uint8_t)(1u << number % 8);
            memcpy(text, altered, length);
            check(!aead.open(aead.context, nonce, header, header_length, text, length, tag), "opened with one bit changed");
            check(memcmp(text, altered, length) == 0, "text of a forged message is not as it was");
            bytes[number % size] ^= (uint8_t)(1u << number % 8);
        }
    }
}

/* --- what sealing leaves on the stack, and what it costs --------------------------------------------------------------------- */

/* Payload of 40 bytes: ten float32. */
enum { PAYLOAD = 40 };
static uint32_t secret[8 + 16 + 8]; /* the key; of one message only: the key stream, the key of Poly1305 */

/* Single words are registers that the compiler saved. */
static void look_for_secrets(void) {
    uint32_t kept = 0;
    const uint32_t *const end = mk_stack_top - mk_stack_depth() / 4;
    for (const volatile uint32_t *word = mk_stack_bottom; word < end; word++)
        for (uint32_t i = 0; i < sizeof secret / sizeof secret[0]; i++) {
            if (*word != secret[i]) continue;
            check(i >= 8, "the key is left on the stack");
            kept++;
        }
    check(kept <= 2, "much of the key stream or of Poly1305's key is left on the stack");
}

static uint32_t run(void (*begin)(void), int opens, uint8_t text[PAYLOAD], uint8_t tag[MK_FRAME_TAG]) {
    static const uint8_t header[MK_FRAME_HEADER + MK_FRAME_SEQUENCE] = {1}, nonce[12] = {7};
    int good;
    mk_stack_paint();
    const uint32_t before = mk_stack_depth();
    begin();
    if (opens) good = aead.open(aead.context, nonce, header, sizeof header, text, PAYLOAD, tag);
    else good = aead.seal(aead.context, nonce, header, sizeof header, text, PAYLOAD, tag);
    sealed_end();
    const uint32_t used = mk_stack_used() - before;
    check(good == (begin != sealed_begin_forged), "result");
    look_for_secrets();
    return used;
}

static void costs(void) {
    static uint8_t text[PAYLOAD], tag[MK_FRAME_TAG], stream[2 * 64];
    static const uint8_t nonce[12] = {7};
    part = "costs";
    (void)crypto_chacha20_ietf(stream, 0, sizeof stream, sealed_key, nonce, 0);
    memcpy(secret, sealed_key, 32);
    memcpy(secret + 8, stream + 64, 64);
    memcpy(secret + 24, stream, 32);
    sealed_begin_nothing();
    sealed_end();
    memset(text, 0, sizeof text);
    const uint32_t seal = run(sealed_begin_seal, 0, text, tag);
    check(memcmp(text, stream + 64, sizeof text) == 0, "the key stream is another");
    tag[3] ^= 4;
    (void)run(sealed_begin_forged, 1, text, tag);
    tag[3] ^= 4;
    const uint32_t open = run(sealed_begin_open, 1, text, tag);
    mk_write("stack ");
    mk_write_number(seal);
    mk_write(" ");
    mk_write_number(open);
    mk_write("\n");
}

/* --- frames ---------------------------------------------------------------------------------------------------------------- */

static node00_t node, before;
static node00_secure_t secure;

/* What a refused frame may not change: the filter. */
static void refused(uint8_t *bytes, uint32_t length) {
    const uint32_t bit = (number * 37u + 11u) % (8 * length);
    before = node;
    bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    check(node00_accept(&node, bytes, length) != MK_OK, "a frame with one bit changed was taken");
    bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    check(node00_accept(&node, bytes, length - 1) != MK_OK, "a frame without its last byte was taken");
    check(memcmp(&before.filter, &node.filter, sizeof node.filter) == 0, "a refused frame changed the filter");
}

static void exchange(int stage) {
    static uint8_t bytes[SEALED_FRAME], wanted[SEALED_FRAME];
    uint32_t length = get_length(SEALED_FRAME);
    get(bytes, length);
    refused(bytes, length);
    const mk_status_t status = node00_accept(&node, bytes, length);
    check(status == MK_OK, mk_status_name(status));
    check(node00_accept(&node, bytes, length) == MK_ERROR_REPLAYED, "a frame was taken twice");
    length = get_length(SEALED_FRAME);
    get(wanted, length);
    check(node00_frame(&node, stage, bytes) == length && memcmp(bytes, wanted, length) == 0, "frame differs");
}

static void frames(void) {
    part = "frames of step";
    check(node00_start(&node, &node00_config) == MK_OK && node00_secure(&node, &secure, &aead, sealed_sequence) == MK_OK, "start");
    for (number = 0; number < SEALED_STEPS; number++) {
        mk_f32_t y[2];
        sealed_reading(0, number, y);
        check(node00_measure(&node, y) == MK_OK, "measure");
        exchange(MK_STAGE_MEASUREMENT);
        check(node00_incremental(&node) == MK_OK, "incremental");
        exchange(MK_STAGE_ESTIMATE);
        check(node00_diffuse(&node) == MK_OK, "diffuse");
    }
    check(node.node.counts[MK_OK] == 2 * SEALED_STEPS && node.node.counts[MK_ERROR_REPLAYED] == 2 * SEALED_STEPS, "counters");
    check(node.node.counts[MK_ERROR_FORGED] > 2 * SEALED_STEPS, "changed frames were not found by their seal");
}

int main(void) {
    char line[160];
    const char *path;
    check(mk_command_line(line, sizeof line) && (path = strchr(line, ' ')) != 0, "no file on the command line");
    file = mk_file_open(path + 1, MK_FILE_READ);
    check(file >= 0, "the file cannot be opened");
    mk_aead_monocypher(&aead, sealed_key);
    messages();
    costs();
    frames();
    uint8_t more;
    check(mk_file_read(file, &more, 1) == 0, "the file has more");
    mk_write_number(SEALED_MESSAGES);
    mk_write(" messages and ");
    mk_write_number(4 * SEALED_STEPS);
    mk_write(" frames agree\n");
    return 0;
}
