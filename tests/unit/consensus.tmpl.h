/* SPDX-License-Identifier: MIT */
#include "consensus_bench.tmpl.h"

MK_CONSENSUS_OF(NAME(pair), PRECISION, 3, 3);
#define PAIR(function) JOIN(NAME(pair), _##function)

/* Every protocol against the powers of its matrix, written out from the definition, iteration by iteration, with and without loss. */
static void NAME(dense)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (uint64_t seed = 1; seed <= 40; seed++) {
        generator_t g = {seed};
        double X[NODES][P], mass[NODES], result[NODES][P], scale[NODES], total = 0.0;
        int measures[NODES], arrives[NODES][NODES];
        net.count = 2 + draw_below(&g, NODES - 1);
        draw_graph(&g, net.count, net.hears, net.weight);
        const int protocol = (int)(seed % 4), weighted = draw_chance(&g, 0.5), knows_total = draw_chance(&g, 0.5);
        const double loss = seed > 20 ? 0.4 : 0.0;
        for (int i = 0; i < net.count; i++) {
            measures[i] = draw_chance(&g, 0.6);
            double d = measures[i];
            for (int j = 0; j < net.count; j++) d += net.hears[i][j] ? weighted ? net.weight[i][j] : 1.0 : 0.0;
            scale[i] = d;
            total += d;
        }
        NAME(net_start)(&net, protocol, 12, protocol == MK_CONSENSUS_PERRON && knows_total ? total : 0.0, weighted);
        for (int i = 0; i < net.count; i++)
            for (int k = 0; k < P; k++) X[i][k] = (double)(REAL)draw_normal(&g);
        NAME(net_begin)(&net, X, measures);
        for (int i = 0; i < net.count; i++) {
            const double f = protocol != MK_CONSENSUS_PERRON ? 1.0 : knows_total ? total / (net.count * scale[i]) : 1.0 / scale[i];
            for (int k = 0; k < P; k++) X[i][k] *= f;
            mass[i] = protocol == MK_CONSENSUS_PERRON && knows_total ? 1.0 : f;
        }
        dense_t dense;
        dense_start(&dense, net.count, X, mass);
        for (int l = 0; l < 12; l++) {
            for (int i = 0; i < net.count; i++)
                for (int j = 0; j < net.count; j++) arrives[i][j] = net.hears[i][j] && !draw_chance(&g, loss);
            NAME(net_iterate)(&net, arrives, &g);
            dense_iterate(&dense, protocol, net.hears, weighted ? net.weight : NULL, measures, arrives);
            if (protocol == MK_CONSENSUS_PERRON && knows_total)
                for (int i = 0; i < net.count; i++) dense.mass[i] = 1.0;
            NAME(net_result)(&net, result);
            for (int i = 0; i < net.count; i++)
                for (int k = 0; k < P; k++) {
                    const double expected = dense.X[i][k] / dense.mass[i];
                    assert_true(fabs(result[i][k] - expected) <= (BITS == 64 ? 1e-11 : 2e-4) * (1.0 + fabs(expected)));
                }
        }
    }
}

