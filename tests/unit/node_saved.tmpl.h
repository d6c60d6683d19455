/* SPDX-License-Identifier: MIT */

#define OWN (BITS == 64 ? 1 : 0)

/* Not started. */
static void V(full_bench)(V(bench_t) * b, int all_foreign) {
    V(bench_make)(b, 10, 11, 12, 13);
    b->config.gate = &b->gate;
    b->gate.patience = 2;
    b->gate.estimate = (REAL)200.0;
    for (int l = 0; l < SLOTS; l++) b->threshold[l] = (REAL)15.0;
    b->is_foreign[2] = 1;
    for (int l = 1; all_foreign && l < SLOTS; l++) b->is_foreign[l] = 1;
    b->foreign.limit = (REAL)1000.0;
    b->config.foreign = &b->foreign;
}

/* A function of the node type for the first node, the one for dimensions known at run time only for the second. */
#define EITHER(function, at_run_time, typed) (i ? MK(mk_node_##function) at_run_time : UNIT(function) typed)

/* Anything that can happen to a node, the same to both; b may be null. What they return must be the same, too. */
static void V(happen)(V(bench_t) * a, V(bench_t) * b, generator_t *g) {
    V(bench_t) *const both[2] = {a, b};
    wire_t wire;
    double values[16];
    REAL own[N];
    const int kind = draw_below(g, 12), slot = 1 + draw_below(g, 3), foreign = a->is_foreign[slot], early = draw_below(g, 12) - 1;
    const int second = a->node.filter.core.stage == 2, stage = kind < 4 ? 1 : 2;
    for (int i = 0; i < 16; i++) values[i] = (double)(float)((draw_chance(g, 0.05) ? 30.0 : 1.0) * draw_normal(g));
    for (int i = 0; i < N; i++) own[i] = (REAL)values[i];
    uint32_t step = a->node.node.step + (uint32_t)(stage == 1 && second);
    if (early < 0) step += (uint32_t)draw_below(g, 20) - 5u;
    const int model = stage == 1 && foreign;
    wire_plain(&wire, stage, draw_chance(g, 0.1) ? 2 : OWN, model ? 16u : 0u, 10u + (unsigned)slot, MODEL, step,
               stage == 2 ? N : a->rows[slot] * (model ? N + 1 : 1), values);
    int status[2] = {0, 0};
    for (int i = 0; i < 2 && both[i]; i++) {
        UNIT(t) *const node = &both[i]->node;
        REAL work[MK_NODE_WORK(N, M) > MK_NODE_GATE_WORK(N, M) ? MK_NODE_WORK(N, M) : MK_NODE_GATE_WORK(N, M)];
        const MK_T(mk_node_view) view = UNIT(node_view)(node, work);
        const uint32_t later = node->node.step + 3;
        if (kind < 8) status[i] = (int)EITHER(accept, (N, M, SLOTS, &view, wire.bytes, wire.length), (node, wire.bytes, wire.length));
        else if (kind == 8) status[i] = (int)EITHER(measure, (M, &view, own), (node, own));
        else if (kind == 9 && values[15] > 2.4) status[i] = (int)EITHER(advance, (N, M, SLOTS, &view, later), (node, later));
        else if (kind == 9 && values[15] < -2.4) status[i] = (int)EITHER(set_tolerance, (&view, (REAL)0.03), (node, (REAL)0.03));
        else if (kind == 9 && values[14] > 2.4) status[i] = (int)EITHER(restart, (N, SLOTS, &view, a->x0, a->P0), (node, a->x0, a->P0));
        else if (kind == 9 && values[13] > 0.7) status[i] = (int)EITHER(drop, (&view, slot - 1), (node, slot - 1));
        else if (second) status[i] = (int)EITHER(diffuse, (N, M, SLOTS, &view), (node));
        else status[i] = (int)(i ? MK(mk_node_incremental)(N, M, SLOTS, &view, kind == 9 ? own : NULL) : UNIT(incremental_with)(node, kind == 9 ? own : NULL));
    }
    if (b) assert_int_equal(status[0], status[1]);
}

