/* SPDX-License-Identifier: MIT */

#define OWN (BITS == 64 ? 1 : 0)

static const double V(three)[6] = {1.5, -2.25, 1024.0}, V(two)[M] = {-0.5, 3.75};

/* What a node sends is the format page, byte for byte. */
static void V(sent)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    uint8_t bytes[UNIT(frame_max)];
    wire_t wire;
    for (int format = 0; format <= 2; format++) {
        double psi[N];
        const REAL y[M] = {(REAL)-0.5, (REAL)3.75};
        if (BITS == 32 && format == 1) continue;
        V(bench_make)(&b, 0x1235, 12, 13, 14);
        b.config.numbers = (uint8_t)format;
        assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
        assert_int_equal(UNIT(frame)(&b.node, 1, bytes), 0);
        assert_int_equal(UNIT(frame)(&b.node, 2, bytes), 0);
        assert_int_equal(UNIT(measure)(&b.node, y), MK_OK);
        for (int i = 0; i < 2; i++) {
            wire_plain(&wire, 1, format, 0, 0x1235, MODEL, (uint32_t)i, 2, V(two));
            assert_int_equal(UNIT(frame)(&b.node, 1, bytes), wire.length);
            assert_memory_equal(bytes, wire.bytes, wire.length);
            assert_int_equal(UNIT(frame)(&b.node, 0, bytes) + UNIT(frame)(&b.node, 3, bytes), 0);
            assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
            /* Its own reading in stage 2 is for the next step, and its frame says so. */
            assert_int_equal(UNIT(frame)(&b.node, 1, bytes), 0);
            assert_int_equal(UNIT(measure)(&b.node, y), MK_OK);
            assert_int_equal(UNIT(measure)(&b.node, y), MK_ERROR_REPEATED);
            wire_plain(&wire, 1, format, 0, 0x1235, MODEL, (uint32_t)i + 1, 2, V(two));
            assert_int_equal(UNIT(frame)(&b.node, 1, bytes), wire.length);
            assert_memory_equal(bytes, wire.bytes, wire.length);
            for (int k = 0; k < N; k++) psi[k] = (double)UNIT(intermediate)(&b.node)[k];
            wire_plain(&wire, 2, format, 0, 0x1235, MODEL, (uint32_t)i, N, psi);
            for (int again = 0; again < 2; again++) {
                assert_int_equal(UNIT(frame)(&b.node, 2, bytes), wire.length);
                assert_memory_equal(bytes, wire.bytes, wire.length);
            }
            assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        }
        assert_int_equal(b.node.node.unsent, 0);
    }
    /* Beyond the format: not sent, and counted. */
    const REAL large[M] = {(REAL)1.0, (REAL)65520.0};
    b.config.numbers = 2;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    assert_int_equal(UNIT(measure)(&b.node, large), MK_OK);
    assert_int_equal(UNIT(frame)(&b.node, 1, bytes), 0);
    assert_int_equal(b.node.node.unsent, 1);
}

/* Each format, stage and neighbour: the numbers are where the filter looks for them. */
static void V(taken_numbers)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    wire_t wire;
    for (int format = 0; format <= 2; format++) {
        V(bench_start)(&b, 10, 11, 12, 13);
        for (int stage = 1; stage <= 2; stage++) {
            for (int l = 1; l < SLOTS; l++) {
                const int count = stage == 2 ? N : b.rows[l];
                const double *const values = stage == 2 ? V(three) : V(two);
                wire_plain(&wire, stage, format, 0, 10u + (unsigned)l, MODEL, 0, count, values);
                V(taken)(&b, wire.bytes, wire.length);
                for (int i = 0; i < count; i++)
                    assert_true((stage == 2 ? b.node.filter.psi[l * N + i] : b.node.filter.y[l * M + i]) == (REAL)values[i]);
                V(refused)(&b, wire.bytes, wire.length, MK_ERROR_REPEATED, 1);
            }
        }
        assert_int_equal(b.node.node.counts[MK_OK], 6);
        assert_int_equal(b.node.node.early, 3);
        V(step)(&b);
        assert_int_equal(b.node.filter.core.measurements, 3);
        assert_int_equal(b.node.filter.core.estimates, 4);
    }
}

