/* SPDX-License-Identifier: MIT */
/* The ready motions and sensors, in both precisions, against closed forms and series in long double. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/tracking.h>

#include "generator.h"
#include "precision.h"

enum { MOST = 9, LAYOUTS = 5, TURNING = 3, COUNT = 7 };

#ifdef UNIT_LONG_RUN
enum { TRIALS = UNIT_LONG_RUN };
#else
enum { TRIALS = 100000 };
#endif

/* Both usual orders in the plane, in space, shuffled, with states that belong to no model. */
static const mk_motion_t layouts[LAYOUTS] = {
    {5, 2, {0, 2, 0}, {1, 3, 0}, 4}, {5, 2, {0, 1, 9}, {2, 3, 9}, 4}, {7, 3, {0, 1, 2}, {3, 4, 5}, 6},
    {9, 3, {8, 2, 5}, {0, 7, 3}, 4}, {7, 2, {5, 1, 1}, {3, 0, 1}, 2},
};

/* --- motions ------------------------------------------------------------------------------------------------------------- */

/* y and its derivative J by Taylor series in dt: terms dt^(j+1) omega^j / (j+1)!, smooth in omega. */
static void motion_by_series(const mk_motion_t *motion, int turns, long double dt, const long double *x, long double *y, long double *J) {
    const int n = motion->n;
    const uint8_t *const p = motion->position, *const v = motion->velocity;
    for (int i = 0; i < n; i++) y[i] = x[i];
    for (int i = 0; i < n * n; i++) J[i] = i % (n + 1) ? 0.0L : 1.0L;
    for (int axis = turns ? 2 : 0; axis < motion->dimensions; axis++) {
        y[p[axis]] += dt * x[v[axis]];
        J[p[axis] * n + v[axis]] = dt;
    }
    if (!turns) return;
    /* even and odd terms, with alternating signs, and their derivatives by omega */
    const long double omega = x[motion->turn_rate];
    long double sum[2] = {0.0L, 0.0L}, slope[2] = {0.0L, 0.0L}, term = dt, lower = 0.5L * dt * dt;
    for (int j = 0; j < 60; j++) {
        const long double sign = j % 4 < 2 ? 1.0L : -1.0L;
        sum[j % 2] += sign * term;
        if (j > 0) slope[j % 2] += sign * j * lower;
        term *= dt * omega / (j + 2);
        if (j > 0) lower *= dt * omega / (j + 2);
    }
    const long double cosine = 1.0L - omega * sum[1], sine = omega * sum[0], v0 = x[v[0]], v1 = x[v[1]];
    y[p[0]] += sum[0] * v0 - sum[1] * v1;
    y[p[1]] += sum[1] * v0 + sum[0] * v1;
    y[v[0]] = cosine * v0 - sine * v1;
    y[v[1]] = sine * v0 + cosine * v1;
    J[p[0] * n + v[0]] = J[p[1] * n + v[1]] = sum[0];
    J[p[0] * n + v[1]] = -sum[1];
    J[p[1] * n + v[0]] = sum[1];
    J[v[0] * n + v[0]] = J[v[1] * n + v[1]] = cosine;
    J[v[0] * n + v[1]] = -sine;
    J[v[1] * n + v[0]] = sine;
    J[p[0] * n + motion->turn_rate] = slope[0] * v0 - slope[1] * v1;
    J[p[1] * n + motion->turn_rate] = slope[1] * v0 + slope[0] * v1;
    J[v[0] * n + motion->turn_rate] = -dt * y[v[1]];
    J[v[1] * n + motion->turn_rate] = dt * y[v[0]];
}

/* --- sensors ------------------------------------------------------------------------------------------------------------- */

typedef enum { RANGE, BEARING, RANGE_BEARING, RANGE_RATE, TDOA, SENSORS } sensor_t;
static const char *const sensor_names[SENSORS] = {"range", "bearing", "range-bearing", "range rate", "tdoa"};

static int sensor_rows(sensor_t kind, const mk_motion_t *motion) {
    return kind == BEARING ? motion->dimensions - 1 : kind == RANGE_BEARING ? motion->dimensions : 1;
}

static int sensor_is_angle(sensor_t kind, int row) { return kind == BEARING || (kind == RANGE_BEARING && row > 0); }

static long double distance(const mk_motion_t *motion, int axes, const long double *place, const long double *x) {
    long double square = 0.0L;
    for (int axis = 0; axis < axes; axis++) square += powl(x[motion->position[axis]] - place[axis], 2.0L);
    return sqrtl(square);
}

