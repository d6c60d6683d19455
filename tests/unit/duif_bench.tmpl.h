/* SPDX-License-Identifier: MIT */
/* Networks of nodes over the kernels, with frames between them: NAME(net_t). Slots follow the numbers of the nodes; node i is number 10 + i. */

typedef struct {
    REAL H[M * N], position[2];
    int rows, linear;
} NAME(sensor_t);

static mk_status_t NAME(measure)(const void *context, REAL dt, int count, const REAL *x, REAL *z) {
    const NAME(sensor_t) *const sensor = context;
    (void)dt;
    for (int i = 0; i < count; i++)
        for (int r = 0; r < sensor->rows; r++) {
            REAL sum = (REAL)0.0;
            for (int k = 0; k < N; k++) sum += sensor->H[r * N + k] * x[i * N + k];
            if (!sensor->linear) {
                const REAL dx = x[i * N] - sensor->position[0], dy = x[i * N + 1] - sensor->position[1];
                sum = (REAL)sqrt((double)(dx * dx + dy * dy));
                if (!(sum > (REAL)0.0)) return MK_ERROR_DOMAIN;
            }
            z[i * sensor->rows + r] = sum;
        }
    return MK_OK;
}

typedef struct {
    TYPE(mk_duif) core;
    TYPE(mk_unscented) unscented;
    TYPE(mk_consensus) consensus;
    REAL x[N], L[MK_PACKED(N)], z[M], now[NODES * (MK_DUIF_VALUES(N) + 1)], next[NODES * (MK_DUIF_VALUES(N) + 1)], sum[MK_DUIF_VALUES(N) + 1];
    TYPE(mk_gate_record) record;
    uint32_t heard[NODES];
    uint8_t have_z, have[NODES], seen[NODES];
    REAL work[MK_DUIF_WORK(N, M)];
    /* What the configuration points to. */
    NAME(sensor_t) context;
    TYPE(mk_sensor) sensor;
    TYPE(mk_duif_config) config;
    REAL A[N * N], Q[MK_PACKED(N)], x0[N], P0[MK_PACKED(N)], R[MK_PACKED(M)], weight[NODES];
    uint16_t nodes[NODES], degree[NODES];
    int number[NODES];
} NAME(member_t);

typedef struct {
    int count, hears[NODES][NODES];
    NAME(member_t) member[NODES];
} NAME(net_t);

static TYPE(mk_duif_view) NAME(view)(NAME(member_t) * a) {
    const TYPE(mk_duif_view) view = {&a->core, {&a->unscented, a->x, a->L, a->z, &a->have_z, &a->record, a->work},
                                     {&a->consensus, a->now, a->next, a->sum, a->have, a->work}, a->heard, a->seen, a->work};
    return view;
}

/* Constant velocity over one second in the plane, sensors that differ: linear of 1 or 2 rows, or a range. Not started: count and hears are filled. */
static void NAME(net_make)(NAME(net_t) * net, int protocol, int iterations, int linear) {
    static const double beacons[NODES][2] = {{0, 0}, {100, 0}, {50, 90}, {-20, 60}, {30, -50}};
    for (int i = 0; i < net->count; i++) {
        NAME(member_t) *const a = net->member + i;
        memset(a, 0, sizeof *a);
        int slots = 1;
        a->nodes[0] = (uint16_t)(10 + i);
        a->number[0] = i;
        for (int j = 0; j < net->count; j++) {
            if (i == j) continue;
            if (net->hears[j][i]) a->degree[0]++;
            if (!net->hears[i][j]) continue;
            a->number[slots] = j;
            a->nodes[slots] = (uint16_t)(10 + j);
            for (int k = 0; k < net->count; k++) a->degree[slots] = (uint16_t)(a->degree[slots] + (k != j && net->hears[k][j]));
            slots++;
        }
        for (int k = 0; k < N; k++) a->A[k * N + k] = (REAL)1.0;
        a->A[2] = a->A[N + 3] = (REAL)1.0;
        for (int k = 0; k < 2; k++) {
            a->Q[MK_PACKED(k) + k] = (REAL)0.0034;
            a->Q[MK_PACKED(k + 2) + k] = (REAL)0.005;
            a->Q[MK_PACKED(k + 2) + k + 2] = (REAL)0.01;
            a->P0[MK_PACKED(k) + k] = (REAL)25.0;
            a->P0[MK_PACKED(k + 2) + k + 2] = (REAL)1.0;
        }
        a->x0[0] = (REAL)12.0;
        a->x0[1] = (REAL)17.0;
        a->x0[2] = (REAL)1.0;
        a->x0[3] = (REAL)0.5;
        a->context.linear = linear;
        a->context.rows = linear ? 1 + i % 2 : 1;
        for (int k = 0; k < M * N; k++) a->context.H[k] = (REAL)((i * 5 + k * 3) % 7 - 3) / (REAL)4.0;
        a->context.position[0] = (REAL)beacons[i][0];
        a->context.position[1] = (REAL)beacons[i][1];
        a->R[0] = (REAL)(1.0 + i / 4.0);
        a->R[1] = (REAL)0.25;
        a->R[2] = (REAL)2.0;
        const TYPE(mk_sensor) sensor = {{NAME(measure), NULL, &a->context, NULL}, a->R, (uint8_t)a->context.rows};
        a->sensor = sensor;
        TYPE(mk_unscented_config) *const filter = &a->config.filter;
        filter->n = N;
        filter->m = M;
        filter->slots = 1;
        filter->transition.A = a->A;
        filter->transition.Q = a->Q;
        filter->sensor = &a->sensor;
        filter->x0 = a->x0;
        filter->P0 = a->P0;
        filter->transform.spread = (REAL)3.0;
        filter->transform.correction = (REAL)-1.0;
        filter->increments = 1;
        TYPE(mk_consensus_config) *const consensus = &a->config.consensus;
        consensus->values = N + MK_PACKED(N) + (protocol == MK_CONSENSUS_SUM ? N : 0);
        consensus->slots = (uint16_t)slots;
        consensus->iterations = (uint16_t)iterations;
        consensus->network = (uint16_t)net->count;
        consensus->protocol = (uint8_t)protocol;
        consensus->degree = a->degree;
        a->config.nodes = a->nodes;
        a->config.model = MODEL;
        a->config.catch_up = 5;
        a->config.numbers = BITS == 64 ? MK_NUMBERS_F64 : MK_NUMBERS_F32;
    }
}

