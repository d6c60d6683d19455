/* SPDX-License-Identifier: MIT */
/* The ends of things: work arrays of exactly the documented size, numbers at the ends of their range, ten thousand silent steps. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/gamma.h>
#include <meshkal/rkfd.h>

#include "precision.h"

#define LONE(function) JOIN(NAME(lone), _##function)

MK_RKFD(lone_f32, f32, 1, 1, 1);
MK_RKFD(lone_f64, f64, 1, 1, 1);

#define PRECISION f32
#define REAL float
#include "tiny.tmpl.h"
#include "limits.tmpl.h"
#undef PRECISION
#undef REAL
#undef REFUSED
#undef COUNTED

#define PRECISION f64
#define REAL double
#include "tiny.tmpl.h"
#include "limits.tmpl.h"

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {
        BOTH(sensor_work),  BOTH(filter_work),      BOTH(sensor_overflow),  BOTH(predict_overflow),
        BOTH(huge_reading), BOTH(large_covariance), BOTH(small_covariance), BOTH(silence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