static void sensor_exact(sensor_t kind, const mk_motion_t *motion, const long double *place, const long double *reference,
                         const long double *x, long double *y) {
    const int axes = motion->dimensions;
    const long double r = distance(motion, axes, place, x);
    if (kind == RANGE || kind == RANGE_BEARING) *y++ = r;
    if (kind == BEARING || kind == RANGE_BEARING) {
        *y++ = atan2l(x[motion->position[1]] - place[1], x[motion->position[0]] - place[0]);
        if (axes == 3) *y++ = asinl((x[motion->position[2]] - place[2]) / r);
    }
    if (kind == RANGE_RATE) {
        *y = 0.0L;
        for (int axis = 0; axis < axes; axis++) *y += (x[motion->position[axis]] - place[axis]) * x[motion->velocity[axis]] / r;
    }
    if (kind == TDOA) *y = r - distance(motion, axes, reference, x);
}

/* What errors grow with when it is small: for bearings the distance in the plane. */
static long double sensor_closest(sensor_t kind, const mk_motion_t *motion, const long double *place, const long double *reference,
                                  const long double *x) {
    if (kind == BEARING || kind == RANGE_BEARING) return distance(motion, 2, place, x);
    const long double r = distance(motion, motion->dimensions, place, x);
    return kind == TDOA ? fminl(r, distance(motion, motion->dimensions, reference, x)) : r;
}

/* Central differences of sensor_exact; the step's error is about 1e-12 of the largest derivative. */
static void sensor_slope(sensor_t kind, const mk_motion_t *motion, const long double *place, const long double *reference,
                         const long double *x, long double *J) {
    const int n = motion->n, rows = sensor_rows(kind, motion);
    const long double step = 1e-6L * sensor_closest(kind, motion, place, reference, x);
    for (int i = 0; i < n; i++) {
        long double up[3], down[3], moved[MOST];
        for (int k = 0; k < n; k++) moved[k] = x[k];
        moved[i] = x[i] + step;
        sensor_exact(kind, motion, place, reference, moved, up);
        moved[i] = x[i] - step;
        sensor_exact(kind, motion, place, reference, moved, down);
        for (int row = 0; row < rows; row++) {
            long double difference = up[row] - down[row];
            if (sensor_is_angle(kind, row)) difference = remainderl(difference, 2.0L * acosl(-1.0L));
            J[row * n + i] = difference / (2.0L * step);
        }
    }
}

static void check(void **unused) {
    (void)unused;
    const int both = MK_MOTION_VELOCITY + MK_MOTION_TURN_RATE;
    assert_int_equal(mk_motion_check(NULL, 0), MK_ERROR_ARGUMENT);
    for (int k = 0; k < LAYOUTS; k++) {
        assert_int_equal(mk_motion_check(&layouts[k], both), MK_OK);
        for (int axis = 0; axis < layouts[k].dimensions; axis++) {
            mk_motion_t motion = layouts[k];
            motion.position[axis] = motion.n;
            assert_int_equal(mk_motion_check(&motion, 0), MK_ERROR_ARGUMENT);
            motion = layouts[k];
            motion.velocity[axis] = motion.n;
            assert_int_equal(mk_motion_check(&motion, 0), MK_OK);
            assert_int_equal(mk_motion_check(&motion, MK_MOTION_VELOCITY), MK_ERROR_ARGUMENT);
            motion.velocity[axis] = motion.position[1];
            assert_int_equal(mk_motion_check(&motion, MK_MOTION_VELOCITY), MK_ERROR_ARGUMENT);
        }
        mk_motion_t motion = layouts[k];
        motion.turn_rate = motion.velocity[0];
        assert_int_equal(mk_motion_check(&motion, MK_MOTION_VELOCITY), MK_OK);
        assert_int_equal(mk_motion_check(&motion, both), MK_ERROR_ARGUMENT);
        motion.turn_rate = 200;
        assert_int_equal(mk_motion_check(&motion, both), MK_ERROR_ARGUMENT);
        for (uint8_t dimensions = 0; dimensions < 6; dimensions++) {
            motion.dimensions = dimensions;
            if (dimensions != 2 && dimensions != 3) assert_int_equal(mk_motion_check(&motion, 0), MK_ERROR_ARGUMENT);
        }
    }
}

#define PRECISION f32
#define REAL float
#include "tracking_motion.tmpl.h"
#include "tracking_sensors.tmpl.h"
#undef PRECISION
#undef REAL

#define PRECISION f64
#define REAL double
#include "tracking_motion.tmpl.h"
#include "tracking_sensors.tmpl.h"

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(check), BOTH(motion), BOTH(slow_turn), BOTH(group),  BOTH(noise),
        BOTH(noise_refused),     BOTH(sensor), BOTH(far_tdoa),  BOTH(domain), BOTH(counts), BOTH(differences),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
