/* SPDX-License-Identifier: MIT */
/* Networks of consensus nodes over the kernels, and the same as dense matrices in double: NAME(net_t). Slots follow the numbers of the nodes. */

typedef struct {
    TYPE(mk_consensus) core;
    TYPE(mk_consensus_config) config;
    REAL now[NODES * (P + 1)], next[NODES * (P + 1)], sum[P + 1], work[MK_CONSENSUS_WORK(P)], weight[NODES];
    uint16_t degree[NODES];
    uint8_t have[NODES];
    int number[NODES]; /* of the node in each slot */
} NAME(member_t);

typedef struct {
    int count, hears[NODES][NODES]; /* receiver, sender */
    double weight[NODES][NODES];
    NAME(member_t) member[NODES];
} NAME(net_t);

static TYPE(mk_consensus_view) NAME(view)(NAME(member_t) * a) {
    const TYPE(mk_consensus_view) view = {&a->core, a->now, a->next, a->sum, a->have, a->work};
    return view;
}

/* hears and weight are filled already; weights are given to the nodes where weighted. Zeroed nodes are started. */
static void NAME(net_start)(NAME(net_t) * net, int protocol, int iterations, double total, int weighted) {
    for (int i = 0; i < net->count; i++) {
        NAME(member_t) *const a = net->member + i;
        memset(a, 0, sizeof *a);
        int slots = 1;
        a->number[0] = i;
        for (int j = 0; j < net->count; j++) {
            if (i == j) continue;
            if (net->hears[j][i]) a->degree[0]++;
            if (!net->hears[i][j]) continue;
            a->number[slots] = j;
            for (int k = 0; k < net->count; k++) a->degree[slots] = (uint16_t)(a->degree[slots] + (k != j && net->hears[k][j]));
            a->weight[slots++] = (REAL)net->weight[i][j];
        }
        a->config.values = P;
        a->config.slots = (uint16_t)slots;
        a->config.iterations = (uint16_t)iterations;
        a->config.network = (uint16_t)net->count;
        a->config.protocol = (uint8_t)protocol;
        a->config.total = (REAL)total;
        a->config.weight = weighted ? a->weight : NULL;
        a->config.degree = a->degree;
        const TYPE(mk_consensus_view) view = NAME(view)(a);
        assert_int_equal(NAME(mk_consensus_start)(P, slots, &view, &a->config), MK_OK);
    }
}

static void NAME(net_begin)(NAME(net_t) * net, double values[NODES][P], const int *measures) {
    for (int i = 0; i < net->count; i++) {
        REAL own[P];
        for (int k = 0; k < P; k++) own[k] = (REAL)values[i][k];
        const TYPE(mk_consensus_view) view = NAME(view)(net->member + i);
        assert_int_equal(NAME(mk_consensus_begin)(P, &view, own, measures[i]), MK_OK);
    }
}

/* One iteration: messages that arrive (receiver, sender), in random order. */
static void NAME(net_iterate)(NAME(net_t) * net, int arrives[NODES][NODES], generator_t *g) {
    for (int i = 0; i < net->count; i++) {
        NAME(member_t) *const a = net->member + i;
        const TYPE(mk_consensus_view) view = NAME(view)(a);
        const int slots = a->config.slots, first = slots > 1 ? draw_below(g, slots - 1) : 0;
        for (int k = 0; k < slots - 1; k++) {
            const int slot = 1 + (first + k) % (slots - 1), sender = a->number[slot];
            if (arrives[i][sender])
                assert_int_equal(NAME(mk_consensus_put)(P, &view, slot, a->core.iteration, net->member[sender].now), MK_OK);
        }
    }
    for (int i = 0; i < net->count; i++) {
        const TYPE(mk_consensus_view) view = NAME(view)(net->member + i);
        assert_int_equal(NAME(mk_consensus_iterate)(P, &view), MK_OK);
    }
}

static void NAME(net_run)(NAME(net_t) * net, int iterations, generator_t *g) {
    for (int l = 0; l < iterations; l++) NAME(net_iterate)(net, net->hears, g);
}

static void NAME(net_result)(NAME(net_t) * net, double result[NODES][P]) {
    for (int i = 0; i < net->count; i++) {
        REAL own[P];
        const TYPE(mk_consensus_view) view = NAME(view)(net->member + i);
        assert_int_equal(NAME(mk_consensus_average)(&view, own), MK_OK);
        for (int k = 0; k < P; k++) result[i][k] = (double)own[k];
    }
}

/* Values and mass that nodes hold and that are on their way, beside those at first. */
static void NAME(net_total)(NAME(net_t) * net, double *total) {
    for (int k = 0; k <= P; k++) {
        total[k] = 0.0;
        for (int i = 0; i < net->count; i++) {
            const NAME(member_t) *const a = net->member + i;
            total[k] += (double)a->next[k];
            for (int l = 1; l < a->config.slots; l++) total[k] += (double)net->member[a->number[l]].now[k] - (double)a->now[l * (P + 1) + k];
        }
    }
}
