/* SPDX-License-Identifier: MIT */
/* The image: every number of every vector, in both passes, against the host's bits. Ends at the first
   difference and names it. Command line: NAME FILE, the file that vectors_write made: it is larger than the smallest target's flash. */
#include "vectors.h"

#include <string.h>

#include "semihost.h"

static const char *pass, *vector;
static int dimensions[4];
static int file;
static uint32_t expected[64], have, at, vectors, words;

void vector_begin(const char *name, int n, int m, int slots, int number) {
    vectors++;
    vector = name;
    dimensions[0] = number;
    dimensions[1] = n;
    dimensions[2] = m;
    dimensions[3] = slots;
}

static void differ(const char *what, int element, uint64_t got, uint64_t wanted, int digits) __attribute__((noreturn));
static void differ(const char *what, int element, uint64_t got, uint64_t wanted, int digits) {
    static const char *const name[4] = {" ", ", n = ", ", m = ", ", slots = "};
    mk_write("differs: ");
    mk_write(pass);
    mk_write(", vector ");
    mk_write(vector);
    for (int i = 0; i < 4; i++) {
        mk_write(name[i]);
        mk_write_number((uint32_t)dimensions[i]);
    }
    mk_write(": ");
    mk_write(what);
    mk_write(", element ");
    mk_write_number((uint32_t)element);
    mk_write(": got 0x");
    mk_write_hex(got, digits);
    mk_write(", wanted 0x");
    mk_write_hex(wanted, digits);
    mk_write("\n");
    mk_exit(1);
}

static void fail(const char *why) __attribute__((noreturn));
static void fail(const char *why) {
    mk_write(why);
    mk_write("\n");
    mk_exit(1);
}

/* 1, or 0 at the end of the file. */
static int more(void) {
    if (at < have) return 1;
    have = mk_file_read(file, expected, sizeof expected) / sizeof expected[0];
    at = 0;
    return have > 0;
}

static uint32_t next(void) {
    if (!more()) fail("differs: the host told less");
    words++;
    return expected[at++];
}

void vector_word(const char *what, uint32_t value) {
    const uint32_t wanted = next();
    if (value != wanted) differ(what, 0, value, wanted, 8);
}

void vector_numbers(const char *what, int count, const MK_REAL *values) {
    for (int i = 0; i < count; i++) {
#if MK_BITS == 32
        uint32_t got;
        const uint32_t wanted = next();
#else
        uint64_t got;
        const uint64_t high = next(), wanted = high << 32 | next();
#endif
        memcpy(&got, &values[i], sizeof got);
        if (got != wanted) differ(what, i, got, wanted, MK_BITS / 4);
    }
}

void vector_must(const char *what, int good) {
    if (!good) fail(what);
}

static void compare(const char *path, vectors_kernels_t chosen) {
    pass = vectors_passes[chosen];
    file = mk_file_open(path, MK_FILE_READ);
    if (file < 0) fail("no file of vectors");
    have = at = 0;
    vectors_run(chosen);
    if (more()) fail("differs: the host told more");
    (void)mk_file_close(file);
}

int main(void) {
    char line[200];
    const char *const path = mk_command_line(line, sizeof line) ? strchr(line, ' ') : NULL;
    if (!path) fail("usage: NAME FILE");
    compare(path + 1, VECTORS_SHARED);
    compare(path + 1, VECTORS_UNROLLED);
    mk_write_number(vectors);
    mk_write(" vectors, ");
    mk_write_number(words);
    mk_write(" words agree\n");
    return 0;
}
