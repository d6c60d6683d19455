/* SPDX-License-Identifier: MIT */
/* meshkal simulate on a tracking scenario. */
#ifndef MESHKAL_TRACKING_TRACK_SIMULATE_H
#define MESHKAL_TRACKING_TRACK_SIMULATE_H

#include "scenario.h"
#include "simulate_options.h"

/* Prints the table, writes log and summary; changes settings of the scenario as the options say. An exit status; complaints are made. */
int mk_track_simulate(const mk_simulate_options_t *options, mk_scenario_t *scenario);

#endif
