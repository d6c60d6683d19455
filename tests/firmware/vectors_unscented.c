/* SPDX-License-Identifier: MIT */
/* Vectors of meshkal/unscented.h and meshkal/gate.h: every update, rule, transform and gate policy on targets that ranges, bearings and
   differences of arrival times see; readings as information; what is refused. */
#include "vectors.h"

#include <math.h>
#include <string.h>

#include <meshkal/tracking.h>
#include <meshkal/unscented.h>

enum { N = 6, M = 3, SLOTS = 4, STEPS = 8 };

static const MK_REAL not_a_number = (MK_REAL)NAN;

/* --- targets and sensors --------------------------------------------------------------------------------------------------- */

#define TYPED(real, number, n, m, slots)                                                                                      \
    MK_UNSCENTED_UNROLLED(filter##number, real, n, m, slots);                                                                 \
    static filter##number##_t object##number;                                                                                 \
    static MK_F_T(mk_unscented_view) view##number(MK_REAL *work) { return filter##number##_view(&object##number, work); }     \
    static mk_status_t predict##number(MK_REAL dt, const MK_REAL *Q) { return filter##number##_predict(&object##number, dt, Q); } \
    static mk_status_t update##number(void) { return filter##number##_update(&object##number); }                              \
    static mk_status_t contribution##number(MK_REAL *s, MK_REAL *S) { return filter##number##_contribution(&object##number, s, S); } \
    static mk_status_t inform##number(MK_REAL scale, const MK_REAL *s, const MK_REAL *S) {                                    \
        return filter##number##_inform(&object##number, scale, s, S);                                                         \
    }

#if MK_BITS == 32
#define DIMENSIONS(number, n, m, slots) TYPED(f32, number, n, m, slots)
#else
#define DIMENSIONS(number, n, m, slots) TYPED(f64, number, n, m, slots)
#endif

DIMENSIONS(0, 5, 2, 3)
DIMENSIONS(1, 6, 3, 2)
DIMENSIONS(2, 4, 1, 4)
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
/* The smallest target has no room for the sum. */
#define WORK(n, m, slots) LARGER(LARGER(MK_UNSCENTED_PREDICT_WORK(n), MK_UNSCENTED_UPDATE_WORK(n, m, slots)), MK_UNSCENTED_OTHER_WORK(n, m))

static const mk_motion_t turning = {5, 2, {0, 2, 0}, {1, 3, 0}, 4}, flying = {6, 3, {0, 2, 4}, {1, 3, 5}, 0}, walking = {4, 2, {0, 2, 0}, {1, 3, 0}, 0};
static const MK_F_T(mk_space) angle = {MK_F(mk_bearing_difference), NULL, &turning};
static const MK_F_T(mk_space) place_2 = {MK_F(mk_range_bearing_difference), NULL, &turning};
static const MK_F_T(mk_space) place_3 = {MK_F(mk_range_bearing_difference), NULL, &flying};

typedef struct {
    MK_F_T(mk_function) function;
    MK_F_T(mk_jacobian) jacobian;
    const MK_F_T(mk_space) * space;
    int rows;
} kind_t;
#define KIND(name, space, rows) {MK_F(mk_##name), MK_F(mk_##name##_jacobian), space, rows}

typedef struct {
    int n, m, slots, turns, linear;
    const mk_motion_t *motion;
    kind_t kind[SLOTS];
    MK_F_T(mk_unscented_view) (*view)(MK_REAL *work);
    mk_status_t (*predict)(MK_REAL dt, const MK_REAL *Q);
    mk_status_t (*update)(void);
    mk_status_t (*contribution)(MK_REAL *s, MK_REAL *S);
    mk_status_t (*inform)(MK_REAL scale, const MK_REAL *s, const MK_REAL *S);
} dimensions_t;
#define FUNCTIONS(number) view##number, predict##number, update##number, contribution##number, inform##number

static const dimensions_t dimensions[] = {
    {5, 2, 3, 1, 0, &turning, {KIND(range, NULL, 1), KIND(bearing, &angle, 1), KIND(range_bearing, &place_2, 2)}, FUNCTIONS(0)},
    {6, 3, 2, 0, 0, &flying, {KIND(range_bearing, &place_3, 3), KIND(tdoa, NULL, 1)}, FUNCTIONS(1)},
    {4, 1, 4, 0, 1, &walking, {KIND(range, NULL, 1), KIND(range, NULL, 1), KIND(range_rate, NULL, 1), KIND(range, NULL, 1)}, FUNCTIONS(2)},
};

