/* SPDX-License-Identifier: MIT */
/* The sensors of <meshkal/tracking.h> in one REAL; test_tracking.c includes this once for each. */

static const struct {
    TYPE(mk_function) function;
    TYPE(mk_jacobian) jacobian;
} NAME(sensors)[SENSORS] = {
    {NAME(mk_range), NAME(mk_range_jacobian)},
    {NAME(mk_bearing), NAME(mk_bearing_jacobian)},
    {NAME(mk_range_bearing), NAME(mk_range_bearing_jacobian)},
    {NAME(mk_range_rate), NAME(mk_range_rate_jacobian)},
    {NAME(mk_tdoa), NAME(mk_tdoa_jacobian)},
};

static void NAME(draw_site)(generator_t *g, const mk_motion_t *motion, double size, TYPE(mk_site) * site, REAL *x) {
    site->motion = motion;
    for (int axis = 0; axis < 3; axis++) {
        site->position[axis] = (REAL)(size * draw_uniform(g, -1.0, 1.0));
        site->reference[axis] = (REAL)(size * draw_uniform(g, -1.0, 1.0));
    }
    for (int i = 0; i < motion->n; i++) x[i] = (REAL)(size * draw_uniform(g, -1.0, 1.0));
}

/* Values and Jacobians of every sensor at sizes from 1 mm to 100 km; what is behind the last row stays. */
static void NAME(sensor)(void **unused) {
    (void)unused;
    generator_t g = {91};
    for (int trial = 0; trial < TRIALS; trial++) {
        const mk_motion_t *const motion = &layouts[trial % LAYOUTS];
        const sensor_t kind = (sensor_t)(trial / LAYOUTS % SENSORS);
        const int n = motion->n, rows = sensor_rows(kind, motion);
        const double size = draw_log_uniform(&g, 1e-3, 1e5);
        TYPE(mk_site) site;
        REAL x[MOST], y[4], J[3 * MOST + 1];
        long double state[MOST], place[3], reference[3], exact[3], slope[3 * MOST];
        NAME(draw_site)(&g, motion, size, &site, x);
        for (int i = 0; i < n; i++) state[i] = (long double)x[i];
        for (int axis = 0; axis < 3; axis++) {
            place[axis] = (long double)site.position[axis];
            reference[axis] = (long double)site.reference[axis];
        }
        sensor_exact(kind, motion, place, reference, state, exact);
        sensor_slope(kind, motion, place, reference, state, slope);
        y[rows] = J[rows * n] = (REAL)12345.0;
        assert_int_equal(NAME(sensors)[kind].function(&site, (REAL)0.0, 1, x, y), MK_OK);
        assert_int_equal(NAME(sensors)[kind].jacobian(&site, (REAL)0.0, x, J), MK_OK);
        assert_true(y[rows] == (REAL)12345.0 && J[rows * n] == (REAL)12345.0);
        /* Near the target the rounding of the difference of places counts more. */
        const long double closest = sensor_closest(kind, motion, place, reference, state), loss = fmaxl(1.0L, (long double)size / closest);
        for (int row = 0; row < rows; row++) {
            const int angle = sensor_is_angle(kind, row);
            const long double scale = angle ? 3.0L * loss : (long double)size * (kind == RANGE_RATE ? loss : 1.0L);
            NAME(near)(8.0L * scale, y[row], exact[row], sensor_names[kind]);
            const long double rise = angle ? 1.0L / closest : kind == RANGE_RATE ? fmaxl(1.0L, (long double)size / closest) : 1.0L;
            for (int i = 0; i < n; i++)
                NAME(near)(16.0L * rise * loss + 1e-11L * rise * loss / NAME(unit), J[row * n + i], slope[row * n + i], "Jacobian");
        }
    }
}

