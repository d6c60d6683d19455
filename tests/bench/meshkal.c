/* SPDX-License-Identifier: MIT */
/* Meshkal behind the interface of the benchmark: unrolled for each n, and the shared build. */
#include <meshkal/unrolled.h>

#include "bench.h"

/* A filter with its configuration and the interface functions. All inputs go through put_measurement and put_estimate, with
   their checks, as on a node. */
#define ENGINE(name, real, type, member, states, declare)                                                                    \
    declare(name, real, states, BENCH_M, BENCH_SLOTS);                                                                       \
    static name##_t name##_filter;                                                                                           \
    static name##_config_t name##_config;                                                                                    \
    static unsigned name##_turn;                                                                                             \
    static int name##_engine_start(const bench_case *c) {                                                                    \
        static const uint8_t rows[BENCH_SLOTS] = {BENCH_M, BENCH_M, BENCH_M, BENCH_M, BENCH_M};                              \
        const bench_data_##type *const d = &c->member;                                                                       \
        const name##_config_t config = {states, BENCH_M, BENCH_SLOTS, d->A, d->Q, 0, d->x0, d->P0, d->weight,                \
                                        rows, d->C, d->F, d->S, d->R_inverse, d->tolerance[0]};                              \
        name##_config = config;                                                                                              \
        name##_turn = 0;                                                                                                     \
        return name##_start(&name##_filter, &name##_config) == MK_OK;                                                        \
    }                                                                                                                        \
    static int name##_engine_run(const bench_case *c, int steps) {                                                           \
        const bench_data_##type *const d = &c->member;                                                                       \
        int bad = 0;                                                                                                        \
        for (int t = 0; t < steps; t++) {                                                                                    \
            const unsigned turn = name##_turn++ % BENCH_MESSAGES;                                                            \
            for (int l = 0; l < BENCH_SLOTS; l++) bad |= (int)name##_put_measurement(&name##_filter, l, d->y[turn][l]);           \
            bad |= (int)name##_incremental(&name##_filter, 0);                                                                    \
            for (int l = 1; l < BENCH_SLOTS; l++) bad |= (int)name##_put_estimate(&name##_filter, l, d->psi[turn][l]);            \
            bad |= (int)name##_diffuse(&name##_filter);                                                                           \
        }                                                                                                                    \
        return bad == 0;                                                                                                     \
    }                                                                                                                        \
    static void name##_engine_read(double *theta, double *x) {                                                               \
        *theta = (double)name##_filter.core.theta;                                                                           \
        for (int i = 0; i < (states); i++) x[i] = (double)name##_filter.x[i];                                                \
    }

#define ENGINES(states)                                                                \
    ENGINE(unrolled_##states##_f32, f32, float, f, states, MK_RKFD_UNROLLED)           \
    ENGINE(unrolled_##states##_f64, f64, double, d, states, MK_RKFD_UNROLLED)          \
    ENGINE(shared_##states##_f32, f32, float, f, states, MK_RKFD)                      \
    ENGINE(shared_##states##_f64, f64, double, d, states, MK_RKFD)

ENGINES(4)
ENGINES(6)
ENGINES(9)
ENGINES(17)

#define ROW(title, name, states, bits) {title, states, bits, name##_engine_start, name##_engine_run, name##_engine_read}
#define ROWS(states)                                                                                     \
    ROW("Meshkal", unrolled_##states##_f32, states, 32), ROW("Meshkal", unrolled_##states##_f64, states, 64), \
        ROW("Meshkal shared", shared_##states##_f32, states, 32), ROW("Meshkal shared", shared_##states##_f64, states, 64)

const bench_engine *bench_meshkal(int *count) {
    static const bench_engine engines[] = {ROWS(4), ROWS(6), ROWS(9), ROWS(17)};
    *count = (int)(sizeof engines / sizeof *engines);
    return engines;
}

#define EVALUATIONS(states) \
    if (n == (states)) return bits == 32 ? unrolled_##states##_f32_filter.core.iterations : unrolled_##states##_f64_filter.core.iterations;

int bench_meshkal_evaluations(int n, int bits) {
    EVALUATIONS(4)
    EVALUATIONS(6)
    EVALUATIONS(9)
    EVALUATIONS(17)
    return 0;
}
