/* SPDX-License-Identifier: MIT */
/* The motions of <meshkal/tracking.h> in one REAL; test_tracking.c includes this once for each. */

static const long double NAME(unit) = sizeof(REAL) == sizeof(float) ? (long double)FLT_EPSILON : (long double)DBL_EPSILON;

static void NAME(draw_state)(generator_t *g, const mk_motion_t *motion, int turns, REAL *x) {
    for (int i = 0; i < motion->n; i++) x[i] = (REAL)draw_uniform(g, -50.0, 50.0);
    if (!turns) return;
    const double sizes[] = {0.0, 1e-40, 1e-12, 1e-4, 0.1, 1.0, 3.0};
    x[motion->turn_rate] = (REAL)(sizes[draw_below(g, 7)] * draw_uniform(g, -1.0, 1.0));
}

static void NAME(near)(long double tolerance, REAL found, long double expected, const char *what) {
    if (!(fabsl((long double)found - expected) <= tolerance * NAME(unit)))
        fail_msg("%s: %.17g, expected %.17Lg, %.1Lf epsilon off, allowed %.1Lf", what, (double)found, expected,
                 fabsl((long double)found - expected) / NAME(unit), tolerance);
}

/* Both motions and their Jacobians against motion_by_series: speeds to 50 m/s, dt to 3 s, so turns to 9 rad. */
static void NAME(motion)(void **unused) {
    (void)unused;
    generator_t g = {81};
    for (int trial = 0; trial < TRIALS; trial++) {
        const mk_motion_t *const motion = &layouts[trial % LAYOUTS];
        const int n = motion->n, turns = trial / LAYOUTS % 2;
        REAL x[MOST], y[MOST], J[MOST * MOST];
        long double exact[MOST], slope[MOST * MOST];
        const REAL dt = (REAL)draw_uniform(&g, 0.0, 3.0);
        NAME(draw_state)(&g, motion, turns, x);
        assert_int_equal((turns ? NAME(mk_constant_turn) : NAME(mk_constant_velocity))(motion, dt, 1, x, y), MK_OK);
        assert_int_equal((turns ? NAME(mk_constant_turn_jacobian) : NAME(mk_constant_velocity_jacobian))(motion, dt, x, J), MK_OK);
        long double start[MOST];
        for (int i = 0; i < n; i++) start[i] = (long double)x[i];
        motion_by_series(motion, turns, (long double)dt, start, exact, slope);
        for (int i = 0; i < n; i++) NAME(near)(2000.0L, y[i], exact[i], "state"); /* 10 times 200 m */
        for (int i = 0; i < n * n; i++)
            NAME(near)(12.0L * fmaxl(fabsl(slope[i]), i % n == motion->turn_rate ? 400.0L : 1.0L), J[i], slope[i], "Jacobian");
    }
}

/* A target at the origin with velocity (1, 0): the small displacements keep all their digits as omega goes to 0. */
static void NAME(slow_turn)(void **unused) {
    (void)unused;
    generator_t g = {82};
    const mk_motion_t *const motion = &layouts[TURNING];
    const int n = motion->n, px = motion->position[0], py = motion->position[1], omega = motion->turn_rate;
    for (int trial = 0; trial < TRIALS; trial++) {
        REAL x[MOST] = {(REAL)0.0}, y[MOST], J[MOST * MOST];
        const REAL dt = (REAL)draw_uniform(&g, 0.5, 2.0);
        long double start[MOST] = {0.0L}, exact[MOST], slope[MOST * MOST];
        x[motion->velocity[0]] = (REAL)1.0;
        x[omega] = (REAL)draw_log_uniform(&g, sizeof(REAL) == sizeof(float) ? 1e-30 : 1e-200, 1.5);
        for (int i = 0; i < n; i++) start[i] = (long double)x[i];
        motion_by_series(motion, 1, (long double)dt, start, exact, slope);
        assert_int_equal(NAME(mk_constant_turn)(motion, dt, 1, x, y), MK_OK);
        assert_int_equal(NAME(mk_constant_turn_jacobian)(motion, dt, x, J), MK_OK);
        assert_true(y[py] > (REAL)0.0); /* counterclockwise */
        NAME(near)(8.0L * fabsl(exact[py]), y[py], exact[py], "across");
        /* At a turn of 3 rad, sin(a) / a is a tenth of its terms. */
        NAME(near)(8.0L * fmaxl(fabsl(exact[px]), 0.5L), y[px], exact[px], "along");
        const int at = px * n + omega;
        NAME(near)(16.0L * fabsl(slope[at]), J[at], slope[at], "slope of along");
    }
}

