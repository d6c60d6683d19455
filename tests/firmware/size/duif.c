/* SPDX-License-Identifier: MIT */
/* Runs a node of the distributed unscented information filter among its neighbours, all of which hear each other, for the instruction counter (count.c),
   and measures its stack: a target of constant velocity, one range (or SIZE_M ranges) a node, 10 iterations of Metropolis consensus, no frame lost.
   Writes what size.py reads:  steps NUMBER,  stack FUNCTION BYTES,  ram BYTES. */
#include <string.h>

#include "duif_node.h"
#include "markers.h"
#include "semihost.h"
#include "stack.h"

enum { N = SIZE_N, M = SIZE_M, NODES = SIZE_SLOTS, STEPS = 12, ITERATIONS = 10 };

#include "models.h"

MARKER(size_begin_start)
MARKER(size_begin_predict)
MARKER(size_begin_measure)
MARKER(size_begin_contribute)
MARKER(size_begin_frame)
MARKER(size_begin_accept)
MARKER(size_begin_iterate)
MARKER(size_begin_fuse)

enum { START, PREDICT, MEASURE, CONTRIBUTE, FRAME, ACCEPT, ITERATE, FUSE, FUNCTIONS };
static const char *const names[FUNCTIONS] = {"start", "predict", "measure", "contribute", "frame", "accept", "iterate", "fuse"};
static uint32_t worst[FUNCTIONS];

static float Q[MK_PACKED(N)], P0[MK_PACKED(N)], R[MK_PACKED(M)], x0[N], truth[N];
static uint16_t degree[NODES];
static struct {
    node_t node;
    node_config_t config;
    mk_sensor_f32_t sensor;
    site_t site;
    uint16_t nodes[NODES];
} all[NODES]; /* the first is measured */
static uint32_t seed = 1;
static mk_status_t status;

/* Uniform on [-1, 1). */
static float draw(void) {
    seed = seed * UINT32_C(1664525) + UINT32_C(1013904223);
    return (float)((int32_t)seed >> 8) * (1.0f / 8388608.0f);
}

static void expect(mk_status_t got) {
    if (got == MK_OK) return;
    mk_write("status ");
    mk_write_number((uint32_t)got);
    mk_write("\n");
    mk_exit(1);
}

static void configure(int k) {
    node_config_t *const c = &all[k].config;
    for (int r = 0; r < M; r++) {
        const int place = k * M + r; /* (0, 0), (2, 0), (0, 2), and on */
        all[k].site.position[r][0] = place % 3 == 1 ? 2.0f : 0.0f;
        all[k].site.position[r][1] = place % 3 == 2 ? 2.0f : 0.0f;
        all[k].site.position[r][2] = 0.1f * (float)place;
    }
    all[k].sensor.model.function = ranges;
    all[k].sensor.model.context = &all[k].site;
    all[k].sensor.R = R;
    all[k].sensor.rows = M;
    for (int l = 0; l < NODES; l++) all[k].nodes[l] = (uint16_t)((k + l) % NODES);
    c->filter.n = N;
    c->filter.m = M;
    c->filter.slots = 1;
    c->filter.transition.model.function = moves;
    c->filter.transition.Q = Q;
    c->filter.sensor = &all[k].sensor;
    c->filter.x0 = x0;
    c->filter.P0 = P0;
    c->filter.transform.spread = 3.0f;
    c->filter.transform.correction = -1.0f;
    c->filter.increments = 1;
    c->consensus.values = N + MK_PACKED(N);
    c->consensus.slots = NODES;
    c->consensus.iterations = ITERATIONS;
    c->consensus.network = NODES;
    c->consensus.degree = degree;
    c->nodes = all[k].nodes;
}

static void one_step(void) {
    static uint8_t bytes[NODES][node_frame_max];
    size_t length[NODES] = {0};
    (void)moves(0, 1.0f, 1, truth, truth);
    for (int k = 0; k < NODES; k++) {
        float z[M];
        for (int r = 0; r < M; r++) z[r] = range(&all[k].site, r, truth) + 0.04f * draw();
        if (k == 0) {
            CALL(PREDICT, size_begin_predict, duif_predict(&all[0].node, 1.0f));
            expect(status);
            CALL(MEASURE, size_begin_measure, duif_measure(&all[0].node, z));
            expect(status);
            CALL(CONTRIBUTE, size_begin_contribute, duif_contribute(&all[0].node));
            expect(status);
        } else {
            expect(duif_predict(&all[k].node, 1.0f));
            expect(duif_measure(&all[k].node, z));
            expect(duif_contribute(&all[k].node));
        }
    }
    for (int i = 0; i < ITERATIONS; i++) {
        CALL(FRAME, size_begin_frame, (mk_status_t)((length[0] = duif_frame(&all[0].node, bytes[0])) == 0));
        expect(status);
        for (int k = 1; k < NODES; k++) length[k] = duif_frame(&all[k].node, bytes[k]);
        for (int k = 0; k < NODES; k++)
            for (int l = 0; l < NODES; l++) {
                if (k == l) continue;
                if (k == 0) CALL(ACCEPT, size_begin_accept, duif_accept(&all[0].node, bytes[l], length[l]));
                else status = duif_accept(&all[k].node, bytes[l], length[l]);
                expect(status);
            }
        CALL(ITERATE, size_begin_iterate, duif_iterate(&all[0].node));
        expect(status);
        for (int k = 1; k < NODES; k++) expect(duif_iterate(&all[k].node));
    }
    CALL(FUSE, size_begin_fuse, duif_fuse(&all[0].node));
    expect(status);
    for (int k = 1; k < NODES; k++) expect(duif_fuse(&all[k].node));
}

int main(void) {
    size_loops();
    put_motion(x0, P0, Q);
    for (int r = 0; r < M; r++) R[MK_PACKED(r) + r] = 2e-3f;
    for (int i = 0; i < N; i++) truth[i] = x0[i] + (i % 2 == 0 ? 0.1f : 0.01f) * draw();
    for (int k = 0; k < NODES; k++) {
        degree[k] = NODES - 1;
        configure(k);
    }
    CALL(START, size_begin_start, duif_start(&all[0].node, &all[0].config));
    expect(status);
    for (int k = 1; k < NODES; k++) expect(duif_start(&all[k].node, &all[k].config));
    for (int t = 0; t < STEPS; t++) one_step();
    mk_write("steps ");
    mk_write_number(STEPS);
    mk_write("\n");
    size_tell(FUNCTIONS, names, worst, (uint32_t)sizeof all[0].node);
    return 0;
}
