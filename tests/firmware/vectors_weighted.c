/* SPDX-License-Identifier: MIT */
/* Vectors of meshkal/weights.h: an extended filter of 17 states and 8 rows with either statistic, and smaller ones, unscented too, gated and with
   sensors of two rows. In the second pass readings are put in another order and scratch memory is spoilt: that changes nothing. */
#include "vectors.h"

#include <math.h>
#include <string.h>

#include <meshkal/tracking.h>
#include <meshkal/unscented.h>

enum { N = 17, ROWS = 8, STEPS = 10 };

static const MK_REAL not_a_number = (MK_REAL)NAN;
const char *const vectors_passes[2] = {"in order", "in another order, scratch memory spoilt"};
static vectors_kernels_t pass;

#define LARGER(a, b) ((a) > (b) ? (a) : (b))
enum { WORK = LARGER(MK_UNSCENTED_PREDICT_WORK(17), MK_UNSCENTED_UPDATE_WORK(17, 1, 8)) };

#if MK_BITS == 32
MK_UNSCENTED(large, f32, 17, 1, 8);
MK_UNSCENTED(small, f32, 4, 2, 4);
#else
MK_UNSCENTED(large, f64, 17, 1, 8);
MK_UNSCENTED(small, f64, 4, 2, 4);
#endif

static union {
    large_t large;
    small_t small;
} object;
static MK_REAL work[WORK];
static MK_F_T(mk_unscented_view) view;
static MK_F_T(mk_unscented_config) config;
static MK_F_T(mk_sensor) sensor[ROWS];
static MK_F_T(mk_site) site[ROWS];
static MK_F_T(mk_row_weights) weights;
static MK_REAL weight[ROWS], statistic[ROWS], truth[N];

/* --- models ----------------------------------------------------------------------------------------------------------------- */

/* Attitude, velocity, position, two biases, clock: what matters here is that all are coupled. In flash. */
#define DIAGONAL(i, value) [(i) * (N + 1)] = MK_R(value)
#define COUPLED(i, j, value) [(i) * N + (j)] = MK_R(value)
static const MK_REAL A_large[N * N] = {
    DIAGONAL(0, 1.0), DIAGONAL(1, 1.0), DIAGONAL(2, 1.0), DIAGONAL(3, 1.0), DIAGONAL(4, 1.0), DIAGONAL(5, 1.0), DIAGONAL(6, 1.0), DIAGONAL(7, 1.0),
    DIAGONAL(8, 1.0), DIAGONAL(9, 0.96875), DIAGONAL(10, 0.96875), DIAGONAL(11, 0.96875), DIAGONAL(12, 0.9375), DIAGONAL(13, 0.9375),
    DIAGONAL(14, 0.9375), DIAGONAL(15, 1.0), DIAGONAL(16, 1.0), COUPLED(0, 9, 0.5), COUPLED(1, 10, 0.5), COUPLED(2, 11, 0.5), COUPLED(3, 1, -9.75),
    COUPLED(4, 0, 9.75), COUPLED(3, 12, 1.0), COUPLED(4, 13, 1.0), COUPLED(5, 14, 1.0), COUPLED(6, 3, 1.0), COUPLED(7, 4, 1.0), COUPLED(8, 5, 1.0),
    COUPLED(15, 16, 1.0)};
static const MK_REAL A_small[16] = {[0] = MK_R(1.0), [1] = MK_R(1.0), [5] = MK_R(1.0), [10] = MK_R(1.0), [11] = MK_R(1.0), [15] = MK_R(1.0)};
#define VARIANCE(i, value) [MK_PACKED(i) + (i)] = MK_R(value)
static const MK_REAL Q[MK_PACKED(N)] = {
    VARIANCE(0, 0x1p-20), VARIANCE(1, 0x1p-20), VARIANCE(2, 0x1p-20), VARIANCE(3, 0x1p-8), VARIANCE(4, 0x1p-8), VARIANCE(5, 0x1p-8),
    VARIANCE(9, 0x1p-24), VARIANCE(10, 0x1p-24), VARIANCE(11, 0x1p-24), VARIANCE(12, 0x1p-16), VARIANCE(13, 0x1p-16), VARIANCE(14, 0x1p-16),
    VARIANCE(15, 0x1p-2), VARIANCE(16, 0x1p-6)};
