/* SPDX-License-Identifier: MIT */
/* A node of firmware, unrolled and typed, that lives through everything and is recorded; replay.h includes this once for each precision. */

typedef struct {
    MK_REAL A[N * N], Q[PACKED_N], r[N], x0[N], P0[PACKED_N], weight[SLOTS], C[SLOTS * M * N], F[SLOTS * M * N], S[SLOTS * PACKED_N];
    MK_REAL R_inverse[SLOTS * PACKED_M], thresholds[SLOTS];
    uint8_t rows[SLOTS], strange[SLOTS];
    uint16_t nodes[SLOTS];
    MK_F_T(mk_node_gate) gate;
    MK_F_T(mk_node_foreign) foreign;
    MK_F_T(mk_rkfd_steady) steady;
    MK_REAL W[PACKED_N];
    MK_F_T(mk_node_config) config;
} MK_F_T(model);

static void MK_F(model_make)(MK_F_T(model) * w, unsigned life) {
    static const double A[N * N] = {0.9, 0.2, 0.0, -0.1, 0.95, 0.1, 0.0, 0.05, 1.02}, C[M * N] = {1.0, 0.0, 0.2, 0.0, 1.0, -0.3};
    MK_REAL R[PACKED_M] = {MK_R(0.5), MK_R(0.1), MK_R(0.6)}, work[3 * PACKED_M];
    memset(w, 0, sizeof *w);
    for (int i = 0; i < N * N; i++) w->A[i] = (MK_REAL)A[i];
    for (int i = 0; i < N; i++) {
        w->Q[MK_PACKED(i) + i] = MK_R(0.02);
        w->P0[MK_PACKED(i) + i] = MK_R(2.0);
        w->r[i] = MK_R(0.1);
        w->x0[i] = (MK_REAL)i;
    }
    for (int l = 0; l < SLOTS; l++) {
        w->weight[l] = l ? MK_R(0.25) : MK_R(0.5);
        w->rows[l] = l == SLOTS - 1 ? 1 : M;
        w->nodes[l] = number[l];
        w->strange[l] = l == 1;
        w->thresholds[l] = MK_R(12.0);
        for (int i = 0; i < w->rows[l] * N; i++) w->C[l * M * N + i] = (MK_REAL)(C[i] * (1.0 + 0.1 * l));
        assert_int_equal(MK_F(mk_rkfd_sensor)(N, M, w->rows[l], w->C + l * M * N, R, w->F + l * M * N, w->S + l * PACKED_N,
                                              w->R_inverse + l * PACKED_M, work),
                         MK_OK);
    }
    w->gate.reading = w->thresholds;
    w->gate.estimate = MK_R(30.0);
    w->gate.patience = 2;
    w->foreign.slot = w->strange;
    w->foreign.C = w->C;
    w->foreign.F = w->F;
    w->foreign.S = w->S;
    w->foreign.R_inverse = w->R_inverse;
    w->foreign.limit = MK_R(100.0);
    const MK_F_T(mk_rkfd_config) filter = {N, M, SLOTS, w->A, w->Q, life & NO_INPUT ? NULL : w->r, w->x0, w->P0, w->weight, w->rows, w->C, w->F, w->S,
                                           w->R_inverse, MK_R(0.05), NULL};
    w->config.filter = filter;
    w->config.nodes = w->nodes;
    w->config.model = MODEL;
    w->config.catch_up = CATCH_UP;
    w->config.numbers = MK_NUMBERS_F32;
    w->config.gate = life & GATE ? &w->gate : NULL;
    w->config.foreign = life & FOREIGN ? &w->foreign : NULL;
}

