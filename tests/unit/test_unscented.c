/* SPDX-License-Identifier: MIT */
/* <meshkal/unscented.h>: its typed functions beside the kernels, and a long run in float32. What the numbers should be is tested in
   tests/host/test_unscented_*.py. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/unscented.h>

#include "generator.h"
#include "precision.h"

/* With the sanitizers the run is shorter: they look for other things than drift. */
#ifndef UNIT_LONG_RUN
#define UNIT_LONG_RUN 1000000
#endif

#define MK_UNSCENTED_OF(name, real, n, m, slots) MK_UNSCENTED(name, real, n, m, slots)

/* A curved model: states, rows, which slot. */
typedef struct {
    int n, rows, slot;
} bent_t;

#define PRECISION f32
#define REAL float
#include "unscented_models.tmpl.h"
#include "unscented_long.tmpl.h"
#include "unscented_types.tmpl.h"
#undef PRECISION
#undef REAL

#define PRECISION f64
#define REAL double
#include "unscented_models.tmpl.h"
#include "unscented_long.tmpl.h"
#include "unscented_types.tmpl.h"

static void transforms(void **unused) {
    (void)unused;
    const mk_transform_f64_t julier = MK_TRANSFORM_JULIER(4, -1), cubature = MK_TRANSFORM_CUBATURE(4);
    const mk_transform_f64_t scaled = MK_TRANSFORM_SCALED(4, 0.5, 2.0, 1.0);
    assert_true(julier.spread == 3.0 && julier.correction == -1.0);
    assert_true(cubature.spread == 4.0 && cubature.correction == -1.0);
    assert_true(scaled.spread == 1.25 && scaled.correction == 1.75);
}

/* --- long run -------------------------------------------------------------------------------------------------------------- */

MK_UNSCENTED(single, f32, 4, 2, 3);
MK_UNSCENTED(twice, f64, 4, 2, 3);

static const double q[4] = {1e-2, 1e-2, 1e-6, 1e-7}, p[4] = {3e3, 1e2, 0.1, 0.01}, r[4] = {0.02, 1e-2, 1e-4, 1e-3};
static const double start_at[4] = {2e3, 10.0, 1e-2, 1e-3};

/* e' P^-1 e */
static double consistency(const double *L, const double *e) {
    double d[4], sum = 0.0;
    for (int i = 0; i < 4; i++) {
        d[i] = e[i];
        for (int k = 0; k < i; k++) d[i] -= L[MK_PACKED(i) + k] * d[k];
        d[i] /= L[MK_PACKED(i) + i];
        sum += d[i] * d[i];
    }
    return sum;
}

/* `steps` steps of both precisions on the same readings, which come by chance; every so often a new start far off with a large P0, and long silences
   over which P grows. */
