/* SPDX-License-Identifier: MIT */
/* Steps that fail and the ways back, in one REAL; test_contract.c includes this once for each. */

/* After a failed incremental step the readings are still there: with the cause gone the step gives what it would have given. */
static void NAME(failed_incremental)(void **unused) {
    (void)unused;
    TYPE(bench) b, fresh;
    const REAL two[] = {(REAL)1.0, (REAL)2.0}, bad_input[] = {(REAL)0.0, (REAL)NAN}, endless[] = {(REAL)HUGE_VAL, (REAL)0.0};
    const REAL most = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MAX : (REAL)DBL_MAX;
    NAME(bench_start)(&b);
    NAME(bench_start)(&fresh);
    for (int l = 0; l < 2; l++) {
        assert_int_equal(TINY(put_measurement)(&b.filter, l, two), MK_OK);
        assert_int_equal(TINY(put_measurement)(&fresh.filter, l, two), MK_OK);
    }
    REFUSED(&b, TINY(incremental)(&b.filter, bad_input), MK_ERROR_NOT_FINITE);
    REFUSED(&b, TINY(incremental)(&b.filter, endless), MK_ERROR_NOT_FINITE);

    const REAL kept_A = b.A[0], kept_S = b.S[0], kept_Q = b.Q[0];
    b.A[0] = most; /* A V A' overflows */
    TYPE(tiny) before;
    memcpy(&before, &b.filter, sizeof before);
    assert_true(TINY(incremental)(&b.filter, NULL) != MK_OK);
    assert_memory_equal(&before, &b.filter, sizeof before);
    b.A[0] = kept_A;
    b.S[0] = (REAL)-100.0; /* W + S loses definiteness */
    REFUSED(&b, TINY(incremental)(&b.filter, NULL), MK_ERROR_NOT_POSITIVE_DEFINITE);
    b.S[0] = kept_S;
    b.Q[0] = (REAL)-100.0; /* P does */
    REFUSED(&b, TINY(incremental)(&b.filter, NULL), MK_ERROR_NOT_POSITIVE_DEFINITE);
    b.Q[0] = kept_Q;

    assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
    assert_int_equal(TINY(incremental)(&fresh.filter, NULL), MK_OK);
    b.filter.core.config = fresh.filter.core.config;
    assert_memory_equal(&b.filter, &fresh.filter, sizeof b.filter);
}

/* A tolerance whose root cannot be told from the pole of gamma. */
static void NAME(tolerance_without_root)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    NAME(bench_start)(&b);
    assert_int_equal(TINY(set_tolerance)(&b.filter, (REAL)1e30), MK_OK);
    REFUSED(&b, TINY(incremental)(&b.filter, NULL), MK_ERROR_TOLERANCE);
    assert_int_equal(TINY(set_tolerance)(&b.filter, (REAL)0.02), MK_OK);
    assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
}

static void NAME(restart)(void **unused) {
    (void)unused;
    TYPE(bench) b, fresh;
    const REAL two[] = {(REAL)1.0, (REAL)2.0};
    const REAL indefinite[] = {(REAL)1.0, (REAL)2.0, (REAL)1.0};
    NAME(bench_start)(&b);
    NAME(bench_start)(&fresh);
    for (int step = 0; step < 5; step++) {
        assert_int_equal(TINY(put_measurement)(&b.filter, 0, two), MK_OK);
        assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
        if (step < 4) assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
    }
    assert_int_equal(TINY(put_estimate)(&b.filter, 1, two), MK_OK);
    REFUSED(&b, TINY(restart)(&b.filter, NULL, b.P0), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(restart)(&b.filter, b.x0, NULL), MK_ERROR_ARGUMENT);
    REFUSED(&b, TINY(restart)(&b.filter, b.x0, indefinite), MK_ERROR_NOT_POSITIVE_DEFINITE);
    const REAL spoil[] = {(REAL)NAN, (REAL)HUGE_VAL, (REAL)-HUGE_VAL};
    for (int k = 0; k < 3; k++) {
        const REAL bad_x[] = {(REAL)1.0, spoil[k]}, bad_P[] = {(REAL)1.0, (REAL)0.0, spoil[k]};
        REFUSED(&b, TINY(restart)(&b.filter, bad_x, b.P0), MK_ERROR_NOT_FINITE);
        REFUSED(&b, TINY(restart)(&b.filter, b.x0, bad_P), MK_ERROR_NOT_FINITE);
    }
    /* Smaller than the reciprocal of the largest number: its inverse is not finite. */
    const REAL least = sizeof(REAL) == sizeof(float) ? (REAL)1e-40 : (REAL)1e-310;
    const REAL vanishing[] = {least, (REAL)0.0, least};
    TYPE(tiny) before;
    memcpy(&before, &b.filter, sizeof before);
    assert_true(TINY(restart)(&b.filter, b.x0, vanishing) != MK_OK);
    assert_memory_equal(&before, &b.filter, sizeof before);

    /* In the middle of a step: the step is dropped, the counters stay, and what follows is what a fresh filter does. */
    assert_int_equal(TINY(restart)(&b.filter, b.x0, b.P0), MK_OK);
    assert_true(b.filter.core.steps == 4 && b.filter.core.stage == 1);
    for (int step = 0; step < 3; step++) {
        assert_int_equal(TINY(put_measurement)(&b.filter, 1, two), MK_OK);
        assert_int_equal(TINY(put_measurement)(&fresh.filter, 1, two), MK_OK);
        assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
        assert_int_equal(TINY(incremental)(&fresh.filter, NULL), MK_OK);
        assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
        assert_int_equal(TINY(diffuse)(&fresh.filter), MK_OK);
        assert_memory_equal(b.filter.x, fresh.filter.x, sizeof b.filter.x);
        assert_memory_equal(b.filter.W, fresh.filter.W, sizeof b.filter.W);
        assert_true(b.filter.core.estimates == fresh.filter.core.estimates);
    }
    /* Readings of the dropped step are gone too. */
    assert_int_equal(TINY(put_measurement)(&b.filter, 0, two), MK_OK);
    assert_int_equal(TINY(restart)(&b.filter, b.x0, b.P0), MK_OK);
    assert_int_equal(TINY(put_measurement)(&b.filter, 0, two), MK_OK);
}