/* A gain that is frozen where W comes near its limit, found by running; what gain it is makes no difference to a replay. */
static void MK_F(model_freeze)(MK_F_T(model) * w, LIVE_T *node) {
    const MK_REAL y[M] = {MK_R(0.0), MK_R(0.0)};
    assert_int_equal(LIVE(start)(node, &w->config), MK_OK);
    for (int t = 0; t < 300; t++) {
        for (int l = 0; l < SLOTS; l++) assert_int_equal(LIVE(filter_put_measurement)(&node->filter, l, y), MK_OK);
        assert_int_equal(LIVE(filter_incremental)(&node->filter, NULL), MK_OK);
        assert_int_equal(LIVE(filter_diffuse)(&node->filter), MK_OK);
    }
    memcpy(w->W, node->filter.W, sizeof w->W);
    const MK_F_T(mk_rkfd_steady) steady = {w->A, w->F, w->W, MK_R(0.25), MK_R(1.0), MK_R(0.3), 5};
    w->steady = steady;
    w->config.filter.steady = &w->steady;
}

/* What a neighbour sends, with or without something wrong with it. */
static void MK_F(send)(LIVE_T * node, const MK_F_T(model) * w, unsigned life, uint32_t step, int slot, int stage, uint64_t *sequence) {
    uint8_t bytes[256];
    double values[M * (N + 1) + 1];
    const int given = stage == MK_STAGE_MEASUREMENT && life & FOREIGN && w->strange[slot], trouble = life & TROUBLE ? draw(20) : 20;
    int count = stage == MK_STAGE_ESTIMATE ? N : given ? w->rows[slot] * (N + 1) : w->rows[slot];
    mk_frame_t frame;
    memset(&frame, 0, sizeof frame);
    if (trouble == 1) count++;
    for (int i = 0; i < count; i++) values[i] = mk_random_normal(&source) * (draw(10) == 0 && life & GATE ? 100.0 : 1.0);
    if (given && trouble == 0) values[0] = 1000.0;
    frame.model = MODEL;
    frame.step = step;
    frame.node = w->nodes[slot];
    frame.stage = (uint8_t)stage;
    frame.numbers = (uint8_t)draw(3);
    frame.with_model = (uint8_t)(stage == MK_STAGE_MEASUREMENT && (trouble == 2 ? !given : given));
    frame.sealed = (life & SEALED) != 0;
    frame.length = (uint16_t)MK_NUMBERS_BYTES(frame.numbers, count);
    uint8_t *const payload = mk_frame_payload(bytes, frame.sealed);
    assert_int_equal(mk_numbers_put_f64(frame.numbers, count, values, payload), MK_OK);
    if (trouble == 3) memset(payload, 0xff, MK_NUMBERS_BYTES(frame.numbers, 1)); /* not a number */
    size_t length = mk_frame_write(&frame, bytes, &aead, ++*sequence);
    assert_true(length > 0);
    if (trouble == 4) bytes[length - 1] ^= 1; /* never gets into the record */
    (void)LIVE(accept)(node, bytes, length);
    if (trouble == 5) (void)LIVE(accept)(node, bytes, length);
}

static void MK_F(hear)(LIVE_T * node, const MK_F_T(model) * w, unsigned life, uint32_t step, int stage, uint64_t *sequence) {
    for (int l = 1; l < SLOTS; l++) {
        if (draw(5) == 0) continue;
        MK_F(send)(node, w, life, step, l, stage, sequence);
        if (!(life & TROUBLE)) continue;
        if (draw(10) == 0) MK_F(send)(node, w, life, step, l, MK_STAGE_ESTIMATE, sequence); /* early, or a repeat */
        if (draw(10) == 0) MK_F(send)(node, w, life, step - 1, l, stage, sequence);
        if (draw(10) == 0) MK_F(send)(node, w, life, step + 3, l, stage, sequence);
    }
}

static void MK_F(measure)(LIVE_T * node, unsigned life) {
    MK_REAL y[M];
    for (int r = 0; r < M; r++) y[r] = (MK_REAL)mk_random_normal(&source);
    if (life & TROUBLE && draw(10) == 0) y[1] = (MK_REAL)NAN;
    if (draw(10)) (void)LIVE(measure)(node, y);
    if (life & TROUBLE && draw(10) == 0) (void)LIVE(measure)(node, y);
}

