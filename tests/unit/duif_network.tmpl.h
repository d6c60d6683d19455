/* SPDX-License-Identifier: MIT */
#include "duif_bench.tmpl.h"

/* The sensor of a node in double. */
static void NAME(dense_sensor)(const NAME(member_t) * a, double *H, double *R) {
    for (int k = 0; k < M * N; k++) H[k] = (double)a->context.H[k];
    for (int r = 0; r < a->context.rows; r++)
        for (int s = 0; s < a->context.rows; s++) R[r * a->context.rows + s] = (double)a->R[r >= s ? MK_PACKED(r) + s : MK_PACKED(s) + r];
}

/* A common prior for the dense references. */
static void NAME(dense_start)(const NAME(member_t) * a, double *x, double *P) {
    double packed[MK_PACKED(N)];
    for (int k = 0; k < N; k++) x[k] = (double)a->x0[k];
    for (int k = 0; k < MK_PACKED(N); k++) packed[k] = (double)a->P0[k];
    unpack(N, packed, P);
}

static void NAME(dense_predict)(const NAME(member_t) * a, double *x, double *P) {
    double A[N * N], packed[MK_PACKED(N)], Q[N * N];
    for (int k = 0; k < N * N; k++) A[k] = (double)a->A[k];
    for (int k = 0; k < MK_PACKED(N); k++) packed[k] = (double)a->Q[k];
    unpack(N, packed, Q);
    dense_move(A, Q, x, P);
}

static void NAME(draw_readings)(NAME(net_t) * net, generator_t *g, const double *truth, double z[NODES][M]) {
    for (int i = 0; i < net->count; i++) {
        REAL state[N], reading[M];
        for (int k = 0; k < N; k++) state[k] = (REAL)truth[k];
        assert_int_equal(NAME(measure)(&net->member[i].context, (REAL)0.0, 1, state, reading), MK_OK);
        for (int r = 0; r < net->member[i].context.rows; r++) z[i][r] = (double)(REAL)((double)reading[r] + draw_normal(g));
    }
}

/* Linear sensors, a node without one, readings that are missing: after many iterations every protocol that averages is the Kalman filter of all
   readings, and the paper's is the Kalman filter of readings whose information counts N pi_j times. */
static void NAME(kalman)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (int protocol = 0; protocol < MK_CONSENSUS_SUM; protocol++)
        for (uint64_t seed = 0; seed < 3; seed++) {
            generator_t g = {seed + 11};
            double x[N], P[N * N], truth[N] = {10.0, 20.0, 1.0, 0.6}, z[NODES][M] = {{0.0}};
            net.count = 4 + (int)seed % 2;
            draw_graph(&g, net.count, net.hears);
            NAME(net_make)(&net, protocol, 500, 1);
            NAME(net_start)(&net);
            NAME(dense_start)(net.member, x, P);
            for (int t = 0; t < 20; t++) {
                int measures[NODES], any = 0;
                double pi[NODES], sum = 0.0;
                for (int i = 0; i < net.count; i++) {
                    measures[i] = i != 1 && t != 4 && draw_chance(&g, 0.6);
                    any |= measures[i];
                    pi[i] = measures[i];
                    for (int j = 0; j < net.count; j++) pi[i] += net.hears[i][j];
                    sum += pi[i];
                }
                truth[0] += truth[2];
                truth[1] += truth[3];
                NAME(draw_readings)(&net, &g, truth, z);
                NAME(net_contribute)(&net, z, measures);
                for (int l = 0; l < 500; l++) NAME(net_iterate)(&net, &g, 0.0);
                NAME(net_fuse)(&net);
                NAME(dense_predict)(net.member, x, P);
                for (int i = 0; i < net.count; i++) {
                    double H[M * N], R[M * M];
                    const int rows = net.member[i].context.rows;
                    NAME(dense_sensor)(net.member + i, H, R);
                    for (int k = 0; k < rows * rows && protocol == MK_CONSENSUS_PAPER; k++) R[k] /= net.count * pi[i] / sum;
                    if (measures[i]) dense_update(rows, H, R, z[i], x, P);
                }
                for (int i = 0; i < net.count; i++) {
                    const TYPE(mk_duif) *const core = &net.member[i].core;
                    NAME(agree)(net.member + i, x, P, BITS == 64 ? 1e-9 : 5e-3);
                    assert_int_equal(core->flags, (measures[i] ? 0 : MK_DUIF_BLIND) | (any ? 0 : MK_DUIF_UNINFORMED));
                    assert_int_equal(core->step, t + 1);
                    assert_int_equal(core->heard, 500 * (net.member[i].config.consensus.slots - 1));
                    assert_int_equal(core->missing + core->behind + core->early + core->unfused, 0);
                }
            }
        }
}

