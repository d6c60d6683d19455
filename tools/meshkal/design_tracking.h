/* SPDX-License-Identifier: MIT */
/* `meshkal design` of a tracking scenario. */
#ifndef MESHKAL_DESIGN_TRACKING_H
#define MESHKAL_DESIGN_TRACKING_H

#include "scenario.h"

/* Values of options as they were given, null where not. */
typedef struct {
    const char *json, *truth, *models, *window, *condition, *runs, *threads;
    int allow;
} mk_design_tracking_arguments_t;

/* Checks, reports, complains, and returns the exit status: 1 if the network cannot work, which the reports say as well, unless `allow`. */
int mk_design_tracking(const mk_scenario_t *scenario, const mk_design_tracking_arguments_t *arguments);

#endif
