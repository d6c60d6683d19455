/* SPDX-License-Identifier: MIT */
/* The yardstick: scalar multiplications and additions that do not wait for each other. Compiled without vectorisation. */
#include "bench.h"

/* Six chains each hide a latency of three cycles in two pipes; all together fit the sixteen registers of plain x86-64. */
#define PEAK(real)                                                                    \
    static double peak_##real(int count) {                                            \
        static volatile real sink, one = (real)1;                                     \
        const real f = one, d = one * (real)0x1p-20;                                  \
        real a0 = f, a1 = f, a2 = f, a3 = f, a4 = f, a5 = f;                          \
        real b0 = f, b1 = f, b2 = f, b3 = f, b4 = f, b5 = f;                          \
        const int rounds = count / 48;                                                \
        for (int i = 0; i < rounds; i++) {                                            \
            a0 *= f, b0 += d, a1 *= f, b1 += d, a2 *= f, b2 += d;                     \
            a3 *= f, b3 += d, a4 *= f, b4 += d, a5 *= f, b5 += d;                     \
            a0 *= f, b0 += d, a1 *= f, b1 += d, a2 *= f, b2 += d;                     \
            a3 *= f, b3 += d, a4 *= f, b4 += d, a5 *= f, b5 += d;                     \
            a0 *= f, b0 += d, a1 *= f, b1 += d, a2 *= f, b2 += d;                     \
            a3 *= f, b3 += d, a4 *= f, b4 += d, a5 *= f, b5 += d;                     \
            a0 *= f, b0 += d, a1 *= f, b1 += d, a2 *= f, b2 += d;                     \
            a3 *= f, b3 += d, a4 *= f, b4 += d, a5 *= f, b5 += d;                     \
        }                                                                             \
        sink = ((a0 + a1) + (a2 + a3)) + ((a4 + a5) + (b0 + b1)) + ((b2 + b3) + (b4 + b5)); \
        (void)sink;                                                                   \
        return 48.0 * rounds;                                                         \
    }

PEAK(float)
PEAK(double)

double bench_peak(int bits, int count) { return bits == 32 ? peak_float(count) : peak_double(count); }