static void V(same_state)(V(bench_t) * a, V(bench_t) * b) {
    static uint8_t first[UNIT(blob_max)], second[UNIT(blob_max)];
    const size_t length = UNIT(save)(&a->node, first);
    assert_true(length > 0 && length <= sizeof first);
    assert_int_equal(UNIT(save)(&b->node, second), length);
    assert_memory_equal(first, second, length);
    assert_memory_equal(a->node.filter.x, b->node.filter.x, sizeof a->node.filter.x);
    assert_memory_equal(a->node.filter.W, b->node.filter.W, sizeof a->node.filter.W);
    assert_memory_equal(a->C, b->C, sizeof a->C);
    assert_memory_equal(a->node.node.counts, b->node.node.counts, sizeof a->node.node.counts);
}

/* Restored at any moment of a step, in another place, the node goes on bit for bit. */
static void V(goes_on)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    static uint8_t blob[UNIT(blob_max)];
    generator_t g = {21};
    unsigned early = 0, gated = 0, second = 0, ahead = 0;
    V(full_bench)(&a, 0);
    assert_int_equal(UNIT(start)(&a.node, &a.config), MK_OK);
    for (int run = 0; run < 40; run++) {
        for (int i = draw_below(&g, 60); i > 0; i--) V(happen)(&a, NULL, &g);
        const size_t length = UNIT(save)(&a.node, blob);
        gated += a.node.node.gated_steps > 0;
        second += a.node.filter.core.stage == 2;
        for (int l = 1; l < SLOTS; l++) {
            early += a.node.filter.core.stage == 2 ? a.node.filter.have_y[l] : a.node.filter.have_psi[l];
            ahead += a.node.seen[l] == 2;
        }
        V(full_bench)(&b, 0);
        memset(&b.node, 0xa5, sizeof b.node);
        assert_int_equal(UNIT(restore)(&b.node, &b.config, blob, length), MK_OK);
        assert_null(b.node.node.recorder);
        assert_null(b.node.node.secure);
        V(same_state)(&a, &b);
        const uint32_t until = a.node.filter.core.steps + (run % 10 ? 20 : 200);
        for (int i = 0; i < 20000 && a.node.filter.core.steps < until; i++) {
            V(happen)(&a, &b, &g);
            V(same_state)(&a, &b);
        }
        assert_true(a.node.filter.core.steps >= until);
    }
    assert_true(early > 10 && gated > 0 && second > 10 && ahead > 1 && a.node.node.reinitialised > 0 && a.node.node.caught_up > 0);
}

static void V(blob_length)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static uint8_t blob[UNIT(blob_max) + 1];
    for (int kind = 0; kind < 3; kind++) {
        V(full_bench)(&b, kind == 2);
        if (kind == 0) b.config.foreign = NULL;
        assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
        memset(blob, 0x5a, sizeof blob);
        const size_t length = UNIT(save)(&b.node, blob);
        assert_true(length <= UNIT(blob_max));
        for (size_t i = length; i < sizeof blob; i++) assert_int_equal(blob[i], 0x5a);
        uint32_t crc;
        memcpy(&crc, blob + length - 4, 4);
        assert_int_equal(wire_crc_of(blob, length - 4), crc);
        /* All neighbours foreign and the bound is short of nothing but the own sensor's model. */
        if (kind == 2) assert_int_equal(UNIT(blob_max) - length, sizeof(REAL) * M * N);
    }
}

/* A restore that must be refused and change nothing, neither of a node that runs nor of one that never did. */
static void V(refused_blob)(V(bench_t) * b, const uint8_t *blob, size_t length, mk_status_t status) {
    static V(bench_t) before;
    uint8_t *const exact = malloc(length ? length : 1);
    assert_non_null(exact);
    memcpy(exact, blob, length);
    memcpy(&before, b, sizeof before);
    const mk_status_t found = UNIT(restore)(&b->node, &b->config, exact, length);
    free(exact);
    if (found != status && status != MK_OK) fail_msg("%s, not %s", mk_status_name(found), mk_status_name(status));
    assert_true(found != MK_OK);
    assert_memory_equal(&before, b, sizeof before);
}