/* --- the filter and its model ---------------------------------------------------------------------------------------------- */

const char *const vectors_passes[2] = {"shared kernels", "unrolled kernels"};

static vectors_kernels_t pass;
static const dimensions_t *now;
static MK_F_T(mk_unscented_view) view;
static MK_F_T(mk_unscented_config) config;
static MK_F_T(mk_sensor) sensor[SLOTS];
static MK_F_T(mk_site) site[SLOTS];
static MK_REAL work[LARGER(LARGER(WORK(5, 2, 3), WORK(6, 3, 2)), WORK(4, 1, 4))], A[N * N], Q[MK_PACKED(N)], x0[N], P0[MK_PACKED(N)], R[SLOTS][MK_PACKED(M)], truth[N];

typedef struct {
    uint8_t update, rule, increments, gate, transform;
} variant_t;

/* Readings that are off and readings that are not: quantiles of chi-square at about 5 %. */
static const MK_REAL threshold[] = {MK_R(3.8), MK_R(6.0), MK_R(7.8), MK_R(9.5), MK_R(11.1), MK_R(12.6)};
static const MK_REAL wide[] = {MK_R(9.0), MK_R(11.0), MK_R(13.0), MK_R(14.0), MK_R(16.0), MK_R(17.0)};
static const MK_F_T(mk_gate) gates[] = {{NULL, NULL, 0, MK_GATE_SKIP}, {threshold, NULL, 2, MK_GATE_SKIP}, {threshold, wide, 0, MK_GATE_INFLATE},
                                        {NULL, threshold, 1, MK_GATE_SKIP}, {wide, NULL, 3, MK_GATE_INFLATE}};
static const variant_t variants[] = {
    {MK_UPDATE_UNSCENTED, MK_RULE_NONE, 1, 0, 0},          {MK_UPDATE_UNSCENTED, MK_RULE_NONE, 1, 1, 1},
    {MK_UPDATE_UNSCENTED, MK_RULE_NONE, 1, 3, 2},          {MK_UPDATE_EXTENDED, MK_RULE_NONE, 1, 0, 0},
    {MK_UPDATE_EXTENDED, MK_RULE_NONE, 1, 2, 0},           {MK_UPDATE_PROGRESSIVE, MK_RULE_NONE, 5, 0, 1},
    {MK_UPDATE_PROGRESSIVE, MK_RULE_INNOVATION, 5, 4, 0},  {MK_UPDATE_PROGRESSIVE, MK_RULE_MAHALANOBIS, 7, 0, 1},
    {MK_UPDATE_PROGRESSIVE, MK_RULE_INNOVATION, 30, 0, 2}, {MK_UPDATE_ITERATED, MK_RULE_NONE, 5, 0, 0},
    {MK_UPDATE_ITERATED, MK_RULE_NONE, 8, 1, 1},           {MK_UPDATE_ITERATED_LITERAL, MK_RULE_NONE, 3, 0, 1},
};

static void draw_model(const variant_t *variant, int number) {
    const int n = now->n;
    MK_REAL Z[MK_PACKED(M)];
    memset(A, 0, sizeof A);
    for (int i = 0; i < n; i++) {
        A[i * n + i] = MK_R(1.0);
        truth[i] = (i % 2 ? MK_R(1.5) : MK_R(20.0)) * draw();
    }
    for (int i = 0; i + 1 < n; i += 2) A[i * n + i + 1] = MK_R(1.0);
    if (now->turns) truth[4] = MK_R(0.3) * draw();
    draw_covariance(n, 2, power(-8), Q);
    draw_covariance(n, 1, MK_R(1.0), P0);
    for (int i = 0; i < n; i++) x0[i] = truth[i] + MK_R(0.5) * draw();
    for (int l = 0; l < now->slots; l++) {
        const kind_t *const kind = now->kind + l;
        site[l].motion = now->motion;
        for (int axis = 0; axis < 3; axis++) {
            site[l].position[axis] = MK_R(40.0) * draw();
            site[l].reference[axis] = MK_R(40.0) * draw();
        }
        draw_covariance(kind->rows, 1, power(kind->space ? -8 : -3), Z);
        memcpy(R[l], Z, sizeof Z);
        const MK_F_T(mk_sensor) made = {{kind->function, kind->jacobian, site + l, kind->space}, R[l], (uint8_t)kind->rows};
        sensor[l] = made;
    }
    const MK_F_T(mk_transform) transform[3] = {MK_TRANSFORM_JULIER((MK_REAL)n, MK_R(3.0) - (MK_REAL)n), MK_TRANSFORM_CUBATURE((MK_REAL)n),
                                               MK_TRANSFORM_SCALED((MK_REAL)n, MK_R(0.5), MK_R(2.0), MK_R(0.0))};
    memset(&config, 0, sizeof config);
    config.n = (uint16_t)n;
    config.m = (uint16_t)now->m;
    config.slots = (uint16_t)now->slots;
    config.transition.model.function = now->turns ? MK_F(mk_constant_turn) : MK_F(mk_constant_velocity);
    config.transition.model.jacobian = now->turns ? MK_F(mk_constant_turn_jacobian) : MK_F(mk_constant_velocity_jacobian);
    config.transition.model.context = now->motion;
    config.transition.A = now->linear ? A : NULL;
    config.transition.Q = Q;
    config.sensor = sensor;
    config.x0 = x0;
    config.P0 = P0;
    config.transform = transform[variant->transform];
    config.gate = variant->gate ? gates + variant->gate : NULL;
    config.increments = variant->increments;
    config.update = variant->update;
    config.rule = variant->rule;
    config.one_at_a_time = (uint8_t)(number % 2);
}

