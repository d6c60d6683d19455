/* SPDX-License-Identifier: MIT */
#include "node.h"

#include <stdlib.h>
#include <string.h>

#include <meshkal/gamma.h>

#define REAL float
#define NAME(name) name##_f32
#define TYPE(name) name##_f32_t
#define EPSILON FLT_EPSILON
#define PRECISION float32
#include "node.tmpl.h"
#undef REAL
#undef NAME
#undef TYPE
#undef EPSILON
#undef PRECISION

#define REAL double
#define NAME(name) name##_f64
#define TYPE(name) name##_f64_t
#define EPSILON DBL_EPSILON
#define PRECISION float64
#include "node.tmpl.h"

void node_free(node_t *node) { free(node); }