/* The way back from a failure that does not go away: a covariance beyond the precision. */
static void NAME(restart_after_failure)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    NAME(bench_start)(&b);
    b.A[0] = (REAL)16.0;
    int failed = 0;
    for (int step = 0; step < 2000 && !failed; step++) {
        const mk_status_t status = TINY(incremental)(&b.filter, NULL);
        if (status == MK_OK) assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
        else failed = 1;
        for (int i = 0; i < 2; i++) assert_true(isfinite(b.filter.x[i]));
        for (int i = 0; i < 3; i++) assert_true(isfinite(b.filter.W[i]));
    }
    assert_true(failed);
    TYPE(tiny) before;
    memcpy(&before, &b.filter, sizeof before);
    assert_true(TINY(incremental)(&b.filter, NULL) != MK_OK);
    assert_memory_equal(&before, &b.filter, sizeof before);
    assert_int_equal(TINY(restart)(&b.filter, b.x0, b.P0), MK_OK);
    assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
    assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
}

/* Nothing in an object points into it: a copy made in the middle of a step goes on alone. */
static void NAME(moved)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    const REAL two[] = {(REAL)1.0, (REAL)2.0};
    NAME(bench_start)(&b);
    assert_int_equal(TINY(put_measurement)(&b.filter, 0, two), MK_OK);
    TYPE(tiny) copy;
    memcpy(&copy, &b.filter, sizeof copy);
    assert_int_equal(TINY(incremental)(&copy, NULL), MK_OK);
    assert_int_equal(TINY(put_estimate)(&copy, 1, two), MK_OK);
    assert_true(b.filter.core.stage == 1);
    TYPE(tiny) *const far = malloc(sizeof *far);
    memcpy(far, &copy, sizeof copy);
    memset(&copy, 0xee, sizeof copy);
    assert_int_equal(TINY(diffuse)(far), MK_OK);
    assert_int_equal(TINY(incremental)(&b.filter, NULL), MK_OK);
    assert_int_equal(TINY(put_estimate)(&b.filter, 1, two), MK_OK);
    assert_int_equal(TINY(diffuse)(&b.filter), MK_OK);
    assert_memory_equal(far, &b.filter, sizeof *far);
    free(far);
}

/* r from the argument, from the configuration, and null in both for zero. */
static void NAME(input)(void **unused) {
    (void)unused;
    TYPE(bench) b[4];
    const REAL zero[] = {(REAL)0.0, (REAL)0.0}, r[] = {(REAL)0.5, (REAL)0.0};
    const REAL *const input[] = {NULL, r, NULL, zero};
    for (int k = 0; k < 4; k++) {
        NAME(bench_start)(&b[k]);
        if (k == 2) b[k].config.input = NULL;
        assert_int_equal(TINY(start)(&b[k].filter, &b[k].config), MK_OK);
        assert_int_equal(TINY(incremental)(&b[k].filter, input[k]), MK_OK);
    }
    const size_t size = sizeof b[0].filter.psi;
    assert_memory_equal(b[0].filter.psi, b[1].filter.psi, size);
    assert_memory_equal(b[2].filter.psi, b[3].filter.psi, size);
    /* psi = A x0 + r: x0 = [1 -2], A = [1 1/8; 0 3/4] */
    assert_true(TINY(intermediate)(&b[0].filter)[0] == (REAL)1.25 && TINY(intermediate)(&b[0].filter)[1] == (REAL)-1.5);
    assert_true(TINY(intermediate)(&b[2].filter)[0] == (REAL)0.75 && TINY(intermediate)(&b[2].filter)[1] == (REAL)-1.5);
}
