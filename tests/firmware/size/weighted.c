/* SPDX-License-Identifier: MIT */
/* Runs an extended filter of 17 states and 8 rows plain and with robust weights for the instruction counter (count.c), and measures its stack:
   readings as they are expected, then with many that are not. Writes what size.py reads:  filter NAME STEPS  in order,
   stack FUNCTION BYTES,  ram BYTES. */
#include <string.h>

#include "markers.h"
#include "semihost.h"
#include "stack.h"
#include "unscented_node.h"

enum { N = SIZE_N, M = SIZE_M, SLOTS = SIZE_SLOTS, STEPS = 12 };

MARKER(size_begin_start)
MARKER(size_begin_predict)
MARKER(size_begin_put)
MARKER(size_begin_update)

/* A row for each sensor, dense. Their instructions and frames count, their flash does not. */
static float row[SLOTS][N];

MK_INLINE mk_status_t ranges(const void *context, float dt, int count, const float *x, float *y) {
    const float *const h = context;
    (void)dt;
    for (int k = 0; k < count; k++, x += N) {
        y[k] = 0.0f;
        for (int i = 0; i < N; i++) y[k] += h[i] * x[i];
    }
    return MK_OK;
}

MK_INLINE mk_status_t ranges_jacobian(const void *context, float dt, const float *x, float *J) {
    (void)dt;
    (void)x;
    memcpy(J, context, sizeof row[0]);
    return MK_OK;
}

static float A[N * N], Q[MK_PACKED(N)], P0[MK_PACKED(N)], x0[N], k0[SLOTS], k1[SLOTS], weight[SLOTS], statistic[SLOTS];
static const float R = 1.0f;
static mk_sensor_f32_t sensor[SLOTS];
static mk_row_weights_f32_t weights;
static filter_config_t config;
static filter_t filter;
static uint32_t seed = 1;

enum { START, PREDICT, PUT, UPDATE, FUNCTIONS };
static const char *const names[FUNCTIONS] = {"start", "predict", "put", "update"};
static uint32_t worst[FUNCTIONS];

/* Uniform on [-1, 1). */
static float draw(void) {
    seed = seed * UINT32_C(1664525) + UINT32_C(1013904223);
    return (float)((int32_t)seed >> 8) * (1.0f / 8388608.0f);
}

static int run(const char *name, int kind, float blunder, int *below) {
    mk_status_t status;
    *below = 0;
    weights.kind = (uint8_t)(kind < 0 ? 0 : kind);
    CALL(START, size_begin_start, unscented_start(&filter, &config));
    for (int t = 0; t < STEPS && status == MK_OK; t++) {
        CALL(PREDICT, size_begin_predict, unscented_predict(&filter, 1.0f));
        for (int l = 0; l < SLOTS && status == MK_OK; l++) {
            float z = 0.25f * draw();
            for (int i = 0; i < N; i++) z += row[l][i] * filter.x[i];
            if (draw() > 0.0f) z += blunder * draw();
            CALL(PUT, size_begin_put, unscented_put(&filter, l, &z));
        }
        if (status == MK_OK) CALL(UPDATE, size_begin_update, kind < 0 ? unscented_update(&filter) : unscented_update_weighted(&filter, &weights));
        if (filter.core.weighted_rows > *below) *below = filter.core.weighted_rows;
    }
    mk_write("filter ");
    mk_write(name);
    mk_write(" ");
    mk_write_number(STEPS);
    mk_write(" ");
    mk_write_number((uint32_t)*below);
    mk_write("\n");
    return status == MK_OK;
}

int main(void) {
    int good = 1, below[5];
    size_loops();
    for (int i = 0; i < N; i++) {
        A[i * N + i] = 0.9375f;
        if (i > 0) A[i * N + i - 1] = 0.25f;
        Q[MK_PACKED(i) + i] = 0.01f;
        P0[MK_PACKED(i) + i] = 0.5f;
    }
    for (int l = 0; l < SLOTS; l++) {
        for (int i = 0; i < N; i++) row[l][i] = draw();
        sensor[l].model.function = ranges;
        sensor[l].model.jacobian = ranges_jacobian;
        sensor[l].model.context = row[l];
        sensor[l].R = &R;
        sensor[l].rows = M;
        k0[l] = 1.5f;
        k1[l] = 4.0f;
    }
    config.n = N;
    config.m = M;
    config.slots = SLOTS;
    config.transition.A = A;
    config.transition.Q = Q;
    config.sensor = sensor;
    config.x0 = x0;
    config.P0 = P0;
    config.transform.spread = (float)N;
    config.transform.correction = -1.0f;
    config.update = MK_UPDATE_EXTENDED;
    config.increments = 1;
    weights.k0 = k0;
    weights.k1 = k1;
    weights.weight = weight;
    weights.statistic = statistic;
    good &= run("ekf", -1, 60.0f, below) & run("rekf-n-usual", MK_STATISTIC_NORMAL, 0.0f, below + 1) & run("rekf-n", MK_STATISTIC_NORMAL, 60.0f, below + 2) &
            run("rekf-t-usual", MK_STATISTIC_STUDENT, 0.0f, below + 3) & run("rekf-t", MK_STATISTIC_STUDENT, 60.0f, below + 4);
    size_tell(FUNCTIONS, names, worst, (uint32_t)sizeof filter);
    return !good || below[1] > 0 || below[2] < 4 || below[4] < 2;
}
