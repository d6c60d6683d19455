/* SPDX-License-Identifier: MIT */
/* On the host: runs the vectors in the first pass and writes what they told, 32-bit words in the order of this machine, the higher one of a double
   first; then in the second one, which must tell the same. Usage: NAME_write-32 > FILE */
#include "vectors.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int writing = 1;
static char vector[96];
static uint32_t kept[1 << 18];
static size_t count, at;

void vector_begin(const char *name, int n, int m, int slots, int number) {
    (void)snprintf(vector, sizeof vector, "%s %d, n = %d, m = %d, %d slots", name, number, n, m, slots);
}

void vector_word(const char *what, uint32_t value) {
    if (writing && count < sizeof kept / sizeof kept[0]) {
        kept[count++] = value;
    } else if (writing || at == count || kept[at++] != value) {
        (void)fprintf(stderr, "vectors_write: %s, %s: %s%s\n", vector, what, writing ? "more words than there is room for" : vectors_passes[1],
                      writing ? "" : " differ");
        exit(1);
    }
}

void vector_numbers(const char *what, int numbers, const MK_REAL *values) {
    for (int i = 0; i < numbers; i++) {
#if MK_BITS == 32
        uint32_t word;
        memcpy(&word, &values[i], sizeof word);
        vector_word(what, word);
#else
        uint64_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        vector_word(what, (uint32_t)(bits >> 32));
        vector_word(what, (uint32_t)bits);
#endif
    }
}

void vector_must(const char *what, int good) {
    if (good) return;
    (void)fprintf(stderr, "vectors_write: %s: these vectors never come to this: %s\n", vector, what);
    exit(1);
}

int main(void) {
    vectors_run(VECTORS_SHARED);
    writing = 0;
    vectors_run(VECTORS_UNROLLED);
    return fwrite(kept, sizeof kept[0], count, stdout) != count || fflush(stdout) ? 1 : 0;
}
