/* SPDX-License-Identifier: MIT */
/* What must hold between several filters: messages in any order, a complete graph, nodes that keep each other's estimates. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "generator.h"
#include "node.h"

static const precision_t *const both[] = {&float32, &float64};

static void shuffle(generator_t *g, int count, int *order) {
    for (int i = 0; i < count; i++) order[i] = i;
    for (int i = count - 1; i > 0; i--) {
        const int j = draw_below(g, i + 1), kept = order[i];
        order[i] = order[j];
        order[j] = kept;
    }
}

/* The same messages in two orders, some of them repeated: the same bits. */
static void order_of_arrival(void **unused) {
    (void)unused;
    for (int k = 0; k < 2; k++) {
        generator_t g = {21};
        for (int trial = 0; trial < 40; trial++) {
            model_t model;
            seen_t a, b;
            const int n = 1 + trial % 9, slots = 2 + trial % 5;
            draw_model(&g, n, 1 + trial % 3, slots, 0.95, &model);
            node_t *const first = both[k]->make(&model), *const second = both[k]->make(&model);
            assert_int_equal(both[k]->start(first), MK_OK);
            assert_int_equal(both[k]->start(second), MK_OK);
            for (int step = 0; step < 10; step++) {
                double values[LARGEST_SLOTS][LARGEST_N];
                int order[LARGEST_SLOTS], gone[LARGEST_SLOTS];
                for (int l = 0; l < slots; l++) {
                    gone[l] = draw_chance(&g, 0.2);
                    for (int i = 0; i < LARGEST_N; i++) values[l][i] = draw_normal(&g);
                    round_to_float(LARGEST_N, values[l]);
                }
                for (int l = 0; l < slots; l++)
                    if (!gone[l]) assert_int_equal(both[k]->put(first, l, values[l], 0), MK_OK);
                shuffle(&g, slots, order);
                for (int i = 0; i < slots; i++) {
                    const int l = order[i], other = order[(i + 1) % slots];
                    if (gone[l]) continue;
                    assert_int_equal(both[k]->put(second, l, values[l], 0), MK_OK);
                    assert_int_equal(both[k]->put(second, l, values[other], 0), MK_ERROR_REPEATED);
                }
                assert_int_equal(both[k]->incremental(first, NULL), MK_OK);
                assert_int_equal(both[k]->incremental(second, NULL), MK_OK);
                for (int l = 1; l < slots; l++)
                    if (!gone[l]) assert_int_equal(both[k]->put_estimate(first, l, values[l]), MK_OK);
                shuffle(&g, slots, order);
                for (int i = 0; i < slots; i++)
                    if (order[i] > 0 && !gone[order[i]])
                        assert_int_equal(both[k]->put_estimate(second, order[i], values[order[i]]), MK_OK);
                assert_int_equal(both[k]->diffuse(first), MK_OK);
                assert_int_equal(both[k]->diffuse(second), MK_OK);
                assert_int_equal(both[k]->see(first, &a), MK_OK);
                assert_int_equal(both[k]->see(second, &b), MK_OK);
                assert_memory_equal(a.x, b.x, sizeof a.x);
                assert_memory_equal(a.W, b.W, sizeof a.W);
                assert_true(a.nis == b.nis && a.theta == b.theta && a.trace_P == b.trace_P);
            }
            node_free(first);
            node_free(second);
        }
    }
}

