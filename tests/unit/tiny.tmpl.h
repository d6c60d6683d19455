/* SPDX-License-Identifier: MIT */
/* A small filter in one REAL (2 states, sensors of up to 2 rows, 3 slots) with its configuration in writable memory, for tests that
   spoil one thing at a time. */

MK_RKFD_OF(NAME(tiny), PRECISION, 2, 2, 3);

typedef struct {
    REAL A[4], Q[3], r[2], x0[2], P0[3], weight[3];
    uint8_t rows[3];
    REAL C[12], F[12], S[9], R_inverse[9];
    TYPE(mk_rkfd_config) config;
    TYPE(tiny) filter;
} TYPE(bench);

/* A filter that has started. */
static void NAME(bench_start)(TYPE(bench) * b) {
    static const REAL A[] = {(REAL)1.0, (REAL)0.125, (REAL)0.0, (REAL)0.75}, Q[] = {(REAL)0.25, (REAL)0.0625, (REAL)0.5};
    static const REAL P0[] = {(REAL)2.0, (REAL)0.5, (REAL)1.0}, weight[] = {(REAL)0.5, (REAL)0.25, (REAL)0.25};
    static const REAL C[] = {(REAL)1.0, (REAL)0.5, (REAL)0.0, (REAL)1.0, /* slot 0: two rows */
                             (REAL)1.0, (REAL)0.0, (REAL)0.0, (REAL)0.0, /* slot 1: one row */
                             (REAL)0.0, (REAL)1.0, (REAL)1.0, (REAL)1.0};
    static const REAL R[] = {(REAL)1.0, (REAL)0.25, (REAL)2.0};
    static const uint8_t rows[] = {2, 1, 2};
    memset(b, 0, sizeof *b);
    memcpy(b->A, A, sizeof A);
    memcpy(b->Q, Q, sizeof Q);
    memcpy(b->P0, P0, sizeof P0);
    memcpy(b->weight, weight, sizeof weight);
    memcpy(b->rows, rows, sizeof rows);
    memcpy(b->C, C, sizeof C);
    b->r[0] = (REAL)0.5;
    b->x0[0] = (REAL)1.0;
    b->x0[1] = (REAL)-2.0;
    for (int l = 0; l < 3; l++) {
        REAL work[9];
        assert_int_equal(NAME(mk_rkfd_sensor)(2, 2, rows[l], C + 4 * l, R, b->F + 4 * l, b->S + 3 * l, b->R_inverse + 3 * l, work),
                         MK_OK);
    }
    const TYPE(mk_rkfd_config) config = {2,        2,       3,    b->A, b->Q, b->r,         b->x0,       b->P0,
                                         b->weight, b->rows, b->C, b->F, b->S, b->R_inverse, (REAL)0.02, NULL};
    memcpy(&b->config, &config, sizeof config);
    assert_int_equal(TINY(start)(&b->filter, &b->config), MK_OK);
}

/* The call must return `status` and leave every byte of the filter as it was. */
#define REFUSED(b, call, status)                                                                                               \
    do {                                                                                                                       \
        TYPE(tiny) before;                                                                                                     \
        memcpy(&before, &(b)->filter, sizeof before);                                                                          \
        assert_int_equal((call), (status));                                                                                    \
        assert_memory_equal(&before, &(b)->filter, sizeof before);                                                             \
    } while (0)

/* The same for an input that was handed over in its turn: counted, and marked for the faults of the step, nothing else. */
#define COUNTED(b, call, status)                                                                                               \
    do {                                                                                                                       \
        TYPE(tiny) before;                                                                                                     \
        memcpy(&before, &(b)->filter, sizeof before);                                                                          \
        assert_int_equal((call), (status));                                                                                    \
        before.core.rejected++;                                                                                                \
        before.core.rejected_now = 1;                                                                                          \
        assert_memory_equal(&before, &(b)->filter, sizeof before);                                                             \
    } while (0)
