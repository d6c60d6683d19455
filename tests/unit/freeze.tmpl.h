/* SPDX-License-Identifier: MIT */
/* The contract of the frozen gain in one REAL; test_contract.c includes this once for each. */

typedef struct {
    TYPE(bench) b;
    TYPE(mk_rkfd_steady) steady;
    REAL Phi[4], G[12], W[3];
} TYPE(cold);

static void NAME(put_all)(TYPE(cold) * f, REAL value) {
    const REAL y[] = {value, value};
    for (int l = 0; l < 3; l++) assert_int_equal(TINY(put_measurement)(&f->b.filter, l, y), MK_OK);
}

/* A filter that has started, with a steady part of the right W and a gain that shows: psi = x / 2 + r + y_0 / 4. */
static void NAME(cold_start)(TYPE(cold) * f) {
    memset(f, 0, sizeof *f);
    NAME(bench_start)(&f->b);
    for (int t = 0; t < 200; t++) {
        NAME(put_all)(f, (REAL)0.0);
        assert_int_equal(TINY(incremental)(&f->b.filter, NULL), MK_OK);
        assert_int_equal(TINY(diffuse)(&f->b.filter), MK_OK);
    }
    memcpy(f->W, f->b.filter.W, sizeof f->W);
    f->Phi[0] = f->Phi[3] = (REAL)0.5;
    f->G[0] = f->G[3] = (REAL)0.25;
    f->steady.Phi = f->Phi;
    f->steady.G = f->G;
    f->steady.W = f->W;
    f->steady.theta = (REAL)0.125;
    f->steady.trace_P = (REAL)3.0;
    f->steady.close = (REAL)1e-4;
    f->steady.period = 1000;
    f->b.config.steady = &f->steady;
    assert_int_equal(TINY(start)(&f->b.filter, &f->b.config), MK_OK);
}

/* The same, frozen, before an incremental step. */
static void NAME(frozen_start)(TYPE(cold) * f) {
    NAME(cold_start)(f);
    for (int t = 0; !f->b.filter.core.frozen; t++) {
        assert_true(t < 200);
        NAME(put_all)(f, (REAL)0.0);
        assert_int_equal(TINY(incremental)(&f->b.filter, NULL), MK_OK);
        assert_int_equal(TINY(diffuse)(&f->b.filter), MK_OK);
    }
}

