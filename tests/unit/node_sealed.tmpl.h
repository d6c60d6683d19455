/* SPDX-License-Identifier: MIT */

#define OWN (BITS == 64 ? 1 : 0)

static uint8_t V(key)[32] = {3, 1, 4, 1, 5, 9, 2, 6}, V(other_key)[32] = {2, 7, 1, 8};
static const mk_aead_t V(aead) = {wire_aead_seal, wire_aead_open, V(key)};
static const double V(numbers)[N] = {1.5, -2.25, 1024.0};

/* Node 10 with neighbours 11, 12, 13; its own numbers begin at 100. */
static void V(secured)(V(bench_t) * b, UNIT(secure_t) * secure) {
    memset(secure, 0, sizeof *secure);
    V(bench_start)(b, 10, 11, 12, 13);
    assert_int_equal(UNIT(secure)(&b->node, secure, &V(aead), 100), MK_OK);
}

/* refused, and the windows are as they were, too. */
static void V(refused_sealed)(V(bench_t) * b, const UNIT(secure_t) * secure, const uint8_t *bytes, size_t length, mk_status_t status) {
    UNIT(secure_t) before = *secure;
    V(refused)(b, bytes, length, status, 0);
    assert_memory_equal(&before.core, &secure->core, sizeof before.core);
    assert_memory_equal(before.window, secure->window, sizeof before.window);
}

static void V(bytes_on_the_air)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    static UNIT(secure_t) sender, receiver;
    uint8_t bytes[UNIT(frame_max)];
    wire_t wire;
    V(secured)(&a, &sender);
    memset(&receiver, 0, sizeof receiver);
    V(bench_start)(&b, 11, 10, 12, 13);
    assert_int_equal(UNIT(secure)(&b.node, &receiver, &V(aead), 1), MK_OK);
    for (uint32_t t = 0; t < 5; t++) {
        const REAL y[M] = {(REAL)1.25 + (REAL)t, (REAL)-7.0};
        double values[N] = {(double)y[0], (double)y[1]};
        assert_int_equal(UNIT(measure)(&a.node, y), MK_OK);
        for (int stage = 1; stage <= 2; stage++) {
            const int count = stage == 2 ? N : a.rows[0];
            if (stage == 2) {
                assert_int_equal(UNIT(incremental)(&a.node), MK_OK);
                assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
                for (int i = 0; i < N; i++) values[i] = (double)UNIT(intermediate)(&a.node)[i];
            }
            wire_sealed(&wire, stage, OWN, 0, 10, MODEL, t, count, values, V(key), 100 + 2 * t + (uint64_t)stage - 1);
            assert_int_equal(UNIT(frame)(&a.node, stage, bytes), wire.length);
            assert_memory_equal(bytes, wire.bytes, wire.length);
            V(taken)(&b, bytes, wire.length);
            for (int i = 0; i < count; i++) assert_true((double)(stage == 2 ? b.node.filter.psi[N + i] : b.node.filter.y[M + i]) == values[i]);
        }
        assert_int_equal(UNIT(diffuse)(&a.node), MK_OK);
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
    }
}