static const MK_REAL P0[MK_PACKED(N)] = {
    VARIANCE(0, 0x1p-10), VARIANCE(1, 0x1p-10), VARIANCE(2, 0x1p-8), VARIANCE(3, 0.25), VARIANCE(4, 0.25), VARIANCE(5, 0.25), VARIANCE(6, 25.0),
    VARIANCE(7, 25.0), VARIANCE(8, 25.0), VARIANCE(9, 0x1p-14), VARIANCE(10, 0x1p-14), VARIANCE(11, 0x1p-14), VARIANCE(12, 0x1p-6),
    VARIANCE(13, 0x1p-6), VARIANCE(14, 0x1p-6), VARIANCE(15, 100.0), VARIANCE(16, 1.0)};
static const MK_REAL Q_small[MK_PACKED(4)] = {VARIANCE(0, 0x1p-4), VARIANCE(1, 0x1p-6), VARIANCE(2, 0x1p-4), VARIANCE(3, 0x1p-6)};
static const MK_REAL P0_small[MK_PACKED(4)] = {VARIANCE(0, 25.0), VARIANCE(1, 1.0), VARIANCE(2, 25.0), VARIANCE(3, 1.0)};
static const MK_REAL x0[N] = {[3] = MK_R(1.0), [7] = MK_R(2.0)};
static const MK_REAL R[] = {MK_R(4.0), MK_R(0.0), MK_R(0x1p-6)};
static const mk_motion_t flying = {N, 3, {6, 7, 8}, {3, 4, 5}, 0}, walking = {4, 2, {0, 2, 0}, {1, 3, 0}, 0};
static const MK_F_T(mk_space) place = {MK_F(mk_range_bearing_difference), NULL, &walking};

/* Two-sided quantiles at 0.1 and 1e-3 for 1, 2, .. rows: normal, then Student with rows - 2 degrees, which needs four. */
#define EIGHT(x) {MK_R(x), MK_R(x), MK_R(x), MK_R(x), MK_R(x), MK_R(x), MK_R(x), MK_R(x)}
static const MK_REAL k0[2][ROWS] = {EIGHT(1.6449), {0, 0, 0, MK_R(2.92), MK_R(2.3534), MK_R(2.1318), MK_R(2.015), MK_R(1.9432)}};
static const MK_REAL k1[2][ROWS] = {EIGHT(3.2905), {0, 0, 0, MK_R(31.6), MK_R(12.92), MK_R(8.61), MK_R(6.869), MK_R(5.959)}};
static const MK_REAL threshold[] = {MK_R(10.8), MK_R(13.8)};
static const MK_F_T(mk_gate) gate = {threshold, NULL, 3, MK_GATE_SKIP};

typedef struct {
    int is_small, update, kind, gated;
} variant_t;
static const variant_t variants[] = {{0, MK_UPDATE_EXTENDED, MK_STATISTIC_NORMAL, 0},  {0, MK_UPDATE_EXTENDED, MK_STATISTIC_STUDENT, 0},
                                     {1, MK_UPDATE_EXTENDED, MK_STATISTIC_NORMAL, 0},  {1, MK_UPDATE_EXTENDED, MK_STATISTIC_STUDENT, 1},
                                     {1, MK_UPDATE_UNSCENTED, MK_STATISTIC_NORMAL, 1}, {1, MK_UPDATE_UNSCENTED, MK_STATISTIC_STUDENT, 0}};

