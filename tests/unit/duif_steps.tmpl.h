/* SPDX-License-Identifier: MIT */
/* The bench of duif_frames.tmpl.h: a node that is behind, hostile numbers, calls out of turn. */

/* The same with three neighbours. */
MK_DUIF_OF(NAME(wide), PRECISION, 2, 1, 4);
#define WIDE(function) JOIN(NAME(wide), _##function)

typedef struct {
    NAME(bench_t) bench;
    uint16_t nodes[4], degree[4];
    WIDE(config_t) config;
    WIDE(t) node;
} NAME(wide_bench_t);

static void NAME(wide_start)(NAME(wide_bench_t) * w) {
    NAME(bench_make)(&w->bench, MK_CONSENSUS_METROPOLIS, 1);
    w->config = w->bench.config;
    for (int l = 0; l < 4; l++) {
        w->nodes[l] = (uint16_t)(10 + l);
        w->degree[l] = 3;
    }
    w->config.nodes = w->nodes;
    w->config.consensus.slots = 4;
    w->config.consensus.degree = w->degree;
    assert_int_equal(WIDE(start)(&w->node, &w->config), MK_OK);
}

/* A node that slept or was rebooted. Neighbour 11 is `lead` steps ahead and sends one frame a step; 12 is silent. */
static void NAME(behind)(void **unused) {
    (void)unused;
    wire_t wire;
    for (uint32_t lead = 1; lead <= 9; lead++)
        for (unsigned iteration = 0; iteration < 3; iteration++)
            for (unsigned place = 0; place <= 4; place++) {
                static NAME(bench_t) b, c;
                NAME(bench_start)(&b, MK_CONSENSUS_METROPOLIS, 3);
                NAME(bench_start)(&c, MK_CONSENSUS_METROPOLIS, 3);
                wire_consensus(&wire, OWN, 0, 11, MODEL, lead, iteration, 5, NAME(seven));
                const unsigned now = place == 0 ? 0 : place - 1, ahead = 3 * lead + iteration - now;
                if (ahead < 2) continue;
                if (place == 0) NAME(refused)(&b, wire.bytes, wire.length, MK_ERROR_AHEAD, 1);
                NAME(contribute)(&b, 0);
                for (unsigned l = 0; l < 3; l++) {
                    if (place == 1 + l) NAME(refused)(&b, wire.bytes, wire.length, MK_ERROR_AHEAD, 1);
                    assert_int_equal(UNIT(iterate)(&b.node), MK_OK);
                }
                if (place == 4) { /* older ones before and after it change nothing */
                    wire_t older;
                    wire_consensus(&older, OWN, 0, 11, MODEL, lead - 1, iteration, 5, NAME(seven));
                    if (ahead >= 5) NAME(refused)(&b, older.bytes, older.length, MK_ERROR_AHEAD, 1);
                    NAME(refused)(&b, wire.bytes, wire.length, MK_ERROR_AHEAD, 1);
                    if (ahead >= 5) NAME(refused)(&b, older.bytes, older.length, MK_ERROR_AHEAD, 1);
                }
                assert_int_equal(UNIT(fuse)(&b.node), MK_OK);
                /* It was `ahead` iterations ahead all the time: so many whole steps are to be made up for. */
                const uint32_t steps = ahead / 3;
                assert_int_equal(b.node.core.step, 1 + steps);
                assert_int_equal(b.node.core.behind, 0);
                assert_int_equal(b.node.core.caught_up, steps <= 4 ? steps : 0);
                assert_int_equal(b.node.core.restarts, steps > 4);
                for (uint32_t t = 0; t < (steps <= 4 ? 1 + steps : 0); t++) assert_int_equal(UNIT(predict)(&c.node, 1, NULL), MK_OK);
                assert_memory_equal(b.node.filter.x, c.node.filter.x, sizeof b.node.filter.x);
                assert_memory_equal(b.node.filter.L, c.node.filter.L, sizeof b.node.filter.L);
                /* It goes on in step with the neighbour. */
                NAME(contribute)(&b, 1);
                const unsigned left = ahead % 3;
                wire_consensus(&wire, OWN, 0, 11, MODEL, 1 + steps, left, 5, NAME(seven));
                for (unsigned l = 0; l < left; l++) assert_int_equal(UNIT(iterate)(&b.node), MK_OK);
                assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
            }
    /* One of three neighbours runs ahead: it is followed in the fourth step in a row, not before. */
    static NAME(wide_bench_t) w;
    NAME(wide_start)(&w);
    for (uint32_t t = 0; t < 4; t++) {
        assert_int_equal(WIDE(predict)(&w.node, 1, NULL), MK_OK);
        assert_int_equal(WIDE(contribute)(&w.node), MK_OK);
        for (unsigned node = 11; node <= 13; node++) {
            wire_consensus(&wire, OWN, 0, node, MODEL, node == 11 ? t + 2 : t, 0, 5, NAME(seven));
            assert_int_equal(WIDE(accept)(&w.node, wire.bytes, wire.length), node == 11 ? MK_ERROR_AHEAD : MK_OK);
        }
        assert_int_equal(WIDE(iterate)(&w.node), MK_OK);
        assert_int_equal(WIDE(fuse)(&w.node), MK_OK);
        assert_int_equal(w.node.core.step, t < 3 ? t + 1 : 6);
    }
    /* advance: what it is for, and against. */
    static NAME(bench_t) b;
    NAME(bench_start)(&b, MK_CONSENSUS_METROPOLIS, 3);
    assert_int_equal(UNIT(advance)(&b.node, 0), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(advance)(&b.node, 0x80000000u), MK_ERROR_ARGUMENT);
    NAME(contribute)(&b, 0);
    assert_int_equal(UNIT(advance)(&b.node, 5), MK_ERROR_ORDER);
    NAME(finish)(&b);
    const REAL z[1] = {5};
    assert_int_equal(UNIT(measure)(&b.node, z), MK_OK);
    wire_consensus(&wire, OWN, 0, 11, MODEL, 1, 0, 5, NAME(seven)); /* for a step that is passed over */
    assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
    assert_int_equal(UNIT(advance)(&b.node, 3), MK_OK);
    wire_consensus(&wire, OWN, 0, 11, MODEL, 3, 0, 5, NAME(seven));
    assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
    assert_int_equal(b.node.core.step, 3);
    assert_int_equal(b.node.core.caught_up, 2);
    assert_int_equal(UNIT(measure)(&b.node, z), MK_OK); /* the reading was of another step, and went */
    assert_int_equal(UNIT(advance)(&b.node, 0x80000002u), MK_OK);
    assert_true(b.node.filter.x[0] == b.x0[0]);
    assert_int_equal(b.node.core.restarts, 1);
    /* A reboot in the middle of a step of its own. */
    NAME(contribute)(&b, 1);
    assert_int_equal(UNIT(restart)(&b.node, b.x0, b.P0), MK_OK);
    assert_int_equal(b.node.core.step, 0x80000002u);
    NAME(contribute)(&b, 1);
    NAME(finish)(&b);
    assert_int_equal(b.node.core.step, 0x80000003u);
}

