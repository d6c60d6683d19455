/* SPDX-License-Identifier: MIT */
/* Stands for a user's program, in C and in C++: a shared float64 and an unrolled float32 filter, 50 steps with lost messages, every
   estimate with all its bits. However Meshkal came to this program, it prints the same. */
#ifdef CONSUMER_ONE_HEADER
#include "meshkal.h"
#else
#include <meshkal/unrolled.h>
#endif

#include <stdio.h>

/* A target without a console keeps the estimates where a linker cannot drop them. */
#ifdef CONSUMER_SILENT
static volatile double kept;
#define SHOW(label, t, a, b) (kept = (double)(a) + (double)(b))
#else
#define SHOW(label, t, a, b) printf(label " %d %a %a\n", (t), (double)(a), (double)(b))
#endif

MK_RKFD(shared, f64, 2, 1, 2);
MK_RKFD_UNROLLED(unrolled, f32, 2, 1, 2);

static const uint8_t rows[2] = {1, 1};
static shared_t shared_node;
static unrolled_t unrolled_node;

#define RUN(name, real, start)                                                                                                 \
    static const mk_##real##_t name##_A[4] = {1, (mk_##real##_t)0.1, 0, 1};                                                    \
    static const mk_##real##_t name##_Q[3] = {(mk_##real##_t)1e-4, 0, (mk_##real##_t)1e-3};                                    \
    static const mk_##real##_t name##_x0[2] = {0, 0}, name##_P0[3] = {1, 0, 1};                                                \
    static const mk_##real##_t name##_weight[2] = {(mk_##real##_t)0.7, (mk_##real##_t)0.3};                                    \
    static const mk_##real##_t name##_C[4] = {1, 0, 1, (mk_##real##_t)0.3}, name##_R[1] = {(mk_##real##_t)0.3};                \
    static mk_##real##_t name##_F[4], name##_S[6], name##_R_inverse[2];                                                        \
    static const name##_config_t name##_config = {2,    1,        2,        name##_A, name##_Q, 0, name##_x0, name##_P0,       \
                                                  name##_weight, rows, name##_C, name##_F, name##_S, name##_R_inverse,         \
                                                  (mk_##real##_t)0.02, 0};                                                     \
    static int name##_run(void) {                                                                                              \
        mk_##real##_t work[3];                                                                                                 \
        int t, l;                                                                                                              \
        for (l = 0; l < 2; l++)                                                                                                \
            if (mk_rkfd_sensor_##real(2, 1, 1, name##_C + 2 * l, name##_R, name##_F + 2 * l, name##_S + 3 * l,                 \
                                      name##_R_inverse + l, work) != MK_OK) return 1;                                          \
        if (name##_start(&start, &name##_config) != MK_OK) return 1;                                                           \
        for (t = 0; t < 50; t++) {                                                                                             \
            const mk_##real##_t own = (mk_##real##_t)((t * 37 % 11) - 5) / 7, heard = own + (mk_##real##_t)0.1;                \
            name##_put_measurement(&start, 0, &own);                                                                           \
            if (t % 3) name##_put_measurement(&start, 1, &heard);                                                              \
            if (name##_incremental(&start, 0) != MK_OK) return 1;                                                              \
            if (t % 4) name##_put_estimate(&start, 1, name##_estimate(&start));                                                \
            if (name##_diffuse(&start) != MK_OK) return 1;                                                                     \
            SHOW(#name, t, name##_estimate(&start)[0], name##_estimate(&start)[1]);                                            \
        }                                                                                                                      \
        return 0;                                                                                                              \
    }

RUN(shared, f64, shared_node)
RUN(unrolled, f32, unrolled_node)

int main(void) {
#ifndef CONSUMER_SILENT
    printf("Meshkal %s\n", MK_VERSION);
#endif
    return shared_run() || unrolled_run();
}