static mk_status_t predict(MK_REAL dt, const MK_REAL *noise) {
    return pass ? now->predict(dt, noise) : MK_F(mk_unscented_predict)(now->n, &view, dt, noise);
}
static mk_status_t update(void) { return pass ? now->update() : MK_F(mk_unscented_update)(now->n, now->m, now->slots, &view); }
static mk_status_t contribution(int without_residual, MK_REAL *s, MK_REAL *S) {
    return pass && !without_residual ? now->contribution(s, S)
                                     : MK_F(mk_unscented_contribution)(now->n, now->m, now->slots, &view, without_residual, s, S);
}
static mk_status_t inform(MK_REAL scale, const MK_REAL *s, const MK_REAL *S) {
    return pass ? now->inform(scale, s, S) : MK_F(mk_unscented_inform)(now->n, &view, scale, s, S);
}

/* --- runs ------------------------------------------------------------------------------------------------------------------ */

static void tell_record(const MK_F_T(mk_gate_record) * record) {
    const MK_REAL numbers[2] = {record->d2, record->ratio};
    vector_numbers("d2, test ratio", 2, numbers);
    vector_word("accepted, inflated", record->accepted << 16 | record->inflated);
    vector_word("rejected, since accepted", record->rejected << 16 | record->since_accepted);
}

/* Everything that a call leaves. */
static void tell(const char *what, mk_status_t status) {
    const MK_F_T(mk_unscented) *const core = view.core;
    vector_word(what, (uint32_t)status);
    vector_numbers("x", now->n, view.x);
    vector_numbers("L", MK_PACKED(now->n), view.L);
    vector_numbers("nis", 1, &core->nis);
    vector_word("its rows, measurements", (uint32_t)core->nis_rows << 16 | core->measurements);
    vector_word("increments, gated updates", (uint32_t)core->increments << 16 | core->gated_updates);
    vector_word("failed, stopped", (uint32_t)core->failed << 16 | core->stopped);
    vector_word("updates, rule fired", core->updates << 16 | core->rule_fired);
    vector_word("reinitialised, rejected", core->reinitialised << 16 | core->rejected);
    tell_record(&core->stacked);
    for (int l = 0; l < now->slots; l++) tell_record(view.record + l);
}

/* All in the first step, then 30 % are missing; some are far off, in steps 3 to 5 most. */
static void put_readings(int t) {
    MK_REAL z[M];
    for (int l = 0; l < now->slots; l++) {
        const int rows = now->kind[l].rows, off = draw_below(t >= 3 && t < 6 ? 2 : 12) == 0;
        const mk_status_t status = now->kind[l].function(site + l, MK_R(0.0), 1, truth, z);
        vector_word("sensor", (uint32_t)status);
        for (int r = 0; r < rows; r++) z[r] += (off ? MK_R(2.0) : MK_R(0.1)) * draw();
        vector_numbers("z", rows, z);
        if (t > 0 && draw_below(10) < 3) continue;
        vector_word("put", (uint32_t)MK_F(mk_unscented_put)(now->m, now->slots, &view, l, z));
        if (t == 2) vector_word("put again", (uint32_t)MK_F(mk_unscented_put)(now->m, now->slots, &view, l, z));
    }
}