/* Neighbours send what no honest one sends. The node goes on, and says so. */
static void NAME(hostile)(void **unused) {
    (void)unused;
    static NAME(bench_t) b, c;
    wire_t wire;
    const double largest = BITS == 64 ? DBL_MAX : (double)FLT_MAX;
    for (int protocol = 0; protocol < MK_CONSENSUS_COUNT; protocol++)
        for (int kind = 0; kind < 4; kind++) {
            const int count = protocol == MK_CONSENSUS_SUM ? 7 : protocol == MK_CONSENSUS_PERRON || protocol == MK_CONSENSUS_RATIO ? 6 : 5;
            double values[7] = {0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0};
            if (kind == 0) values[0] = values[1] = largest;             /* s */
            if (kind == 1) values[3] = largest;                         /* S indefinite */
            if (kind == 2) values[2] = values[4] = largest / 4.0;       /* trace */
            if (kind == 3) values[3] = 50.0, values[5] = values[6] = protocol == MK_CONSENSUS_SUM ? largest : 1.0;
            NAME(bench_start)(&b, protocol, 1);
            NAME(bench_start)(&c, protocol, 1);
            assert_int_equal(UNIT(predict)(&c.node, 1, NULL), MK_OK);
            NAME(contribute)(&b, 1);
            for (unsigned node = 11; node <= 12; node++) {
                wire_consensus(&wire, OWN, (unsigned)protocol, node, MODEL, 0, 0, count, values);
                assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
            }
            NAME(finish)(&b);
            assert_int_equal(b.node.core.step, 1);
            const int fused = !(b.node.core.flags & MK_DUIF_UNFUSED);
            if (!fused) { /* the prediction, untouched */
                assert_int_equal(b.node.core.unfused, 1);
                assert_memory_equal(b.node.filter.x, c.node.filter.x, sizeof c.node.filter.x);
                assert_memory_equal(b.node.filter.L, c.node.filter.L, sizeof c.node.filter.L);
            }
            if (kind == 1) assert_int_equal(fused, protocol == MK_CONSENSUS_RATIO || protocol == MK_CONSENSUS_SUM ? fused : 0);
            if (kind == 0 && protocol == MK_CONSENSUS_SUM) { /* the sum overflows: both are left out */
                assert_int_equal(b.node.core.counts[MK_ERROR_IMPLAUSIBLE], 2);
                assert_int_equal(b.node.core.heard, 0);
                assert_int_equal(fused, 1);
            }
            for (int k = 0; k < 2; k++) assert_true(fabs((double)b.node.filter.x[k]) <= largest);
            /* And the next step is one as any other. */
            NAME(contribute)(&b, 1);
            NAME(finish)(&b);
            assert_int_equal(b.node.core.flags, MK_DUIF_ISOLATED | MK_DUIF_MISSING);
        }
}

