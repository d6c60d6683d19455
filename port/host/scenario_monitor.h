/* SPDX-License-Identifier: MIT */
/* "monitor" of a scenario, of any kind: settings of the integrity monitors (meshkal/monitor.h), and their names. */
#ifndef MESHKAL_HOST_SCENARIO_MONITOR_H
#define MESHKAL_HOST_SCENARIO_MONITOR_H

#include "scenario.h"
#include "scenario_read.h"

/* No monitor, beside the MK_MONITOR_ schemes. */
#define MK_MONITOR_NONE (-1)
/* Epochs of a window, at most: all are kept. */
#define MK_MONITOR_LONGEST 4096

/* "none", "rctm", "aime", "aime-improved", "exclude". */
const char *mk_monitor_name(int scheme);
/* 1, or 0 and an error that lists the names. */
int mk_monitor_find(const char *name, int *scheme, mk_error_t *error);

/* Part of mk_scenario_load_any: what the scenario does not say gets its default, and the scheme is none: that comes from the command line. */
int mk_read_monitor(mk_reader_t *reader, json_t *root, mk_scenario_t *scenario);

#endif
