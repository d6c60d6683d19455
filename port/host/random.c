/* SPDX-License-Identifier: MIT */
#include "random.h"

#include <meshkal/kernels.h>

void mk_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t block[4]) {
    uint32_t c[4] = {counter[0], counter[1], counter[2], counter[3]}, k[2] = {key[0], key[1]};
    for (int round = 0; round < 10; round++) {
        const uint64_t p = UINT64_C(0xd2511f53) * c[0], q = UINT64_C(0xcd9e8d57) * c[2];
        const uint32_t high_p = (uint32_t)(p >> 32), high_q = (uint32_t)(q >> 32);
        c[0] = high_q ^ c[1] ^ k[0];
        c[1] = (uint32_t)q;
        c[2] = high_p ^ c[3] ^ k[1];
        c[3] = (uint32_t)p;
        k[0] += 0x9e3779b9u;
        k[1] += 0xbb67ae85u;
    }
    memcpy(block, c, sizeof c);
}

void mk_random_start(mk_random_t *random, uint64_t seed, uint32_t run, uint32_t owner, uint32_t step, int purpose) {
    memset(random, 0, sizeof *random);
    random->key[0] = (uint32_t)seed;
    random->key[1] = (uint32_t)(seed >> 32);
    /* Word 0 counts blocks within the stream; its top bits hold the purpose, far above any count. */
    random->counter[0] = (uint32_t)purpose << 28;
    random->counter[1] = step;
    random->counter[2] = owner;
    random->counter[3] = run;
    random->used = 4;
}

static uint32_t next_word(mk_random_t *random) {
    if (random->used == 4) {
        mk_philox(random->counter, random->key, random->block);
        random->counter[0]++;
        random->used = 0;
    }
    return random->block[random->used++];
}

double mk_random_uniform(mk_random_t *random) {
    const uint64_t high = next_word(random) >> 5, low = next_word(random) >> 6;
    return (double)((high << 26) | low) * 0x1p-53;
}

double mk_random_normal(mk_random_t *random) {
    if (random->has_spare) {
        random->has_spare = 0;
        return random->spare;
    }
    double u, v, square;
    do {
        u = 2.0 * mk_random_uniform(random) - 1.0;
        v = 2.0 * mk_random_uniform(random) - 1.0;
        square = u * u + v * v;
    } while (square >= 1.0 || square <= 0.0);
    const double factor = mk_sqrt_f64(-2.0 * mk_log_f64(square) / square);
    random->spare = v * factor;
    random->has_spare = 1;
    return u * factor;
}