static void NAME(steady_statuses)(void **unused) {
    (void)unused;
    TYPE(cold) f;
#define SPOIL(change, status)                                                                                                  \
    do {                                                                                                                       \
        NAME(cold_start)(&f);                                                                                                  \
        change;                                                                                                                \
        REFUSED(&f.b, TINY(start)(&f.b.filter, &f.b.config), status);                                                          \
    } while (0)
    SPOIL(f.steady.Phi = NULL, MK_ERROR_ARGUMENT);
    SPOIL(f.steady.G = NULL, MK_ERROR_ARGUMENT);
    SPOIL(f.steady.W = NULL, MK_ERROR_ARGUMENT);
    SPOIL(f.steady.period = 0, MK_ERROR_ARGUMENT);
    SPOIL(f.steady.close = (REAL)0.0, MK_ERROR_ARGUMENT);
    SPOIL(f.steady.close = (REAL)-1e-4, MK_ERROR_ARGUMENT);
    SPOIL(f.steady.theta = (REAL)-0.125, MK_ERROR_ARGUMENT);
    SPOIL(f.W[1] = (REAL)1e3, MK_ERROR_NOT_POSITIVE_DEFINITE);
    for (int k = 0; k < SPOILS; k++) {
        const REAL bad = NAME(spoil)[k];
        SPOIL(f.Phi[3] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(f.G[11] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(f.W[2] = bad, MK_ERROR_NOT_FINITE);
        SPOIL(f.steady.theta = bad, MK_ERROR_NOT_FINITE);
        SPOIL(f.steady.trace_P = bad, MK_ERROR_NOT_FINITE);
        SPOIL(f.steady.close = bad, MK_ERROR_NOT_FINITE);
    }
#undef SPOIL
}

/* What the stored gain says is what comes out, in the order of slots and rows; input as in a full step. */
static void NAME(frozen_gain)(void **unused) {
    (void)unused;
    TYPE(cold) f;
    const REAL input[] = {(REAL)3.0, (REAL)4.0};
    NAME(frozen_start)(&f);
    f.b.filter.x[0] = (REAL)2.0;
    f.b.filter.x[1] = (REAL)-4.0;
    NAME(put_all)(&f, (REAL)16.0);
    assert_int_equal(TINY(incremental)(&f.b.filter, NULL), MK_OK);
    assert_true(TINY(intermediate)(&f.b.filter)[0] == (REAL)5.5 && TINY(intermediate)(&f.b.filter)[1] == (REAL)2.0);
    assert_true(f.b.filter.core.theta == (REAL)0.125 && f.b.filter.core.trace_P == (REAL)3.0);
    assert_int_equal(TINY(diffuse)(&f.b.filter), MK_OK);
    assert_true(TINY(estimate)(&f.b.filter)[0] == (REAL)5.5);
    for (int l = 0; l < 3; l++)
        for (int r = 0; r < 2; r++) {
            memset(f.G, 0, sizeof f.G);
            f.G[(l * 2 + r) * 2 + 1] = (REAL)1.0;
            f.b.filter.x[0] = f.b.filter.x[1] = (REAL)0.0;
            for (int k = 0; k < 3; k++) {
                const REAL y[] = {(REAL)(10 * k + 1), (REAL)(10 * k + 2)};
                assert_int_equal(TINY(put_measurement)(&f.b.filter, k, y), MK_OK);
            }
            assert_int_equal(TINY(incremental)(&f.b.filter, input), MK_OK);
            /* The second row of slot 1 has no sensor. */
            const REAL expected = l == 1 && r == 1 ? (REAL)4.0 : (REAL)(4 + 10 * l + 1 + r);
            assert_true(TINY(intermediate)(&f.b.filter)[0] == (REAL)3.0 && TINY(intermediate)(&f.b.filter)[1] == expected);
            assert_true(f.b.filter.core.frozen == 1);
            assert_int_equal(TINY(diffuse)(&f.b.filter), MK_OK);
        }
    /* Without any input. */
    f.b.config.input = NULL;
    NAME(put_all)(&f, (REAL)0.0);
    f.b.filter.x[0] = (REAL)8.0;
    assert_int_equal(TINY(incremental)(&f.b.filter, NULL), MK_OK);
    assert_true(TINY(intermediate)(&f.b.filter)[0] == (REAL)4.0);
}

static void NAME(frozen_failures)(void **unused) {
    (void)unused;
    TYPE(cold) f;
    const REAL largest = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MAX : (REAL)DBL_MAX;
    NAME(frozen_start)(&f);
    for (int k = 0; k < SPOILS; k++) {
        const REAL input[] = {(REAL)0.0, NAME(spoil)[k]};
        NAME(put_all)(&f, (REAL)1.0);
        REFUSED(&f.b, TINY(incremental)(&f.b.filter, input), MK_ERROR_NOT_FINITE);
        /* The readings are still there, and the mode. */
        assert_int_equal(TINY(incremental)(&f.b.filter, NULL), MK_OK);
        assert_true(f.b.filter.core.frozen == 1);
        REFUSED(&f.b, TINY(incremental)(&f.b.filter, NULL), MK_ERROR_ORDER);
        assert_int_equal(TINY(diffuse)(&f.b.filter), MK_OK);
    }
    /* Overflow of a product, and none where only the test's own sum would overflow. */
    f.b.filter.x[0] = f.b.filter.x[1] = largest;
    NAME(put_all)(&f, (REAL)0.0);
    f.Phi[0] = (REAL)2.0;
    REFUSED(&f.b, TINY(incremental)(&f.b.filter, NULL), MK_ERROR_NOT_FINITE);
    f.Phi[0] = f.Phi[3] = (REAL)0.75;
    assert_int_equal(TINY(incremental)(&f.b.filter, NULL), MK_OK);
    assert_true(TINY(intermediate)(&f.b.filter)[0] == (REAL)0.75 * largest && f.b.filter.core.frozen == 1);
}

/* A reading that was refused and then came again leaves the mode alone, and is told. A copy goes on as the filter itself. */
static void NAME(frozen_faults)(void **unused) {
    (void)unused;
    TYPE(cold) f, copy;
    const REAL bad[] = {NAME(spoil)[0], NAME(spoil)[0]};
    NAME(frozen_start)(&f);
    COUNTED(&f.b, TINY(put_measurement)(&f.b.filter, 1, bad), MK_ERROR_NOT_FINITE);
    NAME(put_all)(&f, (REAL)1.0);
    COUNTED(&f.b, TINY(put_measurement)(&f.b.filter, 1, bad + 1), MK_ERROR_NOT_FINITE);
    memcpy(&copy, &f, sizeof f);
    assert_int_equal(TINY(incremental)(&f.b.filter, NULL), MK_OK);
    assert_int_equal(TINY(incremental)(&copy.b.filter, NULL), MK_OK);
    assert_memory_equal(&copy.b.filter, &f.b.filter, sizeof f.b.filter);
    assert_true(f.b.filter.core.frozen == 1 && f.b.filter.core.faults == MK_FAULT_REJECTED && f.b.filter.core.rejected == 2);
    assert_int_equal(TINY(diffuse)(&f.b.filter), MK_OK);
    assert_int_equal(f.b.filter.core.faults, MK_FAULT_REJECTED | MK_FAULT_ESTIMATE_MISSING);
    NAME(put_all)(&f, (REAL)1.0);
    assert_int_equal(TINY(incremental)(&f.b.filter, NULL), MK_OK);
    assert_true(f.b.filter.core.frozen == 1 && f.b.filter.core.faults == 0);
}
#undef SPOILS
