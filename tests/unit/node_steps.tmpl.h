/* SPDX-License-Identifier: MIT */

#define OWN (BITS == 64 ? 1 : 0)

DECLARE(V(alone), PRECISION, 3, 2, 1);

/* A frame of a neighbour (slots 1 to 3 are nodes 11 to 13), with numbers that follow from slot and step. */
static mk_status_t V(from)(V(bench_t) * b, int slot, int stage, uint32_t step) {
    wire_t wire;
    double values[N];
    for (int i = 0; i < N; i++) values[i] = (double)(float)sin(0.37 * step + slot + 2.0 * i + stage);
    wire_plain(&wire, stage, OWN, 0, 10u + (unsigned)slot, MODEL, step, stage == 2 ? N : b->rows[slot], values);
    return V(give)(b, wire.bytes, wire.length);
}

static void V(all_from)(V(bench_t) * b, int stage, uint32_t step, mk_status_t status) {
    for (int l = 1; l < SLOTS; l++) assert_int_equal(V(from)(b, l, stage, step), status);
}

static void V(same_filter)(const UNIT(t) * a, const UNIT(filter_t) * f) {
    assert_memory_equal(a->filter.x, f->x, sizeof f->x);
    assert_memory_equal(a->filter.W, f->W, sizeof f->W);
}

/* One stage ahead is kept, and gives the bits that it gives on time. */
static void V(early)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    V(bench_start)(&a, 10, 11, 12, 13);
    V(bench_start)(&b, 10, 11, 12, 13);
    V(all_from)(&b, 1, 0, MK_OK);
    for (uint32_t t = 0; t < 50; t++) {
        V(all_from)(&a, 1, t, MK_OK);
        V(all_from)(&b, 2, t, MK_OK);
        assert_int_equal(UNIT(incremental)(&a.node), MK_OK);
        assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
        V(all_from)(&a, 2, t, MK_OK);
        V(all_from)(&b, 1, t + 1, MK_OK);
        assert_int_equal(UNIT(diffuse)(&a.node), MK_OK);
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        V(same_filter)(&a.node, &b.node.filter);
        assert_int_equal(a.node.filter.core.measurements, 3);
        assert_int_equal(b.node.filter.core.measurements, 3);
        assert_int_equal(b.node.filter.core.estimates, 4);
        assert_int_equal(b.node.node.step, t + 1);
    }
    assert_int_equal(a.node.node.early, 0);
    assert_int_equal(b.node.node.early, 300);
}

/* Late frames are dropped: the step is that of a node that never heard them. */
static void V(late)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    V(bench_start)(&a, 10, 11, 12, 13);
    V(bench_start)(&b, 10, 11, 12, 13);
    for (uint32_t t = 0; t < 20; t++) {
        assert_int_equal(V(from)(&a, 1, 1, t), MK_OK);
        assert_int_equal(V(from)(&b, 1, 1, t), MK_OK);
        V(all_from)(&b, 2, t - 1, MK_ERROR_LATE);
        assert_int_equal(UNIT(incremental)(&a.node), MK_OK);
        assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
        V(all_from)(&b, 1, t, MK_ERROR_LATE);
        assert_int_equal(UNIT(diffuse)(&a.node), MK_OK);
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        V(same_filter)(&a.node, &b.node.filter);
    }
    assert_int_equal(b.node.node.counts[MK_ERROR_LATE], 120);
    assert_int_equal(b.node.node.step, 20);
}

/* d steps of sleep: up to catch_up they are predictions, beyond the node starts anew. */
static void V(slept)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(filter_t) plain;
    for (uint32_t d = 1; d <= 8; d++) {
        V(bench_start)(&b, 10, 11, 12, 13);
        assert_int_equal(UNIT(filter_start)(&plain, &b.config.filter), MK_OK);
        for (uint32_t t = 0; t < 4; t++) {
            V(step)(&b);
            assert_int_equal(UNIT(filter_incremental)(&plain, NULL), MK_OK);
            assert_int_equal(UNIT(filter_diffuse)(&plain), MK_OK);
        }
        /* The others are in step 4 + d, this node still in 4. */
        V(all_from)(&b, 1, 4 + d, MK_ERROR_AHEAD);
        assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
        V(all_from)(&b, 2, 4 + d, MK_ERROR_AHEAD);
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        assert_int_equal(b.node.node.step, 5 + d);
        if (d <= b.config.catch_up) {
            for (uint32_t t = 0; t < d + 1; t++) {
                assert_int_equal(UNIT(filter_incremental)(&plain, NULL), MK_OK);
                assert_int_equal(UNIT(filter_diffuse)(&plain), MK_OK);
            }
            assert_int_equal(b.node.node.caught_up, d);
            assert_int_equal(b.node.node.restarts, 0);
            assert_int_equal(b.node.filter.core.steps, 5 + d);
        } else {
            assert_int_equal(UNIT(filter_start)(&plain, &b.config.filter), MK_OK);
            assert_int_equal(b.node.node.caught_up, 0);
            assert_int_equal(b.node.node.restarts, 1);
        }
        V(same_filter)(&b.node, &plain);
        assert_int_equal(b.node.node.behind, 0);
        /* And is one of them. */
        V(all_from)(&b, 1, 5 + d, MK_OK);
        assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
        V(all_from)(&b, 2, 5 + d, MK_OK);
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        assert_int_equal(b.node.node.step, 6 + d);
    }
}

