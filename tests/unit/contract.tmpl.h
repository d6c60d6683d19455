/* SPDX-License-Identifier: MIT */
/* The contract of <meshkal/rkfd.h> in one REAL; test_contract.c includes this once for each. */

#define SPOILS 3
static const REAL NAME(spoil)[SPOILS] = {(REAL)NAN, (REAL)HUGE_VAL, (REAL)-HUGE_VAL};

static void NAME(sensor_statuses)(void **unused) {
    (void)unused;
    const REAL C[] = {(REAL)1.0, (REAL)2.0, (REAL)0.0, (REAL)1.0}, R[] = {(REAL)1.0, (REAL)0.5, (REAL)1.0};
    REAL F[4], S[3], R_inverse[3], work[9];
    memset(F, 0x55, sizeof F);
    memset(S, 0x55, sizeof S);
    memset(R_inverse, 0x55, sizeof R_inverse);
    const REAL untouched = F[0];
#define SENSOR(n, rows, C, R, F, S, R_inverse, work, status)                                                                   \
    do {                                                                                                                       \
        assert_int_equal(NAME(mk_rkfd_sensor)(n, 2, rows, C, R, F, S, R_inverse, work), status);                               \
        for (int i = 0; i < 3; i++) assert_true(outputs[0][i] == untouched && outputs[1][i] == untouched && outputs[2][i] == untouched); \
    } while (0)
    const REAL *const outputs[] = {F, S, R_inverse};
    SENSOR(2, 2, NULL, R, F, S, R_inverse, work, MK_ERROR_ARGUMENT);
    SENSOR(2, 2, C, NULL, F, S, R_inverse, work, MK_ERROR_ARGUMENT);
    SENSOR(2, 2, C, R, NULL, S, R_inverse, work, MK_ERROR_ARGUMENT);
    SENSOR(2, 2, C, R, F, NULL, R_inverse, work, MK_ERROR_ARGUMENT);
    SENSOR(2, 2, C, R, F, S, NULL, work, MK_ERROR_ARGUMENT);
    SENSOR(2, 2, C, R, F, S, R_inverse, NULL, MK_ERROR_ARGUMENT);
    SENSOR(0, 2, C, R, F, S, R_inverse, work, MK_ERROR_ARGUMENT);
    SENSOR(2, 3, C, R, F, S, R_inverse, work, MK_ERROR_ARGUMENT);
    SENSOR(2, -1, C, R, F, S, R_inverse, work, MK_ERROR_ARGUMENT);
    const REAL singular[] = {(REAL)1.0, (REAL)1.0, (REAL)1.0}, negative[] = {(REAL)-1.0, (REAL)0.0, (REAL)1.0};
    SENSOR(2, 2, C, singular, F, S, R_inverse, work, MK_ERROR_NOT_POSITIVE_DEFINITE);
    SENSOR(2, 2, C, negative, F, S, R_inverse, work, MK_ERROR_NOT_POSITIVE_DEFINITE);
    for (int k = 0; k < SPOILS; k++) {
        REAL bad_C[] = {(REAL)1.0, (REAL)2.0, (REAL)0.0, NAME(spoil)[k]}, bad_R[] = {(REAL)1.0, NAME(spoil)[k], (REAL)1.0};
        SENSOR(2, 2, bad_C, R, F, S, R_inverse, work, MK_ERROR_NOT_FINITE);
        SENSOR(2, 2, C, bad_R, F, S, R_inverse, work, MK_ERROR_NOT_FINITE);
        /* Beyond the rows R is not read. */
        const REAL row[] = {(REAL)1.0, (REAL)2.0, (REAL)0.0, (REAL)0.0};
        assert_int_equal(NAME(mk_rkfd_sensor)(2, 2, 1, row, bad_R, F, S, R_inverse, work), MK_OK);
        assert_true(F[0] == (REAL)1.0 && F[1] == (REAL)2.0 && F[2] == (REAL)0.0 && F[3] == (REAL)0.0);
        assert_true(S[0] == (REAL)1.0 && S[1] == (REAL)2.0 && S[2] == (REAL)4.0);
        assert_true(R_inverse[0] == (REAL)1.0 && R_inverse[1] == (REAL)0.0 && R_inverse[2] == (REAL)0.0);
        for (int i = 0; i < 4; i++) F[i] = untouched;
        for (int i = 0; i < 3; i++) S[i] = R_inverse[i] = untouched;
    }
    const REAL none[] = {(REAL)0.0, (REAL)0.0, (REAL)0.0, (REAL)0.0};
    assert_int_equal(NAME(mk_rkfd_sensor)(2, 2, 0, none, R, F, S, R_inverse, work), MK_OK);
    for (int i = 0; i < 3; i++) assert_true(F[i] == (REAL)0.0 && S[i] == (REAL)0.0 && R_inverse[i] == (REAL)0.0);
#undef SENSOR
}

