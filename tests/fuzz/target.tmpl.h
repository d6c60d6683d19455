/* SPDX-License-Identifier: MIT */

typedef struct {
    V(bench_t) b;
    UNIT(secure_t) secure;
    mk_recorder_t recorder;
    uint8_t record[2500];
} V(fuzzed_t);

static void V(sane)(const V(bench_t) * b) {
    for (int i = 0; i < N; i++) MUST(isfinite(b->node.filter.x[i]));
    for (int i = 0; i < 6; i++) MUST(isfinite(b->node.filter.W[i]));
    for (int i = 0; i < N; i++) MUST(b->node.filter.W[MK_PACKED(i) + i] > (REAL)0.0);
    for (int i = 0; i < SLOTS * 6; i++) MUST(isfinite(b->S[i]));
    for (int l = 0; l < SLOTS; l++) MUST(b->node.filter.have_y[l] <= 2 && b->node.filter.have_psi[l] <= 1 && b->node.seen[l] <= 2);
    MUST(b->node.filter.core.stage == 1 || b->node.filter.core.stage == 2);
    const MK_T(mk_rkfd_steady) *const steady = b->config.filter.steady;
    MUST(!b->node.filter.core.steady || (steady && memcmp(b->node.filter.W, steady->W, sizeof b->node.filter.W) == 0));
    for (int i = 0; i < N && b->node.filter.core.stage == 2; i++) MUST(isfinite(b->node.filter.psi[i]));
}

/* Stage 1 with readings in all slots: numbers from -8 to 8, then zeros; now and then as large as they can be. */
static mk_status_t V(whole)(V(bench_t) * b, const uint8_t *data, size_t size) {
    const REAL scale = size > 0 && data[size - 1] > 240 ? (BITS == 64 ? (REAL)DBL_MAX : (REAL)FLT_MAX) / (REAL)128.0 : (REAL)0.0625;
    for (int l = 0; l < SLOTS; l++) {
        REAL y[M] = {(REAL)0.0};
        for (size_t r = 0, i = (size_t)l * M; r < M && i + r < size; r++) y[r] = (REAL)(int8_t)data[i + r] * scale;
        if (!b->node.filter.have_y[l]) MUST(UNIT(filter_put_measurement)(&b->node.filter, l, y) == MK_OK);
    }
    const mk_status_t status = UNIT(incremental)(&b->node);
    frozen_steps += status == MK_OK && b->node.filter.core.frozen;
    return status;
}

/* A gain that is frozen from nearly anywhere, with the limit of W found by running; the gain itself is any. */
static void V(freeze)(V(bench_t) * b) {
    static V(bench_t) other;
    static REAL limit[6];
    static MK_T(mk_rkfd_steady) steady;
    if (!steady.W) {
        V(bench_start)(&other, 10, 11, 12, 13);
        for (int t = 0; t < 60; t++) {
            MUST(V(whole)(&other, NULL, 0) == MK_OK);
            MUST(UNIT(diffuse)(&other.node) == MK_OK);
        }
        memcpy(limit, other.node.filter.W, sizeof limit);
        const MK_T(mk_rkfd_steady) made = {other.A, other.F, limit, (REAL)0.125, (REAL)1.0, (REAL)10.0, 3};
        steady = made;
    }
    b->config.filter.steady = &steady;
}

/* One frame by either way in. */
static void V(frame_in)(V(fuzzed_t) * f, const uint8_t *bytes, size_t length, int recorded) {
    static V(fuzzed_t) before;
    memcpy(&before, f, sizeof before);
    mk_status_t status;
    if (recorded) {
        REAL work[MK_NODE_WORK(N, M)];
        const MK_T(mk_node_view) view = UNIT(node_view)(&f->b.node, work);
        uint8_t *const exact = malloc(length ? length : 1);
        MUST(exact);
        memcpy(exact, bytes, length);
        status = MK(mk_node_accept_recorded)(N, M, SLOTS, &view, exact, length);
        free(exact);
    } else {
        status = V(give)(&f->b, bytes, length);
    }
    MUST(status >= MK_OK && status < MK_STATUS_COUNT && status != MK_ERROR_ORDER && status != MK_ERROR_GATED);
    V(sane)(&f->b);
    if (status == MK_OK) {
        /* A step, x and W are not changed by what comes in. */
        MUST(memcmp(before.b.node.filter.x, f->b.node.filter.x, sizeof before.b.node.filter.x) == 0);
        MUST(memcmp(before.b.node.filter.W, f->b.node.filter.W, sizeof before.b.node.filter.W) == 0);
        MUST(before.b.node.node.step == f->b.node.node.step);
        return;
    }
    before.b.node.node.counts[status]++;
    if (status == MK_ERROR_LATE || status == MK_ERROR_AHEAD || status == MK_ERROR_REPEATED || status == MK_ERROR_NOT_FINITE ||
        status == MK_ERROR_IMPLAUSIBLE) {
        memcpy(before.b.node.heard, f->b.node.heard, sizeof before.b.node.heard);
        memcpy(before.b.node.seen, f->b.node.seen, sizeof before.b.node.seen);
    }
    MUST(memcmp(&before.b, &f->b, sizeof before.b) == 0);
}

