/* SPDX-License-Identifier: MIT */
/* Random numbers by counter (Philox4x32-10; Salmon et al. 2011): a stream belongs to (seed, run, owner, step, purpose), so a draw does
   not depend on which thread made it or on what was drawn before. Same bits on every IEEE machine. */
#ifndef MESHKAL_HOST_RANDOM_H
#define MESHKAL_HOST_RANDOM_H

#include <stdint.h>

typedef struct {
    uint32_t key[2], counter[4], block[4];
    int used;
    int has_spare;
    double spare;
} mk_random_t;

enum { MK_DRAW_INITIAL, MK_DRAW_PROCESS, MK_DRAW_MEASUREMENT, MK_DRAW_LOSS, MK_DRAW_NETWORK, MK_DRAW_ADVERSARY,
       MK_DRAW_FAULT, MK_DRAW_READING, MK_DRAW_STEP, /* a fault and the loss of one reading; the loss of all readings of a step */
       MK_DRAW_INERTIAL };

/* Starts a stream. owner: node number, or 0. */
void mk_random_start(mk_random_t *random, uint64_t seed, uint32_t run, uint32_t owner, uint32_t step, int purpose);
/* Uniform in [0, 1), 53 bits. */
double mk_random_uniform(mk_random_t *random);
/* Standard normal, by Marsaglia's polar method on the library's own logarithm. */
double mk_random_normal(mk_random_t *random);
/* One block of the generator, for tests against its published vectors. */
void mk_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t block[4]);

#endif