static void V(truncated)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    wire_t wire;
    V(bench_start)(&b, 10, 11, 12, 13);
    for (int format = 0; format <= 2; format++) {
        for (int stage = 1; stage <= 2; stage++) {
            wire_plain(&wire, stage, format, 0, 12, MODEL, 0, stage == 2 ? N : 1, V(three));
            for (size_t length = 0; length < wire.length; length++) {
                V(refused)(&b, wire.bytes, length, length < MK_FRAME_PLAIN ? MK_ERROR_LENGTH : MK_ERROR_CHECKSUM, 0);
                uint8_t bytes[256];
                memcpy(bytes, wire.bytes, length);
                if (length < MK_FRAME_PLAIN) continue;
                wire_repair(bytes, length);
                V(refused)(&b, bytes, length, MK_ERROR_LENGTH, 0);
            }
        }
    }
    /* No bytes at all. */
    assert_int_equal(UNIT(accept)(&b.node, NULL, 40), MK_ERROR_ARGUMENT);
    assert_int_equal(b.node.node.counts[MK_ERROR_ARGUMENT], 1);
}

static void V(flipped)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    wire_t wire;
    V(bench_start)(&b, 10, 11, 12, 13);
    for (int stage = 1; stage <= 2; stage++) {
        wire_plain(&wire, stage, OWN, 0, 12, MODEL, 0, stage == 2 ? N : 1, V(three));
        for (size_t bit = 0; bit < 8 * wire.length; bit++) {
            wire.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
            const int looks_sealed = bit == 13;
            const mk_status_t status = bit < 8        ? MK_ERROR_VERSION
                                       : looks_sealed ? wire.length < MK_FRAME_SEALED ? MK_ERROR_LENGTH : MK_ERROR_SECURITY
                                                      : MK_ERROR_CHECKSUM;
            V(refused)(&b, wire.bytes, wire.length, status, 0);
            wire.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        }
        /* The frame itself was good. */
        V(taken)(&b, wire.bytes, wire.length);
    }
}

static void V(oversized)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static uint8_t bytes[70000];
    wire_t wire;
    const double many[60] = {0.0};
    V(bench_start)(&b, 10, 11, 12, 13);
    wire_begin(&wire, 1, 1u | OWN << 2, 12, MODEL, 0);
    memcpy(bytes, wire.bytes, wire.length);
    static const size_t lengths[] = {65535 + 16, 65536 + 16, 65536 + 20, 65536 + 24, 70000};
    for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++) {
        wire_repair(bytes, lengths[i]);
        V(refused)(&b, bytes, lengths[i], MK_ERROR_LENGTH, 0);
    }
    /* Of neighbours 11, 12, 13 with 2, 1 and 2 rows: each length but the right one. */
    for (unsigned node = 11; node <= 13; node++)
        for (int stage = 1; stage <= 2; stage++)
            for (int count = 0; count < 60; count++) {
                if (count == (stage == 2 ? N : node == 12 ? 1 : 2)) continue;
                wire_plain(&wire, stage, OWN, 0, node, MODEL, 0, count, many);
                V(refused)(&b, wire.bytes, wire.length, MK_ERROR_LENGTH, 0);
            }
}

