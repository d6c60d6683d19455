/* SPDX-License-Identifier: MIT */
/* What a node of 2 states with neighbours 11 and 12 sends, takes and refuses. */

MK_DUIF_OF(NAME(unit), PRECISION, 2, 1, 3);
#define UNIT(function) JOIN(NAME(unit), _##function)
#define OWN (BITS == 64 ? 1 : 0)

static mk_status_t NAME(first_state)(const void *context, REAL dt, int count, const REAL *x, REAL *z) {
    (void)context;
    (void)dt;
    for (int i = 0; i < count; i++) {
        if (x[2 * i] > (REAL)1e6) return MK_ERROR_DOMAIN;
        z[i] = x[2 * i];
    }
    return MK_OK;
}

typedef struct {
    REAL A[4], Q[3], x0[2], P0[3], R[1];
    uint16_t nodes[3], degree[3];
    TYPE(mk_sensor) sensor;
    UNIT(config_t) config;
    UNIT(t) node;
} NAME(bench_t);

static void NAME(bench_make)(NAME(bench_t) * b, int protocol, int iterations) {
    static const REAL A[4] = {1, 1, 0, 1}, Q[3] = {(REAL)0.25, 0, (REAL)0.25}, x0[2] = {4, (REAL)0.5}, P0[3] = {4, 1, 2};
    const TYPE(mk_sensor) sensor = {{NAME(first_state), NULL, NULL, NULL}, b->R, 1};
    const TYPE(mk_consensus_config) consensus = {(uint16_t)(protocol == MK_CONSENSUS_SUM ? 7 : 5), 3, (uint16_t)iterations, 3, (uint8_t)protocol, 0, NULL,
                                                 b->degree};
    TYPE(mk_unscented_config) *const filter = &b->config.filter;
    memset(b, 0, sizeof *b);
    memcpy(b->A, A, sizeof A);
    memcpy(b->Q, Q, sizeof Q);
    memcpy(b->x0, x0, sizeof x0);
    memcpy(b->P0, P0, sizeof P0);
    b->R[0] = 1;
    for (int l = 0; l < 3; l++) {
        b->nodes[l] = (uint16_t)(10 + l);
        b->degree[l] = l ? 1 : 2;
    }
    b->sensor = sensor;
    filter->n = 2;
    filter->m = filter->slots = filter->increments = 1;
    filter->transition.A = b->A;
    filter->transition.Q = b->Q;
    filter->sensor = &b->sensor;
    filter->x0 = b->x0;
    filter->P0 = b->P0;
    filter->transform.spread = 3;
    filter->transform.correction = -1;
    b->config.consensus = consensus;
    b->config.nodes = b->nodes;
    b->config.model = MODEL;
    b->config.catch_up = 4;
    b->config.numbers = OWN;
    b->config.epsilon = (REAL)0.25;
}

static void NAME(bench_start)(NAME(bench_t) * b, int protocol, int iterations) {
    NAME(bench_make)(b, protocol, iterations);
    assert_int_equal(UNIT(start)(&b->node, &b->config), MK_OK);
}

/* To stage 2 of the step. */
static void NAME(contribute)(NAME(bench_t) * b, int measures) {
    const REAL z[1] = {5};
    assert_int_equal(UNIT(predict)(&b->node, 1, NULL), MK_OK);
    if (measures) assert_int_equal(UNIT(measure)(&b->node, z), MK_OK);
    assert_int_equal(UNIT(contribute)(&b->node), MK_OK);
}

static void NAME(finish)(NAME(bench_t) * b) {
    while (b->node.core.stage == MK_DUIF_CONSENSUS) assert_int_equal(UNIT(iterate)(&b->node), MK_OK);
    assert_int_equal(UNIT(fuse)(&b->node), MK_OK);
}

/* The state but for counters, and for what is known of steps where the frame was of a neighbour that may say so. */
static void NAME(refused)(NAME(bench_t) * b, const uint8_t *bytes, size_t length, mk_status_t status, int of_a_step) {
    static UNIT(t) before;
    uint8_t copy[600];
    memcpy(&before, &b->node, sizeof before);
    if (length && bytes) memcpy(copy, bytes, length < sizeof copy ? length : sizeof copy);
    assert_int_equal(UNIT(accept)(&b->node, bytes, length), status);
    before.core.counts[status]++;
    if (of_a_step) {
        memcpy(before.heard, b->node.heard, sizeof before.heard);
        memcpy(before.seen, b->node.seen, sizeof before.seen);
    }
    assert_memory_equal(&before, &b->node, sizeof before);
    if (length && bytes) assert_memory_equal(copy, bytes, length < sizeof copy ? length : sizeof copy);
}