static void V(rebooted)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    V(bench_start)(&b, 10, 11, 12, 13);
    /* In the order in which they stand the lowest is neither first nor last; the newest frame of each counts. */
    assert_int_equal(V(from)(&b, 1, 2, 1005), MK_ERROR_AHEAD);
    assert_int_equal(V(from)(&b, 2, 2, 1001), MK_ERROR_AHEAD);
    assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
    assert_int_equal(V(from)(&b, 2, 1, 1003), MK_ERROR_AHEAD);
    assert_int_equal(V(from)(&b, 2, 2, 1000), MK_ERROR_AHEAD);
    assert_int_equal(V(from)(&b, 3, 1, 1004), MK_ERROR_AHEAD);
    assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
    assert_int_equal(b.node.node.step, 1003);
    assert_int_equal(b.node.node.restarts, 1);
    assert_memory_equal(b.node.filter.x, b.x0, sizeof b.x0);
}

/* lead[l]: steps that a neighbour claims to be ahead, -1: not heard, 0: in step. */
static uint32_t V(after)(int first, int second, int third) {
    static V(bench_t) b;
    const int lead[SLOTS] = {0, first, second, third};
    V(bench_start)(&b, 10, 11, 12, 13);
    for (int l = 1; l < SLOTS; l++)
        if (lead[l] >= 0) assert_int_equal(V(from)(&b, l, 2, (uint32_t)lead[l]), lead[l] ? MK_ERROR_AHEAD : MK_OK);
    V(step)(&b);
    for (int i = 0; i < N; i++) assert_true(isfinite(b.node.filter.x[i]));
    return b.node.node.step;
}

static void V(majority)(void **unused) {
    (void)unused;
    assert_int_equal(V(after)(0, 0, 0), 1);
    assert_int_equal(V(after)(-1, -1, -1), 1);
    assert_int_equal(V(after)(100, 0, 0), 1);
    assert_int_equal(V(after)(100, 0, -1), 101);
    assert_int_equal(V(after)(100, 0, 90), 91);
    assert_int_equal(V(after)(100, 110, 90), 91);
    assert_int_equal(V(after)(0x7ffffff0, 20, 20), 21);
    assert_int_equal(V(after)(0x7ffffff0, 0, 0), 1);
    /* One neighbour alone is believed. */
    assert_int_equal(V(after)(100, -1, -1), 101);
    /* Their estimate of the next step: the node goes on to 1, they to 2, and it must, too. */
    assert_int_equal(V(after)(1, 1, 1), 2);
}

/* No neighbour at all. */
static void V(alone)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static JOIN(V(alone), _t) node;
    static JOIN(V(alone), _filter_t) plain;
    uint8_t bytes[JOIN(V(alone), _frame_max)];
    wire_t wire;
    const double psi[N] = {0.0};
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.filter.slots = 1;
    b.weight[0] = (REAL)1.0;
    assert_int_equal(JOIN(V(alone), _start)(&node, &b.config), MK_OK);
    assert_int_equal(JOIN(V(alone), _filter_start)(&plain, &b.config.filter), MK_OK);
    for (uint32_t t = 0; t < 50; t++) {
        const REAL y[M] = {(REAL)sin(0.1 * t), (REAL)1.0};
        assert_int_equal(JOIN(V(alone), _measure)(&node, y), MK_OK);
        assert_int_equal(JOIN(V(alone), _filter_put_measurement)(&plain, 0, y), MK_OK);
        assert_true(JOIN(V(alone), _frame)(&node, 1, bytes) > 0);
        wire_plain(&wire, 2, OWN, 0, 11, MODEL, t + 100, N, psi);
        assert_int_equal(JOIN(V(alone), _accept)(&node, wire.bytes, wire.length), MK_ERROR_STRANGER);
        assert_int_equal(JOIN(V(alone), _incremental)(&node), MK_OK);
        assert_int_equal(JOIN(V(alone), _filter_incremental)(&plain, NULL), MK_OK);
        assert_int_equal(JOIN(V(alone), _diffuse)(&node), MK_OK);
        assert_int_equal(JOIN(V(alone), _filter_diffuse)(&plain), MK_OK);
        assert_memory_equal(node.filter.x, plain.x, sizeof plain.x);
        assert_int_equal(node.node.step, t + 1);
        assert_int_equal(node.filter.core.faults, 0);
    }
}

