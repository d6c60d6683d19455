/* SPDX-License-Identifier: MIT */
/* meshkal draw on a navigation scenario. */
#ifndef MESHKAL_NAVIGATION_NAV_DRAW_H
#define MESHKAL_NAVIGATION_NAV_DRAW_H

#include "scenario.h"

typedef struct {
    const char *measurements, *imu, *truth, *json; /* null: not wanted */
    uint64_t seed;
    int run;
    long steps;
} mk_nav_draw_options_t;

/* One run as CSV files (epochs.h) for simulate --measurements --imu --truth, which adds the scenario's faults: they are not in the files. The JSON has the
   initial estimate, for model.navigation.estimate. An exit status; complaints are made. */
int mk_nav_draw(const mk_scenario_t *scenario, const mk_nav_draw_options_t *options);

#endif
