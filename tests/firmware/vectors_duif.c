/* SPDX-License-Identifier: MIT */
/* A network in one program: the nodes of duif_nodes.h and a target that circles among them, 20 % of the frames lost. What each sends (its frames' CRC)
   and thinks after every step is told. In the second pass frames come in another order and some twice: that changes nothing. */
#include "vectors.h"

#include "duif_nodes.h"
#include "vectors_seal.h"

const char *const vectors_passes[2] = {"frames in order", "frames in another order"};
static vectors_kernels_t pass;

typedef struct {
    uint8_t protocol, iterations, steps, numbers;
    uint8_t with_origin, gated, sealed;
    uint8_t reboots; /* the step before which node 3 is reset, 0: never */
} variant_t;
static const variant_t variants[] = {
    {MK_CONSENSUS_METROPOLIS, 10, 200, OWN_NUMBERS, 0, 0, 0, 0}, {MK_CONSENSUS_METROPOLIS, 10, 200, MK_NUMBERS_F16, 1, 0, 0, 0},
    {MK_CONSENSUS_PERRON, 10, 30, OWN_NUMBERS, 0, 0, 0, 0},      {MK_CONSENSUS_RATIO, 10, 40, MK_NUMBERS_F32, 1, 0, 0, 20},
    {MK_CONSENSUS_SUM, 1, 60, OWN_NUMBERS, 0, 0, 0, 0},          {MK_CONSENSUS_PAPER, 10, 30, OWN_NUMBERS, 0, 1, 0, 0},
    {MK_CONSENSUS_METROPOLIS, 10, 20, OWN_NUMBERS, 0, 0, 1, 0},
};

static MK_REAL truth[N];
static mk_aead_t aead;

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
        configure(k, variant->protocol, variant->iterations, variant->numbers, variant->with_origin, variant->gated);
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