/* Range sensors: the centralised filter, the sum of all information, its unscented transform written out here. Both forms of information. */
static void NAME(central)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (int paper = 0; paper < 2; paper++) {
        generator_t g = {21};
        double x[N], P[N * N], truth[N] = {10.0, 20.0, 1.0, 0.6}, z[NODES][M] = {{0.0}};
        net.count = 3;
        path_graph(3, net.hears);
        NAME(net_make)(&net, MK_CONSENSUS_METROPOLIS, 100, 0);
        for (int i = 0; i < 3; i++) net.member[i].config.paper_information = (uint8_t)paper;
        NAME(net_start)(&net);
        NAME(dense_start)(net.member, x, P);
        for (int t = 0; t < 30; t++) {
            int measures[NODES];
            double S[N * N] = {0.0}, s[N] = {0.0};
            for (int i = 0; i < 3; i++) measures[i] = draw_chance(&g, 0.8);
            truth[0] += truth[2];
            truth[1] += truth[3];
            NAME(draw_readings)(&net, &g, truth, z);
            NAME(net_contribute)(&net, z, measures);
            for (int l = 0; l < 100; l++) NAME(net_iterate)(&net, &g, 0.0);
            NAME(net_fuse)(&net);
            NAME(dense_predict)(net.member, x, P);
            for (int i = 0; i < 3; i++) {
                const NAME(sensor_t) *const sensor = &net.member[i].context;
                if (measures[i])
                    dense_range(paper, (double)sensor->position[0], (double)sensor->position[1], (double)net.member[i].R[0], z[i][0], x, P, s, S);
            }
            dense_inform(x, P, s, S);
            for (int i = 0; i < 3; i++) NAME(agree)(net.member + i, x, P, BITS == 64 ? 1e-9 : 2e-3);
        }
        assert_true(hypot(x[0] - truth[0], x[1] - truth[1]) < 4.0);
    }
}