/* What each protocol ends at: the path of three nodes, then random graphs. Not all nodes measure. */
static void NAME(limits)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (uint64_t seed = 0; seed < 12; seed++) {
        generator_t g = {seed + 77};
        net.count = seed == 0 ? 3 : NODES;
        draw_graph(&g, net.count, net.hears, net.weight);
        if (seed == 0) path_graph(3, net.hears);
        for (int protocol = 0; protocol < MK_CONSENSUS_SUM; protocol++)
            for (int all = 0; all < 2; all++) {
                double X[NODES][P], result[NODES][P], pi[NODES], sum = 0.0;
                int measures[NODES];
                const int iterations = seed == 0 && protocol == MK_CONSENSUS_METROPOLIS ? 50 : 600;
                for (int i = 0; i < net.count; i++) {
                    measures[i] = all || i % 3 == 0;
                    pi[i] = measures[i];
                    for (int j = 0; j < net.count; j++) pi[i] += net.hears[i][j];
                    sum += pi[i];
                    for (int k = 0; k < P; k++) X[i][k] = (double)(REAL)draw_normal(&g);
                }
                NAME(net_start)(&net, protocol, iterations, all ? sum : 0.0, 0);
                NAME(net_begin)(&net, X, measures);
                NAME(net_run)(&net, iterations, &g);
                NAME(net_result)(&net, result);
                for (int k = 0; k < P; k++) {
                    double expected = 0.0, average = 0.0;
                    for (int i = 0; i < net.count; i++) {
                        average += X[i][k] / net.count;
                        expected += pi[i] / sum * X[i][k];
                    }
                    if (protocol != MK_CONSENSUS_PAPER) expected = average;
                    /* The path of three nodes has the second eigenvalue 2/3: a bound for its 50 iterations, 1.6e-9. Running sums of 600 float32. */
                    double bound = BITS == 64 ? 1e-9 : protocol == MK_CONSENSUS_RATIO ? 5e-4 : 1e-4;
                    if (iterations == 50) {
                        double norm = 0.0;
                        for (int i = 0; i < 3; i++) norm += (X[i][k] - average) * (X[i][k] - average);
                        bound = pow(2.0 / 3.0, 50) * sqrt(norm) * (1.0 + 1e-6) + 50.0 * (BITS == 64 ? DBL_EPSILON : (double)FLT_EPSILON);
                    }
                    for (int i = 0; i < net.count; i++) assert_true(fabs(result[i][k] - expected) <= bound);
                }
            }
    }
}

#if BITS == 64 /* in float32 rounding ends the fall before the other eigenvalues have died out */
/* Disagreement falls by the second largest modulus of the matrix an iteration. */
static void NAME(rate)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (uint64_t seed = 0; seed < 6; seed++)
        for (int protocol = MK_CONSENSUS_METROPOLIS; protocol <= MK_CONSENSUS_PAPER; protocol++) {
            generator_t g = {seed + 3};
            double X[NODES][P], W[NODES][NODES], spread[2];
            const int measures[NODES] = {1, 1, 1, 1, 1, 1, 1};
            net.count = NODES;
            path_graph(NODES, net.hears);
            for (int extra = 0; extra < (int)seed % 3; extra++) net.hears[extra][5] = net.hears[5][extra] = 1;
            dense_matrix(protocol, net.count, net.hears, NULL, measures, net.hears, W);
            const double second = second_modulus(net.count, W);
            for (int i = 0; i < net.count; i++)
                for (int k = 0; k < P; k++) X[i][k] = draw_normal(&g);
            NAME(net_start)(&net, protocol, 200, 0.0, 0);
            NAME(net_begin)(&net, X, measures);
            for (int part = 0; part < 2; part++) {
                NAME(net_run)(&net, part == 0 ? 60 : 40, &g);
                NAME(net_result)(&net, X);
                spread[part] = spread_of(net.count, X);
            }
            assert_true(second > 0.3 && second < 0.97);
            assert_true(fabs(pow(spread[1] / spread[0], 1.0 / 40.0) - second) < 2e-3);
        }
}

#endif