/* A running sum that overflows in the middle of a step costs this node what it holds; what comes later is an average again. */
static void NAME(overflow)(void **unused) {
    (void)unused;
    static NAME(bench_t) b;
    wire_t wire;
    const double largest = BITS == 64 ? DBL_MAX : (double)FLT_MAX;
    NAME(bench_start)(&b, MK_CONSENSUS_RATIO, 3);
    NAME(contribute)(&b, 1);
    for (unsigned l = 0; l < 3; l++) {
        double values[6] = {l == 1 ? largest : 2.0 * (l + 1), 1.0, l + 1.0, 0.0, l + 1.0, l == 2 ? 1.5 : l + 1.0};
        for (unsigned node = 11; node <= (l == 2 ? 11u : 12u); node++) {
            wire_consensus(&wire, OWN, MK_CONSENSUS_RATIO, node, MODEL, 0, l, 6, values);
            assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
        }
        assert_int_equal(UNIT(iterate)(&b.node), MK_OK);
    }
    assert_int_equal(b.node.core.counts[MK_ERROR_IMPLAUSIBLE], 2);
    assert_true(fabs((double)b.node.consensus.next[0] - 6.0) < 1e-5 && fabs((double)b.node.consensus.next[5] - 1.5) < 1e-5);
    assert_int_equal(UNIT(fuse)(&b.node), MK_OK);
    assert_int_equal(b.node.core.flags, MK_DUIF_MISSING);
}

