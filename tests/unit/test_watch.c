/* SPDX-License-Identifier: MIT */
/* MK_WATCH beside the unscented filter and the distributed unscented information filter: a range that drifts is left out, and comes back. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/duif.h>
#include <meshkal/monitor.h>
#include <meshkal/tracking.h>

#include "generator.h"
#include "precision.h"

#define MK_UNSCENTED_OF(name, real, n, m, slots) MK_UNSCENTED(name, real, n, m, slots)
#define MK_DUIF_OF(name, real, n, m, slots) MK_DUIF(name, real, n, m, slots)
#define MK_WATCH_OF(name, real, m, slots, window) MK_WATCH(name, real, m, slots, window)

enum { N = 4, BEACONS = 5, WINDOW = 10, STEPS = 300, FROM = 80, TO = 200, DRIFTS = 2 };
#define SIGMA 0.3
#define RATE 0.05

static const mk_motion_t motion = {.n = N, .dimensions = 2, .position = {0, 2}, .velocity = {1, 3}};
static const double beacons[BEACONS][2] = {{0, 0}, {100, 0}, {50, 90}, {-20, 60}, {30, -50}};

/* What the sensors say at step t of a target that goes straight on. */
static void draw_ranges(generator_t *g, int t, double *range) {
    const double x = 40.0 + 0.1 * t, y = 20.0 + 0.05 * t;
    for (int k = 0; k < BEACONS; k++) {
        range[k] = hypot(x - beacons[k][0], y - beacons[k][1]) + SIGMA * draw_normal(g);
        if (k == DRIFTS && t > FROM && t <= TO) range[k] += RATE * (t - FROM);
    }
}

#define PRECISION f32
#define REAL float
#include "watch.tmpl.h"
#undef PRECISION
#undef REAL

#define PRECISION f64
#define REAL double
#include "watch.tmpl.h"

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(unscented_f32), cmocka_unit_test(unscented_f64), cmocka_unit_test(information_f32),
                                       cmocka_unit_test(information_f64)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