/* Ratio consensus: messages are lost, links come and go and go one way. Nothing is ever lost of what is on its way; the end is the average. */
static void NAME(loss)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (uint64_t seed = 0; seed < 9; seed++) {
        generator_t g = {seed + 1000};
        double X[NODES][P], result[NODES][P], first[P + 1], total[P + 1];
        int measures[NODES] = {0}, arrives[NODES][NODES];
        const int iterations = 400;
        net.count = NODES;
        draw_graph(&g, NODES, net.hears, net.weight);
        if (seed % 3 == 1) { /* one way: a ring and a chord */
            memset(net.hears, 0, sizeof net.hears);
            for (int i = 0; i < NODES; i++) net.hears[(i + 1) % NODES][i] = 1;
            net.hears[3][6] = net.hears[0][4] = 1;
        }
        for (int i = 0; i < NODES; i++)
            for (int k = 0; k < P; k++) X[i][k] = (double)(REAL)draw_normal(&g);
        NAME(net_start)(&net, MK_CONSENSUS_RATIO, iterations, 0.0, 0);
        NAME(net_begin)(&net, X, measures);
        NAME(net_total)(&net, first);
        assert_true(fabs(first[P] - NODES) < (BITS == 64 ? 1e-13 : 1e-5));
        for (int l = 0; l < iterations; l++) {
            for (int i = 0; i < NODES; i++)
                for (int j = 0; j < NODES; j++) /* seeds 2, 5, 8: an edge is up every second to seventh iteration only */
                    arrives[i][j] = net.hears[i][j] && (seed % 3 == 2 ? (l + i + j) % (2 + (i * j) % 6) == 0 : !draw_chance(&g, 0.4));
            NAME(net_iterate)(&net, arrives, &g);
            if (l == iterations - 1) break;
            NAME(net_total)(&net, total);
            for (int k = 0; k <= P; k++) assert_true(fabs(total[k] - first[k]) <= (BITS == 64 ? 1e-11 : 1e-2));
        }
        NAME(net_result)(&net, result);
        for (int k = 0; k < P; k++) {
            double average = 0.0;
            for (int i = 0; i < NODES; i++) average += X[i][k] / NODES;
            for (int i = 0; i < NODES; i++) assert_true(fabs(result[i][k] - average) <= (BITS == 64 ? 1e-9 : 1e-3));
        }
    }
}

/* A topology that changes between runs: degrees in the owner's memory. */
static void NAME(changing)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    generator_t g = {5};
    double X[NODES][P], result[NODES][P];
    const int measures[NODES] = {0};
    const int protocols[2] = {MK_CONSENSUS_METROPOLIS, MK_CONSENSUS_RATIO};
    for (int p = 0; p < 2; p++) {
        net.count = 4;
        path_graph(4, net.hears);
        net.hears[0][3] = net.hears[3][0] = 1;
        NAME(net_start)(&net, protocols[p], 300, 0.0, 0);
        for (int run = 0; run < 4; run++) {
            /* In runs 1 and 3 the edge between 0 and 3 is gone, and all know it. */
            const int up = run % 2 == 0;
            net.hears[0][3] = net.hears[3][0] = up;
            for (int i = 0; i < 4; i++)
                for (int l = 0; l < net.member[i].config.slots; l++) {
                    const int number = net.member[i].number[l];
                    net.member[i].degree[l] = (uint16_t)(number == 0 || number == 3 ? 1 + up : 2);
                }
            for (int i = 0; i < 4; i++)
                for (int k = 0; k < P; k++) X[i][k] = (double)(REAL)draw_normal(&g);
            NAME(net_begin)(&net, X, measures);
            NAME(net_run)(&net, 300, &g);
            NAME(net_result)(&net, result);
            for (int k = 0; k < P; k++)
                for (int i = 0; i < 4; i++)
                    assert_true(fabs(result[i][k] - (X[0][k] + X[1][k] + X[2][k] + X[3][k]) / 4.0) <= (BITS == 64 ? 1e-9 : 1e-4));
        }
    }
}

