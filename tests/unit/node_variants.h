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

#include <meshkal/node.h>
#include <meshkal/unrolled.h>

#include "generator.h"
#include "precision.h"
#include "wire.h"

#define MK_NODE_OF(name, real, n, m, slots) MK_NODE(name, real, n, m, slots)
#define MK_NODE_UNROLLED_OF(name, real, n, m, slots) MK_NODE_UNROLLED(name, real, n, m, slots)
#define V(name) JOIN(JOIN(name##_, KIND), JOIN(_, PRECISION))
#define UNIT(function) JOIN(V(unit), _##function)
#define MK(name) JOIN(name##_, PRECISION)
#define MK_T(name) JOIN(MK(name), _t)

enum { N = 3, M = 2, SLOTS = 4, MODEL = 0x2b5c81e7 };

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
