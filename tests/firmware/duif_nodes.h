/* SPDX-License-Identifier: MIT */
/* Four nodes of meshkal/duif.h that hear each other in a triangle with a tail: three with ranges to a target in the plane, one blind. Included once,
   after real.h; N, M and NODES are dimensions that it gives. */
#ifndef FIRMWARE_DUIF_NODES_H
#define FIRMWARE_DUIF_NODES_H

#include <string.h>

#include <meshkal/duif.h>
#include <meshkal/tracking.h>

enum { NODES = 4, N = 4, M = 1, BLIND = 1, FRAME = MK_FRAME_SEALED + MK_CONSENSUS_HEADER + sizeof(MK_REAL) * MK_DUIF_VALUES(N) };
#define OWN_NUMBERS (MK_BITS == 64 ? MK_NUMBERS_F64 : MK_NUMBERS_F32)

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

/* --- their configurations: those of duif.json ------------------------------------------------------------------------------------ */

static const uint16_t neighbours[NODES][NODES] = {{0, 1, 2}, {1, 0, 2}, {2, 0, 1, 3}, {3, 2}};
static const uint16_t degree[NODES][NODES] = {{2, 2, 3}, {2, 2, 3}, {3, 2, 2, 1}, {1, 3}};

static const mk_motion_t motion = {N, 2, {0, 2, 0}, {1, 3, 0}, 0};
static const MK_F_T(mk_site) site[NODES] = {{&motion, {MK_R(0.0)}, {MK_R(0.0)}},
                                            {&motion, {MK_R(40.0), MK_R(-35.0)}, {MK_R(0.0)}},
                                            {&motion, {MK_R(80.0), MK_R(10.0)}, {MK_R(0.0)}},
                                            {&motion, {MK_R(30.0), MK_R(70.0)}, {MK_R(0.0)}}};
static const MK_REAL Q[MK_PACKED(N)] = {MK_R(0x1p-6), MK_R(0x1p-6), MK_R(0x1p-5), 0, 0, MK_R(0x1p-6), 0, 0, MK_R(0x1p-6), MK_R(0x1p-5)};
static const MK_REAL P0[MK_PACKED(N)] = {MK_R(25.0), 0, MK_R(4.0), 0, 0, MK_R(25.0), 0, 0, 0, MK_R(4.0)};
static const MK_REAL x0[N] = {MK_R(15.0), 0, MK_R(30.0), 0}, R[1] = {MK_R(0.09375)};
/* Not in that scenario. */
static const MK_REAL origin[N] = {MK_R(40.0), 0, MK_R(25.0), 0};
static const MK_REAL threshold[1] = {MK_R(9.0)};
static const MK_F_T(mk_gate) gate = {threshold, NULL, 4, MK_GATE_SKIP};
#define SENSOR(k) {{MK_F(mk_range), MK_F(mk_range_jacobian), site + (k), NULL}, R, 1}
static const MK_F_T(mk_sensor) sensor[NODES] = {SENSOR(0), SENSOR(1), SENSOR(2), SENSOR(3)};

static MK_F_T(mk_duif_config) config[NODES];

static void configure(int k, int protocol, int iterations, int numbers, int with_origin, int gated) {
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
    c->filter.gate = gated ? &gate : NULL;
    c->filter.increments = 1;
    c->consensus.values = N + MK_PACKED(N) + (protocol == MK_CONSENSUS_SUM ? N : 0);
    c->consensus.slots = (uint16_t)node[k]->slots;
    c->consensus.iterations = (uint16_t)iterations;
    c->consensus.network = NODES;
    c->consensus.protocol = (uint8_t)protocol;
    c->consensus.degree = degree[k];
    c->nodes = neighbours[k];
    c->model = UINT32_C(0x2d4b1f07);
    c->catch_up = 5;
    c->numbers = (uint8_t)numbers;
    c->epsilon = protocol == MK_CONSENSUS_SUM ? MK_R(0.25) : MK_R(0.0);
    c->origin = with_origin ? origin : NULL;
}

#endif