static const double NAME(seven)[7] = {1.5, -2.25, 3.0, 0.5, 2.0, 1.0, -4.0};

/* What a node sends is the format page, byte for byte, and has the size of the table. */
static void NAME(sent)(void **unused) {
    (void)unused;
    static NAME(bench_t) b;
    uint8_t bytes[UNIT(frame_max)];
    wire_t wire;
    for (int protocol = 0; protocol < MK_CONSENSUS_COUNT; protocol++)
        for (int format = 0; format <= 2; format++)
            for (int measures = 0; measures < 2; measures++) {
                double values[7] = {0.0};
                if (BITS == 32 && format == 1) continue;
                const int L = protocol == MK_CONSENSUS_SUM ? 1 : 3, count = protocol == MK_CONSENSUS_SUM ? 7 : protocol >= MK_CONSENSUS_PERRON ? 6 : 5;
                NAME(bench_make)(&b, protocol, L);
                b.config.numbers = (uint8_t)format;
                assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
                for (uint32_t step = 0; step < 2; step++) {
                    assert_int_equal(UNIT(frame)(&b.node, bytes), 0);
                    NAME(contribute)(&b, measures);
                    for (unsigned l = 0; l < (unsigned)L; l++) {
                        for (int k = 0; k < count; k++) values[k] = (double)b.node.consensus.now[k];
                        if (step == 0 && l == 0) { /* S = 1 in the first state, s = z; the mass of the protocols that send it */
                            const double mass = protocol == MK_CONSENSUS_PERRON ? 1.0 / (2 + measures) : protocol == MK_CONSENSUS_RATIO ? 1.0 / 3.0 : 1.0;
                            assert_true(fabs(values[0] - mass * 5.0 * measures) < 1e-5 && fabs(values[2] - mass * measures) < 1e-5);
                            assert_true(fabs(values[1]) + fabs(values[3]) + fabs(values[4]) < 1e-5);
                            if (count == 6) assert_true(fabs(values[5] - mass) < 1e-5);
                            if (count == 7) assert_true(values[5] == 4.5 && values[6] == 0.5);
                        }
                        wire_consensus(&wire, format, (unsigned)protocol | (measures ? 8u : 0u), 10, MODEL, step, l, count, values);
                        for (int again = 0; again < 2; again++) {
                            assert_int_equal(UNIT(frame)(&b.node, bytes), wire.length);
                            assert_memory_equal(bytes, wire.bytes, wire.length);
                        }
                        assert_int_equal(UNIT(iterate)(&b.node), MK_OK);
                    }
                    assert_int_equal(UNIT(frame)(&b.node, bytes), 0);
                    assert_int_equal(UNIT(fuse)(&b.node), MK_OK);
                }
                assert_int_equal(b.node.core.unsent, 0);
            }
    /* Beyond the format. */
    const REAL z[1] = {(REAL)70000.0};
    NAME(bench_make)(&b, MK_CONSENSUS_METROPOLIS, 3);
    b.config.numbers = MK_NUMBERS_F16;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    assert_int_equal(UNIT(measure)(&b.node, z), MK_OK);
    assert_int_equal(UNIT(contribute)(&b.node), MK_OK);
    assert_int_equal(UNIT(frame)(&b.node, bytes), 0);
    assert_int_equal(b.node.core.unsent, 1);
    for (int states = 4; states <= 6; states += 2) { /* the table of <meshkal/frame.h> */
        const int count = states + MK_PACKED(states);
        assert_int_equal(MK_FRAME_PLAIN + MK_CONSENSUS_HEADER + MK_NUMBERS_BYTES(MK_NUMBERS_F32, count), states == 4 ? 75 : 127);
        assert_int_equal(MK_FRAME_SEALED + MK_CONSENSUS_HEADER + MK_NUMBERS_BYTES(MK_NUMBERS_F16, count), states == 4 ? 67 : 93);
        assert_int_equal(MK_FRAME_SEALED + MK_CONSENSUS_HEADER + MK_NUMBERS_BYTES(MK_NUMBERS_F64, count), states == 4 ? 151 : 255);
    }
}