/* A reading that is dropped was never there: everything that can be seen of the filter, bit for bit. It may come once more. */
static void dropped(void **unused) {
    (void)unused;
    for (int k = 0; k < 2; k++) {
        generator_t g = {27};
        for (int trial = 0; trial < 40; trial++) {
            model_t model;
            seen_t a, b;
            const int n = 1 + trial % 9, slots = 2 + trial % 5;
            draw_model(&g, n, 1 + trial % 3, slots, 0.95, &model);
            node_t *const first = both[k]->make(&model), *const second = both[k]->make(&model);
            assert_int_equal(both[k]->drop(first, 0), MK_ERROR_ORDER);
            assert_int_equal(both[k]->start(first), MK_OK);
            assert_int_equal(both[k]->start(second), MK_OK);
            assert_int_equal(both[k]->drop(first, -1), MK_ERROR_ARGUMENT);
            assert_int_equal(both[k]->drop(first, slots), MK_ERROR_ARGUMENT);
            for (int step = 0; step < 10; step++) {
                for (int l = 0; l < slots; l++) {
                    double y[LARGEST_M], wrong[LARGEST_M];
                    const int there = draw_chance(&g, 0.6), put = draw_chance(&g, 0.5);
                    for (int i = 0; i < LARGEST_M; i++) {
                        y[i] = draw_normal(&g);
                        wrong[i] = 1e6 * draw_normal(&g);
                    }
                    round_to_float(LARGEST_M, y);
                    round_to_float(LARGEST_M, wrong);
                    if (put) assert_int_equal(both[k]->put(second, l, wrong, draw_chance(&g, 0.5)), MK_OK);
                    assert_int_equal(both[k]->drop(second, l), MK_OK);
                    if (!there) continue;
                    assert_int_equal(both[k]->put(first, l, y, 0), MK_OK);
                    assert_int_equal(both[k]->put(second, l, y, 0), MK_OK);
                }
                assert_int_equal(both[k]->incremental(first, NULL), MK_OK);
                assert_int_equal(both[k]->incremental(second, NULL), MK_OK);
                assert_int_equal(both[k]->drop(second, 0), MK_ERROR_ORDER);
                assert_int_equal(both[k]->see(first, &a), MK_OK);
                assert_int_equal(both[k]->see(second, &b), MK_OK);
                assert_memory_equal(&a, &b, sizeof a);
                assert_int_equal(both[k]->diffuse(first), MK_OK);
                assert_int_equal(both[k]->diffuse(second), MK_OK);
            }
            node_free(first);
            node_free(second);
        }
    }
}

/* Everyone hears everyone, weights equal: each node is the central filter (spec 1.3), robust or not. Node k has its own sensor in
   slot 0, so the nodes add the same numbers in different orders. */
static void complete_graph(void **unused) {
    (void)unused;
    for (int robust = 0; robust < 2; robust++) {
        generator_t g = {22};
        model_t central, own[4];
        node_t *node[4];
        reference_t state;
        seen_t seen;
        double worst = 0.0;
        draw_model(&g, 4, 2, 4, 0.95, &central);
        central.tolerance = robust ? 0.02 : 0.0;
        for (int l = 0; l < 4; l++) central.weight[l] = 0.25;
        reference_start(&central, &state);
        for (int k = 0; k < 4; k++) {
            own[k] = central;
            for (int l = 0; l < 4; l++) {
                own[k].rows[l] = central.rows[(l + k) % 4];
                memcpy(own[k].C[l], central.C[(l + k) % 4], sizeof central.C[0]);
                memcpy(own[k].R[l], central.R[(l + k) % 4], sizeof central.R[0]);
            }
            node[k] = float64.make(&own[k]);
            assert_int_equal(float64.start(node[k]), MK_OK);
        }
        for (int step = 0; step < 200; step++) {
            double y[4][LARGEST_M], psi[4][LARGEST_N];
            const double *arrived[4];
            for (int l = 0; l < 4; l++) {
                arrived[l] = y[l];
                for (int i = 0; i < 2; i++) y[l][i] = 3.0 * draw_normal(&g);
            }
            reference_incremental(&central, &state, arrived, NULL, central.tolerance);
            memcpy(state.x, state.psi, sizeof state.x);
            for (int k = 0; k < 4; k++) {
                for (int l = 0; l < 4; l++) assert_int_equal(float64.put(node[k], l, y[(l + k) % 4], 0), MK_OK);
                assert_int_equal(float64.incremental(node[k], NULL), MK_OK);
                assert_int_equal(float64.see(node[k], &seen), MK_OK);
                memcpy(psi[k], seen.psi, sizeof psi[k]);
            }
            for (int k = 0; k < 4; k++) {
                for (int l = 1; l < 4; l++) assert_int_equal(float64.put_estimate(node[k], l, psi[(l + k) % 4]), MK_OK);
                assert_int_equal(float64.diffuse(node[k]), MK_OK);
                assert_int_equal(float64.see(node[k], &seen), MK_OK);
                assert_true(seen.faults == 0.0);
                worst = fmax(worst, relative_error(4, seen.x, state.x, 1.0));
                worst = fmax(worst, relative_error(16, seen.V, state.V, 0.0));
            }
        }
        for (int k = 0; k < 4; k++) node_free(node[k]);
        print_message("- complete graph, %s: worst difference from the central filter %.1e\n", robust ? "c = 0.02" : "c = 0", worst);
        assert_true(worst < 1e-10);
    }
}

