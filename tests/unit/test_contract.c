/* SPDX-License-Identifier: MIT */
/* What <meshkal/rkfd.h> promises besides numbers: statuses, untouched state after a failure, order of calls, faults, counters. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/rkfd.h>

#include "precision.h"

#define PRECISION f32
#define REAL float
#include "tiny.tmpl.h"
#include "contract.tmpl.h"
#include "freeze.tmpl.h"
#include "failures.tmpl.h"
#undef PRECISION
#undef REAL
#undef REFUSED
#undef COUNTED

#define PRECISION f64
#define REAL double
#include "tiny.tmpl.h"
#include "contract.tmpl.h"
#include "freeze.tmpl.h"
#include "failures.tmpl.h"

static void status_names(void **unused) {
    (void)unused;
    assert_string_equal(mk_status_name(MK_OK), "MK_OK");
    assert_string_equal(mk_status_name(MK_ERROR_ARGUMENT), "MK_ERROR_ARGUMENT");
    assert_string_equal(mk_status_name(MK_ERROR_SHAPE), "MK_ERROR_SHAPE");
    assert_string_equal(mk_status_name(MK_ERROR_NOT_FINITE), "MK_ERROR_NOT_FINITE");
    assert_string_equal(mk_status_name(MK_ERROR_NOT_POSITIVE_DEFINITE), "MK_ERROR_NOT_POSITIVE_DEFINITE");
    assert_string_equal(mk_status_name(MK_ERROR_TOLERANCE), "MK_ERROR_TOLERANCE");
    assert_string_equal(mk_status_name(MK_ERROR_ORDER), "MK_ERROR_ORDER");
    assert_string_equal(mk_status_name(MK_ERROR_REPEATED), "MK_ERROR_REPEATED");
    assert_non_null(mk_status_name((mk_status_t)99));
}

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(status_names),
        BOTH(sensor_statuses),
        BOTH(start_statuses),
        BOTH(call_order),
        BOTH(restart_before_start),
        BOTH(put_statuses),
        BOTH(faults),
        BOTH(tolerance_and_queries),
        BOTH(failed_incremental),
        BOTH(tolerance_without_root),
        BOTH(restart),
        BOTH(restart_after_failure),
        BOTH(moved),
        BOTH(input),
        BOTH(steady_statuses),
        BOTH(frozen_gain),
        BOTH(frozen_failures),
        BOTH(frozen_faults),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
