/* SPDX-License-Identifier: MIT */
/* meshkal/extended.h: on a linear model the step cut in two is that of meshkal/rkfd.h, with messages missing, c = 0 and above; and its contract. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/extended.h>

#include "precision.h"

#define MK_EXTENDED_OF(name, real, n, m, slots) MK_EXTENDED(name, real, n, m, slots)
#define OF(name, real) JOIN(JOIN(name##_, real), _t)

enum { N = 3, M = 2, SLOTS = 2, STEPS = 60 };

#define PRECISION f32
#define REAL float
#include "extended.tmpl.h"
#undef PRECISION
#undef REAL
#define PRECISION f64
#define REAL double
#include "extended.tmpl.h"

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_linear_f32),   cmocka_unit_test(test_linear_f64),   cmocka_unit_test(test_contract_f32),
        cmocka_unit_test(test_contract_f64), cmocka_unit_test(test_failures_f32), cmocka_unit_test(test_failures_f64),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
