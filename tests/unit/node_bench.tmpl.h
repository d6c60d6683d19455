/* SPDX-License-Identifier: MIT */
/* A node object with all that it points to, in writable memory. Sensors follow from the number of a node, so that benches of the same numbers
   make a network. */

DECLARE(V(unit), PRECISION, 3, 2, 4);

typedef struct {
    REAL A[N * N], Q[6], r[N], x0[N], P0[6], weight[SLOTS];
    uint8_t rows[SLOTS], is_foreign[SLOTS];
    uint16_t nodes[SLOTS];
    REAL C[SLOTS * M * N], F[SLOTS * M * N], S[SLOTS * 6], R_inverse[SLOTS * 3], threshold[SLOTS];
    MK_T(mk_node_gate) gate;
    MK_T(mk_node_foreign) foreign;
    UNIT(config_t) config;
    UNIT(t) node;
} V(bench_t);

/* The model of a sensor; returns its rows. R packed. */
MK_INLINE int V(sensor)(int number, REAL *C, REAL *R) {
    const int rows = number % 5 == 4 ? 0 : 1 + number % 2;
    for (int r = 0; r < M; r++)
        for (int i = 0; i < N; i++) C[r * N + i] = r < rows ? (REAL)((number * 7 + r * 5 + i * 3) % 11 - 5) / (REAL)4.0 : (REAL)0.0;
    R[0] = (REAL)1.0 + (REAL)(number % 3) / (REAL)4.0;
    R[1] = (REAL)0.25;
    R[2] = (REAL)2.0;
    return rows;
}

/* Slot 0 is the node itself. Not started. */
MK_INLINE void V(bench_make)(V(bench_t) * b, int own, int first, int second, int third) {
    static const REAL A[] = {(REAL)0.9375, (REAL)0.25, (REAL)0.0, (REAL)-0.25, (REAL)0.875, (REAL)0.125, (REAL)0.0, (REAL)0.0, (REAL)0.96875};
    static const REAL Q[] = {(REAL)0.25, (REAL)0.0625, (REAL)0.5, (REAL)0.0, (REAL)0.125, (REAL)0.375};
    static const REAL P0[] = {(REAL)2.0, (REAL)0.5, (REAL)1.5, (REAL)0.0, (REAL)0.25, (REAL)1.0};
    const int number[SLOTS] = {own, first, second, third};
    memset(b, 0, sizeof *b);
    memcpy(b->A, A, sizeof A);
    memcpy(b->Q, Q, sizeof Q);
    memcpy(b->P0, P0, sizeof P0);
    b->r[1] = (REAL)0.125;
    b->x0[0] = (REAL)1.0;
    b->x0[2] = (REAL)-0.5;
    for (int l = 0; l < SLOTS; l++) {
        REAL R[3], work[9];
        b->nodes[l] = (uint16_t)number[l];
        b->weight[l] = l ? (REAL)0.1875 : (REAL)0.4375;
        b->rows[l] = (uint8_t)V(sensor)(number[l], b->C + l * M * N, R);
        assert_int_equal(MK(mk_rkfd_sensor)(N, M, b->rows[l], b->C + l * M * N, R, b->F + l * M * N, b->S + l * 6, b->R_inverse + l * 3, work), MK_OK);
    }
    const MK_T(mk_rkfd_config) filter = {N, M, SLOTS, b->A, b->Q, b->r, b->x0, b->P0, b->weight, b->rows, b->C, b->F, b->S, b->R_inverse, (REAL)0.02, 0};
    b->config.filter = filter;
    b->config.nodes = b->nodes;
    b->config.model = MODEL;
    b->config.catch_up = 5;
    b->config.numbers = BITS == 64 ? MK_NUMBERS_F64 : MK_NUMBERS_F32;
    b->foreign.slot = b->is_foreign;
    b->foreign.C = b->C;
    b->foreign.F = b->F;
    b->foreign.S = b->S;
    b->foreign.R_inverse = b->R_inverse;
    b->gate.reading = b->threshold;
}

MK_INLINE void V(bench_start)(V(bench_t) * b, int own, int first, int second, int third) {
    V(bench_make)(b, own, first, second, third);
    assert_int_equal(UNIT(start)(&b->node, &b->config), MK_OK);
}

/* Hands a frame over in memory of its very length, so that a read beyond it is seen. */
MK_INLINE mk_status_t V(give)(V(bench_t) * b, const uint8_t *bytes, size_t length) {
    uint8_t *const exact = malloc(length ? length : 1);
    assert_non_null(exact);
    memcpy(exact, bytes, length);
    const mk_status_t status = UNIT(accept)(&b->node, exact, length);
    assert_memory_equal(exact, bytes, length);
    free(exact);
    return status;
}

/* A frame that must be refused, with nothing changed but its counter and, where `of_a_step`, what the node knows of its neighbours' steps. */
MK_INLINE void V(refused)(V(bench_t) * b, const uint8_t *bytes, size_t length, mk_status_t status, int of_a_step) {
    static V(bench_t) before;
    memcpy(&before, b, sizeof before);
    const mk_status_t found = V(give)(b, bytes, length);
    if (found != status) fail_msg("%s, not %s", mk_status_name(found), mk_status_name(status));
    before.node.node.counts[status]++;
    if (of_a_step) {
        memcpy(before.node.heard, b->node.heard, sizeof before.node.heard);
        memcpy(before.node.seen, b->node.seen, sizeof before.node.seen);
    }
    assert_memory_equal(&before, b, sizeof before);
}

MK_INLINE void V(taken)(V(bench_t) * b, const uint8_t *bytes, size_t length) {
    const mk_status_t found = V(give)(b, bytes, length);
    if (found != MK_OK) fail_msg("%s, not MK_OK", mk_status_name(found));
}

MK_INLINE void V(step)(V(bench_t) * b) {
    assert_int_equal(UNIT(incremental)(&b->node), MK_OK);
    assert_int_equal(UNIT(diffuse)(&b->node), MK_OK);
}