static size_t V(some_blob)(V(bench_t) * b, uint8_t *blob) {
    generator_t g = {22};
    V(full_bench)(b, 0);
    assert_int_equal(UNIT(start)(&b->node, &b->config), MK_OK);
    for (int i = 0; i < 150; i++) V(happen)(b, NULL, &g);
    return UNIT(save)(&b->node, blob);
}

static void V(cut_or_flipped)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static uint8_t blob[UNIT(blob_max) + 8];
    const size_t length = V(some_blob)(&b, blob);
    for (size_t cut = 0; cut < length; cut++) {
        static uint8_t copy[sizeof blob];
        V(refused_blob)(&b, blob, cut, cut < 24 ? MK_ERROR_LENGTH : MK_ERROR_CHECKSUM);
        memcpy(copy, blob, cut);
        if (cut < 24) continue;
        wire_repair(copy, cut);
        V(refused_blob)(&b, copy, cut, MK_ERROR_LENGTH);
    }
    for (size_t bit = 0; bit < 8 * length; bit++) {
        blob[bit / 8] ^= (uint8_t)(1u << bit % 8);
        V(refused_blob)(&b, blob, length, bit < 32 ? MK_ERROR_VERSION : MK_ERROR_CHECKSUM);
        blob[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    wire_repair(blob, length + 1);
    V(refused_blob)(&b, blob, length + 1, MK_ERROR_LENGTH);
    assert_int_equal(UNIT(restore)(&b.node, &b.config, NULL, length), MK_ERROR_ARGUMENT);
    assert_int_equal(UNIT(restore)(&b.node, NULL, blob, length), MK_ERROR_ARGUMENT);
}

/* Its writer was broken, or an enemy: every bit, with a CRC that is right. Refused with nothing changed, or a state that can be worked with. */
static void V(repaired)(void **unused) {
    (void)unused;
    static V(bench_t) b, kept;
    static uint8_t blob[UNIT(blob_max)];
    const size_t length = V(some_blob)(&b, blob);
    unsigned good = 0, refused = 0;
    memcpy(&kept, &b, sizeof b);
    for (size_t bit = 8 * 4; bit < 8 * (length - 4); bit++) {
        generator_t g = {bit};
        blob[bit / 8] ^= (uint8_t)(1u << bit % 8);
        wire_repair(blob, length);
        memcpy(&b, &kept, sizeof b);
        if (UNIT(restore)(&b.node, &b.config, blob, length) != MK_OK) {
            V(refused_blob)(&b, blob, length, MK_OK);
            refused++;
        } else {
            good++;
            b.node.node.behind = 0;
            for (int i = 0; i < 12; i++) V(happen)(&b, NULL, &g);
            for (int i = 0; i < N; i++) assert_true(isfinite(b.node.filter.x[i]));
            double packed[6], W[N * N], eigenvalues[N];
            for (int i = 0; i < 6; i++) packed[i] = (double)b.node.filter.W[i];
            unpack(N, packed, W);
            reference_eigenvalues(N, W, eigenvalues);
            assert_true(eigenvalues[0] > 0.0);
            /* The model of a neighbour is whole: S = C'C. */
            double trace = 0.0, square = 0.0;
            for (int i = 0; i < N; i++) trace += (double)b.S[2 * 6 + MK_PACKED(i) + i];
            for (int i = 0; i < M * N; i++) square += (double)b.C[2 * M * N + i] * (double)b.C[2 * M * N + i];
            assert_true(fabs(trace - square) <= 1e-5 * square && trace <= 1001.0);
        }
        blob[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    assert_true(good > 500 && refused > 200);
    /* Numbers that no node has, one by one at its place: W, x, y, psi, tolerance, theta, trace, nis, the foreign model. */
    memcpy(&b, &kept, sizeof b);
    const size_t numbers = 6 + N + SLOTS * (M + N) + 4 + M * N;
    for (size_t i = 0; i < numbers; i++) {
        static const double bad[] = {(double)NAN, (double)INFINITY, -(double)INFINITY};
        for (int k = 0; k < 3; k++) {
            static uint8_t copy[sizeof blob];
            const REAL number = (REAL)bad[k];
            memcpy(copy, blob, length);
            memcpy(copy + 20 + i * sizeof(REAL), &number, sizeof number);
            wire_repair(copy, length);
            V(refused_blob)(&b, copy, length, MK_ERROR_NOT_FINITE);
        }
    }
    const size_t place[] = {0, 2, 5, 6 + N + SLOTS * (M + N), 6 + N + SLOTS * (M + N) + 4};
    const double bad[] = {-1.0, 0.0, -1e-3, -0.5, 100.0};
    const mk_status_t status[] = {MK_ERROR_NOT_POSITIVE_DEFINITE, MK_ERROR_NOT_POSITIVE_DEFINITE, MK_ERROR_NOT_POSITIVE_DEFINITE,
                                  MK_ERROR_TOLERANCE, MK_ERROR_IMPLAUSIBLE};
    for (int i = 0; i < 5; i++) {
        static uint8_t copy[sizeof blob];
        const REAL number = (REAL)bad[i];
        memcpy(copy, blob, length);
        memcpy(copy + 20 + place[i] * sizeof(REAL), &number, sizeof number);
        wire_repair(copy, length);
        V(refused_blob)(&b, copy, length, status[i]);
    }
}

/* Flags that no node has: its stage, and of each slot what has come and what is known of its step. */
static void V(bad_flags)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static uint8_t blob[UNIT(blob_max)];
    const size_t length = V(some_blob)(&b, blob), flags = length - 4 - 3 * SLOTS;
    for (size_t i = 0; i < 3 * SLOTS + 1; i++) {
        const size_t place = i ? flags + i - 1 : flags - 2;
        const int least = i ? 0 : 1, most = i == 0 || i % 3 != 2 ? 2 : 1;
        for (int value = 0; value < 256; value++) {
            const uint8_t kept = blob[place];
            blob[place] = (uint8_t)value;
            wire_repair(blob, length);
            if (value < least || value > most) V(refused_blob)(&b, blob, length, MK_ERROR_ARGUMENT);
            else assert_int_equal(UNIT(restore)(&b.node, &b.config, blob, length), MK_OK);
            blob[place] = kept;
        }
    }
}

/* Of another model, node, network, precision or version. */
static void V(of_another)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    static uint8_t blob[UNIT(blob_max)], copy[UNIT(blob_max)];
    static const struct {
        int byte;
        mk_status_t status;
    } place[] = {{3, MK_ERROR_VERSION}, {0, MK_ERROR_VERSION}, {4, MK_ERROR_SHAPE}, {5, MK_ERROR_SHAPE},
                 {6, MK_ERROR_SHAPE}, {8, MK_ERROR_SHAPE}, {10, MK_ERROR_SHAPE},
                 {12, MK_ERROR_STRANGER}, {13, MK_ERROR_STRANGER}, {14, MK_ERROR_MODEL}, {17, MK_ERROR_MODEL}};
    const size_t length = V(some_blob)(&b, blob);
    for (size_t i = 0; i < sizeof place / sizeof *place; i++) {
        memcpy(copy, blob, length);
        copy[place[i].byte]++;
        wire_repair(copy, length);
        V(refused_blob)(&b, copy, length, place[i].status);
    }
    b.config.model++;
    V(refused_blob)(&b, blob, length, MK_ERROR_MODEL);
    b.config.model--;
    b.nodes[0] = 9;
    V(refused_blob)(&b, blob, length, MK_ERROR_STRANGER);
    b.nodes[0] = 10;
    b.config.foreign = NULL;
    V(refused_blob)(&b, blob, length, MK_ERROR_SHAPE);
    b.config.foreign = &b.foreign;
    b.is_foreign[3] = 1;
    V(refused_blob)(&b, blob, length, MK_ERROR_LENGTH);
    b.is_foreign[3] = 0;
    b.nodes[3] = 11;
    V(refused_blob)(&b, blob, length, MK_ERROR_ARGUMENT);
    b.nodes[3] = 13;
    assert_int_equal(UNIT(restore)(&b.node, &b.config, blob, length), MK_OK);
}

#include "node_recorded.tmpl.h"

#undef OWN
#undef EITHER