static void one_step(int t) {
    MK_REAL next[N], noise[MK_PACKED(N)], s[N], S[MK_PACKED(N)], P[MK_PACKED(N)], q[3];
    const MK_REAL dt = now->linear ? MK_R(1.0) : MK_R(0.75) + MK_R(0.5) * draw();
    for (int i = 0; i < 3; i++) q[i] = MK_R(0.02) + MK_R(0.01) * draw();
    (void)(now->turns ? MK_F(mk_constant_turn)(now->motion, dt, 1, truth, next) : MK_F(mk_constant_velocity)(now->motion, dt, 1, truth, next));
    memcpy(truth, next, (size_t)now->n * sizeof *truth);
    vector_numbers("truth", now->n, truth);
    vector_word("noise", (uint32_t)(now->turns ? MK_F(mk_constant_turn_noise)(now->motion, dt, q, q[0] * MK_R(0.01), noise)
                                               : MK_F(mk_constant_velocity_noise)(now->motion, dt, q, noise)));
    tell("predict", predict(dt, t % 2 ? noise : NULL));
    put_readings(t);
    if (t % 4 != 3) {
        tell("update", update());
    } else {
        vector_word("contribution", (uint32_t)contribution(t == 7, s, S));
        vector_numbers("s", now->n, s);
        vector_numbers("S", MK_PACKED(now->n), S);
        tell("inform", inform(MK_R(1.25), s, S));
    }
    vector_word("covariance", (uint32_t)MK_F(mk_unscented_covariance)(now->n, &view, P));
    vector_numbers("P", MK_PACKED(now->n), P);
}

static mk_status_t start(void) { return MK_F(mk_unscented_start)(now->n, now->m, now->slots, &view, &config); }

static void run(const variant_t *variant, int number) {
    vector_begin("unscented", now->n, now->m, now->slots, number);
    draw_model(variant, number);
    tell("start", start());
    for (int t = 0; t < STEPS; t++) one_step(t);
}

/* What is refused, or fails and leaves all as it was. */
static void failure(int number) {
    const int n = now->n;
    MK_REAL z[M], s[N], S[MK_PACKED(N)];
    vector_begin("unscented, failing", n, now->m, now->slots, number);
    draw_model(variants + (number % 2 ? 3 : 0), number);
    if (number == 0) P0[MK_PACKED(n) - 1] = MK_R(-1.0);
    if (number == 1) R[0][0] = MK_R(0.0);
    if (number == 2) Q[MK_PACKED(n) - 1] = MK_R(-1.0);
    if (number == 3) x0[n - 1] = not_a_number;
    if (number == 4) config.increments = 0;
    tell("start", start());
    if (number < 5) return;
    one_step(0);
    tell("predict backwards", predict(MK_R(-1.0), NULL));
    tell("predict by no time", predict(not_a_number, NULL));
    for (int r = 0; r < M; r++) z[r] = not_a_number;
    tell("put NaN", MK_F(mk_unscented_put)(now->m, now->slots, &view, 0, z));
    /* A target at the sensor: no bearing, no derivative. */
    for (int axis = 0; axis < now->motion->dimensions; axis++)
        for (int l = 0; l < now->slots; l++) site[l].position[axis] = view.x[now->motion->position[axis]];
    put_readings(0);
    tell("update at the sensor", update());
    for (int l = 0; l < now->slots; l++) tell("drop", MK_F(mk_unscented_drop)(now->slots, &view, l));
    tell("update without readings", update());
    draw_many(n, MK_R(1.0), s);
    draw_covariance(n, 2, power(8), S);
    for (int i = 0; i < MK_PACKED(n); i++) S[i] = -S[i];
    tell("inform of less than nothing", inform(MK_R(1.0), s, S));
    s[n - 1] = not_a_number;
    tell("inform of NaN", inform(MK_R(1.0), s, S));
    tell("restart", MK_F(mk_unscented_restart)(n, now->slots, &view, truth, P0));
}

void vectors_run(vectors_kernels_t chosen) {
    pass = chosen;
    draw_seed(20251121);
    for (now = dimensions; now < dimensions + sizeof dimensions / sizeof dimensions[0]; now++) {
        view = now->view(work);
        memset(view.core, 0, sizeof *view.core);
        memset(view.x, 0, (size_t)now->n * sizeof *view.x);
        memset(view.L, 0, (size_t)MK_PACKED(now->n) * sizeof *view.L);
        memset(view.record, 0, (size_t)now->slots * sizeof *view.record);
        memset(view.have, 0, (size_t)now->slots);
        for (int i = 0; i < (int)(sizeof variants / sizeof variants[0]); i++) run(variants + i, i);
        for (int i = 0; i < 9; i++) failure(i);
    }
}
