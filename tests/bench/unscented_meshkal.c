/* SPDX-License-Identifier: MIT */
/* Meshkal's unscented and extended filters behind the interface of unscented.h. */
#include <meshkal/unrolled.h>

#include "unscented.h"

#include <math.h>
#include <string.h>

#define REAL float
#define TYPE(name) name##_f32_t
#define NAME(name) name##_f32
#define SQRT sqrtf
#define ATAN2 atan2f
#define BITS 32
#define KIND f32
#include "unscented_meshkal.tmpl.h"
#undef REAL
#undef TYPE
#undef NAME
#undef SQRT
#undef ATAN2
#undef BITS
#undef KIND

#define REAL double
#define TYPE(name) name##_f64_t
#define NAME(name) name##_f64
#define SQRT sqrt
#define ATAN2 atan2
#define BITS 64
#define KIND f64
#include "unscented_meshkal.tmpl.h"

#define ROW(title, name, n, bits) {title, n, bits, name##_f##bits##_begin, name##_f##bits##_run, name##_f##bits##_read}
#define ROWS(title, name) ROW(title, name##4, 4, 32), ROW(title, name##4, 4, 64), ROW(title, name##6, 6, 32), ROW(title, name##6, 6, 64)

const contender_t *scene_meshkal(int *count) {
    static const contender_t all[] = {ROWS("Meshkal unrolled", unrolled), ROWS("Meshkal unrolled, one sensor", unrolled_joint), ROWS("Meshkal shared", split),
                                      ROWS("Meshkal shared, one sensor", joint)};
    *count = (int)(sizeof all / sizeof *all);
    return all;
}