static void V(each_cause)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    wire_t wire;
    V(bench_start)(&b, 10, 11, 14, 13);
    uint32_t calls = 0;
    for (int second = 0; second < 2; second++) {
#define BEGUN(version, type, node, model, step, count)                                                                        \
    (wire_begin(&wire, version, type, node, model, step), wire_numbers(&wire, OWN, count, V(three)), wire_crc(&wire), calls++)
#define IS_REFUSED(status, of_a_step) V(refused)(&b, wire.bytes, wire.length, status, of_a_step)
        const unsigned format = OWN << 2;
        for (int version = 0; version < 256; version++) {
            if (version == 1) continue;
            BEGUN(version, 2u | format, 11, MODEL, 0, N);
            IS_REFUSED(MK_ERROR_VERSION, 0);
        }
        /* Every type byte but the two that this node expects of that neighbour: stages 0 and 3, which is another object's, format 3, flags. */
        for (unsigned type = 0; type < 256; type++) {
            const unsigned stage = type & 3u, numbers = type >> 2 & 3u;
            if (stage >= 1 && stage <= 2 && numbers <= 2 && type < 16) continue;
            const int reserved = type >= 64 || stage == 0 || numbers == 3 || (type & 16u && stage >= 2);
            BEGUN(1, type, 11, MODEL, 0, 6);
            IS_REFUSED(type & 32u && !reserved ? MK_ERROR_SECURITY : MK_ERROR_TYPE, 0);
        }
        for (int bit = 0; bit < 32; bit++) {
            BEGUN(1, 2u | format, 11, MODEL ^ (uint32_t)1 << bit, 0, N);
            IS_REFUSED(MK_ERROR_MODEL, 0);
        }
        static const unsigned strangers[] = {0, 10, 12, 267, 65535}; /* 10: its own echo */
        for (size_t i = 0; i < sizeof strangers / sizeof *strangers; i++) {
            BEGUN(1, 2u | format, strangers[i], MODEL, 0, N);
            IS_REFUSED(MK_ERROR_STRANGER, 0);
        }
        /* A neighbour without a sensor sends no readings. */
        BEGUN(1, 1u | format, 14, MODEL, 0, 0);
        IS_REFUSED(MK_ERROR_TYPE, 0);
        /* Steps: this node is in step 0, stage 1 or 2. */
        BEGUN(1, 1u | format, 11, MODEL, UINT32_MAX, 2);
        IS_REFUSED(MK_ERROR_LATE, 1);
        BEGUN(1, 2u | format, 11, MODEL, UINT32_MAX, N);
        IS_REFUSED(MK_ERROR_LATE, 1);
        BEGUN(1, 2u | format, 11, MODEL, 0x80000000u, N);
        IS_REFUSED(MK_ERROR_LATE, 1);
        BEGUN(1, 2u | format, 11, MODEL, 0x7fffffffu, N);
        IS_REFUSED(MK_ERROR_AHEAD, 1);
        BEGUN(1, 2u | format, 11, MODEL, 1, N);
        IS_REFUSED(MK_ERROR_AHEAD, 1);
        BEGUN(1, 1u | format, 13, MODEL, (uint32_t)1, 2);
        if (!second) {
            IS_REFUSED(MK_ERROR_AHEAD, 1);
        } else {
            V(taken)(&b, wire.bytes, wire.length);
            IS_REFUSED(MK_ERROR_REPEATED, 1);
            calls++;
        }
        BEGUN(1, 1u | format, 13, MODEL, 0, 2);
        if (second) IS_REFUSED(MK_ERROR_LATE, 1);
        else V(taken)(&b, wire.bytes, wire.length);
        BEGUN(1, 2u | format, 13, MODEL, 0, N);
        if (second) IS_REFUSED(MK_ERROR_REPEATED, 1);
        else V(taken)(&b, wire.bytes, wire.length);
        if (!second) assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
#undef BEGUN
#undef IS_REFUSED
    }
    uint32_t sum = 0;
    for (int i = 0; i < MK_STATUS_COUNT; i++) sum += b.node.node.counts[i];
    assert_int_equal(sum, calls);
}

