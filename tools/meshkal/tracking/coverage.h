/* SPDX-License-Identifier: MIT */
/* How many nodes measure along trajectories that are drawn, with process noise and losses: the mean trajectory may stay where a target does not. */
#ifndef MESHKAL_COVERAGE_H
#define MESHKAL_COVERAGE_H

#include "tracking/events.h"

typedef struct {
    long runs, steps;
    long few, none; /* steps of all runs at which fewer than two nodes measure; at which nobody does */
    long runs_few;  /* runs with such a step */
    long longest;   /* such steps in a row */
} mk_coverage_t;

/* The runs that simulate draws from the scenario's seed. 1, or 0 and an error: a target left the domain of a model. */
int mk_coverage(const mk_models_f64_t *models, long steps, long runs, mk_coverage_t *coverage, mk_error_t *error);

#endif