/* Weights that do not sum to one over what arrived are renormalised; with no positive weight among them the node's own psi
   stays, and a neighbour of weight zero changes nothing. */
static void weights(void **unused) {
    (void)unused;
    const double weight[] = {0.0, 0.25, 0.0, 0.75}, psi[] = {1.0, 2.0, 4.0, 8.0};
    for (int k = 0; k < 2; k++) {
        for (int set = 0; set < 8; set++) {
            generator_t g = {23};
            model_t model;
            seen_t seen;
            draw_model(&g, 1, 1, 4, 0.9, &model);
            memcpy(model.weight, weight, sizeof weight);
            node_t *const node = both[k]->make(&model);
            assert_int_equal(both[k]->start(node), MK_OK);
            assert_int_equal(both[k]->incremental(node, NULL), MK_OK);
            assert_int_equal(both[k]->see(node, &seen), MK_OK);
            double sum = 0.0, total = 0.0;
            for (int l = 1; l < 4; l++) {
                if (!(set >> (l - 1) & 1)) continue;
                assert_int_equal(both[k]->put_estimate(node, l, &psi[l]), MK_OK);
                sum += weight[l] * psi[l];
                total += weight[l];
            }
            const double expected = total > 0.0 ? sum / total : seen.psi[0];
            assert_int_equal(both[k]->diffuse(node), MK_OK);
            assert_int_equal(both[k]->see(node, &seen), MK_OK);
            assert_true(fabs(seen.x[0] - expected) <= 4.0 * both[k]->epsilon * fabs(expected));
            node_free(node);
        }
    }
}

/* A convex combination of finite estimates is finite, be they the largest numbers there are. */
static void largest_estimates(void **unused) {
    (void)unused;
    generator_t g = {24};
    for (int k = 0; k < 2; k++) {
        for (int trial = 0; trial < 200; trial++) {
            model_t model;
            seen_t seen;
            draw_model(&g, 1, 1, LARGEST_SLOTS, 0.9, &model);
            model.weight[0] = 0.0;
            node_t *const node = both[k]->make(&model);
            assert_int_equal(both[k]->start(node), MK_OK);
            assert_int_equal(both[k]->incremental(node, NULL), MK_OK);
            for (int l = 1; l < LARGEST_SLOTS; l++) {
                const double psi = k == 0 ? (double)FLT_MAX : DBL_MAX;
                if (draw_chance(&g, 0.7)) assert_int_equal(both[k]->put_estimate(node, l, &psi), MK_OK);
            }
            const mk_status_t status = both[k]->diffuse(node);
            both[k]->see(node, &seen);
            node_free(node);
            if (status == MK_OK && !isfinite(seen.x[0])) fail_msg("%s: diffuse returned MK_OK and left %g", both[k]->name, seen.x[0]);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(order_of_arrival),
        cmocka_unit_test(dropped),
        cmocka_unit_test(complete_graph),
        cmocka_unit_test(weights),
        cmocka_unit_test(largest_estimates),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
