/* SPDX-License-Identifier: MIT */
#include "vectors.h"

static uint64_t state;

/* splitmix64, upper half */
static uint32_t draw_bits(void) {
    uint64_t z = state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (uint32_t)((z ^ (z >> 31)) >> 32);
}

void draw_seed(uint64_t seed) { state = seed; }

int draw_below(int count) { return (int)((draw_bits() >> 8) % (uint32_t)count); }

MK_REAL draw(void) {
    MK_REAL value = (MK_REAL)(draw_bits() >> 8) * MK_R(0x1p-23) - MK_R(1.0);
#if MK_BITS == 64
    value += (MK_REAL)(draw_bits() >> 8) * 0x1p-47;
#endif
    return value;
}

void draw_many(int count, MK_REAL size, MK_REAL *values) {
    for (int i = 0; i < count; i++) values[i] = size * draw();
}

MK_REAL power(int exponent) {
    MK_REAL value = MK_R(1.0);
    for (int i = 0; i < exponent; i++) value *= MK_R(2.0);
    for (int i = 0; i > exponent; i--) value *= MK_R(0.5);
    return value;
}

void draw_covariance(int n, int spread, MK_REAL size, MK_REAL *P) {
    MK_REAL L[MK_PACKED(VECTOR_STATES)];
    for (int i = 0; i < n; i++) {
        const MK_REAL row = power(-draw_below(spread + 1));
        for (int j = 0; j < i; j++) L[MK_AT(i, j)] = MK_R(0.5) * draw() * row;
        L[MK_AT(i, i)] = (MK_R(1.5) + MK_R(0.5) * draw()) * row;
    }
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int k = 0; k <= j; k++) sum += L[MK_AT(i, k)] * L[MK_AT(j, k)];
            P[MK_AT(i, j)] = size * sum;
        }
    }
}