/* A frame with everything wrong: mended one by one, the next cause shows. */
static void V(in_order)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    uint8_t bytes[12 + 8 * sizeof(REAL)] = {0};
    const REAL infinite = (REAL)INFINITY;
    V(bench_start)(&b, 10, 11, 12, 13);
    V(step)(&b);
    const size_t size = 12 + N * sizeof(REAL) + 4;
    bytes[0] = 2;
    bytes[1] = 0xc3;
    for (size_t i = 12; i < sizeof bytes; i += sizeof(REAL)) memcpy(bytes + i, &infinite, sizeof(REAL));
    V(refused)(&b, bytes, 15, MK_ERROR_LENGTH, 0);
    V(refused)(&b, bytes, size + 1, MK_ERROR_VERSION, 0);
    bytes[0] = 1;
    V(refused)(&b, bytes, size + 1, MK_ERROR_CHECKSUM, 0);
    wire_repair(bytes, size + 1);
    V(refused)(&b, bytes, size + 1, MK_ERROR_TYPE, 0);
    bytes[1] = (uint8_t)(1u | 16u | 32u | OWN << 2); /* sealed, with a model that is not expected */
    V(refused)(&b, bytes, 12 + 8 + 15, MK_ERROR_LENGTH, 0);
    V(refused)(&b, bytes, 12 + 8 + 16, MK_ERROR_SECURITY, 0);
    bytes[1] = (uint8_t)(1u | 16u | OWN << 2);
    wire_repair(bytes, size + 1);
    V(refused)(&b, bytes, size + 1, MK_ERROR_MODEL, 0);
    const uint32_t model = MODEL;
    memcpy(bytes + 4, &model, 4);
    wire_repair(bytes, size + 1);
    V(refused)(&b, bytes, size + 1, MK_ERROR_STRANGER, 0);
    bytes[2] = 11;
    wire_repair(bytes, size + 1);
    V(refused)(&b, bytes, size + 1, MK_ERROR_TYPE, 0);
    bytes[1] = (uint8_t)(2u | OWN << 2);
    wire_repair(bytes, size + 1);
    V(refused)(&b, bytes, size + 1, MK_ERROR_LENGTH, 0);
    wire_repair(bytes, size);
    V(refused)(&b, bytes, size, MK_ERROR_LATE, 1);
    bytes[8] = 2;
    wire_repair(bytes, size);
    V(refused)(&b, bytes, size, MK_ERROR_AHEAD, 1);
    bytes[8] = 1;
    wire_repair(bytes, size);
    V(refused)(&b, bytes, size, MK_ERROR_NOT_FINITE, 1);
    const REAL good[N] = {(REAL)1.0};
    uint8_t first[sizeof bytes];
    memcpy(first, bytes, size);
    memcpy(first + 12, good, sizeof good);
    wire_repair(first, size);
    V(taken)(&b, first, size);
    V(refused)(&b, bytes, size, MK_ERROR_REPEATED, 1);
}

/* Every number of a payload that is NaN, infinite, or beyond this precision. */
static void V(bad_numbers)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static const double bad[] = {(double)NAN, (double)INFINITY, -(double)INFINITY, 3.4028235677973366e38 /* rounds to 2^128 */, 1e300};
    wire_t wire;
    V(bench_start)(&b, 10, 11, 12, 13);
    for (int format = 0; format <= 2; format++)
        for (int stage = 1; stage <= 2; stage++)
            for (int place = 0; place < (stage == 2 ? N : M); place++)
                for (int i = 0; i < 5; i++) {
                    double values[N] = {1.0, 2.0, 3.0};
                    if (i >= 3 && BITS == 64 && format == 1) continue;
                    values[place] = bad[i];
                    wire_plain(&wire, stage, format, 0, 11, MODEL, 0, stage == 2 ? N : M, values);
                    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_NOT_FINITE, 1);
                }
    /* The largest float is one. */
    const double large[N] = {3.4028235677973362e38, -3.4028234663852886e38, 1e-310};
    wire_plain(&wire, 2, 1, 0, 11, MODEL, 0, N, large);
    V(taken)(&b, wire.bytes, wire.length);
    for (int i = 0; i < N; i++) assert_true(b.node.filter.psi[N + i] == (REAL)large[i]);
}