static void NAME(net_start)(NAME(net_t) * net) {
    for (int i = 0; i < net->count; i++) {
        NAME(member_t) *const a = net->member + i;
        const TYPE(mk_duif_view) view = NAME(view)(a);
        assert_int_equal(NAME(mk_duif_start)(N, M, a->config.consensus.slots, &view, &a->config), MK_OK);
    }
}

/* Up to contribute; z null where a node has no reading. */
static void NAME(net_contribute)(NAME(net_t) * net, double z[NODES][M], const int *measures) {
    for (int i = 0; i < net->count; i++) {
        const TYPE(mk_duif_view) view = NAME(view)(net->member + i);
        REAL own[M];
        assert_int_equal(NAME(mk_duif_predict)(N, &view, (REAL)1.0, NULL), MK_OK);
        for (int r = 0; r < M; r++) own[r] = (REAL)z[i][r];
        if (measures[i]) assert_int_equal(NAME(mk_duif_measure)(M, &view, own), MK_OK);
        assert_int_equal(NAME(mk_duif_contribute)(N, M, &view), MK_OK);
    }
}

/* One iteration: frames that are heard, each with probability 1 - loss, some twice. */
static void NAME(net_iterate)(NAME(net_t) * net, generator_t *g, double loss) {
    static uint8_t bytes[NODES][400];
    size_t length[NODES];
    for (int i = 0; i < net->count; i++) {
        const TYPE(mk_duif_view) view = NAME(view)(net->member + i);
        length[i] = NAME(mk_duif_frame)(&view, bytes[i]);
        assert_true(length[i] > 0 && length[i] <= sizeof bytes[i]);
    }
    for (int i = 0; i < net->count; i++) {
        const TYPE(mk_duif_view) view = NAME(view)(net->member + i);
        const int first = draw_below(g, net->count);
        for (int k = 0; k < net->count; k++) {
            const int j = (first + k) % net->count;
            if (!net->hears[i][j] || draw_chance(g, loss)) continue;
            assert_int_equal(NAME(mk_duif_accept)(N, &view, bytes[j], length[j]), MK_OK);
            if (draw_chance(g, 0.1)) assert_int_equal(NAME(mk_duif_accept)(N, &view, bytes[j], length[j]), MK_ERROR_REPEATED);
        }
    }
    for (int i = 0; i < net->count; i++) {
        const TYPE(mk_duif_view) view = NAME(view)(net->member + i);
        assert_int_equal(NAME(mk_duif_iterate)(N, &view), MK_OK);
    }
}

static void NAME(net_fuse)(NAME(net_t) * net) {
    for (int i = 0; i < net->count; i++) {
        const TYPE(mk_duif_view) view = NAME(view)(net->member + i);
        assert_int_equal(NAME(mk_duif_fuse)(N, &view), MK_OK);
    }
}

/* x and full P of a node in double. */
static void NAME(see)(NAME(member_t) * a, double *x, double *P) {
    const TYPE(mk_duif_view) view = NAME(view)(a);
    REAL packed[MK_PACKED(N)];
    double doubles[MK_PACKED(N)];
    assert_int_equal(NAME(mk_unscented_covariance)(N, &view.filter, packed), MK_OK);
    for (int k = 0; k < MK_PACKED(N); k++) doubles[k] = (double)packed[k];
    unpack(N, doubles, P);
    for (int k = 0; k < N; k++) x[k] = (double)a->x[k];
}

/* Node and reference agree, relative to the size of the state and to the variances. */
static void NAME(agree)(NAME(member_t) * a, const double *x, const double *P, double tolerance) {
    double own_x[N], own_P[N * N];
    NAME(see)(a, own_x, own_P);
    assert_true(relative_error(N, own_x, x, 1.0) <= tolerance);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) assert_true(fabs(own_P[i * N + j] - P[i * N + j]) <= tolerance * sqrt(P[i * N + i] * P[j * N + j]));
}
