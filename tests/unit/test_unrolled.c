/* SPDX-License-Identifier: MIT */
/* MK_RKFD and MK_RKFD_UNROLLED promise the same bits: both declared for the same dimensions, fed the same messages, compared as
   bytes after every call. This also runs the typed functions with several dimensions in one translation unit. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/unrolled.h>

#include "generator.h"

enum { STEPS = 60 };

static int frozen_steps;

/* The parts of two filters that a caller can see. The structs differ in type, not in layout; padding is set to zero by the test. */
#define SAME(a, b) assert_memory_equal(&(a), &(b), sizeof(a))

/* float from double is meant: the generator's numbers are floats. */
#define CONVERT(real, count, from, to)                                                                                         \
    do {                                                                                                                       \
        for (int index = 0; index < (count); index++) (to)[index] = (mk_##real##_t)(from)[index];                              \
    } while (0)

#define COMPARE(name, real, n, m, slots)                                                                                       \
    MK_RKFD(name##_shared, real, n, m, slots);                                                                                 \
    MK_RKFD_UNROLLED(name##_unrolled, real, n, m, slots);                                                                      \
    static void name(void **unused) {                                                                                          \
        (void)unused;                                                                                                          \
        generator_t g = {31};                                                                                                  \
        for (int trial = 0; trial < 6; trial++) {                                                                              \
            static name##_shared_t a;                                                                                          \
            static name##_unrolled_t b;                                                                                        \
            static model_t model;                                                                                              \
            static mk_##real##_t A[(n) * (n)], Q[MK_PACKED(n)], r[n], x0[n], P0[MK_PACKED(n)], weight[slots];                  \
            static mk_##real##_t C[(slots) * (m) * (n)], F[(slots) * (m) * (n)], S[(slots) * MK_PACKED(n)];                    \
            static mk_##real##_t R_inverse[(slots) * MK_PACKED(m)];                                                            \
            static uint8_t rows[slots];                                                                                        \
            mk_##real##_t R[MK_PACKED(m)], work[3 * MK_PACKED(m)], values[(n) + (m)], y[m] = {0};                              \
            double packed[MK_PACKED(LARGEST_N)];                                                                               \
            draw_model(&g, n, m, slots, 0.9, &model);                                                                          \
            /* The plain filter, the polynomial root at both ends of its range, and where it gives up. */                      \
            const double tolerances[] = {0.0, 0.02, 1e-9, 10.0, 1e-4, 1.0};                                                    \
            memset(&a, 0, sizeof a);                                                                                           \
            memset(&b, 0, sizeof b);                                                                                           \
            memset(C, 0, sizeof C);                                                                                            \
            CONVERT(real, (n) * (n), model.A, A);                                                                              \
            CONVERT(real, n, model.r, r);                                                                                      \
            CONVERT(real, n, model.x0, x0);                                                                                    \
            CONVERT(real, slots, model.weight, weight);                                                                        \
            pack(n, model.Q, packed);                                                                                          \
            CONVERT(real, MK_PACKED(n), packed, Q);                                                                            \
            pack(n, model.P0, packed);                                                                                         \
            CONVERT(real, MK_PACKED(n), packed, P0);                                                                           \
            for (int l = 0; l < (slots); l++) {                                                                                \
                rows[l] = (uint8_t)model.rows[l];                                                                              \
                CONVERT(real, rows[l] * (n), model.C[l], C + l * (m) * (n));                                                   \
                pack(rows[l], model.R[l], packed);                                                                             \
                CONVERT(real, MK_PACKED(rows[l]), packed, R);                                                                  \
                assert_int_equal(mk_rkfd_sensor_##real(n, m, rows[l], C + l * (m) * (n), R, F + l * (m) * (n),                 \
                                                       S + l * MK_PACKED(n), R_inverse + l * MK_PACKED(m), work),              \
                                 MK_OK);                                                                                       \
            }                                                                                                                  \
            mk_rkfd_config_##real##_t config = {n, m, slots, A, Q, r, x0, P0, weight, rows, C, F, S, R_inverse,                \
                                                      (mk_##real##_t)tolerances[trial], NULL};                                 \
            /* The limit of W; what the gain is does not matter here. */                                                       \
            static mk_##real##_t Phi[(n) * (n)], G[(slots) * (m) * (n)], limit[MK_PACKED(n)];                                  \
            const mk_rkfd_steady_##real##_t steady = {Phi, G, limit, 1, 2, (mk_##real##_t)1e-4, 5};                            \
            for (int i = 0; i < (n) * (n); i++) Phi[i] = (mk_##real##_t)(0.3 * draw_normal(&g));                               \
            for (int i = 0; i < (slots) * (m) * (n); i++) G[i] = (mk_##real##_t)draw_normal(&g);                               \
            assert_int_equal(name##_shared_start(&a, &config), MK_OK);                                                         \
            for (int step = 0; step < 4 * STEPS; step++) {                                                                     \
                for (int l = 0; l < (slots); l++) assert_int_equal(name##_shared_put_measurement(&a, l, y), MK_OK);            \
                if (name##_shared_incremental(&a, NULL) != MK_OK || name##_shared_diffuse(&a) != MK_OK) break;                 \
            }                                                                                                                  \
            memcpy(limit, a.W, sizeof limit);                                                                                  \
            if (trial % 3 < 2) config.steady = &steady;                                                                        \
            int frozen = 0;                                                                                                    \
            assert_int_equal(name##_shared_start(&a, &config), MK_OK);                                                         \
            assert_int_equal(name##_unrolled_start(&b, &config), MK_OK);                                                       \
            for (int step = 0; step < STEPS; step++) {                                                                         \
                for (int l = 0; l < (slots); l++) {                                                                            \
                    const int quiet = step % 20 >= 5; /* all readings, so that a gain can be frozen */                         \
                    if (!quiet && draw_chance(&g, 0.3)) continue;                                                              \
                    for (int i = 0; i < (m); i++) values[i] = (mk_##real##_t)(3.0 * draw_normal(&g));                          \
                    const int innovation = !quiet && draw_chance(&g, 0.2);                                                               \
                    assert_int_equal(innovation ? name##_shared_put_innovation(&a, l, values)                                  \
                                                : name##_shared_put_measurement(&a, l, values),                                \
                                     MK_OK);                                                                                   \
                    assert_int_equal(innovation ? name##_unrolled_put_innovation(&b, l, values)                                \
                                                : name##_unrolled_put_measurement(&b, l, values),                              \
                                     MK_OK);                                                                                   \
                }                                                                                                              \
                for (int i = 0; i < (n); i++) values[i] = (mk_##real##_t)draw_normal(&g);                                      \
                const mk_##real##_t *const input = draw_chance(&g, 0.5) ? values : NULL;                                       \
                const mk_status_t status = name##_shared_incremental(&a, input);                                               \
                assert_int_equal(name##_unrolled_incremental(&b, input), status);                                              \
                SAME(a, b);                                                                                                    \
                frozen += a.core.frozen;                                                                                       \
                /* With c = 10 the variance may leave the precision: both must say so at the same step. */                     \
                if (status != MK_OK) break;                                                                                    \
                for (int l = 1; l < (slots); l++) {                                                                            \
                    if (draw_chance(&g, 0.3)) continue;                                                                        \
                    for (int i = 0; i < (n); i++) values[i] = (mk_##real##_t)(3.0 * draw_normal(&g));                          \
                    assert_int_equal(name##_shared_put_estimate(&a, l, values), MK_OK);                                        \
                    assert_int_equal(name##_unrolled_put_estimate(&b, l, values), MK_OK);                                      \
                }                                                                                                              \
                assert_int_equal(name##_shared_diffuse(&a), MK_OK);                                                            \
                assert_int_equal(name##_unrolled_diffuse(&b), MK_OK);                                                          \
                SAME(a, b);                                                                                                    \
            }                                                                                                                  \
            frozen_steps += frozen;                                                                                            \
            assert_true(frozen == 0 || config.steady);                                                                         \
        }                                                                                                                      \
    }

COMPARE(f32_n1, f32, 1, 1, 1)
COMPARE(f32_n2, f32, 2, 1, 3)
COMPARE(f32_n3, f32, 3, 2, 2)
COMPARE(f32_n4, f32, 4, 3, 3)
COMPARE(f32_n5, f32, 5, 1, 2)
COMPARE(f32_n6, f32, 6, 2, 5)
COMPARE(f32_n9, f32, 9, 3, 4)
COMPARE(f64_n1, f64, 1, 1, 2)
COMPARE(f64_n2, f64, 2, 2, 1)
COMPARE(f64_n3, f64, 3, 1, 4)
COMPARE(f64_n4, f64, 4, 2, 2)
COMPARE(f64_n5, f64, 5, 3, 3)
COMPARE(f64_n6, f64, 6, 2, 5)
COMPARE(f64_n9, f64, 9, 3, 4)

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(f32_n1), cmocka_unit_test(f32_n2), cmocka_unit_test(f32_n3), cmocka_unit_test(f32_n4),
        cmocka_unit_test(f32_n5), cmocka_unit_test(f32_n6), cmocka_unit_test(f32_n9), cmocka_unit_test(f64_n1),
        cmocka_unit_test(f64_n2), cmocka_unit_test(f64_n3), cmocka_unit_test(f64_n4), cmocka_unit_test(f64_n5),
        cmocka_unit_test(f64_n6), cmocka_unit_test(f64_n9),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    print_message("- %d steps with a frozen gain\n", frozen_steps);
    return failed || frozen_steps < 1000;
}
