/* SPDX-License-Identifier: MIT */
/* MK_UNSCENTED_UNROLLED gives the bits of the shared kernels, for every filter, with readings missing. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/unrolled.h>

#include "generator.h"
#include "precision.h"

#define MK_UNSCENTED_OF(name, real, n, m, slots) MK_UNSCENTED_UNROLLED(name, real, n, m, slots)

/* A curved model: states, rows, which slot. */
typedef struct {
    int n, rows, slot;
} bent_t;

#define PRECISION f32
#define REAL float
#include "unscented_models.tmpl.h"
#include "unscented_types.tmpl.h"
#undef PRECISION
#undef REAL

#define PRECISION f64
#define REAL double
#include "unscented_models.tmpl.h"
#include "unscented_types.tmpl.h"

#define BOTH(tag) cmocka_unit_test(tag##f32_typed), cmocka_unit_test(tag##f64_typed)

int main(void) {
    const struct CMUnitTest tests[] = {BOTH(least), BOTH(wide), BOTH(tracker), BOTH(many), BOTH(tall)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