static void configure(const variant_t *variant) {
    const int slots = variant->is_small ? 4 : ROWS;
    memset(&config, 0, sizeof config);
    config.n = variant->is_small ? 4 : N;
    config.m = variant->is_small ? 2 : 1;
    config.slots = (uint16_t)slots;
    config.transition.A = variant->is_small ? A_small : A_large;
    config.transition.Q = variant->is_small ? Q_small : Q;
    config.sensor = sensor;
    config.x0 = x0;
    config.P0 = variant->is_small ? P0_small : P0;
    config.transform.spread = (MK_REAL)config.n;
    config.transform.correction = MK_R(-1.0);
    config.gate = variant->gated ? &gate : NULL;
    config.increments = 1;
    config.update = (uint8_t)variant->update;
    weights.k0 = k0[variant->kind];
    weights.k1 = k1[variant->kind];
    weights.weight = weight;
    weights.statistic = statistic;
    weights.kind = (uint8_t)variant->kind;
    for (int l = 0; l < slots; l++) {
        const MK_F_T(mk_model) range = {MK_F(mk_range), MK_F(mk_range_jacobian), site + l, NULL};
        const MK_F_T(mk_model) both = {MK_F(mk_range_bearing), MK_F(mk_range_bearing_jacobian), site + l, &place};
        const int rows = variant->is_small && l % 2 ? 2 : 1;
        for (int axis = 0; axis < 3; axis++) site[l].position[axis] = MK_R(200.0) * draw();
        site[l].motion = variant->is_small ? &walking : &flying;
        sensor[l].model = rows == 2 ? both : range;
        sensor[l].R = R;
        sensor[l].rows = (uint8_t)rows;
    }
    memcpy(truth, x0, sizeof truth);
    for (int axis = 0; axis < 3; axis++) truth[variant->is_small ? axis : 6 + axis] += MK_R(3.0) * draw();
}

/* --- runs ------------------------------------------------------------------------------------------------------------------- */

static uint32_t weighted, unused; /* rows, of all runs */

static void spoil(void) {
    for (int i = 0; i < WORK && pass; i++) work[i] = not_a_number;
}

static void tell(const char *what, mk_status_t status) {
    const MK_F_T(mk_unscented) *const core = view.core;
    vector_word(what, (uint32_t)status);
    vector_numbers("x", config.n, view.x);
    vector_numbers("L", MK_PACKED(config.n), view.L);
    vector_numbers("nis", 1, &core->nis);
    vector_word("its rows, measurements", (uint32_t)core->nis_rows << 16 | core->measurements);
    vector_word("weighted, unused", (uint32_t)core->weighted_rows << 16 | core->unused_rows);
    vector_numbers("weight", config.slots * config.m, weight);
    vector_numbers("statistic", config.slots * config.m, statistic);
}

/* A fifth is missing, in step 7 most; from step 3 on one ramp, now and then a blunder, in step 5 in all rows. */
static void draw_readings(int t, MK_REAL *z, uint8_t *have) {
    for (int l = 0; l < config.slots; l++, z += config.m) {
        const int blunder = t == 5 || draw_below(12) == 0;
        vector_word("sensor", (uint32_t)sensor[l].model.function(site + l, MK_R(0.0), 1, truth, z));
        z[0] += MK_R(2.0) * (draw() + draw() + draw());
        if (blunder) z[0] += MK_R(60.0) * draw();
        if (l == 2 && t > 3) z[0] += MK_R(3.0) * (MK_REAL)(t - 3);
        if (sensor[l].rows > 1) z[1] += MK_R(0.125) * draw();
        vector_numbers("z", sensor[l].rows, z);
        have[l] = draw_below(t == 7 ? 2 : 5) > 0;
    }
}

static mk_status_t predict(void) {
    spoil();
    return MK_F(mk_unscented_predict)(config.n, &view, MK_R(1.0), NULL);
}

static mk_status_t update(void) {
    spoil();
    return MK_F(mk_unscented_update_weighted)(config.n, config.m, config.slots, &view, &weights);
}