static void NAME(start_statuses)(void **unused) {
    (void)unused;
    TYPE(bench) good, b;
    NAME(bench_start)(&good);
    /* The object's bytes are arbitrary before start and must still be there after a failure. */
    memset(&good.filter, 0xa5, sizeof good.filter);
#define SPOIL(change, status)                                                                                                  \
    do {                                                                                                                       \
        memcpy(&b, &good, sizeof b);                                                                                           \
        TYPE(mk_rkfd_config) config = {2,   2,   3,   b.A, b.Q, b.r,         b.x0,        b.P0, b.weight,                      \
                                       b.rows, b.C, b.F, b.S, b.R_inverse, (REAL)0.02, NULL};                                  \
        change;                                                                                                                \
        REFUSED(&b, TINY(start)(&b.filter, &config), status);                                                                  \
    } while (0)
    memcpy(&b, &good, sizeof b);
    REFUSED(&b, TINY(start)(&b.filter, NULL), MK_ERROR_ARGUMENT);
    SPOIL(config.n = 3, MK_ERROR_SHAPE);
    SPOIL(config.n = 1, MK_ERROR_SHAPE);
    SPOIL(config.m = 1, MK_ERROR_SHAPE);
    SPOIL(config.slots = 2, MK_ERROR_SHAPE);
    SPOIL(config.slots = 0, MK_ERROR_SHAPE);
    SPOIL(config.A = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.Q = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.x0 = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.P0 = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.weight = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.rows = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.C = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.F = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.S = NULL, MK_ERROR_ARGUMENT);
    SPOIL(config.R_inverse = NULL, MK_ERROR_ARGUMENT);
    SPOIL(b.weight[1] = (REAL)-0.25, MK_ERROR_ARGUMENT);
    SPOIL(b.rows[2] = 3, MK_ERROR_ARGUMENT);
    SPOIL(b.P0[1] = (REAL)8.0, MK_ERROR_NOT_POSITIVE_DEFINITE);
    SPOIL(b.P0[0] = (REAL)-2.0, MK_ERROR_NOT_POSITIVE_DEFINITE);
    SPOIL(b.P0[2] = (REAL)0.0, MK_ERROR_NOT_POSITIVE_DEFINITE);
    SPOIL(memset(b.P0, 0, sizeof b.P0), MK_ERROR_NOT_POSITIVE_DEFINITE);
    SPOIL(config.tolerance = (REAL)-1e-9, MK_ERROR_TOLERANCE);
    for (int k = 0; k < SPOILS; k++) {
        const REAL bad = NAME(spoil)[k];
        SPOIL(config.tolerance = bad, MK_ERROR_TOLERANCE);
        SPOIL(b.A[3] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.Q[2] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.r[1] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.x0[1] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.P0[2] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.P0[1] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.weight[2] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.C[11] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.F[11] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.S[8] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(b.R_inverse[8] = bad, MK_ERROR_NOT_FINITE);
    }
    /* The shared kernel knows its dimensions at run time only and must look at them. */
    REAL work[MK_RKFD_WORK(2, 2)];
    const TYPE(mk_rkfd_view) view = TINY(view)(&b.filter, work);
    REFUSED(&b, NAME(mk_rkfd_start)(0, 2, 3, &view, &b.config), MK_ERROR_ARGUMENT);
    REFUSED(&b, NAME(mk_rkfd_start)(2, 0, 3, &view, &b.config), MK_ERROR_ARGUMENT);
    REFUSED(&b, NAME(mk_rkfd_start)(2, 2, 0, &view, &b.config), MK_ERROR_ARGUMENT);
    /* And a second start wipes everything. */
    assert_int_equal(TINY(start)(&b.filter, &good.config), MK_OK);
    assert_true(b.filter.core.stage == 1 && b.filter.core.steps == 0 && b.filter.core.rejected == 0);
    assert_true(b.filter.core.tolerance == (REAL)0.02 && b.filter.core.config == &good.config);
    assert_true(TINY(estimate)(&b.filter)[0] == (REAL)1.0 && TINY(estimate)(&b.filter)[1] == (REAL)-2.0);
#undef SPOIL
}

/* Every call in every stage: before start (all zero), before the incremental step, before the diffusion. */
static void NAME(call_order)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    const REAL two[] = {(REAL)1.0, (REAL)2.0};
    REAL V[3], e[2], E[3], r[6], S[21];
    uint8_t counts[3];
    NAME(bench_start)(&b);
    memset(&b.filter, 0, sizeof b.filter);
    REFUSED(&b, TINY(put_measurement)(&b.filter, 0, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(put_innovation)(&b.filter, 0, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(incremental)(&b.filter, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(put_estimate)(&b.filter, 1, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(diffuse)(&b.filter), MK_ERROR_ORDER);
    REFUSED(&b, TINY(covariance)(&b.filter, V), MK_ERROR_ORDER);
    REFUSED(&b, TINY(predict)(&b.filter, 0, e, E), MK_ERROR_ORDER);
    REFUSED(&b, TINY(innovations)(&b.filter, r, S, counts), MK_ERROR_ORDER);
    REFUSED(&b, TINY(drop)(&b.filter, 0), MK_ERROR_ORDER);

    NAME(bench_start)(&b);
    REFUSED(&b, TINY(put_estimate)(&b.filter, 1, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(diffuse)(&b.filter), MK_ERROR_ORDER);
    REFUSED(&b, TINY(covariance)(&b.filter, V), MK_OK);
    assert_int_equal(TINY(put_measurement)(&b.filter, 0, two), MK_OK);
    REFUSED(&b, TINY(predict)(&b.filter, 0, e, E), MK_OK);
    REFUSED(&b, TINY(innovations)(&b.filter, r, S, counts), MK_OK);
    assert_true(counts[0] == 2 && counts[1] == 0 && counts[2] == 0 && r[0] == e[0] && r[1] == e[1] && S[0] == E[0] && S[1] == E[1] && S[2] == E[2]);
    REFUSED(&b, TINY(innovations)(&b.filter, NULL, S, counts), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(innovations)(&b.filter, r, NULL, counts), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(innovations)(&b.filter, r, S, NULL), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(drop)(&b.filter, 3), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(drop)(&b.filter, -1), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(drop)(&b.filter, 1), MK_OK);
    assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);

    REFUSED(&b, TINY(put_measurement)(&b.filter, 1, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(put_innovation)(&b.filter, 1, two), MK_ERROR_ORDER);
    REFUSED(&b, TINY(incremental)(&b.filter, NULL), MK_ERROR_ORDER);
    REFUSED(&b, TINY(predict)(&b.filter, 0, e, E), MK_ERROR_ORDER);
    REFUSED(&b, TINY(innovations)(&b.filter, r, S, counts), MK_ERROR_ORDER);
    REFUSED(&b, TINY(drop)(&b.filter, 0), MK_ERROR_ORDER);
    REFUSED(&b, TINY(covariance)(&b.filter, V), MK_OK);
    assert_true(b.filter.core.steps == 0);
    assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
    assert_true(b.filter.core.steps == 1);
    REFUSED(&b, TINY(diffuse)(&b.filter), MK_ERROR_ORDER);
}

/* A filter that never started has no configuration: restart cannot make one of it. */
static void NAME(restart_before_start)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    NAME(bench_start)(&b);
    memset(&b.filter, 0, sizeof b.filter);
    REFUSED(&b, TINY(restart)(&b.filter, b.x0, b.P0), MK_ERROR_ORDER);
}

static void NAME(put_statuses)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    const REAL two[] = {(REAL)1.0, (REAL)2.0}, other[] = {(REAL)3.0, (REAL)4.0};
    NAME(bench_start)(&b);
    COUNTED(&b, TINY(put_measurement)(&b.filter, 0, NULL), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_innovation)(&b.filter, 0, NULL), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_measurement)(&b.filter, -1, two), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_measurement)(&b.filter, 3, two), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_measurement)(&b.filter, 70000, two), MK_ERROR_ARGUMENT);
    for (int k = 0; k < SPOILS; k++) {
        const REAL bad[] = {(REAL)1.0, NAME(spoil)[k]};
        COUNTED(&b, TINY(put_measurement)(&b.filter, 0, bad), MK_ERROR_NOT_FINITE);
        COUNTED(&b, TINY(put_innovation)(&b.filter, 2, bad), MK_ERROR_NOT_FINITE);
    }
    /* Slot 1 has one row: a buffer of one number is enough, what stands behind it is nobody's business. */
    const REAL bad_behind[] = {(REAL)1.0, (REAL)NAN};
    assert_int_equal(TINY(put_measurement)(&b.filter, 1, bad_behind), MK_OK);
    REAL *const one = malloc(sizeof *one);
    *one = (REAL)1.0;
    COUNTED(&b, TINY(put_measurement)(&b.filter, 1, one), MK_ERROR_REPEATED);
    free(one);
    assert_int_equal(TINY(put_innovation)(&b.filter, 0, two), MK_OK);
    COUNTED(&b, TINY(put_measurement)(&b.filter, 0, other), MK_ERROR_REPEATED);
    COUNTED(&b, TINY(put_innovation)(&b.filter, 0, two), MK_ERROR_REPEATED);
    assert_true(b.filter.core.rejected == 14);
    assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
    assert_true(b.filter.core.faults == (MK_FAULT_REJECTED | MK_FAULT_MEASUREMENT_MISSING));

    COUNTED(&b, TINY(put_estimate)(&b.filter, 1, NULL), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_estimate)(&b.filter, 0, two), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_estimate)(&b.filter, -1, two), MK_ERROR_ARGUMENT);
    COUNTED(&b, TINY(put_estimate)(&b.filter, 3, two), MK_ERROR_ARGUMENT);
    for (int k = 0; k < SPOILS; k++) {
        const REAL bad[] = {(REAL)1.0, NAME(spoil)[k]};
        COUNTED(&b, TINY(put_estimate)(&b.filter, 2, bad), MK_ERROR_NOT_FINITE);
    }
    assert_int_equal(TINY(put_estimate)(&b.filter, 2, two), MK_OK);
    COUNTED(&b, TINY(put_estimate)(&b.filter, 2, other), MK_ERROR_REPEATED);
    assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
    assert_true(b.filter.core.rejected == 22 && b.filter.core.estimates == 2);
    assert_true(b.filter.core.faults == (MK_FAULT_REJECTED | MK_FAULT_MEASUREMENT_MISSING | MK_FAULT_ESTIMATE_MISSING));
}