static void V(not_started)(void **unused) {
    (void)unused;
    static V(bench_t) b, before;
    static uint8_t blob[UNIT(blob_max)];
    uint8_t bytes[UNIT(frame_max)];
    const REAL y[M] = {(REAL)1.0, (REAL)2.0}, P0[6] = {(REAL)1.0, (REAL)0.0, (REAL)1.0, (REAL)0.0, (REAL)0.0, (REAL)1.0};
    mk_recorder_t recorder = {blob, sizeof blob, 0, 0, 0};
    wire_t wire;
    V(bench_make)(&b, 10, 11, 12, 13);
    memcpy(&before, &b, sizeof b);
    wire_plain(&wire, 2, OWN, 0, 11, MODEL, 0, N, V(three));
    assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_ERROR_ORDER);
    assert_int_equal(UNIT(measure)(&b.node, y), MK_ERROR_ORDER);
    assert_int_equal(UNIT(incremental)(&b.node), MK_ERROR_ORDER);
    assert_int_equal(UNIT(diffuse)(&b.node), MK_ERROR_ORDER);
    assert_int_equal(UNIT(advance)(&b.node, 3), MK_ERROR_ORDER);
    assert_int_equal(UNIT(set_tolerance)(&b.node, (REAL)0.0), MK_ERROR_ORDER);
    assert_int_equal(UNIT(restart)(&b.node, y, P0), MK_ERROR_ORDER);
    assert_int_equal(UNIT(record)(&b.node, &recorder), MK_ERROR_ORDER);
    assert_int_equal(UNIT(frame)(&b.node, 1, bytes) + UNIT(frame)(&b.node, 2, bytes) + UNIT(save)(&b.node, blob), 0);
    assert_memory_equal(&before, &b, sizeof b);
}

static void V(bad_configuration)(void **unused) {
    (void)unused;
    static V(bench_t) b, good;
    V(bench_start)(&b, 10, 11, 12, 13);
    V(step)(&b);
    memcpy(&good, &b, sizeof b);
#define WRONG(change, status)                                                                                                 \
    do {                                                                                                                      \
        UNIT(t) before;                                                                                                       \
        change;                                                                                                               \
        memcpy(&before, &b.node, sizeof before);                                                                              \
        assert_int_equal(UNIT(start)(&b.node, &b.config), status);                                                            \
        assert_memory_equal(&before, &b.node, sizeof before);                                                                 \
        memcpy(&b, &good, sizeof b);                                                                                          \
    } while (0)
    WRONG(b.config.nodes = NULL, MK_ERROR_ARGUMENT);
    WRONG(b.nodes[3] = 10, MK_ERROR_ARGUMENT);
    WRONG(b.nodes[1] = 12, MK_ERROR_ARGUMENT);
    WRONG(b.config.numbers = 3, MK_ERROR_ARGUMENT);
    WRONG(b.config.filter.slots = 3, MK_ERROR_SHAPE);
    WRONG(b.config.filter.n = 4, MK_ERROR_SHAPE);
    WRONG(b.config.filter.m = 1, MK_ERROR_SHAPE);
    WRONG(b.rows[2] = 3, MK_ERROR_ARGUMENT);
    WRONG(b.A[4] = (REAL)NAN, MK_ERROR_NOT_FINITE);
    WRONG(b.P0[0] = (REAL)-1.0, MK_ERROR_NOT_POSITIVE_DEFINITE);
    WRONG(b.config.filter.tolerance = (REAL)-1.0, MK_ERROR_TOLERANCE);
    WRONG((b.config.gate = &b.gate, b.gate.reading = NULL), MK_ERROR_ARGUMENT);
    WRONG((b.config.gate = &b.gate, b.threshold[2] = (REAL)-1.0), MK_ERROR_ARGUMENT);
    WRONG((b.config.gate = &b.gate, b.threshold[3] = (REAL)INFINITY), MK_ERROR_ARGUMENT);
    WRONG((b.config.gate = &b.gate, b.gate.estimate = (REAL)NAN), MK_ERROR_ARGUMENT);
    WRONG((b.config.foreign = &b.foreign, b.foreign.C = b.F), MK_ERROR_ARGUMENT);
    WRONG((b.config.foreign = &b.foreign, b.is_foreign[0] = 1), MK_ERROR_ARGUMENT);
    WRONG((b.config.foreign = &b.foreign, b.foreign.limit = (REAL)NAN), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(start)(&b.node, NULL), MK_ERROR_ARGUMENT);
    if (BITS == 32) WRONG(b.config.numbers = 1, MK_ERROR_ARGUMENT);
#undef WRONG
}

#undef OWN
