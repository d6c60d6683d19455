/* SPDX-License-Identifier: MIT */
/* What meshkal design says of its results: a table for people, JSON for programs. */
#ifndef MESHKAL_DESIGN_REPORT_H
#define MESHKAL_DESIGN_REPORT_H

#include <stdio.h>

#include "design/admissible.h"
#include "design/design.h"

/* The largest tolerance that the search for one at which the recursion no longer settles goes up to. */
#define MK_SEARCH_LIMIT 10.0

typedef struct {
    const mk_scenario_t *scenario;
    mk_design_t design;
    mk_observability_t seen;
    mk_admissible_t central, *node; /* node: null if not made */
    int has_central;
    double settles;                 /* largest c that settles, at most MK_SEARCH_LIMIT */
    mk_schedule_t *schedule;        /* null: no tolerances over time */
    long long steps;                /* of the schedule */
    int threads;
    double loaded, seconds;         /* wall time to read the scenario, to design */
} mk_design_results_t;

/* Table, summary, time, and the peak memory of the process so far. */
void mk_print_design(const mk_design_results_t *results);

/* One object: a member or a node on a line, each written before the next is made, so that a million nodes need no memory here. P and V of a
   node are there if the design kept them. Steps the schedule. 1, or 0 and an error (the schedule's; those of the stream are its own). */
int mk_write_design(FILE *stream, const mk_design_results_t *results, mk_error_t *error);

#endif