/* The same messages in another order, early or in time, give the same bits. */
static void NAME(order)(void **unused) {
    (void)unused;
    static NAME(member_t) a[2];
    for (int protocol = 0; protocol < MK_CONSENSUS_SUM; protocol++)
        for (uint64_t seed = 0; seed < 20; seed++) {
            generator_t g = {seed};
            REAL message[3][4][P + 1], own[P], result[2][P];
            for (int l = 0; l < 3; l++)
                for (int j = 0; j < 4; j++)
                    for (int k = 0; k <= P; k++) message[l][j][k] = (REAL)draw_normal(&g) + (REAL)(k == P ? 4 + l : 0);
            for (int k = 0; k < P; k++) own[k] = (REAL)draw_normal(&g);
            for (int order = 0; order < 2; order++) {
                memset(a + order, 0, sizeof *a);
                const TYPE(mk_consensus_config) config = {P, 5, 3, 5, (uint8_t)protocol, (REAL)0.0, NULL, a[order].degree};
                for (int l = 0; l < 5; l++) a[order].degree[l] = (uint16_t)(4 + l);
                a[order].config = config;
                const TYPE(mk_consensus_view) view = NAME(view)(a + order);
                assert_int_equal(NAME(mk_consensus_start)(P, 5, &view, &a[order].config), MK_OK);
                if (order == 1) /* before begin, the next iteration first */
                    for (int j = 3; j >= 0; j--)
                        for (int l = 1; l >= 0; l--)
                            assert_int_equal(NAME(mk_consensus_put)(P, &view, 1 + j, (uint32_t)l, message[l][j]), MK_OK);
                assert_int_equal(NAME(mk_consensus_begin)(P, &view, own, 1), MK_OK);
                for (int l = 0; l < 3; l++) {
                    for (int j = 0; j < 4; j++) {
                        if (order == 0) assert_int_equal(NAME(mk_consensus_put)(P, &view, 1 + j, (uint32_t)l, message[l][j]), MK_OK);
                        else if (l == 1) assert_int_equal(NAME(mk_consensus_put)(P, &view, 4 - j, 2, message[2][3 - j]), MK_OK);
                    }
                    assert_int_equal(NAME(mk_consensus_iterate)(P, &view), MK_OK);
                }
                assert_int_equal(a[order].core.heard, 12);
                assert_int_equal(a[order].core.missing, 0);
                assert_int_equal(NAME(mk_consensus_average)(&view, result[order]), MK_OK);
            }
            assert_memory_equal(result[0], result[1], sizeof *result);
        }
}

/* Early, late, repeated, ahead, and over the boundary of runs. */
static void NAME(iterations)(void **unused) {
    (void)unused;
    for (int L = 1; L <= 3; L++) {
        static PAIR(t) c, before;
        const uint16_t degree[3] = {2, 1, 1};
        const PAIR(config_t) config = {3, 3, (uint16_t)L, 3, MK_CONSENSUS_METROPOLIS, (REAL)0.0, NULL, degree};
        const REAL own[3] = {(REAL)1.0, (REAL)2.0, (REAL)3.0}, other[3] = {(REAL)4.0, (REAL)5.0, (REAL)6.0};
        REAL result[3];
        memset(&c, 0, sizeof c);
        assert_int_equal(PAIR(start)(&c, &config), MK_OK);
        assert_null(PAIR(message)(&c));
        assert_int_equal(PAIR(average)(&c, result), MK_ERROR_ORDER);
        assert_int_equal(PAIR(iterate)(&c), MK_ERROR_ORDER);
        for (int run = 0; run < 3; run++) {
            if (run == 0) assert_int_equal(PAIR(begin)(&c, own, 0), MK_OK);
            for (int l = 0; l < L; l++) {
                const int first = run == 0 && l == 0;
                if (run > 0 && l == 0) {
                    /* Between runs: the first message came a run ago. */
                    memcpy(&before, &c, sizeof c);
                    assert_int_equal(PAIR(put)(&c, 1, 0, other), MK_ERROR_REPEATED);
                    assert_int_equal(PAIR(put)(&c, 1, 2, other), MK_ERROR_AHEAD);
                    assert_memory_equal(&before, &c, sizeof c);
                    assert_int_equal(PAIR(begin)(&c, own, 0), MK_OK);
                }
                assert_int_equal(PAIR(begin)(&c, own, 0), MK_ERROR_ORDER);
                if (first) assert_int_equal(PAIR(put)(&c, 1, (uint32_t)l, other), MK_OK);
                memcpy(&before, &c, sizeof c);
                assert_int_equal(PAIR(put)(&c, 1, (uint32_t)l, own), MK_ERROR_REPEATED);
                if (l > 0) assert_int_equal(PAIR(put)(&c, 2, (uint32_t)l - 1, other), MK_ERROR_LATE);
                assert_int_equal(PAIR(put)(&c, 2, (uint32_t)l + 2, other), MK_ERROR_AHEAD);
                assert_int_equal(PAIR(put)(&c, 2, 0xffffffffu, other), MK_ERROR_AHEAD);
                assert_memory_equal(&before, &c, sizeof c);
                /* The neighbour is always one ahead; the other one is never heard. */
                assert_int_equal(PAIR(put)(&c, 1, (uint32_t)l + 1, other), MK_OK);
                assert_int_equal(PAIR(put)(&c, 1, (uint32_t)l + 1, other), MK_ERROR_REPEATED);
                assert_int_equal(PAIR(iterate)(&c), MK_OK);
            }
            assert_int_equal(c.core.heard, L);
            assert_int_equal(c.core.missing, L);
            assert_int_equal(c.core.kept, 0);
            assert_null(PAIR(message)(&c));
            assert_int_equal(PAIR(average)(&c, result), MK_OK);
            for (int k = 0; k < 3; k++) /* own falls to 2/3 of the distance each time */
                assert_true(fabs((double)result[k] - (4.0 + k - 3.0 * pow(2.0 / 3.0, L))) < 1e-5);
        }
        PAIR(reset)(&c);
        assert_int_equal(PAIR(average)(&c, result), MK_ERROR_ORDER);
        assert_int_equal(PAIR(put)(&c, 1, 0, other), MK_OK);
    }
}