/* Every bit of a sealed frame, and every length. */
static void V(altered)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(secure_t) secure;
    wire_t wire;
    V(secured)(&b, &secure);
    wire_sealed(&wire, 2, OWN, 0, 12, MODEL, 0, N, V(numbers), V(key), 7);
    for (size_t bit = 0; bit < 8 * wire.length; bit++) {
        const size_t byte = bit / 8;
        mk_status_t status = byte == 0               ? MK_ERROR_VERSION
                             : byte == 2 || byte == 3 ? MK_ERROR_STRANGER
                             : byte >= 4 && byte < 8  ? MK_ERROR_MODEL
                                                      : MK_ERROR_FORGED;
        wire.bytes[byte] ^= (uint8_t)(1u << bit % 8);
        const unsigned type = wire.bytes[1];
        if (byte == 1) {
            status = type >= 64 || (type & 3u) == 0 || (type >> 2 & 3u) == 3 ||
                             (type & 16u && (type & 3u) >= 2) ? MK_ERROR_TYPE : MK_ERROR_FORGED;
            if (!(type & 32u)) status = MK_ERROR_CHECKSUM;
        }
        /* Another neighbour's name: its key is the same, but the header is not what was sealed. */
        if ((byte == 2 || byte == 3) && (wire.bytes[2] == 11 || wire.bytes[2] == 13) && wire.bytes[3] == 0) status = MK_ERROR_FORGED;
        V(refused_sealed)(&b, &secure, wire.bytes, wire.length, status);
        wire.bytes[byte] ^= (uint8_t)(1u << bit % 8);
    }
    for (size_t length = 0; length < wire.length; length++)
        V(refused_sealed)(&b, &secure, wire.bytes, length, length < MK_FRAME_SEALED ? MK_ERROR_LENGTH : MK_ERROR_FORGED);
    /* Longer than any payload of this node: not even decrypted. Longer than its content: found after the seal. */
    double many[64] = {0.0};
    wire_t large;
    const int most = (int)(sizeof secure.text / sizeof(REAL));
    wire_sealed(&large, 2, OWN, 0, 12, MODEL, 0, most + 1, many, V(key), 6);
    V(refused_sealed)(&b, &secure, large.bytes, large.length, MK_ERROR_LENGTH);
    wire_sealed(&large, 2, OWN, 0, 12, MODEL, 0, N + 1, many, V(key), 5);
    V(refused)(&b, large.bytes, large.length, MK_ERROR_LENGTH, 0);
    V(taken)(&b, wire.bytes, wire.length);
    V(refused_sealed)(&b, &secure, wire.bytes, wire.length, MK_ERROR_REPLAYED);
}

/* Orders within and beyond 64; each neighbour has a window of its own. */
static void V(replayed)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(secure_t) secure;
    static wire_t wire[200];
    V(secured)(&b, &secure);
    for (unsigned i = 0; i < 200; i++) wire_sealed(&wire[i], 1, OWN, 0, 12, MODEL, i, 1, V(numbers), V(key), i);
    V(taken)(&b, wire[0].bytes, wire[0].length);
    for (unsigned i = 199; i > 199 - 64; i--) V(refused)(&b, wire[i].bytes, wire[i].length, MK_ERROR_AHEAD, 1);
    for (unsigned i = 0; i < 200; i++) V(refused_sealed)(&b, &secure, wire[i].bytes, wire[i].length, MK_ERROR_REPLAYED);
    wire_t other;
    wire_sealed(&other, 1, OWN, 0, 11, MODEL, 0, 2, V(numbers), V(key), 3);
    V(taken)(&b, other.bytes, other.length);
    /* The largest number there is; nothing comes after it. */
    wire_sealed(&other, 2, OWN, 0, 13, MODEL, 0, N, V(numbers), V(key), UINT64_MAX);
    V(taken)(&b, other.bytes, other.length);
    V(refused_sealed)(&b, &secure, other.bytes, other.length, MK_ERROR_REPLAYED);
    wire_sealed(&other, 1, OWN, 0, 13, MODEL, 0, 2, V(numbers), V(key), 0);
    V(refused_sealed)(&b, &secure, other.bytes, other.length, MK_ERROR_REPLAYED);
    wire_sealed(&other, 1, OWN, 0, 13, MODEL, 0, 2, V(numbers), V(key), UINT64_MAX - 63);
    V(taken)(&b, other.bytes, other.length);
}

