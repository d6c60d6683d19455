/* SPDX-License-Identifier: MIT */
/* Tracking scenarios of the published experiments. */
#ifndef MESHKAL_SCENARIO_PUBLISHED_H
#define MESHKAL_SCENARIO_PUBLISHED_H

#include "error.h"

/* "incomplete-measurements" (spec 2.5) or "distributed-unscented" (4.3, range_limit in m, 0: none) to standard output. 1, or 0 and an error. */
int mk_print_published(const char *kind, unsigned long long seed, double range_limit, mk_error_t *error);

#endif