static void V(restore)(V(fuzzed_t) * f, const uint8_t *bytes, size_t length) {
    static V(bench_t) before, other;
    static uint8_t first[UNIT(blob_max)], second[UNIT(blob_max)];
    uint8_t *const exact = malloc(length ? length : 1);
    MUST(exact);
    memcpy(exact, bytes, length);
    memcpy(&before, &f->b, sizeof before);
    const mk_status_t status = UNIT(restore)(&f->b.node, &f->b.config, exact, length);
    free(exact);
    if (status != MK_OK) {
        MUST(memcmp(&before, &f->b, sizeof before) == 0);
        return;
    }
    V(sane)(&f->b);
    const size_t size = UNIT(save)(&f->b.node, first);
    MUST(size > 0 && size <= sizeof first && size == length);
    V(bench_make)(&other, 10, 11, 12, 13);
    other.config.filter.steady = f->b.config.filter.steady;
    if (f->b.config.foreign) {
        memcpy(other.is_foreign, f->b.is_foreign, sizeof other.is_foreign);
        other.config.foreign = &other.foreign;
    }
    MUST(UNIT(restore)(&other.node, &other.config, first, size) == MK_OK);
    MUST(UNIT(save)(&other.node, second) == size && memcmp(first, second, size) == 0);
    if (before.node.node.secure) MUST(UNIT(secure)(&f->b.node, &f->secure, &weak, 5) == MK_OK);
}

static void V(call)(V(fuzzed_t) * f, int kind, const uint8_t *data, size_t size) {
    UNIT(t) *const node = &f->b.node;
    uint8_t bytes[UNIT(blob_max) + 300];
    const int second = node->filter.core.stage == 2;
    switch (kind) {
    case CALL_BYTES: V(frame_in)(f, data, size, 0); break;
    case CALL_RECORDED: V(frame_in)(f, data, size, 1); break;
    case CALL_REPAIRED:
        memcpy(bytes, data, size);
        if (size >= 4) wire_repair(bytes, size);
        V(frame_in)(f, bytes, size, 0);
        break;
    case CALL_FRAME: {
        wire_t wire;
        if (size < 3) break;
        wire_begin(&wire, 1, data[0], f->b.nodes[data[1] % SLOTS], MODEL, node->node.step + (uint32_t)(int32_t)(int8_t)data[2] / 16);
        if (data[0] & 32u) {
            const uint64_t sequence = data[2];
            memcpy(wire.bytes + 12, &sequence, 8);
            wire.length += 8;
        }
        memcpy(wire.bytes + wire.length, data + 3, size - 3);
        wire.length += size - 3;
        if (data[0] & 32u) {
            uint8_t nonce[12] = {wire.bytes[2], wire.bytes[3]};
            memcpy(nonce + 4, wire.bytes + 12, 8);
            (void)weak_seal(NULL, nonce, wire.bytes, 20, wire.bytes + 20, size - 3, wire.bytes + wire.length);
            wire.length += 16;
        } else {
            wire_crc(&wire);
        }
        if (data[1] & 128u) wire.bytes[data[1] / 4 % wire.length] ^= 1; /* damaged on the way */
        V(frame_in)(f, wire.bytes, wire.length, 0);
        break;
    }
    case CALL_MEASURE: {
        REAL y[M] = {(REAL)0.0};
        memcpy(y, data, size < sizeof y ? size : sizeof y);
        (void)UNIT(measure)(node, y);
        break;
    }
    case CALL_STEP: {
        const mk_status_t status = second ? UNIT(diffuse)(node) : UNIT(incremental)(node);
        /* The way back that the header names. */
        if (status != MK_OK) MUST(UNIT(restart)(node, f->b.x0, f->b.P0) == MK_OK);
        break;
    }
    case CALL_WHOLE:
        if (second && UNIT(diffuse)(node) != MK_OK) MUST(UNIT(restart)(node, f->b.x0, f->b.P0) == MK_OK);
        if (V(whole)(&f->b, data, size) != MK_OK) MUST(UNIT(restart)(node, f->b.x0, f->b.P0) == MK_OK);
        break;
    case CALL_RESTART: MUST(UNIT(restart)(node, f->b.x0, f->b.P0) == MK_OK); break;
    case CALL_DROP: {
        REAL r[SLOTS * M], S[MK_PACKED(SLOTS * M)];
        uint8_t rows[SLOTS];
        const int slot = size ? (int)(int8_t)data[0] % (SLOTS + 1) : SLOTS;
        MUST(second == (UNIT(innovations)(node, r, S, rows) == MK_ERROR_ORDER));
        const mk_status_t status = UNIT(drop)(node, slot);
        MUST(status == (second ? MK_ERROR_ORDER : slot < 0 || slot == SLOTS ? MK_ERROR_ARGUMENT : MK_OK));
        MUST(status != MK_OK || !node->filter.have_y[slot]);
        break;
    }
    case CALL_TOLERANCE: (void)UNIT(set_tolerance)(node, size ? (REAL)(int8_t)data[0] / (REAL)1000.0 : (REAL)NAN); break;
    case CALL_WRONG_ORDER: MUST((second ? UNIT(incremental)(node) : UNIT(diffuse)(node)) == MK_ERROR_ORDER); break;
    case CALL_ADVANCE: {
        const mk_status_t status = UNIT(advance)(node, node->node.step + (size ? data[0] % 9u : 0u));
        if (status != MK_OK && status != MK_ERROR_ORDER && status != MK_ERROR_ARGUMENT)
            MUST(UNIT(restart)(node, f->b.x0, f->b.P0) == MK_OK);
        break;
    }
    case CALL_SEND:
        for (int stage = 0; stage < 4; stage++) {
            const size_t length = UNIT(frame)(node, stage, bytes);
            MUST(length <= UNIT(frame_max));
            /* Its own echo. */
            if (length) V(frame_in)(f, bytes, length, 0);
        }
        break;
    case CALL_SAVE: {
        const size_t length = UNIT(save)(node, bytes);
        MUST(length > 0 && length <= UNIT(blob_max));
        for (size_t i = 0; i + 3 <= size; i += 3) {
            const size_t place = ((size_t)data[i] << 8 | data[i + 1]) % length;
            bytes[place] ^= data[i + 2];
            if (data[i + 2] == 0) memset(bytes + place, 0xff, length - place < 8 ? length - place : 8);
        }
        wire_repair(bytes, length);
        V(restore)(f, bytes, length);
        break;
    }
    case CALL_RESTORE:
        memcpy(bytes, data, size);
        if (size >= 4) wire_repair(bytes, size);
        V(restore)(f, bytes, size);
        break;
    case CALL_ITEMS:
        for (size_t at = 0, length; at < size; at += length) {
            mk_item_t item;
            int damaged = 7;
            length = mk_item_read(data + at, size - at, &item, &damaged);
            MUST(damaged == 0 || damaged == 1);
            if (length == 0) break;
            MUST(length >= 10 && length <= size - at && item.content == data + at + 6 && item.length == length - 10);
        }
        break;
    default: break;
    }
    V(sane)(&f->b);
}

