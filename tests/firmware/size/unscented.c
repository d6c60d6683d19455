/* SPDX-License-Identifier: MIT */
/* Runs an unscented filter type as each of its filters for the instruction counter (count.c), and measures its stack: spec 2.5, a target of constant
   velocity on SIZE_N / 2 axes and one range, or SIZE_M ranges, a sensor, all of which arrive. Writes what size.py reads:  filter NAME STEPS  in
   order,  stack FUNCTION BYTES,  ram BYTES. */
#include <string.h>

#include "markers.h"
#include "semihost.h"
#include "stack.h"
#include "unscented_node.h"

enum { N = SIZE_N, M = SIZE_M, SLOTS = SIZE_SLOTS, STEPS = 12 };

#include "models.h"

MARKER(size_begin_start)
MARKER(size_begin_predict)
MARKER(size_begin_put)
MARKER(size_begin_update)

/* --- runs ------------------------------------------------------------------------------------------------------------------------- */

static float Q[MK_PACKED(N)], P0[MK_PACKED(N)], R[MK_PACKED(M)], x0[N];
static site_t site[SLOTS];
static mk_sensor_f32_t sensor[SLOTS];
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

static int run(const char *name, uint8_t update, uint16_t increments) {
    mk_status_t status;
    float x[N];
    config.update = update;
    config.increments = increments;
    config.rule = update == MK_UPDATE_PROGRESSIVE ? MK_RULE_INNOVATION : MK_RULE_NONE;
    for (int i = 0; i < N; i++) x[i] = x0[i] + (i % 2 == 0 ? 0.1f : 0.01f) * draw();
    CALL(START, size_begin_start, unscented_start(&filter, &config));
    for (int t = 0; t < STEPS && status == MK_OK; t++) {
        (void)moves(0, 1.0f, 1, x, x);
        CALL(PREDICT, size_begin_predict, unscented_predict(&filter, 1.0f));
        for (int l = 0; l < SLOTS && status == MK_OK; l++) {
            float z[M];
            for (int r = 0; r < M; r++) z[r] = range(site + l, r, x) + 0.04f * draw();
            CALL(PUT, size_begin_put, unscented_put(&filter, l, z));
        }
        if (status == MK_OK) CALL(UPDATE, size_begin_update, unscented_update(&filter));
    }
    mk_write("filter ");
    mk_write(name);
    mk_write(" ");
    mk_write_number(STEPS);
    mk_write("\n");
    return status == MK_OK;
}

int main(void) {
    size_loops();
    put_motion(x0, P0, Q);
    for (int l = 0; l < SLOTS; l++) {
        for (int r = 0; r < M; r++) {
            const int k = l * M + r; /* (0, 0), (2, 0), (0, 2), and on */
            site[l].position[r][0] = k % 3 == 1 ? 2.0f : 0.0f;
            site[l].position[r][1] = k % 3 == 2 ? 2.0f : 0.0f;
            site[l].position[r][2] = 0.1f * (float)k;
            R[MK_PACKED(r) + r] = 2e-3f;
        }
        sensor[l].model.function = ranges;
        sensor[l].model.jacobian = ranges_jacobian;
        sensor[l].model.context = site + l;
        sensor[l].R = R;
        sensor[l].rows = M;
    }
    config.n = N;
    config.m = M;
    config.slots = SLOTS;
    config.transition.model.function = moves;
    config.transition.model.jacobian = moves_jacobian;
    config.transition.Q = Q;
    config.sensor = sensor;
    config.x0 = x0;
    config.P0 = P0;
    config.transform.spread = 3.0f;
    config.transform.correction = -1.0f;

    const int good = run("ukf", MK_UPDATE_UNSCENTED, 1) & run("ekf", MK_UPDATE_EXTENDED, 1) & run("mpukf-5", MK_UPDATE_PROGRESSIVE, 5) &
                     run("mpukf-30", MK_UPDATE_PROGRESSIVE, 30) & run("iukf", MK_UPDATE_ITERATED, 5);
    size_tell(FUNCTIONS, names, worst, (uint32_t)sizeof filter);
    return !good;
}
