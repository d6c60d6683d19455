/* SPDX-License-Identifier: MIT */
/* Monte Carlo runs of one filter of a navigation scenario. */
#ifndef MESHKAL_NAVIGATION_NAV_CAMPAIGN_H
#define MESHKAL_NAVIGATION_NAV_CAMPAIGN_H

#include "navigation/nav_record.h"

typedef struct {
    const mk_scenario_t *scenario;
    int filter;                    /* MK_NAV_EKF, ...; MK_NAV_FILTER_COUNT: all, one after another */
    const mk_nav_precision_t *precision;
    mk_monitor_settings_t monitor;
    const mk_epochs_t *epochs;
    mk_epochs_facts_t facts;
    mk_nav_fault_span_t span;
    uint64_t seed;
    int runs, threads;
    long from;                     /* first epoch of the window, from 1 */
    const char *log_path;          /* "-": standard output; null: none */
    int progress;                  /* 1: a bar on standard error */
} mk_nav_campaign_t;

typedef struct {
    mk_nav_statistics_t statistics;
    mk_nav_story_t *story;         /* of each run that was done: statistics.runs of them */
    int interrupted;
    double epoch_seconds;          /* mean over all runs */
} mk_nav_result_t;

/* 0; 1 if the log could not be written; 2 if the filter cannot run on this scenario, with *error. The result, of the runs before that, is
   released by mk_nav_result_free. Figures and logs do not depend on threads, but for epoch_seconds. */
int mk_nav_campaign_run(const mk_nav_campaign_t *campaign, mk_nav_result_t *result, mk_error_t *error);
void mk_nav_result_free(mk_nav_result_t *result);

#endif