/* Calls out of turn, and what a model or a configuration may get wrong. */
static void NAME(turns)(void **unused) {
    (void)unused;
    static NAME(bench_t) b;
    static UNIT(t) before;
    uint8_t bytes[UNIT(frame_max)];
    const REAL z[1] = {5}, nan[1] = {(REAL)NAN}, bad[2] = {(REAL)NAN, 0};
    REAL P[3];
    wire_t wire;
#define UNCHANGED(call, status)                                                                                               \
    do {                                                                                                                      \
        memcpy(&before, &b.node, sizeof before);                                                                              \
        assert_int_equal(call, status);                                                                                       \
        assert_memory_equal(&before, &b.node, sizeof before);                                                                 \
    } while (0)
    NAME(bench_make)(&b, MK_CONSENSUS_METROPOLIS, 3);
    wire_consensus(&wire, OWN, 0, 11, MODEL, 0, 0, 5, NAME(seven));
    UNCHANGED(UNIT(predict)(&b.node, 1, NULL), MK_ERROR_ORDER);
    UNCHANGED(UNIT(measure)(&b.node, z), MK_ERROR_ORDER);
    UNCHANGED(UNIT(drop)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(contribute)(&b.node), MK_ERROR_ORDER);
    UNCHANGED((mk_status_t)UNIT(frame)(&b.node, bytes), MK_OK);
    UNCHANGED(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_ERROR_ORDER);
    UNCHANGED(UNIT(iterate)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(fuse)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(advance)(&b.node, 3), MK_ERROR_ORDER);
    UNCHANGED(UNIT(restart)(&b.node, b.x0, b.P0), MK_ERROR_ORDER);
    UNCHANGED(UNIT(covariance)(&b.node, P), MK_ERROR_ORDER);
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    UNCHANGED(UNIT(iterate)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(fuse)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(restart)(&b.node, bad, b.P0), MK_ERROR_NOT_FINITE);
    const REAL indefinite[3] = {1, 2, 1}, undefined[3] = {(REAL)NAN, 0, 1};
    assert_int_equal(UNIT(measure)(&b.node, z), MK_OK);
    UNCHANGED(UNIT(predict)(&b.node, 1, indefinite), MK_ERROR_NOT_POSITIVE_DEFINITE);
    UNCHANGED(UNIT(predict)(&b.node, 1, undefined), MK_ERROR_NOT_FINITE);
    UNCHANGED(UNIT(predict)(&b.node, (REAL)-1.0, NULL), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(drop)(&b.node), MK_OK);
    /* Out of the precision's range: P first, then x. */
    const REAL huge = BITS == 64 ? (REAL)1e300 : (REAL)1e38;
    b.node.filter.L[0] = huge;
    assert_int_equal(UNIT(predict)(&b.node, 1, NULL), MK_OK);
    assert_true(b.node.filter.x[0] == (REAL)4.5 && b.node.core.reinitialised == 1);
    b.node.filter.x[0] = b.node.filter.x[1] = 3 * huge;
    if (BITS == 64) b.node.filter.x[0] = b.node.filter.x[1] = (REAL)1.7e308;
    assert_int_equal(UNIT(predict)(&b.node, 1, NULL), MK_OK);
    assert_true(b.node.filter.x[0] == (REAL)4.5 && b.node.core.reinitialised == 2);
    assert_int_equal(UNIT(measure)(&b.node, nan), MK_ERROR_NOT_FINITE);
    NAME(contribute)(&b, 1);
    UNCHANGED(UNIT(predict)(&b.node, 1, NULL), MK_ERROR_ORDER);
    UNCHANGED(UNIT(contribute)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(fuse)(&b.node), MK_ERROR_ORDER);
    assert_int_equal(UNIT(measure)(&b.node, z), MK_OK); /* for the next step */
    for (int l = 0; l < 3; l++) assert_int_equal(UNIT(iterate)(&b.node), MK_OK);
    UNCHANGED(UNIT(iterate)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(contribute)(&b.node), MK_ERROR_ORDER);
    UNCHANGED(UNIT(advance)(&b.node, 3), MK_ERROR_ORDER);
    assert_int_equal(UNIT(fuse)(&b.node), MK_OK);
    assert_true(UNIT(estimate)(&b.node) == b.node.filter.x && UNIT(root)(&b.node) == b.node.filter.L);
    assert_int_equal(UNIT(covariance)(&b.node, P), MK_OK);
    assert_int_equal(UNIT(measure)(&b.node, z), MK_ERROR_REPEATED);
    /* Outside the sensor's domain: named, nothing lost; without the reading it goes on. */
    b.node.filter.x[0] = (REAL)2e6;
    memcpy(&before, &b.node, sizeof before);
    assert_int_equal(UNIT(contribute)(&b.node), MK_ERROR_DOMAIN);
    before.filter.core.failed = 0;
    assert_memory_equal(&before, &b.node, sizeof before);
    assert_int_equal(UNIT(drop)(&b.node), MK_OK);
    assert_int_equal(UNIT(contribute)(&b.node), MK_OK);
    NAME(finish)(&b);
    assert_int_equal(b.node.core.flags, MK_DUIF_BLIND | MK_DUIF_MISSING | MK_DUIF_ISOLATED | MK_DUIF_UNINFORMED);
#define WRONG(change, status)                                                                                                 \
    do {                                                                                                                      \
        static NAME(bench_t) good;                                                                                            \
        memcpy(&good, &b, sizeof good);                                                                                       \
        change;                                                                                                               \
        UNCHANGED(UNIT(start)(&b.node, &b.config), status);                                                                   \
        memcpy(&b, &good, sizeof b);                                                                                          \
    } while (0)
    UNCHANGED(UNIT(start)(&b.node, NULL), MK_ERROR_ARGUMENT);
    WRONG(b.config.nodes = NULL, MK_ERROR_ARGUMENT);
    WRONG(b.nodes[2] = 10, MK_ERROR_ARGUMENT);
    WRONG(b.config.numbers = 3, MK_ERROR_ARGUMENT);
    if (BITS == 32) WRONG(b.config.numbers = MK_NUMBERS_F64, MK_ERROR_ARGUMENT);
    WRONG(b.config.limit = (REAL)-1.0, MK_ERROR_ARGUMENT);
    WRONG(b.config.limit = (REAL)NAN, MK_ERROR_ARGUMENT);
    WRONG(b.config.epsilon = (REAL)-1.0, MK_ERROR_ARGUMENT);
    WRONG(b.config.origin = bad, MK_ERROR_NOT_FINITE);
    WRONG(b.config.consensus.values = 6, MK_ERROR_SHAPE);
    WRONG(b.config.consensus.slots = 2, MK_ERROR_SHAPE);
    WRONG(b.config.consensus.degree = NULL, MK_ERROR_ARGUMENT);
    WRONG(b.config.filter.slots = 2, MK_ERROR_SHAPE);
    WRONG(b.config.filter.n = 3, MK_ERROR_SHAPE);
    WRONG(b.P0[0] = (REAL)-1.0, MK_ERROR_NOT_POSITIVE_DEFINITE);
#undef WRONG
#undef UNCHANGED
}

#undef OWN
#undef UNIT
#undef WIDE
