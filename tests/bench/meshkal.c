/* SPDX-License-Identifier: MIT */
/* Meshkal behind the interface of the benchmark: unrolled for each n, and the shared build. */
#include <meshkal/unrolled.h>

#include "bench.h"

#include <string.h>

/* A filter with its configuration and the interface functions. CHECKED: every input goes through put_measurement and put_estimate,
   with their checks for numbers that are not finite and repetitions, as on a node. IN_PLACE: copied to where these functions
   leave it, which is what the other libraries are given. */
#define CHECKED(name, d, turn) \
    for (int l = 0; l < BENCH_SLOTS; l++) bad |= (int)name##_put_measurement(&name##_filter, l, (d)->y[turn][l]);
#define CHECKED_ESTIMATES(name, d, turn, states) \
    for (int l = 1; l < BENCH_SLOTS; l++) bad |= (int)name##_put_estimate(&name##_filter, l, (d)->psi[turn][l]);
#define IN_PLACE(name, d, turn)                                          \
    memcpy(name##_filter.y, (d)->y[turn], sizeof name##_filter.y);       \
    memset(name##_filter.have_y, 1, BENCH_SLOTS);
#define IN_PLACE_ESTIMATES(name, d, turn, states)                                                                       \
    for (int l = 1; l < BENCH_SLOTS; l++) {                                                                             \
        memcpy(name##_filter.psi + l * (states), (d)->psi[turn][l], (states) * sizeof *name##_filter.psi);              \
        name##_filter.have_psi[l] = 1;                                                                                  \
    }

#define ENGINE(name, real, type, member, states, declare, inputs)                                                            \
    declare(name, real, states, BENCH_M, BENCH_SLOTS);                                                                       \
    static name##_t name##_filter;                                                                                           \
    static name##_config_t name##_config;                                                                                    \
    static unsigned name##_turn;                                                                                             \
    static int name##_engine_start(const bench_case *c) {                                                                    \
        static const uint8_t rows[BENCH_SLOTS] = {BENCH_M, BENCH_M, BENCH_M, BENCH_M, BENCH_M};                              \
        const bench_data_##type *const d = &c->member;                                                                       \
        const name##_config_t config = {states, BENCH_M, BENCH_SLOTS, d->A, d->Q, 0, d->x0, d->P0, d->weight,                \
                                        rows, d->C, d->F, d->S, d->R_inverse, d->tolerance[0], NULL};                        \
        name##_config = config;                                                                                              \
        name##_turn = 0;                                                                                                     \
        return name##_start(&name##_filter, &name##_config) == MK_OK;                                                        \
    }                                                                                                                        \
    static int name##_engine_run(const bench_case *c, int steps) {                                                           \
        const bench_data_##type *const d = &c->member;                                                                       \
        int bad = 0;                                                                                                        \
        for (int t = 0; t < steps; t++) {                                                                                    \
            const unsigned turn = name##_turn++ % BENCH_MESSAGES;                                                            \
            inputs(name, d, turn)                                                                                            \
            bad |= (int)name##_incremental(&name##_filter, 0);                                                                    \
            inputs##_ESTIMATES(name, d, turn, states)                                                                        \
            bad |= (int)name##_diffuse(&name##_filter);                                                                           \
        }                                                                                                                    \
        return bad == 0;                                                                                                     \
    }                                                                                                                        \
    static void name##_engine_read(double *theta, double *x) {                                                               \
        *theta = (double)name##_filter.core.theta;                                                                           \
        for (int i = 0; i < (states); i++) x[i] = (double)name##_filter.x[i];                                                \
    }

#define ENGINES(states)                                                                \
    ENGINE(unrolled_##states##_f32, f32, float, f, states, MK_RKFD_UNROLLED, IN_PLACE)           \
    ENGINE(unrolled_##states##_f64, f64, double, d, states, MK_RKFD_UNROLLED, IN_PLACE)          \
    ENGINE(checked_##states##_f32, f32, float, f, states, MK_RKFD_UNROLLED, CHECKED)             \
    ENGINE(checked_##states##_f64, f64, double, d, states, MK_RKFD_UNROLLED, CHECKED)            \
    ENGINE(shared_##states##_f32, f32, float, f, states, MK_RKFD, IN_PLACE)                      \
    ENGINE(shared_##states##_f64, f64, double, d, states, MK_RKFD, IN_PLACE)

ENGINES(4)
ENGINES(6)
ENGINES(9)
ENGINES(17)

#define ROW(title, name, states, bits) {title, states, bits, name##_engine_start, name##_engine_run, name##_engine_read}
#define ROWS(states)                                                                                     \
    ROW("Meshkal", unrolled_##states##_f32, states, 32), ROW("Meshkal", unrolled_##states##_f64, states, 64), \
        ROW("Meshkal, inputs checked", checked_##states##_f32, states, 32),                                  \
        ROW("Meshkal, inputs checked", checked_##states##_f64, states, 64),                                  \
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