/* Faults and counters belong to the last step and start afresh with the next. */
static void NAME(faults)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    const REAL two[] = {(REAL)1.0, (REAL)2.0};
    NAME(bench_start)(&b);
    for (unsigned step = 0; step < 64; step++) {
        const unsigned y = step & 7u, psi = step >> 3 & 3u, refused = step >> 5 & 1u;
        const uint32_t silent = b.filter.core.steps_since_measurement;
        for (int l = 0; l < 3; l++)
            if (y >> l & 1u) assert_int_equal(TINY(put_measurement)(&b.filter, l, two), MK_OK);
        assert_int_equal(TINY(incremental)(&b.filter, two), MK_OK);
        const unsigned incremental = (y != 7u ? MK_FAULT_MEASUREMENT_MISSING : 0u) | (y ? 0u : MK_FAULT_NO_MEASUREMENT);
        assert_int_equal(b.filter.core.faults, incremental);
        assert_int_equal(b.filter.core.measurements, (y & 1u) + (y >> 1 & 1u) + (y >> 2));
        assert_int_equal(b.filter.core.nis_rows, 2u * (y & 1u) + (y >> 1 & 1u) + 2u * (y >> 2));
        assert_int_equal(b.filter.core.steps_since_measurement, y ? 0u : silent + 1u);
        for (int l = 1; l < 3; l++)
            if (psi >> (l - 1) & 1u) assert_int_equal(TINY(put_estimate)(&b.filter, l, two), MK_OK);
        if (refused) assert_int_equal(TINY(put_estimate)(&b.filter, 5, two), MK_ERROR_ARGUMENT);
        assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
        assert_int_equal(b.filter.core.faults, incremental | (psi != 3u ? MK_FAULT_ESTIMATE_MISSING : 0u) |
                                                   (refused ? MK_FAULT_REJECTED : 0u));
        assert_int_equal(b.filter.core.estimates, 1u + (psi & 1u) + (psi >> 1));
        assert_int_equal(b.filter.core.steps, step + 1u);
    }
}