static void V(wrong_kind)(void **unused) {
    (void)unused;
    static V(bench_t) b, plain;
    static UNIT(secure_t) secure;
    wire_t wire;
    V(secured)(&b, &secure);
    wire_plain(&wire, 2, OWN, 0, 12, MODEL, 0, N, V(numbers));
    V(refused_sealed)(&b, &secure, wire.bytes, wire.length, MK_ERROR_SECURITY);
    wire_sealed(&wire, 2, OWN, 0, 12, MODEL, 0, N, V(numbers), V(other_key), 7);
    V(refused_sealed)(&b, &secure, wire.bytes, wire.length, MK_ERROR_FORGED);
    wire_sealed(&wire, 2, OWN, 0, 12, MODEL ^ 1u, 0, N, V(numbers), V(key), 7);
    V(refused_sealed)(&b, &secure, wire.bytes, wire.length, MK_ERROR_MODEL);
    wire_sealed(&wire, 2, OWN, 0, 10, MODEL, 0, N, V(numbers), V(key), 7);
    V(refused_sealed)(&b, &secure, wire.bytes, wire.length, MK_ERROR_STRANGER);
    /* Sealed under the right key by a node gone wrong: what is inside is looked at as in a plain frame. */
    const double bad[N] = {1.0, (double)NAN, 2.0};
    wire_sealed(&wire, 2, OWN, 0, 12, MODEL, 0, N, bad, V(key), 8);
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_NOT_FINITE, 1);
    V(bench_start)(&plain, 10, 11, 12, 13);
    wire_sealed(&wire, 2, OWN, 0, 12, MODEL, 0, N, V(numbers), V(key), 7);
    V(refused)(&plain, wire.bytes, wire.length, MK_ERROR_SECURITY, 0);
}

/* A seal that fails now and then, and remembers every nonce. */
typedef struct {
    uint8_t nonce[1000][12];
    int count, failures;
} V(log_t);

static int V(failing_seal)(void *context, const uint8_t nonce[12], const uint8_t *header, size_t header_length, uint8_t *text, size_t length,
                           uint8_t tag[16]) {
    V(log_t) *const log = context;
    (void)header, (void)header_length, (void)text, (void)length;
    for (int i = 0; i < log->count; i++) assert_memory_not_equal(log->nonce[i], nonce, 12);
    memcpy(log->nonce[log->count++], nonce, 12);
    memset(tag, 0, 16);
    if (log->count % 3 == 0) log->failures++;
    return log->count % 3 != 0;
}

/* No nonce is used twice, also after a seal that failed, a frame sent again, and a number beyond the format. */
static void V(nonces)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(secure_t) secure;
    static V(log_t) log;
    memset(&log, 0, sizeof log);
    memset(&secure, 0, sizeof secure);
    const mk_aead_t failing = {V(failing_seal), wire_aead_open, &log};
    uint8_t bytes[UNIT(frame_max)];
    uint32_t unsent = 0;
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.numbers = MK_NUMBERS_F16;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    assert_int_equal(UNIT(secure)(&b.node, &secure, &failing, UINT64_C(7) << 32), MK_OK);
    for (int t = 0; t < 100; t++) {
        const REAL y[M] = {t % 10 == 9 ? (REAL)1e5 : (REAL)1.0, (REAL)2.0};
        assert_int_equal(UNIT(measure)(&b.node, y), MK_OK);
        for (int i = 0; i < 3; i++) unsent += UNIT(frame)(&b.node, 1, bytes) == 0;
        V(step)(&b);
    }
    assert_int_equal(b.node.node.unsent, unsent);
    assert_int_equal(unsent, log.failures + 30);
    assert_int_equal(log.count, 270);
}

/* The numbers run out: the node says nothing rather than use one again. */
static void V(last_sequence)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(secure_t) secure;
    static V(log_t) log;
    memset(&log, 0, sizeof log);
    memset(&secure, 0, sizeof secure);
    const mk_aead_t failing = {V(failing_seal), wire_aead_open, &log};
    uint8_t bytes[UNIT(frame_max)];
    const REAL y[M] = {(REAL)1.0, (REAL)2.0};
    V(bench_start)(&b, 10, 11, 12, 13);
    assert_int_equal(UNIT(secure)(&b.node, &secure, &failing, UINT64_MAX - 3), MK_OK);
    assert_int_equal(UNIT(measure)(&b.node, y), MK_OK);
    for (int i = 0; i < 20; i++) (void)UNIT(frame)(&b.node, 1, bytes);
    assert_true(log.count >= 3 && log.count <= 4);
    for (int i = 0; i < log.count; i++) {
        uint64_t sequence;
        memcpy(&sequence, log.nonce[i] + 4, 8);
        assert_true(sequence == UINT64_MAX - 3 + (uint64_t)i);
    }
    assert_int_equal(b.node.node.unsent, 20 - log.count + log.failures);
    /* 0 is a number like any other. */
    assert_int_equal(UNIT(secure)(&b.node, &secure, &V(aead), 0), MK_OK);
    assert_true(UNIT(frame)(&b.node, 1, bytes) > 0);
    assert_true(bytes[12] == 0 && UNIT(frame)(&b.node, 1, bytes) > 0 && bytes[12] == 1);
}

