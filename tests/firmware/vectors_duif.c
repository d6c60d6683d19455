/* SPDX-License-Identifier: MIT */
/* A network of nodes of meshkal/duif.h in one program: four that hear each other in a triangle with a tail, three with ranges to a target that
   circles among them and one that is blind, 20 % of the frames lost. What each sends (its frames' CRC) and thinks after every step is told. In the second
   pass frames come in another order and some twice: that changes nothing. */
#include "vectors.h"

#include <string.h>

#include <meshkal/duif.h>
#include <meshkal/tracking.h>

#include "vectors_seal.h"

enum { NODES = 4, N = 4, M = 1, BLIND = 1, FRAME = MK_FRAME_SEALED + MK_CONSENSUS_HEADER + sizeof(MK_REAL) * MK_DUIF_VALUES(N) };

const char *const vectors_passes[2] = {"frames in order", "frames in another order"};
static vectors_kernels_t pass;

/* --- nodes of 2, 3 and 4 slots ---------------------------------------------------------------------------------------------- */

typedef struct {
    int slots;
    const MK_F_T(mk_duif) * core;
    const MK_REAL *x, *L;
    mk_status_t (*start)(const MK_F_T(mk_duif_config) * config);
    mk_status_t (*secure)(const mk_aead_t *aead);
    mk_status_t (*predict)(MK_REAL dt);
    mk_status_t (*measure)(const MK_REAL *z);
    mk_status_t (*contribute)(void);
    size_t (*frame)(uint8_t *bytes);
    mk_status_t (*accept)(const uint8_t *bytes, size_t length);
    mk_status_t (*iterate)(void);
    mk_status_t (*fuse)(void);
} face_t;

#if MK_BITS == 32
MK_DUIF(node2, f32, N, M, 2);
MK_DUIF(node3, f32, N, M, 3);
MK_DUIF(node4, f32, N, M, 4);
#else
MK_DUIF(node2, f64, N, M, 2);
MK_DUIF(node3, f64, N, M, 3);
MK_DUIF(node4, f64, N, M, 4);
#endif

#define FACE(k, type, slots)                                                                                                  \
    static type##_t object##k;                                                                                                \
    static type##_secure_t secure##k;                                                                                         \
    static mk_status_t start##k(const MK_F_T(mk_duif_config) * config) { return type##_start(&object##k, config); }           \
    static mk_status_t seal##k(const mk_aead_t *aead) {                                                                       \
        memset(&secure##k, 0, sizeof secure##k);                                                                              \
        return type##_secure(&object##k, &secure##k, aead, 7);                                                                \
    }                                                                                                                         \
    static mk_status_t predict##k(MK_REAL dt) { return type##_predict(&object##k, dt, 0); }                                   \
    static mk_status_t measure##k(const MK_REAL *z) { return type##_measure(&object##k, z); }                                 \
    static mk_status_t contribute##k(void) { return type##_contribute(&object##k); }                                          \
    static size_t frame##k(uint8_t *bytes) { return type##_frame(&object##k, bytes); }                                        \
    static mk_status_t accept##k(const uint8_t *bytes, size_t length) { return type##_accept(&object##k, bytes, length); }    \
    static mk_status_t iterate##k(void) { return type##_iterate(&object##k); }                                                \
    static mk_status_t fuse##k(void) { return type##_fuse(&object##k); }                                                      \
    static const face_t face##k = {slots,    &object##k.core, object##k.filter.x, object##k.filter.L, start##k,   seal##k, predict##k, \
                                   measure##k, contribute##k, frame##k,           accept##k,          iterate##k, fuse##k};

FACE(0, node3, 3)
FACE(1, node3, 3)
FACE(2, node4, 4)
FACE(3, node2, 2)
static const face_t *const node[NODES] = {&face0, &face1, &face2, &face3};

/* --- what they are told ------------------------------------------------------------------------------------------------------ */

static const uint16_t neighbours[NODES][NODES] = {{0, 1, 2}, {1, 0, 2}, {2, 0, 1, 3}, {3, 2}};
static const uint16_t degree[NODES][NODES] = {{2, 2, 3}, {2, 2, 3}, {3, 2, 2, 1}, {1, 3}};