/* Cut anywhere, and changed in any bit; then with the CRC put right. */
static void NAME(damaged)(void **unused) {
    (void)unused;
    static NAME(bench_t) b;
    wire_t wire;
    for (int format = 0; format <= 2; format++) {
        NAME(bench_start)(&b, MK_CONSENSUS_METROPOLIS, 3);
        NAME(contribute)(&b, 1);
        wire_consensus(&wire, format, 0, 12, MODEL, 0, 0, 5, NAME(seven));
        for (size_t length = 0; length < wire.length; length++) {
            uint8_t bytes[200];
            NAME(refused)(&b, wire.bytes, length, length < MK_FRAME_PLAIN ? MK_ERROR_LENGTH : MK_ERROR_CHECKSUM, 0);
            memcpy(bytes, wire.bytes, length);
            if (length < MK_FRAME_PLAIN) continue;
            wire_repair(bytes, length);
            NAME(refused)(&b, bytes, length, MK_ERROR_LENGTH, 0);
        }
        for (size_t bit = 0; bit < 8 * wire.length; bit++) {
            wire.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
            const mk_status_t status = bit < 8 ? MK_ERROR_VERSION : bit == 13 ? wire.length < MK_FRAME_SEALED ? MK_ERROR_LENGTH : MK_ERROR_SECURITY
                                                                  : MK_ERROR_CHECKSUM;
            NAME(refused)(&b, wire.bytes, wire.length, status, 0);
            if (bit < 8 * 15 && bit != 13) { /* header, iteration and flags: not even with a good checksum, but for what is another good frame */
                uint8_t bytes[200];
                memcpy(bytes, wire.bytes, wire.length);
                wire_repair(bytes, wire.length);
                const int early = bit == 96; /* iteration 1 */
                if (!early && bit != 8 * 14 + 3) {
                    static UNIT(t) before;
                    memcpy(&before, &b.node, sizeof before);
                    assert_int_not_equal(UNIT(accept)(&b.node, bytes, wire.length), MK_OK);
                    assert_memory_equal(&before.filter, &b.node.filter, sizeof before.filter);
                    assert_memory_equal(&before.consensus, &b.node.consensus, sizeof before.consensus);
                    memcpy(b.node.heard, before.heard, sizeof before.heard);
                    memcpy(b.node.seen, before.seen, sizeof before.seen);
                }
            }
            wire.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        }
        assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
        for (int k = 0; k < 5; k++) assert_true(b.node.consensus.now[2 * (MK_DUIF_VALUES(2) + 1) + k] == (REAL)NAME(seven)[k]);
    }
    NAME(refused)(&b, NULL, 40, MK_ERROR_ARGUMENT, 0);
}