static void run_long(int update, int steps, int robust) {
    static const float k0[6] = {2, 2, 2, 2, 2, 2}, k1[6] = {5, 5, 5, 5, 5, 5};
    static const double k0_twin[6] = {2, 2, 2, 2, 2, 2}, k1_twin[6] = {5, 5, 5, 5, 5, 5};
    const mk_row_weights_f32_t weights = {k0, k1, NULL, NULL, MK_STATISTIC_NORMAL};
    const mk_row_weights_f64_t weights_twin = {k0_twin, k1_twin, NULL, NULL, MK_STATISTIC_NORMAL};
    int weighted = 0, unused = 0;
    generator_t g = {(uint64_t)(100 + update)};
    static single_t f;
    static twice_t twin;
    static long_model_f32_t model;
    static long_model_f64_t model_twin;
    double truth[4], nees = 0.0, nees_twin = 0.0, apart = 0.0, apart_sum = 0.0, ratio_low = 1.0, ratio_high = 1.0, condition = 0.0;
    int judged = 0;
    long_prepare_f32(&model, q, p, r, start_at, update);
    long_prepare_f64(&model_twin, q, p, r, start_at, update);
    /* The same numbers in both. */
    for (int i = 0; i < 10; i++) {
        model_twin.Q[i] = (double)model.Q[i];
        model_twin.P0[i] = (double)model.P0[i];
    }
    for (int l = 0; l < 3; l++)
        for (int i = 0; i < 3; i++) model_twin.R[l][i] = (double)model.R[l][i];
    assert_int_equal(single_start(&f, &model.config), MK_OK);
    assert_int_equal(twice_start(&twin, &model_twin.config), MK_OK);
    int silence = 0;
    for (int step = 0; step < steps; step++) {
        if (step % 1000 == 0) {
            for (int i = 0; i < 4; i++) truth[i] = start_at[i] + p[i] * draw_normal(&g);
            assert_int_equal(single_restart(&f, model.x0, model.P0), MK_OK);
            assert_int_equal(twice_restart(&twin, model_twin.x0, model_twin.P0), MK_OK);
        }
        double moved[4];
        const float dt = (float)draw_uniform(&g, 0.1, 1.0);
        assert_int_equal(long_motion_f64(NULL, (double)dt, 1, truth, moved), MK_OK);
        for (int i = 0; i < 4; i++) truth[i] = moved[i] + q[i] * draw_normal(&g);
        assert_int_equal(single_predict(&f, dt, NULL), MK_OK);
        assert_int_equal(twice_predict(&twin, (double)dt, NULL), MK_OK);
        /* A weight hardly different leaves a P quite different where the prior is wide: only single updates can be compared. */
        for (int i = 0; i < 4 && robust; i++) twin.x[i] = (double)f.x[i];
        for (int i = 0; i < 10 && robust; i++) twin.L[i] = (double)f.L[i];
        if (silence == 0 && draw_chance(&g, 0.01)) silence = draw_below(&g, 100);
        if (silence > 0) silence--;
        for (int l = 0, k = 0; l < 3; k += model.sensor[l].rows, l++) {
            if (silence > 0 || draw_chance(&g, 0.5)) continue;
            double y[2] = {0.0, 0.0};
            float z[2];
            assert_int_equal(model_twin.sensor[l].model.function(NULL, 0.0, 1, truth, y), MK_OK);
            for (int i = 0; i < model.sensor[l].rows; i++) {
                const double faulty = robust && step % 1000 > 20 && draw_chance(&g, 0.1) ? 20.0 : 1.0;
                z[i] = (float)(y[i] + faulty * r[k + i] * draw_normal(&g));
                y[i] = (double)z[i];
            }
            assert_int_equal(single_put(&f, l, z), MK_OK);
            assert_int_equal(twice_put(&twin, l, y), MK_OK);
        }
        assert_int_equal(robust ? single_update_weighted(&f, &weights) : single_update(&f), MK_OK);
        assert_int_equal(robust ? twice_update_weighted(&twin, &weights_twin) : twice_update(&twin), MK_OK);
        weighted += f.core.weighted_rows;
        unused += f.core.unused_rows;
        double e[4], e_twin[4], d[4], L[10];
        for (int i = 0; i < 10; i++) L[i] = (double)single_root(&f)[i];
        for (int i = 0; i < 4; i++) {
            const double x = (double)single_estimate(&f)[i];
            assert_true(L[MK_PACKED(i + 1) - 1] > 0.0 && L[MK_PACKED(i + 1) - 1] < 1e30 && fabs(x) < 1e30);
            e[i] = truth[i] - x;
            e_twin[i] = truth[i] - twice_estimate(&twin)[i];
            d[i] = x - twice_estimate(&twin)[i];
        }
        if (step % 1000 < 100) continue; /* both far off still, each in its own way */
        judged++;
        const double off = consistency(twice_root(&twin), d);
        nees += consistency(L, e);
        nees_twin += consistency(twice_root(&twin), e_twin);
        apart = fmax(apart, off);
        apart_sum += off;
        for (int i = 0; i < 4; i++) {
            double own = 0.0, other = 0.0;
            for (int k = 0; k <= i; k++) {
                own += L[MK_PACKED(i) + k] * L[MK_PACKED(i) + k];
                other += twice_root(&twin)[MK_PACKED(i) + k] * twice_root(&twin)[MK_PACKED(i) + k];
            }
            ratio_low = fmin(ratio_low, sqrt(own / other));
            ratio_high = fmax(ratio_high, sqrt(own / other));
            condition = fmax(condition, fabs(truth[i]) / sqrt(other));
        }
    }
    print_message("- update %d, %d steps: NEES %.3f in float32, %.3f in float64 (4 states); apart by %.2g standard deviations (root mean square), at "
                  "most %.2g; standard deviations %.4f to %.4f of float64's; a state is up to %.1e standard deviations large\n",
                  update, steps, nees / judged, nees_twin / judged, sqrt(apart_sum / judged / 4.0), sqrt(apart), ratio_low, ratio_high, condition);
    if (robust) print_message("- of its rows %d had a weight below 1, %d of these none\n", weighted, unused);
    assert_true(!robust == !weighted && weighted >= unused && (!robust || unused > steps / 100));
    assert_true(judged > 0);
    assert_true(sqrt(apart_sum / judged / 4.0) < 0.3);
    assert_true(fabs(nees - nees_twin) < 0.2 * nees_twin);
    assert_true(ratio_low > 0.9 && ratio_high < 1.1);
}

static void long_unscented(void **unused) {
    (void)unused;
    run_long(MK_UPDATE_UNSCENTED, UNIT_LONG_RUN, 0);
}

static void long_weighted(void **unused) {
    (void)unused;
    run_long(MK_UPDATE_UNSCENTED, UNIT_LONG_RUN / 4, 1);
}