/* A record holds what was opened, as a plain frame without CRC, also of frames that were then refused; forged ones it does not hold. */
static void V(recorded)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static UNIT(secure_t) secure;
    static uint8_t record[4096];
    mk_recorder_t recorder = {record, sizeof record, 0, 0, 0};
    wire_t wire, plain;
    V(secured)(&b, &secure);
    assert_int_equal(UNIT(record)(&b.node, &recorder), MK_OK);
    for (int late = 0; late < 2; late++) {
        recorder.used = 0;
        wire_sealed(&wire, 2, OWN, 0, 12, MODEL, late ? UINT32_MAX : 0, N, V(numbers), V(key), 7 + (uint64_t)late);
        wire_plain(&plain, 2, OWN, 0, 12, MODEL, late ? UINT32_MAX : 0, N, V(numbers));
        wire.bytes[21] ^= 1;
        V(refused)(&b, wire.bytes, wire.length, MK_ERROR_FORGED, 0);
        wire.bytes[21] ^= 1;
        assert_int_equal(recorder.used, 0);
        assert_int_equal(V(give)(&b, wire.bytes, wire.length), late ? MK_ERROR_LATE : MK_OK);
        mk_item_t item;
        int damaged;
        assert_int_equal(mk_item_read(record, recorder.used, &item, &damaged), recorder.used);
        assert_int_equal(item.kind, MK_ITEM_FRAME);
        assert_int_equal(item.status, late ? MK_ERROR_LATE : MK_OK);
        assert_int_equal(item.length, plain.length - 4);
        assert_memory_equal(item.content, plain.bytes, item.length);
    }
}

/* A refused call leaves the node with the key that it had. */
static void V(secure_statuses)(void **unused) {
    (void)unused;
    static V(bench_t) b, before;
    static UNIT(secure_t) secure, kept;
    wire_t wire;
    V(secured)(&b, &secure);
    wire_sealed(&wire, 2, OWN, 0, 12, MODEL, 0, N, V(numbers), V(key), 7);
    V(taken)(&b, wire.bytes, wire.length);
    memcpy(&before, &b, sizeof b);
    kept = secure;
    const mk_aead_t no_seal = {NULL, wire_aead_open, NULL}, no_open = {wire_aead_seal, NULL, NULL};
    assert_int_equal(UNIT(secure)(&b.node, NULL, &V(aead), 1), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(secure)(&b.node, &secure, NULL, 1), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(secure)(&b.node, &secure, &no_seal, 1), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(secure)(&b.node, &secure, &no_open, 1), MK_ERROR_ARGUMENT);
    assert_memory_equal(&before, &b, sizeof b);
    assert_memory_equal(&kept, &secure, sizeof kept);
    wire_sealed(&wire, 2, OWN, 0, 11, MODEL, 0, N, V(numbers), V(key), 7);
    V(taken)(&b, wire.bytes, wire.length);
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_REPLAYED, 0);
    /* A call that is taken begins anew: numbers that were seen under the key before mean nothing under this one. */
    assert_int_equal(UNIT(secure)(&b.node, &secure, &V(aead), 1), MK_OK);
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_REPEATED, 1);
    V(bench_make)(&b, 10, 11, 12, 13);
    assert_int_equal(UNIT(secure)(&b.node, &secure, &V(aead), 1), MK_ERROR_ARGUMENT);
}

#undef OWN
