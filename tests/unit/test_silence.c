/* SPDX-License-Identifier: MIT */
/* Long silence with several states: the covariance grows and its condition with it, until the precision ends. Up to there every
   MK_OK must leave a positive definite W, and what comes after must be a status that changes nothing. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "generator.h"
#include "node.h"

enum { STEPS = 400 };

static int all_finite(int count, const double *values) {
    for (int i = 0; i < count; i++)
        if (!isfinite(values[i])) return 0;
    return 1;
}

static void run(const precision_t *precision, uint64_t seed, int hear_one) {
    generator_t g = {seed};
    int failed = 0, models = 0;
    for (int trial = 0; trial < 300; trial++, models++) {
        static const double tolerances[] = {0.0, 1e-6, 0.02, 1.0};
        model_t model;
        seen_t before, after;
        const int n = 1 + trial % 7;
        draw_model(&g, n, 1, 1, draw_uniform(&g, 0.5, 1.6), &model);
        model.tolerance = (double)(float)tolerances[trial % 4];
        node_t *const node = precision->make(&model);
        assert_int_equal(precision->start(node), MK_OK);
        assert_int_equal(precision->see(node, &before), MK_OK);
        for (int step = 0; step < STEPS; step++) {
            const double y = 0.0;
            if (hear_one) assert_int_equal(precision->put(node, 0, &y, 0), MK_OK);
            const mk_status_t status = precision->incremental(node, NULL);
            const mk_status_t covariance = precision->see(node, &after);
            if (status != MK_OK) {
                assert_memory_equal(after.x, before.x, sizeof after.x);
                assert_memory_equal(after.W, before.W, sizeof after.W);
                failed++;
                break;
            }
            if (covariance != MK_OK)
                fail_msg("%s: n %d c %g trial %d step %d: MK_OK, but covariance says %s", precision->name, n, model.tolerance, trial,
                         step, mk_status_name(covariance));
            assert_true(all_finite(n, after.psi) && all_finite(MK_PACKED(n), after.W) && isfinite(after.trace_P) &&
                        isfinite(after.theta) && isfinite(after.nis));
            assert_int_equal(precision->diffuse(node), MK_OK);
            precision->see(node, &before);
            assert_true(all_finite(n, before.x));
        }
        node_free(node);
    }
    print_message("- %s, %s: %d of %d models ended with a status within %d steps\n", precision->name,
                  hear_one ? "one sensor" : "no sensor", failed, models, STEPS);
}

static void nothing_heard(void **unused) {
    (void)unused;
    run(&float64, 51, 0);
    run(&float32, 52, 0);
}

static void one_sensor_heard(void **unused) {
    (void)unused;
    run(&float64, 53, 1);
    run(&float32, 54, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_heard),
        cmocka_unit_test(one_sensor_heard),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