/* The Kalman-consensus filter against its formula, every node with its own x and P. Messages are lost. */
static void NAME(kalman_consensus)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    static const REAL origin[N] = {(REAL)8.0, (REAL)-3.5, (REAL)0.25, (REAL)1.0};
    generator_t g = {31};
    double x[NODES][N], P[NODES][N * N], truth[N] = {10.0, 20.0, 1.0, 0.6}, z[NODES][M] = {{0.0}};
    net.count = NODES;
    draw_graph(&g, NODES, net.hears);
    NAME(net_make)(&net, MK_CONSENSUS_SUM, 1, 1);
    for (int i = 0; i < NODES; i++) {
        net.member[i].config.epsilon = (REAL)0.5;
        net.member[i].config.origin = origin;
        net.member[i].x0[0] += (REAL)i;
    }
    NAME(net_start)(&net);
    for (int i = 0; i < NODES; i++) NAME(dense_start)(net.member + i, x[i], P[i]);
    for (int t = 0; t < 30; t++) {
        int measures[NODES], heard[NODES][NODES];
        truth[0] += truth[2];
        truth[1] += truth[3];
        for (int i = 0; i < NODES; i++) measures[i] = draw_chance(&g, 0.7) && t != 10;
        NAME(draw_readings)(&net, &g, truth, z);
        NAME(net_contribute)(&net, z, measures);
        NAME(net_iterate)(&net, &g, t % 3 == 1 ? 0.5 : 0.0);
        for (int i = 0; i < NODES; i++) {
            const NAME(member_t) *const a = net.member + i;
            for (int j = 0; j < NODES; j++) heard[i][j] = i == j;
            for (int l = 1; l < a->config.consensus.slots; l++) heard[i][a->number[l]] = a->seen[l] == 1;
        }
        NAME(net_fuse)(&net);
        double mean[NODES][N];
        for (int i = 0; i < NODES; i++) {
            NAME(dense_predict)(net.member + i, x[i], P[i]);
            memcpy(mean[i], x[i], sizeof mean[i]);
        }
        for (int i = 0; i < NODES; i++) {
            double S[N * N] = {0.0}, s[N] = {0.0}, term[N] = {0.0}, norm = 0.0, prior[N * N];
            int readings = 0, others = -1;
            memcpy(prior, P[i], sizeof prior);
            for (int k = 0; k < N * N; k++) norm += prior[k] * prior[k];
            for (int j = 0; j < NODES; j++) {
                double H[M * N], R[M * M];
                if (!heard[i][j]) continue;
                others++;
                for (int k = 0; k < N; k++) term[k] += mean[j][k] - mean[i][k];
                if (!measures[j]) continue;
                readings++;
                NAME(dense_sensor)(net.member + j, H, R);
                dense_information(net.member[j].context.rows, H, R, z[j], s, S);
            }
            dense_inform(x[i], P[i], s, S);
            for (int k = 0; k < N; k++)
                for (int q = 0; q < N; q++) x[i][k] += 0.5 / (1.0 + sqrt(norm)) * prior[k * N + q] * term[q];
            NAME(agree)(net.member + i, x[i], P[i], BITS == 64 ? 1e-9 : 5e-3);
            const int missing = others < net.member[i].config.consensus.slots - 1;
            assert_int_equal(net.member[i].core.flags, (measures[i] ? 0 : MK_DUIF_BLIND) | (readings ? 0 : MK_DUIF_UNINFORMED) |
                                                           (missing ? MK_DUIF_MISSING : 0) | (others == 0 ? MK_DUIF_ISOLATED : 0));
        }
    }
}

/* A node that nobody speaks to, blind and not, with every protocol; the messages of the others are dropped on the way. */
static void NAME(isolated)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    for (int protocol = 0; protocol < MK_CONSENSUS_COUNT; protocol++)
        for (int measures = 0; measures < 2; measures++) {
            generator_t g = {41};
            const int L = protocol == MK_CONSENSUS_SUM ? 1 : 10, sees[NODES] = {measures};
            double x[N], P[N * N], truth[N] = {10.0, 20.0, 1.0, 0.6}, z[NODES][M] = {{0.0}};
            net.count = 3;
            path_graph(3, net.hears);
            NAME(net_make)(&net, protocol, L, 1);
            const REAL origin[N] = {(REAL)12345.678, (REAL)-0.7, (REAL)98.7, (REAL)1e4};
            for (int k = 0; k < N; k++) net.member[0].x0[k] += (REAL)0.1;
            if (!measures) net.member[0].config.origin = origin; /* what is kept is kept to the last bit */
            NAME(net_start)(&net);
            NAME(draw_readings)(&net, &g, truth, z);
            NAME(net_contribute)(&net, z, sees);
            NAME(member_t) *const a = net.member;
            REAL predicted[N];
            memcpy(predicted, a->x, sizeof predicted);
            for (int l = 0; l < L; l++) NAME(net_iterate)(&net, &g, 1.0);
            NAME(net_fuse)(&net);
            NAME(dense_start)(a, x, P);
            NAME(dense_predict)(a, x, P);
            double H[M * N], R[M * M];
            NAME(dense_sensor)(a, H, R);
            if (measures) dense_update(a->context.rows, H, R, z[0], x, P);
            NAME(agree)(a, x, P, BITS == 64 ? 1e-10 : protocol == MK_CONSENSUS_SUM ? 1e-3 : 1e-5); /* once, not N times */
            if (!measures && protocol != MK_CONSENSUS_SUM) assert_memory_equal(a->x, predicted, sizeof predicted);
            assert_int_equal(a->core.flags, MK_DUIF_ISOLATED | MK_DUIF_MISSING | (measures ? 0 : MK_DUIF_BLIND | MK_DUIF_UNINFORMED));
            assert_int_equal(a->core.isolated, 1);
            assert_int_equal(a->core.uninformed, !measures);
            assert_int_equal(a->core.missing, L);
        }
}