static void V(application_advances)(void **unused) {
    (void)unused;
    static V(bench_t) b, before;
    static UNIT(filter_t) plain;
    V(bench_start)(&b, 10, 11, 12, 13);
    V(step)(&b);
    memcpy(&before, &b, sizeof b);
    assert_int_equal(UNIT(advance)(&b.node, 1), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(advance)(&b.node, 0), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(advance)(&b.node, 0x80000001u), MK_ERROR_ARGUMENT);
    assert_memory_equal(&before, &b, sizeof b);
    /* What was kept for the next step is used there, as without the sleep. */
    assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
    V(all_from)(&b, 1, 2, MK_OK);
    memcpy(&before, &b, sizeof b);
    assert_int_equal(UNIT(advance)(&b.node, 5), MK_ERROR_ORDER);
    assert_memory_equal(&before, &b, sizeof b);
    assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
    plain = b.node.filter;
    for (int t = 0; t < 3; t++) {
        assert_int_equal(UNIT(filter_incremental)(&plain, NULL), MK_OK);
        assert_int_equal(UNIT(filter_diffuse)(&plain), MK_OK);
    }
    assert_int_equal(UNIT(advance)(&b.node, 5), MK_OK);
    V(same_filter)(&b.node, &plain);
    assert_int_equal(b.node.node.step, 5);
    assert_int_equal(b.node.node.caught_up, 3);
    assert_int_equal(UNIT(advance)(&b.node, 10), MK_OK);
    assert_int_equal(b.node.node.restarts, 0);
    assert_int_equal(UNIT(advance)(&b.node, 16), MK_OK);
    assert_int_equal(b.node.node.restarts, 1);
    assert_int_equal(UNIT(advance)(&b.node, 0x8000000fu), MK_OK);
    assert_int_equal(b.node.node.step, 0x8000000fu);
    assert_memory_equal(b.node.filter.x, b.x0, sizeof b.x0);
    /* Neighbours that were ahead before the application went past them are not ahead any more. */
    V(all_from)(&b, 2, 0x8000002fu, MK_ERROR_AHEAD);
    assert_int_equal(UNIT(advance)(&b.node, 0x80000040u), MK_OK);
    V(step)(&b);
    assert_int_equal(b.node.node.step, 0x80000041u);
}

/* A model that runs away while steps are made up for: the steps before the error are done, the estimate is finite. */
static void V(error_in_catching_up)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    const REAL bad[2] = {BITS == 32 ? (REAL)1e8 : (REAL)1e55, (REAL)NAN}, good = (REAL)0.5;
    for (int by_application = 0; by_application < 2; by_application++) {
        for (int i = 0; i < 2; i++) {
            /* What overflows now and then is made up for; what never can be computed is an error, with the steps before it done. */
            V(bench_start)(&b, 10, 11, 12, 13);
            if (!by_application) {
                V(all_from)(&b, 2, 4, MK_ERROR_AHEAD);
                assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
            }
            b.A[0] = bad[i];
            const mk_status_t status = by_application ? UNIT(advance)(&b.node, 5) : UNIT(diffuse)(&b.node);
            assert_int_equal(status == MK_OK, i == 0);
            assert_int_equal(b.node.node.step, i == 0 ? 5 : !by_application);
            assert_true(b.node.node.reinitialised > 0);
            assert_int_equal(b.node.filter.core.stage, 1);
            assert_int_equal(b.node.filter.core.steps, b.node.node.step);
            for (int j = 0; j < N; j++) assert_true(isfinite(b.node.filter.x[j]));
            b.A[0] = good;
            const uint32_t step = b.node.node.step;
            assert_int_equal(UNIT(restart)(&b.node, b.x0, b.P0), MK_OK);
            V(all_from)(&b, 1, step, MK_OK);
            V(step)(&b);
            assert_int_equal(b.node.node.step, step + 1);
        }
    }
}