/* Nodes that hear nobody, and nodes without anything to say. */
static void NAME(alone)(void **unused) {
    (void)unused;
    const REAL own[3] = {(REAL)1.0, (REAL)-2.0, (REAL)3.0}, zero[4] = {0}, other[4] = {(REAL)4.0, (REAL)5.0, (REAL)6.0, (REAL)0.5};
    const uint16_t degree[3] = {2, 1, 1};
    for (int protocol = 0; protocol < MK_CONSENSUS_COUNT; protocol++)
        for (int measures = 0; measures < 2; measures++) {
            static PAIR(t) c;
            REAL result[3];
            const int L = protocol == MK_CONSENSUS_SUM ? 1 : 200;
            const PAIR(config_t) config = {3, 3, (uint16_t)L, 3, (uint8_t)protocol, (REAL)0.0, NULL, degree};
            memset(&c, 0, sizeof c);
            assert_int_equal(PAIR(start)(&c, &config), MK_OK);
            for (int run = 0; run < 2; run++) {
                assert_int_equal(PAIR(begin)(&c, own, measures), MK_OK);
                for (int l = 0; l < L; l++) assert_int_equal(PAIR(iterate)(&c), MK_OK);
                assert_int_equal(c.core.kept, L);
                assert_int_equal(c.core.missing, 2 * L);
                assert_int_equal(PAIR(average)(&c, result), MK_OK);
                for (int k = 0; k < 3; k++) assert_true(fabs((double)(result[k] - own[k])) <= 4.0 * (BITS == 64 ? DBL_EPSILON : (double)FLT_EPSILON));
            }
            if (protocol == MK_CONSENSUS_SUM) continue;
            /* A blind node dilutes itself at once where the neighbour says something: it takes it over in the paper's. */
            assert_int_equal(PAIR(begin)(&c, zero, 0), MK_OK);
            assert_int_equal(PAIR(put)(&c, 2, 0, other), MK_OK);
            assert_int_equal(PAIR(iterate)(&c), MK_OK);
            assert_int_equal(PAIR(average)(&c, result), MK_OK);
            const double share = protocol == MK_CONSENSUS_METROPOLIS ? 1.0 / 3.0 : protocol == MK_CONSENSUS_PAPER ? 1.0
                                 : protocol == MK_CONSENSUS_PERRON ? 2.0 : 1.0 / (1.0 / 3.0 + 0.5);
            for (int k = 0; k < 3; k++) assert_true(fabs((double)result[k] - share * (double)other[k]) < 1e-5);
        }
    /* Without neighbours: what weighs nothing has no average; what measures has. */
    static PAIR(t) c;
    REAL result[3], weight[3] = {0};
    const PAIR(config_t) config = {3, 3, 1, 3, MK_CONSENSUS_PERRON, (REAL)0.0, weight, NULL};
    memset(&c, 0, sizeof c);
    assert_int_equal(PAIR(start)(&c, &config), MK_OK);
    assert_int_equal(PAIR(begin)(&c, own, 0), MK_OK);
    assert_int_equal(PAIR(average)(&c, result), MK_ERROR_NOT_FINITE);
    assert_int_equal(PAIR(iterate)(&c), MK_OK);
    assert_int_equal(PAIR(begin)(&c, own, 1), MK_OK);
    assert_int_equal(PAIR(average)(&c, result), MK_OK);
    assert_true(result[1] == own[1]);
}