/* Two half steps are one step, there and back is where it was, and a turn keeps the speed. */
static void NAME(group)(void **unused) {
    (void)unused;
    generator_t g = {83};
    for (int trial = 0; trial < TRIALS; trial++) {
        const mk_motion_t *const motion = &layouts[trial % LAYOUTS];
        const int n = motion->n, turns = trial / LAYOUTS % 2;
        const TYPE(mk_function) function = turns ? NAME(mk_constant_turn) : NAME(mk_constant_velocity);
        REAL x[MOST], whole[MOST], half[MOST], both[MOST], back[MOST];
        const REAL dt = (REAL)draw_uniform(&g, 0.0, 3.0);
        NAME(draw_state)(&g, motion, turns, x);
        assert_int_equal(function(motion, dt, 1, x, whole), MK_OK);
        assert_int_equal(function(motion, (REAL)0.5 * dt, 1, x, half), MK_OK);
        assert_int_equal(function(motion, (REAL)0.5 * dt, 1, half, both), MK_OK);
        assert_int_equal(function(motion, -dt, 1, whole, back), MK_OK);
        for (int i = 0; i < n; i++) {
            NAME(near)(2000.0L, both[i], (long double)whole[i], "two halves");
            NAME(near)(4000.0L, back[i], (long double)x[i], "back");
        }
        const int u = motion->velocity[0], v = motion->velocity[1];
        const long double speed = hypotl((long double)x[u], (long double)x[v]);
        NAME(near)(6.0L * speed, (REAL)hypotl((long double)whole[u], (long double)whole[v]), speed, "speed");
    }
}

/* Q against the integral over s in [0, dt] of (s, 1)' q (s, 1), by Simpson's rule, which is exact for it. */
static void NAME(noise)(void **unused) {
    (void)unused;
    generator_t g = {84};
    for (int trial = 0; trial < 1000; trial++) {
        const mk_motion_t *const motion = &layouts[trial % LAYOUTS];
        const int n = motion->n, turns = trial / LAYOUTS % 2, packed = MK_PACKED(n);
        const REAL dt = (REAL)draw_uniform(&g, 0.0, 10.0), q_turn = (REAL)0.125;
        const REAL q[3] = {(REAL)draw_uniform(&g, 0.0, 2.0), (REAL)0.25, (REAL)7.0};
        REAL Q[MK_PACKED(MOST) + 1];
        long double exact[MK_PACKED(MOST)] = {0.0L};
        for (int axis = 0; axis < motion->dimensions; axis++) {
            const int p = motion->position[axis], v = motion->velocity[axis], low = p < v ? p : v, high = p < v ? v : p;
            for (int k = 0; k < 3; k++) {
                const long double s = 0.5L * k * (long double)dt;
                const long double weight = (k == 1 ? 4.0L : 1.0L) * (long double)dt * (long double)q[axis] / 6.0L;
                exact[MK_PACKED(p) + p] += weight * s * s;
                exact[MK_PACKED(high) + low] += weight * s;
                exact[MK_PACKED(v) + v] += weight;
            }
        }
        if (turns) exact[MK_PACKED(motion->turn_rate) + motion->turn_rate] = (long double)(q_turn * dt);
        Q[packed] = (REAL)12345.0;
        const mk_status_t status =
            turns ? NAME(mk_constant_turn_noise)(motion, dt, q, q_turn, Q) : NAME(mk_constant_velocity_noise)(motion, dt, q, Q);
        assert_int_equal(status, MK_OK);
        for (int i = 0; i < packed; i++) NAME(near)(4.0L * exact[i], Q[i], exact[i], "Q");
        assert_true(Q[packed] == (REAL)12345.0);
    }
}

static void NAME(noise_refused)(void **unused) {
    (void)unused;
    const mk_motion_t *const motion = &layouts[TURNING];
    const REAL one = (REAL)1.0, bad[] = {(REAL)NAN, (REAL)INFINITY, -(REAL)1.0};
    /* Its third power overflows, its square does not. */
    const REAL huge = sizeof(REAL) == sizeof(float) ? (REAL)1e15 : (REAL)1e120;
    const mk_status_t status[] = {MK_ERROR_NOT_FINITE, MK_ERROR_NOT_FINITE, MK_ERROR_ARGUMENT};
    REAL Q[MK_PACKED(MOST)], before[MK_PACKED(MOST)];
    for (int i = 0; i < MK_PACKED(MOST); i++) Q[i] = before[i] = (REAL)i;
    REAL q[3] = {one, one, one};
    for (int k = 0; k < 3; k++) {
        assert_int_equal(NAME(mk_constant_turn_noise)(motion, one, q, bad[k], Q), status[k]);
        assert_int_equal(NAME(mk_constant_turn_noise)(motion, bad[k], q, one, Q), status[k]);
        assert_int_equal(NAME(mk_constant_velocity_noise)(motion, bad[k], q, Q), status[k]);
        q[motion->dimensions - 1] = bad[k];
        assert_int_equal(NAME(mk_constant_velocity_noise)(motion, one, q, Q), status[k]);
        q[motion->dimensions - 1] = one;
    }
    assert_int_equal(NAME(mk_constant_velocity_noise)(motion, huge, q, Q), MK_ERROR_NOT_FINITE);
    assert_int_equal(NAME(mk_constant_velocity_noise)(NULL, one, q, Q), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_constant_velocity_noise)(motion, one, NULL, Q), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_constant_velocity_noise)(motion, one, q, NULL), MK_ERROR_ARGUMENT);
    assert_memory_equal(Q, before, sizeof Q);
}