/* One of three ahead, for a while: not followed at once, but in the end. */
static void V(left_behind)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    V(bench_start)(&b, 10, 11, 12, 13);
    for (uint32_t t = 0; t < MK_NODE_LEFT_BEHIND; t++) {
        assert_int_equal(b.node.node.step, t);
        assert_int_equal(V(from)(&b, 1, 1, 10 + t), MK_ERROR_AHEAD);
        assert_int_equal(V(from)(&b, 2, 1, t), MK_OK);
        assert_int_equal(V(from)(&b, 3, 1, t), MK_OK);
        V(step)(&b);
    }
    assert_int_equal(b.node.node.step, 10 + MK_NODE_LEFT_BEHIND);
    /* Steps in which nobody was ahead begin the count anew; those in which nobody was heard do not. */
    V(bench_start)(&b, 10, 11, 12, 13);
    for (uint32_t t = 0; t < 30; t++) {
        if (t % 3) assert_int_equal(V(from)(&b, 1, 1, 100 + t), MK_ERROR_AHEAD);
        assert_int_equal(V(from)(&b, 2, 1, t), MK_OK);
        assert_int_equal(V(from)(&b, 3, 1, t), MK_OK);
        V(step)(&b);
    }
    assert_int_equal(b.node.node.step, 30);
    assert_int_equal(b.node.node.left_behind, 2);
    V(step)(&b);
    assert_int_equal(b.node.node.left_behind, 2);
}

/* A node goes on where a step is impossible: as from P0, without the readings; where estimates overflow, without them. */
static void V(goes_on)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(filter_t) plain;
    const REAL most = BITS == 32 ? (REAL)FLT_MAX : (REAL)DBL_MAX;
    const REAL huge[M] = {most, -most};
    V(bench_start)(&b, 10, 11, 12, 13);
    for (int t = 0; t < 3; t++) V(step)(&b);
    assert_int_equal(UNIT(filter_start)(&plain, &b.config.filter), MK_OK);
    assert_int_equal(UNIT(filter_restart)(&plain, b.node.filter.x, b.P0), MK_OK);
    for (int i = 0; i < M * N; i++) b.F[i] *= (REAL)1e4;
    assert_int_equal(UNIT(measure)(&b.node, huge), MK_OK);
    assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
    assert_int_equal(b.node.node.reinitialised, 1);
    assert_int_equal(b.node.filter.core.measurements, 0);
    assert_int_equal(UNIT(filter_incremental)(&plain, NULL), MK_OK);
    assert_memory_equal(plain.psi, b.node.filter.psi, N * sizeof(REAL));
    assert_memory_equal(plain.W, b.node.filter.W, sizeof plain.W);

    for (int l = 0; l < SLOTS; l++) b.weight[l] = (REAL)0.4;
    for (int l = 1; l < SLOTS; l++) {
        wire_t wire;
        double values[N];
        for (int i = 0; i < N; i++) values[i] = (double)most;
        wire_plain(&wire, 2, OWN, 0, 10u + (unsigned)l, MODEL, b.node.node.step, N, values);
        assert_int_equal(V(give)(&b, wire.bytes, wire.length), MK_OK);
    }
    assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
    assert_int_equal(UNIT(filter_diffuse)(&plain), MK_OK);
    V(same_filter)(&b.node, &plain);
    assert_int_equal(b.node.node.counts[MK_ERROR_IMPLAUSIBLE], SLOTS - 1);
    assert_int_equal(b.node.node.step, 4);
}

/* Long silence: the robust covariance grows until this precision cannot hold it. */
static void V(silence)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.filter.tolerance = (REAL)1.0;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    for (uint32_t t = 0; t < 20000; t++) {
        V(step)(&b);
        assert_int_equal(b.node.node.step, t + 1);
    }
    for (int i = 0; i < N; i++) assert_true(isfinite(b.node.filter.x[i]));
    assert_true(b.node.node.reinitialised > 0);
}

/* A step that fails or is called out of turn leaves everything as it was. */
static void V(failed_step)(void **unused) {
    (void)unused;
    static V(bench_t) b, before;
    const REAL input[N] = {(REAL)0.0, (REAL)NAN, (REAL)0.0};
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.gate = &b.gate;
    b.threshold[1] = b.threshold[2] = (REAL)1e-6;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    memcpy(&before, &b, sizeof b);
    assert_int_equal(UNIT(diffuse)(&b.node), MK_ERROR_ORDER);
    assert_int_equal(UNIT(incremental_with)(&b.node, input), MK_ERROR_NOT_FINITE);
    assert_memory_equal(&before, &b, sizeof b);
    V(all_from)(&b, 1, 0, MK_OK);
    assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
    assert_int_equal(b.node.node.gated, 2);
    memcpy(&before, &b, sizeof b);
    assert_int_equal(UNIT(incremental)(&b.node), MK_ERROR_ORDER);
    assert_memory_equal(&before, &b, sizeof b);
    assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
}

#undef OWN
