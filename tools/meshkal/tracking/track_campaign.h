/* SPDX-License-Identifier: MIT */
/* Monte Carlo runs of one filter of a tracking scenario. */
#ifndef MESHKAL_TRACKING_TRACK_CAMPAIGN_H
#define MESHKAL_TRACKING_TRACK_CAMPAIGN_H

#include "tracking/track_record.h"

typedef struct {
    const mk_scenario_t *scenario;
    const mk_tracking_filter_t *filter;
    const mk_tracker_t *tracker;
    const void *models; /* of its precision */
    const mk_space_f64_t *space; /* of the states; null: ordinary numbers */
    const mk_events_t *events;
    mk_events_facts_t facts;
    uint64_t seed;
    int runs, threads;
    long from;            /* first step of the window, from 1 */
    double loss;          /* of messages */
    double lost_m;        /* position error at the end of a run that has lost its target; infinite: not asked for */
    const char *log_path; /* "-": standard output; null: none */
    int progress;         /* 1: a bar on standard error */
} mk_track_campaign_t;

typedef struct {
    mk_track_statistics_t statistics;
    int estimators, interrupted;
    double step_seconds; /* of all estimators together: the median over runs of a run's mean */
} mk_track_result_t;

/* 0; 1 if a run failed or the log could not be written; 2 if the filter cannot run on this scenario, with *error. The result, of the runs before
   that, is released by mk_track_result_free. Figures and logs do not depend on threads, but for step_seconds. */
int mk_track_campaign_run(const mk_track_campaign_t *campaign, mk_track_result_t *result, mk_error_t *error);
void mk_track_result_free(mk_track_result_t *result);

#endif