/* Every cause in its turn, at each place of a step. Position: iterations since the start. */
static void NAME(causes)(void **unused) {
    (void)unused;
    static NAME(bench_t) b;
    wire_t wire;
    double values[7];
    int had[3][40] = {{0}};
    uint32_t taken = 0, early = 0;
#define GIVEN(flags, node, model, step, iteration, count)                                                                     \
    wire_consensus(&wire, OWN, flags, node, model, step, (unsigned)(iteration), count, values)
#define REFUSED(status, of_a_step) NAME(refused)(&b, wire.bytes, wire.length, status, of_a_step)
    NAME(bench_start)(&b, MK_CONSENSUS_METROPOLIS, 3);
    memcpy(values, NAME(seven), sizeof values);
    for (uint32_t step = 0; step < 3; step++)
        for (uint32_t place = 0; place <= 4; place++) { /* before contribute, iterations 0, 1, 2, before fuse */
            const uint32_t here = 3 * step + (place == 0 ? 0 : place - 1);
            if (place == 1) NAME(contribute)(&b, 1);
            for (unsigned flags = 0; flags < 256; flags++) {
                if ((flags & ~8u) == 0) continue;
                GIVEN(flags, 11, MODEL, step, 0, 5);
                REFUSED(MK_ERROR_TYPE, 0);
            }
            GIVEN(0, 11, MODEL, step, 3, 5);
            REFUSED(MK_ERROR_TYPE, 0);
            GIVEN(0, 11, MODEL, step, 65535, 5);
            REFUSED(MK_ERROR_TYPE, 0);
            for (int count = 0; count < 20; count++) {
                const double many[20] = {0.0};
                if (count == 5) continue;
                wire_consensus(&wire, OWN, 0, 11, MODEL, step, 0, count, many);
                REFUSED(MK_ERROR_LENGTH, 0);
            }
            for (int stage = 1; stage <= 2; stage++) {
                wire_plain(&wire, stage, OWN, 0, 11, MODEL, step, 2, values);
                REFUSED(MK_ERROR_TYPE, 0);
            }
            GIVEN(0, 11, MODEL ^ 1u, step, 0, 5);
            REFUSED(MK_ERROR_MODEL, 0);
            static const unsigned strangers[] = {0, 10, 13, 65535};
            for (int i = 0; i < 4; i++) {
                GIVEN(0, strangers[i], MODEL, step, 0, 5);
                REFUSED(MK_ERROR_STRANGER, 0);
            }
            GIVEN(0, 12, MODEL, step + 0x7fffffffu, 2, 5);
            REFUSED(MK_ERROR_AHEAD, 1);
            GIVEN(0, 12, MODEL, step - 1, 2, 5);
            REFUSED(MK_ERROR_LATE, 1);
            GIVEN(0, 12, MODEL, step + 0x80000002u, 2, 5);
            REFUSED(MK_ERROR_LATE, 1);
            for (unsigned slot = 1; slot <= 2; slot++)
                for (uint32_t there = here < 4 ? 0 : here - 4; there < here + 8; there++) {
                    const mk_status_t status = there < here ? MK_ERROR_LATE : there > here + 1 ? MK_ERROR_AHEAD : had[slot][there] ? MK_ERROR_REPEATED : MK_OK;
                    values[0] = (double)NAN; /* which is found out only where the frame is not refused anyway */
                    GIVEN(0, 10 + slot, MODEL, there / 3, there % 3, 5);
                    REFUSED(status == MK_OK ? MK_ERROR_NOT_FINITE : status, 1);
                    values[0] = 1.5;
                    if (status != MK_OK) continue;
                    for (int k = 0; k < 5; k++)
                        for (int i = 0; i < 2; i++) {
                            values[k] = i ? (double)INFINITY : -(double)INFINITY;
                            GIVEN(8, 10 + slot, MODEL, there / 3, there % 3, 5);
                            REFUSED(MK_ERROR_NOT_FINITE, 1);
                            values[k] = NAME(seven)[k];
                        }
                    values[4] = -1e-3;
                    GIVEN(8, 10 + slot, MODEL, there / 3, there % 3, 5);
                    REFUSED(MK_ERROR_IMPLAUSIBLE, 1);
                    values[4] = 2.0;
                    GIVEN(8, 10 + slot, MODEL, there / 3, there % 3, 5);
                    b.config.limit = (REAL)4.75; /* the trace is 5 */
                    REFUSED(MK_ERROR_IMPLAUSIBLE, 1);
                    b.config.limit = (REAL)5.0;
                    if (there != here + (slot == 2)) continue; /* 11 comes in time, 12 early */
                    assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
                    REFUSED(MK_ERROR_REPEATED, 1);
                    had[slot][there] = 1;
                    taken++;
                    early += slot == 2;
                }
            memset(b.node.seen, 0, sizeof b.node.seen); /* nobody was ahead: this test is not about following */
            if (place >= 1 && place <= 3) assert_int_equal(UNIT(iterate)(&b.node), MK_OK);
            if (place == 4) assert_int_equal(UNIT(fuse)(&b.node), MK_OK);
        }
    assert_int_equal(b.node.core.counts[MK_OK], taken);
    assert_int_equal(b.node.core.early, early);
    assert_int_equal(b.node.core.heard, 6);
    assert_int_equal(b.node.core.step, 3);
    assert_int_equal(b.node.core.unfused, 0);
#undef GIVEN
#undef REFUSED
}