static void NAME(tolerance_and_queries)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    const REAL two[] = {(REAL)1.0, (REAL)2.0};
    REAL V[3] = {(REAL)7.0, (REAL)7.0, (REAL)7.0}, e[2] = {(REAL)7.0, (REAL)7.0}, E[3] = {(REAL)7.0, (REAL)7.0, (REAL)7.0};
    NAME(bench_start)(&b);
    REFUSED(&b, TINY(set_tolerance)(&b.filter, (REAL)-1e-9), MK_ERROR_TOLERANCE);
    for (int k = 0; k < SPOILS; k++) REFUSED(&b, TINY(set_tolerance)(&b.filter, NAME(spoil)[k]), MK_ERROR_TOLERANCE);
    assert_int_equal(TINY(set_tolerance)(&b.filter, (REAL)0.5), MK_OK);
    assert_true(b.filter.core.tolerance == (REAL)0.5);
    assert_int_equal(TINY(set_tolerance)(&b.filter, (REAL)0.0), MK_OK);

    REFUSED(&b, TINY(covariance)(&b.filter, NULL), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(predict)(&b.filter, 0, e, E), MK_ERROR_ARGUMENT);
    assert_int_equal(TINY(put_measurement)(&b.filter, 1, two), MK_OK);
    REFUSED(&b, TINY(predict)(&b.filter, 1, NULL, E), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(predict)(&b.filter, 1, e, NULL), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(predict)(&b.filter, -1, e, E), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(predict)(&b.filter, 3, e, E), MK_ERROR_ARGUMENT);
    assert_true(e[0] == (REAL)7.0 && E[0] == (REAL)7.0 && E[2] == (REAL)7.0 && V[0] == (REAL)7.0);
    REFUSED(&b, TINY(predict)(&b.filter, 1, e, E), MK_OK);
    /* y = 1, C = [1 0], x = [1 -2], V = P0, R = 1 */
    assert_true(fabs((double)e[0]) < 1e-6 && fabs((double)E[0] - 3.0) < 1e-5);
    assert_true(e[1] == (REAL)0.0 && E[1] == (REAL)0.0 && E[2] == (REAL)0.0);
    assert_int_equal(TINY(covariance)(&b.filter, V), MK_OK);
    assert_true(fabs((double)V[0] - 2.0) < 1e-5 && fabs((double)V[1] - 0.5) < 1e-5 && fabs((double)V[2] - 1.0) < 1e-5);
}