/* Calls that an application makes seldom. */
static void MK_F(intervene)(LIVE_T * node, const MK_F_T(model) * w) {
    MK_REAL x[N], P[PACKED_N];
    const int what = draw(12);
    if (what == 0) (void)LIVE(set_tolerance)(node, (MK_REAL)(0.1 * draw(5) - 0.1));
    if (what == 1) (void)LIVE(advance)(node, node->node.step + (uint32_t)draw(2 * CATCH_UP));
    if (what > 2) return;
    for (int i = 0; i < N; i++) x[i] = (MK_REAL)mk_random_normal(&source);
    for (int i = 0; i < PACKED_N; i++) P[i] = w->P0[i] * MK_R(0.5);
    if (draw(4) == 0) P[0] = MK_R(-1.0);
    if (what == 2) (void)LIVE(restart)(node, x, P);
}

/* A life of `steps` steps and its record, as it was drained. A recorder that lost items starts again five steps later. */
static void MK_F(live)(unsigned life, int steps, uint32_t seed, stream_t *out) {
    MK_F_T(model) *const w = malloc(sizeof *w);
    LIVE_T *const node = malloc(sizeof *node);
    LIVE(secure_t) secure;
    uint8_t buffer[4096];
    /* With the largest state and configuration in it there is room for a step or two: what does not fit gets lost if it is not drained. */
    mk_recorder_t recorder = {buffer, life & TIGHT ? (MK_BITS == 32 ? 1400 : 2300) : sizeof buffer, 0, 0, !(life & BARE)};
    uint64_t sequence = 0;
    uint32_t network = 0;
    int lost_for = 0;
    assert_true(w && node);
    mk_random_start(&source, seed, life, MK_BITS, 0, 0);
    memset(&secure, 0, sizeof secure);
    out->used = 0;
    MK_F(model_make)(w, life);
    if (life & STEADY) MK_F(model_freeze)(w, node);
    assert_int_equal(LIVE(start)(node, &w->config), MK_OK);
    if (life & SEALED) assert_int_equal(LIVE(secure)(node, &secure, &aead, 1), MK_OK);
    for (int t = 0; t < steps; t++) {
        const MK_REAL input[N] = {MK_R(0.5), MK_R(-0.25), MK_R(0.125)};
        if (t == START) assert_int_equal(LIVE(record)(node, &recorder), MK_OK);
        if (network - node->node.step >= 0x80000000u || (life & TROUBLE && draw(25) == 0)) network = node->node.step + (uint32_t)draw(CATCH_UP);
        MK_F(measure)(node, life);
        MK_F(hear)(node, w, life, network, MK_STAGE_MEASUREMENT, &sequence);
        if (draw(5) == 0) (void)LIVE(drop)(node, draw(SLOTS + 2) - 1);
        if (life & TROUBLE && draw(20) == 0) (void)LIVE(diffuse)(node); /* ORDER */
        (void)(draw(4) ? LIVE(incremental)(node) : LIVE(incremental_with)(node, input));
        frozen_steps += node->filter.core.frozen;
        if (life & TROUBLE && draw(20) == 0) (void)LIVE(incremental)(node);
        MK_F(hear)(node, w, life, network, MK_STAGE_ESTIMATE, &sequence);
        if (node->filter.core.stage == 2) assert_int_equal(LIVE(diffuse)(node), MK_OK);
        network++;
        if (life & TROUBLE) MK_F(intervene)(node, w);
        if (t >= START && (!(life & TIGHT) || draw(3) == 0)) drain(&recorder, out);
        lost_for = recorder.lost ? lost_for + 1 : 0;
        if (t >= START && (lost_for == 5 || (life & TIGHT && !recorder.lost && draw(10) == 0))) {
            drain(&recorder, out);
            assert_int_equal(LIVE(record)(node, &recorder), MK_OK);
        }
    }
    drain(&recorder, out);
    free(node);
    free(w);
}