static const mk_motion_t motion = {N, 2, {0, 2, 0}, {1, 3, 0}, 0};
static const MK_F_T(mk_site) site[NODES] = {{&motion, {MK_R(0.0)}, {MK_R(0.0)}},
                                            {&motion, {MK_R(40.0), MK_R(-35.0)}, {MK_R(0.0)}},
                                            {&motion, {MK_R(80.0), MK_R(10.0)}, {MK_R(0.0)}},
                                            {&motion, {MK_R(30.0), MK_R(70.0)}, {MK_R(0.0)}}};
static const MK_REAL Q[MK_PACKED(N)] = {MK_R(0.01), MK_R(0.015), MK_R(0.03), 0, 0, MK_R(0.01), 0, 0, MK_R(0.015), MK_R(0.03)};
static const MK_REAL P0[MK_PACKED(N)] = {MK_R(25.0), 0, MK_R(4.0), 0, 0, MK_R(25.0), 0, 0, 0, MK_R(4.0)};
static const MK_REAL x0[N] = {MK_R(15.0), 0, MK_R(30.0), 0}, origin[N] = {MK_R(40.0), 0, MK_R(25.0), 0}, R[1] = {MK_R(0.1)};
static const MK_REAL threshold[1] = {MK_R(9.0)};
static const MK_F_T(mk_gate) gate = {threshold, NULL, 4, MK_GATE_SKIP};
#define SENSOR(k) {{MK_F(mk_range), MK_F(mk_range_jacobian), site + (k), NULL}, R, 1}
static const MK_F_T(mk_sensor) sensor[NODES] = {SENSOR(0), SENSOR(1), SENSOR(2), SENSOR(3)};

typedef struct {
    uint8_t protocol, iterations, steps, numbers;
    uint8_t with_origin, gated, sealed;
    uint8_t reboots; /* the step before which node 3 is reset, 0: never */
} variant_t;
#define OWN (MK_BITS == 64 ? MK_NUMBERS_F64 : MK_NUMBERS_F32)
static const variant_t variants[] = {
    {MK_CONSENSUS_METROPOLIS, 10, 200, OWN, 0, 0, 0, 0}, {MK_CONSENSUS_METROPOLIS, 10, 200, MK_NUMBERS_F16, 1, 0, 0, 0},
    {MK_CONSENSUS_PERRON, 10, 30, OWN, 0, 0, 0, 0},      {MK_CONSENSUS_RATIO, 10, 40, MK_NUMBERS_F32, 1, 0, 0, 20},
    {MK_CONSENSUS_SUM, 1, 60, OWN, 0, 0, 0, 0},          {MK_CONSENSUS_PAPER, 10, 30, OWN, 0, 1, 0, 0},
    {MK_CONSENSUS_METROPOLIS, 10, 20, OWN, 0, 0, 1, 0},
};

static MK_F_T(mk_duif_config) config[NODES];
static MK_REAL truth[N];
static mk_aead_t aead;

static void configure(int k, const variant_t *variant) {
    MK_F_T(mk_duif_config) *const c = config + k;
    memset(c, 0, sizeof *c);
    c->filter.n = N;
    c->filter.m = M;
    c->filter.slots = 1;
    c->filter.transition.model.function = MK_F(mk_constant_velocity);
    c->filter.transition.model.context = &motion;
    c->filter.transition.Q = Q;
    c->filter.sensor = sensor + k;
    c->filter.x0 = x0;
    c->filter.P0 = P0;
    c->filter.transform.spread = (MK_REAL)N;
    c->filter.transform.correction = MK_R(-1.0);
    c->filter.gate = variant->gated ? &gate : NULL;
    c->filter.increments = 1;
    c->consensus.values = N + MK_PACKED(N) + (variant->protocol == MK_CONSENSUS_SUM ? N : 0);
    c->consensus.slots = (uint16_t)node[k]->slots;
    c->consensus.iterations = variant->iterations;
    c->consensus.network = NODES;
    c->consensus.protocol = variant->protocol;
    c->consensus.degree = degree[k];
    c->nodes = neighbours[k];
    c->model = UINT32_C(0x2d4b1f07);
    c->catch_up = 5;
    c->numbers = variant->numbers;
    c->epsilon = variant->protocol == MK_CONSENSUS_SUM ? MK_R(0.25) : MK_R(0.0);
    c->origin = variant->with_origin ? origin : NULL;
}

/* --- a run ------------------------------------------------------------------------------------------------------------------- */