/* From far away r - |p - reference| keeps the digits that the ranges lose; a difference of ranges would be off by 1e4 epsilon. */
static void NAME(far_tdoa)(void **unused) {
    (void)unused;
    generator_t g = {92};
    const mk_motion_t *const motion = &layouts[TURNING];
    for (int trial = 0; trial < TRIALS; trial++) {
        TYPE(mk_site) site;
        REAL x[MOST], y;
        long double state[MOST], place[3], reference[3], exact;
        NAME(draw_site)(&g, motion, 10.0, &site, x);
        for (int axis = 0; axis < 3; axis++) x[motion->position[axis]] *= (REAL)1e4;
        for (int i = 0; i < motion->n; i++) state[i] = (long double)x[i];
        for (int axis = 0; axis < 3; axis++) {
            place[axis] = (long double)site.position[axis];
            reference[axis] = (long double)site.reference[axis];
        }
        sensor_exact(TDOA, motion, place, reference, state, &exact);
        assert_int_equal(NAME(mk_tdoa)(&site, (REAL)0.0, 1, x, &y), MK_OK);
        NAME(near)(8.0L * 35.0L, y, exact, "tdoa");
    }
}

/* Where each is undefined, in both dimensions. */
static void NAME(domain)(void **unused) {
    (void)unused;
    const REAL huge = sizeof(REAL) == sizeof(float) ? (REAL)1e20 : (REAL)1e155;
    const REAL tiny = sizeof(REAL) == sizeof(float) ? (REAL)1e-20 : (REAL)1e-155;
    for (int layout = 0; layout < LAYOUTS; layout++) {
        const mk_motion_t *const motion = &layouts[layout];
        const TYPE(mk_site) site = {motion, {(REAL)1.0, (REAL)2.0, (REAL)3.0}, {(REAL)4.0, (REAL)5.0, (REAL)6.0}};
        const TYPE(mk_site) origin = {motion, {(REAL)0.0}, {(REAL)4.0, (REAL)5.0, (REAL)6.0}};
        REAL at[MOST] = {(REAL)0.0}, other[MOST] = {(REAL)0.0}, above[MOST] = {(REAL)0.0}, close[MOST] = {(REAL)0.0};
        REAL bad[MOST], y[3], J[3 * MOST];
        for (int axis = 0; axis < motion->dimensions; axis++) {
            at[motion->position[axis]] = site.position[axis];
            other[motion->position[axis]] = site.reference[axis];
            above[motion->position[axis]] = site.position[axis] + (axis == 2 ? (REAL)1.0 : (REAL)0.0);
        }
        close[motion->position[0]] = tiny;
        for (int kind = 0; kind < SENSORS; kind++) {
            const mk_status_t undefined = kind == RANGE || kind == TDOA ? MK_OK : MK_ERROR_DOMAIN;
            /* In the plane there is no above. */
            const mk_status_t vertical = motion->dimensions == 2 || kind == BEARING || kind == RANGE_BEARING ? MK_ERROR_DOMAIN : MK_OK;
            const TYPE(mk_function) function = NAME(sensors)[kind].function;
            const TYPE(mk_jacobian) jacobian = NAME(sensors)[kind].jacobian;
            assert_int_equal(function(&site, (REAL)0.0, 1, at, y), undefined);
            if (kind == RANGE) assert_true(y[0] == (REAL)0.0);
            assert_int_equal(jacobian(&site, (REAL)0.0, at, J), MK_ERROR_DOMAIN);
            assert_int_equal(function(&site, (REAL)0.0, 1, other, y), MK_OK);
            assert_int_equal(jacobian(&site, (REAL)0.0, other, J), kind == TDOA ? MK_ERROR_DOMAIN : MK_OK);
            assert_int_equal(function(&site, (REAL)0.0, 1, above, y), undefined == MK_OK ? MK_OK : vertical);
            assert_int_equal(jacobian(&site, (REAL)0.0, above, J), vertical);
            assert_int_equal(function(&origin, (REAL)0.0, 1, close, y), undefined);
            assert_int_equal(jacobian(&origin, (REAL)0.0, close, J), MK_ERROR_DOMAIN);
            const REAL wrong[] = {(REAL)NAN, (REAL)INFINITY, huge, -huge};
            for (int axis = 0; axis < motion->dimensions; axis++) {
                for (int k = 0; k < 4; k++) {
                    memcpy(bad, above, sizeof bad);
                    bad[motion->position[axis]] = wrong[k];
                    assert_int_equal(function(&site, (REAL)0.0, 1, bad, y), MK_ERROR_NOT_FINITE);
                    assert_int_equal(jacobian(&site, (REAL)0.0, bad, J), MK_ERROR_NOT_FINITE);
                }
            }
        }
    }
}