/* Student's weights of eight rows, outliers of all sizes up to the range's end, several at a time, wide and narrow covariances: P stays positive definite. */
MK_UNSCENTED(eight, f32, 6, 1, 8);
static void random_weighted(void **unused) {
    (void)unused;
    generator_t g = {77};
    static eight_t f;
    bent_t motion = {6, 6, 0}, sensors[8];
    mk_sensor_f32_t sensor[8];
    float Q[21] = {0}, P0[21] = {0}, x0[6] = {0}, R[8], k0[8], k1[8];
    const mk_transform_f32_t cubature = MK_TRANSFORM_CUBATURE(6);
    const mk_row_weights_f32_t weights = {k0, k1, NULL, NULL, MK_STATISTIC_STUDENT};
    mk_unscented_config_f32_t config;
    int weighted = 0, none = 0, starts = 0;
    memset(&config, 0, sizeof config);
    memset(sensor, 0, sizeof sensor);
    assert_int_equal(mk_weight_thresholds_f32(MK_STATISTIC_STUDENT, 0.1, 8, k0), MK_OK);
    assert_int_equal(mk_weight_thresholds_f32(MK_STATISTIC_STUDENT, 0.01, 8, k1), MK_OK);
    for (int l = 0; l < 8; l++) {
        const bent_t made = {6, 1, l};
        sensors[l] = made;
        R[l] = (float)draw_log_uniform(&g, 1e-4, 1.0);
        sensor[l].model.function = bent_sensor_f32;
        sensor[l].model.jacobian = bent_sensor_slope_f32;
        sensor[l].model.context = &sensors[l];
        sensor[l].R = &R[l];
        sensor[l].rows = 1;
    }
    config.n = 6;
    config.m = 1;
    config.slots = 8;
    config.transition.model.function = bent_motion_f32;
    config.transition.model.jacobian = bent_motion_slope_f32;
    config.transition.model.context = &motion;
    config.transition.Q = Q;
    config.sensor = sensor;
    config.x0 = x0;
    config.P0 = P0;
    config.transform = cubature;
    config.increments = 1;
    for (int step = 0; step < UNIT_LONG_RUN / 10; step++) {
        if (step % 500 == 0) {
            for (int i = 0; i < 6; i++) {
                Q[MK_PACKED(i + 1) - 1] = (float)draw_log_uniform(&g, 1e-8, 1e-2);
                P0[MK_PACKED(i + 1) - 1] = (float)draw_log_uniform(&g, 1e-4, step % 1000 ? 1.0 : 1e6);
            }
            config.update = step % 1000 ? MK_UPDATE_UNSCENTED : MK_UPDATE_EXTENDED;
            assert_int_equal(eight_start(&f, &config), MK_OK);
            starts++;
        }
        assert_int_equal(eight_predict(&f, (float)draw_uniform(&g, 0.0, 1.0), NULL), MK_OK);
        const int wild = draw_below(&g, 80); /* one alone, and of five at least: two would hide each other, as they do from Student's statistic */
        for (int l = 0; l < 8; l++) {
            if (l > 4 && draw_chance(&g, 0.2)) continue;
            float z = (float)draw_normal(&g);
            if (l == wild || draw_chance(&g, 0.1)) z *= (float)draw_log_uniform(&g, 1.0, l == wild ? 1e37 : 1e2);
            assert_int_equal(eight_put(&f, l, &z), MK_OK);
        }
        assert_int_equal(eight_update_weighted(&f, &weights), MK_OK);
        weighted += f.core.weighted_rows > 0;
        none += f.core.unused_rows > 0;
        for (int i = 0; i < 6; i++) assert_true(eight_root(&f)[MK_PACKED(i + 1) - 1] > 0.0f && fabs((double)eight_estimate(&f)[i]) < 1e30);
    }
    print_message("- %d starts, %d steps with weights, %d with rows left out\n", starts, weighted, none);
    assert_true(none > UNIT_LONG_RUN / 200);
}

static void long_progressive(void **unused) {
    (void)unused;
    run_long(MK_UPDATE_PROGRESSIVE, UNIT_LONG_RUN / 4, 0);
}

static void long_iterated(void **unused) {
    (void)unused;
    run_long(MK_UPDATE_ITERATED, UNIT_LONG_RUN / 4, 0);
}

#define BOTH(tag) cmocka_unit_test(tag##f32_typed), cmocka_unit_test(tag##f64_typed)

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transforms), BOTH(least), BOTH(wide), BOTH(tracker), BOTH(many), BOTH(tall),
        cmocka_unit_test(long_unscented), cmocka_unit_test(long_weighted),
        cmocka_unit_test(random_weighted), cmocka_unit_test(long_progressive), cmocka_unit_test(long_iterated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
