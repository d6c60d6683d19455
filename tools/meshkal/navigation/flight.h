/* SPDX-License-Identifier: MIT */
/*
 * The true flight of a navigation scenario: constant speed, heading and climb rate that change by raised cosines (scenario_navigation.h), so that
 * acceleration and turn rate are continuous. Climb rate u: pitch with sin = u / speed. Turn rate r: bank with tan = r x horizontal speed / gravity,
 * that of a coordinated turn. Position is the integral of velocity, by Simpson's rule over each interval of the inertial unit.
 *
 * A perfect unit's samples are made of attitude and velocity at both ends of an interval: strapdown navigation gives these back but for rounding.
 */
#ifndef MESHKAL_NAVIGATION_FLIGHT_H
#define MESHKAL_NAVIGATION_FLIGHT_H

#include "navigation/strapdown.h"

typedef struct {
    double q[4], v[3], p[3];
    mk_inertial_t sample; /* of the interval that ends here; none at the start */
} mk_flown_t;

/* intervals + 1 places, the first at start_s. Free it. */
mk_flown_t *mk_fly(const mk_navigation_t *navigation, long intervals);

#endif