/* Many points at once are the same bits as one after another, for sensors and motions; a point outside the domain is found anywhere. */
static void NAME(counts)(void **unused) {
    (void)unused;
    generator_t g = {93};
    for (int trial = 0; trial < 200; trial++) {
        const mk_motion_t *const motion = &layouts[trial % LAYOUTS];
        const int n = motion->n;
        TYPE(mk_site) site;
        REAL x[COUNT * MOST], together[COUNT * MOST + 1], alone[COUNT * MOST];
        for (int point = 0; point < COUNT; point++) NAME(draw_site)(&g, motion, 5.0, &site, x + point * n);
        for (int kind = 0; kind < SENSORS + 2; kind++) {
            const int moves = kind >= SENSORS, rows = moves ? n : sensor_rows((sensor_t)kind, motion);
            const TYPE(mk_function) motions[] = {NAME(mk_constant_velocity), NAME(mk_constant_turn)};
            const TYPE(mk_function) function = moves ? motions[kind - SENSORS] : NAME(sensors)[kind].function;
            const void *const context = moves ? (const void *)motion : (const void *)&site;
            const REAL dt = moves ? (REAL)0.75 : (REAL)0.0;
            together[COUNT * rows] = (REAL)12345.0;
            assert_int_equal(function(context, dt, COUNT, x, together), MK_OK);
            for (int point = 0; point < COUNT; point++)
                assert_int_equal(function(context, dt, 1, x + point * n, alone + point * rows), MK_OK);
            assert_memory_equal(together, alone, sizeof(REAL) * (size_t)(COUNT * rows));
            assert_true(together[COUNT * rows] == (REAL)12345.0);
            assert_int_equal(function(context, dt, 0, x, together), MK_OK);
            if (moves) continue;
            REAL kept[MOST];
            memcpy(kept, x + (COUNT - 1) * n, sizeof(REAL) * (size_t)n);
            x[(COUNT - 1) * n + motion->position[0]] = (REAL)NAN;
            assert_int_equal(function(context, dt, COUNT, x, together), MK_ERROR_NOT_FINITE);
            memcpy(x + (COUNT - 1) * n, kept, sizeof(REAL) * (size_t)n);
        }
    }
}

/* Angles the short way round, ranges as they are; the result may stand where an argument stood. */
static void NAME(differences)(void **unused) {
    (void)unused;
    for (int layout = 0; layout < LAYOUTS; layout++) {
        const mk_motion_t *const motion = &layouts[layout];
        const REAL a[] = {(REAL)100.0, (REAL)3.0, (REAL)-3.0}, b[] = {(REAL)1.0, (REAL)-3.0, (REAL)2.5};
        const long double expected[] = {99.0L, 6.0L - 2.0L * acosl(-1.0L), -5.5L + 2.0L * acosl(-1.0L)};
        REAL d[] = {(REAL)12345.0, (REAL)12345.0, (REAL)12345.0};
        NAME(mk_range_bearing_difference)(motion, a, b, d);
        for (int row = 0; row < motion->dimensions; row++) NAME(near)(1.0L, d[row], expected[row], "difference");
        if (motion->dimensions == 2) assert_true(d[2] == (REAL)12345.0);
        memcpy(d, a, sizeof d);
        NAME(mk_bearing_difference)(motion, d + 1, b + 1, d + 1);
        for (int row = 1; row < motion->dimensions; row++) NAME(near)(1.0L, d[row], expected[row], "difference");
        assert_true(d[0] == (REAL)100.0 && (motion->dimensions == 3 || d[2] == a[2]));
        d[0] = (REAL)0.5;
        NAME(mk_bearing_difference)(motion, d, d, d);
        assert_true(d[0] == (REAL)0.0);
    }
}