/* Short numbers on the air, near zero, 1000 away from it, and that with an origin there: how far from the Kalman filter of all readings in standard deviations, at most. s
   is S times a position: its rounding grows with the distance from the origin. */
static void NAME(short_numbers)(void **unused) {
    (void)unused;
    static NAME(net_t) net;
    static const double bound[3][2][4] = {{{1e-4, 0, 1e-4, 2e-4}, {0.02, 0, 0.02, 0.2}}, {{0.02, 0, 0.02, 0.02}, {3, 0, 3, 40}},
                                          {{0.02, 0, 0.02, 0.02}, {0.02, 0, 0.02, 0.2}}};
    const REAL origin[N] = {(REAL)1000.0};
    for (int far = 0; far < 3; far++)
        for (int half = 0; half < 2; half++)
            for (int protocol = 0; protocol < MK_CONSENSUS_SUM; protocol++) {
                generator_t g = {51};
                double x[N], P[N * N], own_x[N], own_P[N * N], truth[N] = {1.0, 2.0, 0.1, -0.06}, z[NODES][M] = {{0.0}}, worst = 0.0;
                const int measures[NODES] = {1, 1, 1, 1, 1};
                if (protocol == MK_CONSENSUS_PAPER) continue;
                net.count = 4;
                path_graph(4, net.hears);
                NAME(net_make)(&net, protocol, 60, 1);
                for (int i = 0; i < 4; i++) {
                    net.member[i].config.numbers = half ? MK_NUMBERS_F16 : MK_NUMBERS_F32;
                    net.member[i].x0[0] += (REAL)(far ? 1000.0 : 0.0);
                    net.member[i].config.origin = far == 2 ? origin : NULL;
                }
                truth[0] += far ? 1000.0 : 0.0;
                NAME(net_start)(&net);
                NAME(dense_start)(net.member, x, P);
                for (int t = 0; t < 20; t++) {
                    truth[0] += truth[2];
                    truth[1] += truth[3];
                    NAME(draw_readings)(&net, &g, truth, z);
                    NAME(net_contribute)(&net, z, measures);
                    for (int l = 0; l < 60; l++) NAME(net_iterate)(&net, &g, protocol == MK_CONSENSUS_RATIO && t % 2 ? 0.1 : 0.0);
                    NAME(net_fuse)(&net);
                    NAME(dense_predict)(net.member, x, P);
                    for (int i = 0; i < 4; i++) {
                        double H[M * N], R[M * M];
                        NAME(dense_sensor)(net.member + i, H, R);
                        dense_update(net.member[i].context.rows, H, R, z[i], x, P);
                    }
                    for (int i = 0; i < 4; i++) {
                        NAME(see)(net.member + i, own_x, own_P);
                        for (int k = 0; k < N; k++) worst = fmax(worst, fabs(own_x[k] - x[k]) / sqrt(P[k * N + k]));
                        assert_int_equal(net.member[i].core.unfused, 0);
                    }
                }
                print_message("- float%d numbers at %d%s, protocol %d, filter of %d bits: %.2g standard deviations from the centralised filter\n",
                              half ? 16 : 32, far ? 1000 : 1, far == 2 ? " from an origin at 1000" : "", protocol, BITS, worst);
                assert_true(worst < bound[far][half][protocol]);
            }
}

