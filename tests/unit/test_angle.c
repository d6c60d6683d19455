/* SPDX-License-Identifier: MIT */
/* Sine, cosine, arc tangent and wrapping of the library, in both precisions. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>

#include <cmocka.h>

#include <meshkal/angle.h>

#include "generator.h"
#include "precision.h"

#define M_PI_LONG 3.14159265358979323846264338327950288L
#define TEXT(words) #words
#define QUOTE(words) TEXT(words)

/* The sanitizers look for other things than the last digit. */
#ifdef UNIT_LONG_RUN
enum { POINTS = 10 * UNIT_LONG_RUN };
#else
enum { POINTS = 2000000 };
#endif

#define PRECISION f32
#define REAL float
#include "angle.tmpl.h"
#undef PRECISION
#undef REAL

#define PRECISION f64
#define REAL double
#include "angle.tmpl.h"

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {BOTH(sincos_range), BOTH(sincos_beyond), BOTH(atan2_plane), BOTH(atan2_ends), BOTH(wrap)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