/* Of the message of an iteration from one node to another: one in five, in both passes the same. */
static int lost(int step, int iteration, int from, int to) {
    const uint32_t mixed = (uint32_t)(((step * 16 + iteration) * NODES + from) * NODES + to + 1) * UINT32_C(2654435761);
    return (mixed ^ mixed >> 15) % 5 == 0;
}

static void exchange(int step, int iteration, uint32_t *crc) {
    uint8_t bytes[FRAME];
    for (int i = 0; i < NODES; i++) {
        const int from = pass ? NODES - 1 - i : i;
        const size_t length = node[from]->frame(bytes);
        crc[from] = mk_crc32(crc[from], bytes, length);
        for (int l = 1; l < node[from]->slots; l++) {
            const int to = neighbours[from][l];
            if (lost(step, iteration, from, to)) continue;
            (void)node[to]->accept(bytes, length);
            if (pass && (step + to) % 3 == 0) (void)node[to]->accept(bytes, length);
        }
    }
    for (int k = 0; k < NODES; k++) vector_word("iterate", (uint32_t)node[k]->iterate());
}

/* The target is drawn to the middle by a spring. */
static void move(void) {
    MK_REAL next[N];
    (void)MK_F(mk_constant_velocity)(&motion, MK_R(1.0), 1, truth, next);
    next[1] += MK_R(0.004) * (MK_R(35.0) - next[0]);
    next[3] += MK_R(0.004) * (MK_R(20.0) - next[2]);
    memcpy(truth, next, sizeof truth);
}

static void one_step(const variant_t *variant, int step) {
    uint32_t crc[NODES] = {0};
    move();
    vector_numbers("truth", N, truth);
    for (int k = 0; k < NODES; k++) {
        MK_REAL z;
        vector_word("predict", (uint32_t)node[k]->predict(MK_R(1.0)));
        vector_word("range", (uint32_t)MK_F(mk_range)(site + k, MK_R(0.0), 1, truth, &z));
        z += MK_R(0.4) * draw();
        if (variant->gated && draw_below(6) == 0) z += MK_R(8.0);
        vector_numbers("reading", 1, &z);
        if (k != BLIND && draw_below(10) > 0) vector_word("measure", (uint32_t)node[k]->measure(&z));
        vector_word("contribute", (uint32_t)node[k]->contribute());
    }
    for (int l = 0; l < variant->iterations; l++) exchange(step, l, crc);
    for (int k = 0; k < NODES; k++) {
        vector_word("frames", crc[k]);
        vector_word("fuse", (uint32_t)node[k]->fuse());
        vector_numbers("x", N, node[k]->x);
        vector_numbers("L", MK_PACKED(N), node[k]->L);
        vector_word("flags, heard, missing", (uint32_t)node[k]->core->flags << 16 | node[k]->core->heard << 8 | node[k]->core->missing);
    }
}

static mk_status_t start(int k, const variant_t *variant) {
    const mk_status_t status = node[k]->start(config + k);
    return status == MK_OK && variant->sealed ? node[k]->secure(&aead) : status;
}

static void run(const variant_t *variant, int number) {
    vector_begin("network", N, M, NODES, number);
    truth[0] = MK_R(15.0) + draw();
    truth[1] = MK_R(0.8);
    truth[2] = MK_R(30.0) + draw();
    truth[3] = MK_R(1.1);
    for (int k = 0; k < NODES; k++) {
        configure(k, variant);
        vector_word("start", (uint32_t)start(k, variant));
    }
    for (int step = 0; step < variant->steps; step++) {
        if (variant->reboots && step == variant->reboots) vector_word("start again", (uint32_t)start(NODES - 1, variant));
        one_step(variant, step);
    }
    for (int k = 0; k < NODES; k++) {
        const MK_F_T(mk_duif) *const core = node[k]->core;
        vector_word("taken, early", core->counts[MK_OK] << 16 | core->early);
        vector_word("unsent, isolated, uninformed, unfused", core->unsent << 24 | core->isolated << 16 | core->uninformed << 8 | core->unfused);
        vector_word("caught up, restarts, step", core->caught_up << 24 | core->restarts << 16 | core->step);
    }
}

void vectors_run(vectors_kernels_t chosen) {
    pass = chosen;
    draw_seed(20251122);
    vectors_aead(&aead);
    for (int i = 0; i < (int)(sizeof variants / sizeof variants[0]); i++) run(variants + i, i);
}
