/* SPDX-License-Identifier: MIT */
/* meshkal simulate on a navigation scenario. */
#ifndef MESHKAL_NAVIGATION_NAV_SIMULATE_H
#define MESHKAL_NAVIGATION_NAV_SIMULATE_H

#include "scenario.h"
#include "simulate_options.h"

/* Prints the table, writes log and summary. An exit status; complaints are made. */
int mk_nav_simulate(const mk_simulate_options_t *options, const mk_scenario_t *scenario);

#endif