static void one_step(int t) {
    MK_REAL next[N], z[ROWS], r[ROWS], S[MK_PACKED(ROWS)];
    uint8_t have[ROWS], rows[ROWS];
    for (int i = 0; i < config.n; i++) {
        next[i] = MK_R(0.0);
        for (int j = 0; j < config.n; j++) next[i] += config.transition.A[i * config.n + j] * truth[j];
    }
    memcpy(truth, next, sizeof truth[0] * config.n);
    tell("predict", predict());
    draw_readings(t, z, have);
    for (int k = 0; k < config.slots; k++) {
        const int l = pass ? config.slots - 1 - k : k;
        if (have[l]) vector_must("a reading that is taken", MK_F(mk_unscented_put)(config.m, config.slots, &view, l, z + l * config.m) == MK_OK);
    }
    spoil();
    vector_word("innovations", (uint32_t)MK_F(mk_unscented_innovations)(config.n, config.m, config.slots, &view, r, S, rows));
    int count = 0;
    for (int l = 0; l < config.slots; l++) count += rows[l];
    vector_numbers("r", count, r);
    vector_numbers("S", MK_PACKED(count), S);
    tell("update", update());
    weighted += view.core->weighted_rows;
    unused += view.core->unused_rows;
    if (t % 4 == 3) {
        draw_many(config.n, MK_R(0x1p-6), next);
        tell("move", MK_F(mk_unscented_move)(config.n, &view, next));
        for (int i = 0; i < config.n; i++) truth[i] += next[i];
    }
}

static mk_status_t start(void) {
    spoil();
    return MK_F(mk_unscented_start)(config.n, config.m, config.slots, &view, &config);
}

static void run(const variant_t *variant, int number) {
    vector_begin("weighted", variant->is_small ? 4 : N, variant->is_small ? 2 : 1, variant->is_small ? 4 : ROWS, number);
    memset(&object, 0, sizeof object);
    memset(weight, 0, sizeof weight);
    memset(statistic, 0, sizeof statistic);
    view = variant->is_small ? small_view(&object.small, work) : large_view(&object.large, work);
    configure(variant);
    tell("start", start());
    for (int t = 0; t < STEPS; t++) one_step(t);
    /* What an update refuses. */
    weights.k1 = weights.k0;
    vector_word("k1 not above k0", (uint32_t)update());
    weights.k1 = k1[variant->kind];
    weights.kind = 2;
    vector_word("no such statistic", (uint32_t)update());
    weights.kind = (uint8_t)variant->kind;
    config.update = MK_UPDATE_PROGRESSIVE;
    vector_word("no such update", (uint32_t)update());
}

/* The functions by themselves. */
static void parts(void) {
    static const MK_REAL size[] = {MK_R(0.0), MK_R(1.0), MK_R(1.5), MK_R(2.9), MK_R(3.5), MK_R(1e30), MK_R(1e-30)};
    MK_REAL r[ROWS], variance[ROWS];
    vector_begin("weights", 0, 0, 0, 0);
    for (int i = 0; i < 7; i++) {
        for (int sign = -1; sign < 2; sign += 2) {
            const MK_REAL w = MK_F(mk_igg3_weight)((MK_REAL)sign * size[i], MK_R(1.5), MK_R(3.0));
            vector_numbers("IGG-III", 1, &w);
        }
        for (int rows = 1; rows <= ROWS; rows++) {
            for (int k = 0; k < rows; k++) {
                r[k] = size[i] * draw();
                variance[k] = MK_R(1.5) + draw();
            }
            MK_F(mk_weight_statistics)(rows % 2 ? MK_STATISTIC_NORMAL : MK_STATISTIC_STUDENT, rows, r, variance, variance);
            vector_numbers("statistics", rows, variance);
        }
    }
    const MK_REAL none = MK_F(mk_igg3_weight)(not_a_number, MK_R(1.5), MK_R(3.0));
    vector_numbers("of NaN", 1, &none);
#if MK_BITS == 64
    /* In double alone: the image that promises single precision has none. */
    vector_word("status", (uint32_t)mk_weight_thresholds_f64(MK_STATISTIC_NORMAL, 0.1, ROWS, r));
    vector_numbers("normal", ROWS, r);
    vector_word("status", (uint32_t)mk_weight_thresholds_f64(MK_STATISTIC_STUDENT, 1e-3, ROWS, r));
    vector_numbers("Student", ROWS, r);
#endif
}

void vectors_run(vectors_kernels_t chosen) {
    pass = chosen;
    weighted = unused = 0;
    draw_seed(20251124);
    for (int i = 0; i < (int)(sizeof variants / sizeof variants[0]); i++) run(variants + i, i);
    vector_must("rows with weights below 1, and rows not used", weighted > 30 && unused > 10 && weighted > unused + 10);
    parts();
}
