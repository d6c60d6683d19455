/* SPDX-License-Identifier: MIT */
/* Compiles NODE_TESTS, a *.tmpl.h file, for a node object of 3 states, sensors of up to 2 rows and 4 slots: shared and unrolled, both
   precisions. In it V(name) is a name of its own, UNIT(function) a function of the node type, REAL its number. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "generator.h"
#include "node_names.h"

#define EACH(name) cmocka_unit_test(name##_shared_f32), cmocka_unit_test(name##_shared_f64), cmocka_unit_test(name##_unrolled_f32), \
                   cmocka_unit_test(name##_unrolled_f64)

#define PRECISION f32
#define REAL float
#define BITS 32
#define KIND shared
#define DECLARE MK_NODE_OF
#include "node_bench.tmpl.h"
#include NODE_TESTS
#undef KIND
#undef DECLARE
#define KIND unrolled
#define DECLARE MK_NODE_UNROLLED_OF
#include "node_bench.tmpl.h"
#include NODE_TESTS
#undef PRECISION
#undef REAL
#undef BITS

#define PRECISION f64
#define REAL double
#define BITS 64
#include "node_bench.tmpl.h"
#include NODE_TESTS
#undef KIND
#undef DECLARE
#define KIND shared
#define DECLARE MK_NODE_OF
#include "node_bench.tmpl.h"
#include NODE_TESTS