/* Frames come in another order and an iteration early: the same bits. */
static void NAME(same_bits)(void **unused) {
    (void)unused;
    static NAME(net_t) net, other;
    static uint8_t bytes[3][400], early[400];
    for (int protocol = 0; protocol < MK_CONSENSUS_SUM; protocol++) {
        generator_t g = {61};
        double truth[N] = {10.0, 20.0, 1.0, 0.6}, z[NODES][M] = {{0.0}};
        const int measures[NODES] = {1, 0, 1};
        net.count = 3;
        path_graph(3, net.hears);
        NAME(net_make)(&net, protocol, 2, 1);
        NAME(net_make)(&other, protocol, 2, 1);
        other.count = 3;
        NAME(net_start)(&net);
        for (int i = 0; i < 3; i++) {
            const TYPE(mk_duif_view) view = NAME(view)(other.member + i);
            assert_int_equal(NAME(mk_duif_start)(N, M, net.member[i].config.consensus.slots, &view, &net.member[i].config), MK_OK);
        }
        size_t length = 0;
        for (int t = 0; t < 4; t++) {
            NAME(draw_readings)(&net, &g, truth, z);
            NAME(net_contribute)(&net, z, measures);
            /* Nodes 0 and 2 of the other network are the ones of this; node 1 of the other gets the frame of 2 before its time. */
            const TYPE(mk_duif_view) slow = NAME(view)(other.member + 1);
            if (t > 0) {
                const TYPE(mk_duif_view) fast = NAME(view)(net.member + 2);
                length = NAME(mk_duif_frame)(&fast, early);
                assert_int_equal(NAME(mk_duif_accept)(N, &slow, early, length), MK_OK);
                assert_int_equal(NAME(mk_duif_accept)(N, &slow, early, length), MK_ERROR_REPEATED);
                if (t > 1) {
                    assert_int_equal(NAME(mk_duif_iterate)(N, &slow), MK_OK);
                    assert_int_equal(NAME(mk_duif_fuse)(N, &slow), MK_OK);
                }
            }
            if (t == 1) {
                assert_int_equal(NAME(mk_duif_iterate)(N, &slow), MK_OK);
                assert_int_equal(NAME(mk_duif_fuse)(N, &slow), MK_OK);
            }
            assert_int_equal(NAME(mk_duif_predict)(N, &slow, (REAL)1.0, NULL), MK_OK);
            assert_int_equal(NAME(mk_duif_contribute)(N, M, &slow), MK_OK);
            for (int l = 0; l < 2; l++) {
                for (int i = 0; i < 3; i++) {
                    const TYPE(mk_duif_view) view = NAME(view)(net.member + i);
                    length = NAME(mk_duif_frame)(&view, bytes[i]);
                }
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++) {
                        const TYPE(mk_duif_view) view = NAME(view)(net.member + i);
                        if (net.hears[i][j]) assert_int_equal(NAME(mk_duif_accept)(N, &view, bytes[j], length), MK_OK);
                    }
                if (t == 0 || l == 1) assert_int_equal(NAME(mk_duif_accept)(N, &slow, bytes[2], length), MK_OK);
                assert_int_equal(NAME(mk_duif_accept)(N, &slow, bytes[0], length), MK_OK);
                for (int i = 0; i < 3; i++) {
                    const TYPE(mk_duif_view) view = NAME(view)(net.member + i);
                    assert_int_equal(NAME(mk_duif_iterate)(N, &view), MK_OK);
                }
                if (l == 0) assert_int_equal(NAME(mk_duif_iterate)(N, &slow), MK_OK);
            }
            NAME(net_fuse)(&net);
        }
        const TYPE(mk_duif_view) slow = NAME(view)(other.member + 1);
        assert_int_equal(NAME(mk_duif_iterate)(N, &slow), MK_OK);
        assert_int_equal(NAME(mk_duif_fuse)(N, &slow), MK_OK);
        assert_memory_equal(other.member[1].x, net.member[1].x, sizeof net.member[1].x);
        assert_memory_equal(other.member[1].L, net.member[1].L, sizeof net.member[1].L);
        assert_int_equal(other.member[1].core.early, 3);
        assert_int_equal(other.member[1].core.missing, 0);
    }
}