/* What travels with a mass: the limit is on S / mass. */
static void NAME(masses)(void **unused) {
    (void)unused;
    static NAME(bench_t) b;
    wire_t wire;
    const int protocols[2] = {MK_CONSENSUS_PERRON, MK_CONSENSUS_RATIO};
    for (int p = 0; p < 2; p++) {
        double values[6] = {1.5, -2.25, 3.0, 0.5, 2.0, 2.0};
        const unsigned flags = (unsigned)protocols[p];
        NAME(bench_make)(&b, protocols[p], 3);
        b.config.limit = (REAL)2.5;
        assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
        static const double bad[] = {-0.5, 0.0, 1.75};
        for (int i = 0; i < 3; i++) {
            values[5] = bad[i];
            wire_consensus(&wire, OWN, flags, 11, MODEL, 0, 0, 6, values);
            NAME(refused)(&b, wire.bytes, wire.length, MK_ERROR_IMPLAUSIBLE, 1);
        }
        b.config.limit = 0;
        values[5] = -0.5;
        wire_consensus(&wire, OWN, flags, 11, MODEL, 0, 0, 6, values);
        NAME(refused)(&b, wire.bytes, wire.length, MK_ERROR_IMPLAUSIBLE, 1);
        b.config.limit = (REAL)2.5;
        values[5] = 2.0;
        wire_consensus(&wire, OWN, flags, 11, MODEL, 0, 0, 6, values);
        assert_int_equal(UNIT(accept)(&b.node, wire.bytes, wire.length), MK_OK);
    }
}

/* Sealed frames: any bit changed, replayed, plain ones, a wrong key. */
static void NAME(sealed)(void **unused) {
    (void)unused;
    static NAME(bench_t) a, b;
    static UNIT(secure_t) a_secure, b_secure;
    uint8_t key[32] = {1, 2, 3}, other[32] = {9}, bytes[UNIT(frame_max)], old[UNIT(frame_max)];
    const mk_aead_t aead = {wire_aead_seal, wire_aead_open, key}, wrong = {wire_aead_seal, wire_aead_open, other};
    memset(&a_secure, 0, sizeof a_secure);
    memset(&b_secure, 0, sizeof b_secure);
    NAME(bench_make)(&a, MK_CONSENSUS_SUM, 1);
    NAME(bench_start)(&b, MK_CONSENSUS_SUM, 1);
    a.nodes[0] = 11;
    a.nodes[1] = 10;
    assert_int_equal(UNIT(secure)(&a.node, &a_secure, &aead, 0), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(start)(&a.node, &a.config), MK_OK);
    assert_int_equal(UNIT(secure)(&a.node, NULL, &aead, 0), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(secure)(&a.node, &a_secure, NULL, 0), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(secure)(&a.node, &a_secure, &aead, 100), MK_OK);
    NAME(contribute)(&a, 1);
    const size_t length = UNIT(frame)(&a.node, bytes);
    assert_int_equal(length, MK_FRAME_SEALED + 3 + 7 * sizeof(REAL));
    NAME(refused)(&b, bytes, length, MK_ERROR_SECURITY, 0);
    assert_int_equal(UNIT(secure)(&b.node, &b_secure, &wrong, 0), MK_OK);
    NAME(refused)(&b, bytes, length, MK_ERROR_FORGED, 0);
    assert_int_equal(UNIT(secure)(&b.node, &b_secure, &aead, 0), MK_OK);
    for (size_t bit = 0; bit < 8 * length; bit++) {
        static UNIT(t) before;
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        memcpy(&before, &b.node, sizeof before);
        const mk_status_t status = UNIT(accept)(&b.node, bytes, length);
        assert_int_not_equal(status, MK_OK);
        before.core.counts[status]++;
        assert_memory_equal(&before, &b.node, sizeof before);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    for (size_t cut = 0; cut < length; cut++) NAME(refused)(&b, bytes, cut, cut < MK_FRAME_SEALED ? MK_ERROR_LENGTH : MK_ERROR_FORGED, 0);
    memcpy(old, bytes, length);
    assert_int_equal(UNIT(accept)(&b.node, bytes, length), MK_OK);
    NAME(refused)(&b, bytes, length, MK_ERROR_REPLAYED, 0);
    /* Sent again it has another number, is opened, and is a repeat. */
    assert_int_equal(UNIT(frame)(&a.node, bytes), length);
    NAME(refused)(&b, bytes, length, MK_ERROR_REPEATED, 1);
    NAME(refused)(&b, old, length, MK_ERROR_REPLAYED, 0);
    for (int k = 0; k < 7; k++) assert_true(b.node.consensus.now[(MK_DUIF_VALUES(2) + 1) + k] == a.node.consensus.now[k]);
    /* No seal, no frame; no numbers left either. */
    a_secure.core.sequence = UINT64_MAX;
    assert_int_equal(UNIT(frame)(&a.node, bytes), 0);
    assert_int_equal(a.node.core.unsent, 1);
}