static void V(run)(unsigned settings, const uint8_t *data, size_t size) {
    static V(fuzzed_t) f;
    memset(&f, 0, sizeof f);
    V(bench_make)(&f.b, 10, 11, 12, 13);
    if (settings & SETTING_GATE) {
        for (int l = 0; l < SLOTS; l++) f.b.threshold[l] = (REAL)20.0;
        f.b.gate.patience = 3;
        f.b.gate.estimate = (REAL)50.0;
        f.b.config.gate = &f.b.gate;
    }
    if (settings & SETTING_FOREIGN) {
        f.b.is_foreign[1] = f.b.is_foreign[3] = 1;
        f.b.foreign.limit = settings & SETTING_GATE ? (REAL)1e4 : (REAL)0.0;
        f.b.config.foreign = &f.b.foreign;
    } else if (settings & SETTING_STEADY) {
        V(freeze)(&f.b);
    }
    f.b.config.with_model = (settings & SETTING_MODEL) != 0;
    MUST(UNIT(start)(&f.b.node, &f.b.config) == MK_OK);
    if (settings & SETTING_SEALED) MUST(UNIT(secure)(&f.b.node, &f.secure, &weak, 1) == MK_OK);
    if (settings & SETTING_RECORD) {
        f.recorder.with_configuration = settings & SETTING_GATE ? 1 : 0;
        f.recorder.bytes = f.record;
        f.recorder.capacity = sizeof f.record;
        MUST(UNIT(record)(&f.b.node, &f.recorder) == MK_OK);
    }
    while (size >= 2) {
        const size_t length = data[1] < size - 2 ? data[1] : size - 2;
        V(call)(&f, data[0] % CALL_COUNT, data + 2, length);
        MUST(f.recorder.used <= f.recorder.capacity);
        if (f.recorder.used > 2300) {
            V(call)(&f, CALL_ITEMS, f.record, f.recorder.used);
            if (settings & SETTING_MODEL) f.recorder.used = 0;
        }
        data += 2 + length;
        size -= 2 + length;
    }
}
