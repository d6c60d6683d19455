/* SPDX-License-Identifier: MIT */
/* The designer for some nodes only, as a part of a network asks for it: the same bits as for all of them. Runs from the top of the tree. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "design/design.h"

static mk_scenario_t scenario;
static mk_error_t error;

static int load(void **state) {
    (void)state;
    return mk_scenario_load(&scenario, "tests/host/mixed.json", &error) ? 0 : -1;
}

static int unload(void **state) {
    (void)state;
    mk_scenario_free(&scenario);
    return 0;
}

static void test_some_local_tolerances(void **state) {
    (void)state;
    mk_design_t all, some;
    assert_true(mk_design_make(&all, &scenario, 0.05, &error));
    assert_true(mk_design_central(&some, &scenario, 0.05, &error));
    assert_null(some.local);
    const int id[5] = {scenario.nodes - 1, 1, 1, 0, 2};
    for (int threads = 1; threads < 4; threads++) {
        double c[5];
        assert_true(mk_design_local(&some, &scenario, id, 5, threads, c, &error));
        for (int i = 0; i < 5; i++) {
            assert_true(c[i] > 0.0 && c[i] <= 0.05 * (1.0 + 1e-12));
            assert_memory_equal(&c[i], &all.local[id[i]], sizeof c[i]);
        }
    }
    mk_design_free(&all);
    mk_design_free(&some);
}

static void test_no_tolerance(void **state) {
    (void)state;
    mk_design_t design;
    const int id[2] = {1, 0};
    double c[2] = {1.0, 1.0};
    assert_true(mk_design_central(&design, &scenario, 0.0, &error));
    assert_true(mk_design_local(&design, &scenario, id, 2, 2, c, &error));
    assert_true(c[0] == 0.0 && c[1] == 0.0);
    mk_design_free(&design);
    mk_schedule_t *schedule = mk_schedule_open(&scenario, 0.0, id, 2, 2);
    c[0] = c[1] = 1.0;
    assert_true(mk_schedule_step(schedule, c, &error));
    assert_true(c[0] == 0.0 && c[1] == 0.0);
    mk_schedule_close(schedule);
}

static void test_schedule_of_some_nodes(void **state) {
    (void)state;
    enum { STEPS = 400 };
    const size_t nodes = (size_t)scenario.nodes;
    const int id[3] = {2, 0, scenario.nodes - 1};
    double *all = mk_design_schedule(&scenario, 0.05, STEPS, NULL, scenario.nodes, 2, &error), c[3];
    assert_non_null(all);
    mk_schedule_t *schedule = mk_schedule_open(&scenario, 0.05, id, 3, 2);
    for (size_t t = 0; t < STEPS; t++) {
        assert_true(mk_schedule_step(schedule, c, &error));
        for (int i = 0; i < 3; i++) assert_memory_equal(&c[i], &all[t * nodes + (size_t)id[i]], sizeof c[i]);
    }
    mk_schedule_close(schedule);
    /* It ends where the steady tolerances are, and begins elsewhere. */
    mk_design_t design;
    assert_true(mk_design_make(&design, &scenario, 0.05, &error));
    for (size_t k = 0; k < nodes; k++) {
        assert_true(fabs(all[(STEPS - 1) * nodes + k] / design.local[k] - 1.0) < 1e-9);
        assert_true(fabs(all[k] / design.local[k] - 1.0) > 1e-6);
    }
    mk_design_free(&design);
    free(all);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_some_local_tolerances), cmocka_unit_test(test_no_tolerance),
                                       cmocka_unit_test(test_schedule_of_some_nodes)};
    return cmocka_run_group_tests(tests, load, unload);
}