/* What is refused, and that it changes nothing. */
static void NAME(refused)(void **unused) {
    (void)unused;
    static PAIR(t) c, before;
    const REAL largest = BITS == 64 ? (REAL)DBL_MAX : (REAL)FLT_MAX;
    const REAL own[3] = {(REAL)1.0, (REAL)2.0, (REAL)3.0}, nan[3] = {(REAL)1.0, (REAL)NAN, (REAL)3.0}, huge[3] = {largest, -largest, largest};
    const uint16_t degree[3] = {2, 1, 1};
    REAL weight[3] = {0}, result[3];
    PAIR(config_t) config = {3, 3, 4, 3, MK_CONSENSUS_METROPOLIS, (REAL)0.0, NULL, degree};
    memset(&c, 0, sizeof c);
    memcpy(&before, &c, sizeof c);
#define UNCHANGED(call, status)                                                                                               \
    do {                                                                                                                      \
        assert_int_equal(call, status);                                                                                       \
        assert_memory_equal(&before, &c, sizeof c);                                                                           \
    } while (0)
#define WRONG(change, status)                                                                                                 \
    do {                                                                                                                      \
        const PAIR(config_t) good = config;                                                                                   \
        change;                                                                                                               \
        UNCHANGED(PAIR(start)(&c, &config), status);                                                                          \
        config = good;                                                                                                        \
    } while (0)
    UNCHANGED(PAIR(begin)(&c, own, 0), MK_ERROR_ORDER);
    UNCHANGED(PAIR(put)(&c, 1, 0, own), MK_ERROR_ORDER);
    UNCHANGED(PAIR(iterate)(&c), MK_ERROR_ORDER);
    UNCHANGED(PAIR(average)(&c, result), MK_ERROR_ORDER);
    UNCHANGED(PAIR(start)(&c, NULL), MK_ERROR_ARGUMENT);
    WRONG(config.values = 4, MK_ERROR_SHAPE);
    WRONG(config.values = 0, MK_ERROR_SHAPE);
    WRONG(config.slots = 2, MK_ERROR_SHAPE);
    WRONG(config.iterations = 0, MK_ERROR_ARGUMENT);
    WRONG(config.network = 0, MK_ERROR_ARGUMENT);
    WRONG(config.protocol = MK_CONSENSUS_COUNT, MK_ERROR_ARGUMENT);
    WRONG(config.protocol = MK_CONSENSUS_SUM, MK_ERROR_ARGUMENT);
    WRONG(config.degree = NULL, MK_ERROR_ARGUMENT);
    WRONG((config.degree = NULL, config.protocol = MK_CONSENSUS_RATIO), MK_ERROR_ARGUMENT);
    WRONG(config.total = (REAL)-1.0, MK_ERROR_ARGUMENT);
    WRONG(config.total = (REAL)NAN, MK_ERROR_ARGUMENT);
    WRONG((config.weight = weight, weight[2] = (REAL)-1.0), MK_ERROR_ARGUMENT);
    WRONG((config.weight = weight, weight[2] = (REAL)INFINITY), MK_ERROR_ARGUMENT);
    config.protocol = MK_CONSENSUS_SUM;
    config.iterations = 1;
    assert_int_equal(PAIR(start)(&c, &config), MK_OK);
    memcpy(&before, &c, sizeof c);
    UNCHANGED(PAIR(begin)(&c, nan, 0), MK_ERROR_NOT_FINITE);
    UNCHANGED(PAIR(begin)(&c, NULL, 0), MK_ERROR_ARGUMENT);
    UNCHANGED(PAIR(begin)(&c, own, 2), MK_ERROR_ARGUMENT);
    assert_int_equal(PAIR(begin)(&c, huge, 0), MK_OK);
    memcpy(&before, &c, sizeof c);
    UNCHANGED(PAIR(put)(&c, 1, 0, nan), MK_ERROR_NOT_FINITE);
    UNCHANGED(PAIR(put)(&c, 1, 0, NULL), MK_ERROR_ARGUMENT);
    UNCHANGED(PAIR(put)(&c, 0, 0, own), MK_ERROR_ARGUMENT);
    UNCHANGED(PAIR(put)(&c, 3, 0, own), MK_ERROR_ARGUMENT);
    UNCHANGED(PAIR(put)(&c, -1, 0, own), MK_ERROR_ARGUMENT);
    UNCHANGED(PAIR(average)(&c, NULL), MK_ERROR_ARGUMENT);
    assert_int_equal(PAIR(put)(&c, 1, 0, huge), MK_OK);
    memcpy(&before, &c, sizeof c);
    UNCHANGED(PAIR(iterate)(&c), MK_ERROR_NOT_FINITE);
    /* Running sums that overflow; a scale that does. */
    config.protocol = MK_CONSENSUS_RATIO;
    config.iterations = 9;
    assert_int_equal(PAIR(start)(&c, &config), MK_OK);
    assert_int_equal(PAIR(begin)(&c, huge, 0), MK_OK);
    const REAL many[4] = {largest, largest, largest, (REAL)1.0};
    assert_int_equal(PAIR(put)(&c, 1, 0, many), MK_OK);
    assert_int_equal(PAIR(put)(&c, 2, 0, many), MK_OK);
    memcpy(&before, &c, sizeof c);
    UNCHANGED(PAIR(iterate)(&c), MK_ERROR_NOT_FINITE);
    PAIR(reset)(&c); /* the sum that would be sent, not what is held */
    const REAL half = largest / 4, halves[4] = {half, half, half, (REAL)1.0};
    assert_int_equal(PAIR(begin)(&c, huge, 0), MK_OK);
    assert_int_equal(PAIR(put)(&c, 1, 0, halves), MK_OK);
    assert_int_equal(PAIR(put)(&c, 2, 0, halves), MK_OK);
    memcpy(&before, &c, sizeof c);
    UNCHANGED(PAIR(iterate)(&c), MK_ERROR_NOT_FINITE);
    config.protocol = MK_CONSENSUS_PERRON;
    config.total = largest;
    assert_int_equal(PAIR(start)(&c, &config), MK_OK);
    memcpy(&before, &c, sizeof c);
    UNCHANGED(PAIR(begin)(&c, many, 1), MK_ERROR_NOT_FINITE);
#undef WRONG
#undef UNCHANGED
}

/* A node that gave its mass away and got nothing back says so, instead of dividing rounding by rounding. */
static void NAME(no_mass)(void **unused) {
    (void)unused;
    static PAIR(t) c;
    const uint16_t degree[3] = {60000, 1, 1};
    const PAIR(config_t) config = {3, 3, 50, 3, MK_CONSENSUS_RATIO, (REAL)0.0, NULL, degree};
    const REAL own[3] = {(REAL)1.0, (REAL)2.0, (REAL)3.0};
    REAL result[3], sums[4] = {(REAL)0.1, (REAL)0.1, (REAL)0.1, (REAL)0.3};
    memset(&c, 0, sizeof c);
    assert_int_equal(PAIR(start)(&c, &config), MK_OK);
    assert_int_equal(PAIR(begin)(&c, own, 0), MK_OK);
    for (int l = 0; l < 50; l++) {
        assert_int_equal(PAIR(put)(&c, 1, (uint32_t)l, sums), MK_OK);
        assert_int_equal(PAIR(iterate)(&c), MK_OK);
    }
    assert_int_equal(PAIR(average)(&c, result), MK_ERROR_NOT_FINITE);
    assert_int_equal(PAIR(begin)(&c, own, 0), MK_OK);
}

#undef PAIR
