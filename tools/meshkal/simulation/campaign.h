/* SPDX-License-Identifier: MIT */
/* Monte Carlo runs of one filter over one source of truth and measurements, on all cores and by all processes of a team. What comes out does
   not depend on how many they are. */
#ifndef MESHKAL_CAMPAIGN_H
#define MESHKAL_CAMPAIGN_H

#include "design/filter.h"
#include "run_log.h"
#include "scenario_monitor.h"
#include "simulation/arrivals.h"
#include "simulation/network.h"
#include "simulation/record.h"
#include "simulation/source.h"

typedef struct {
    const mk_scenario_t *scenario;
    const mk_filter_t *filter;
    const mk_network_t *network;
    int runs, steps, threads;
    int split_nodes;      /* a team of several shares each network, not the runs */
    uint64_t seed;
    double loss;          /* with arrivals: the share that is missing */
    const mk_arrivals_t *arrivals; /* of a distributed filter; null: messages are lost at random */
    double tolerance;     /* c of the design */
    mk_monitor_settings_t monitor; /* of every estimator; scheme MK_MONITOR_NONE: none */
    double frozen;        /* nodes of constant tolerance freeze their gain this close to its limit; 0: they do not */
    const char *log_path; /* null: no log; "-": standard output */
    const char *record_path; /* directory for records of the nodes in the first run, one process; null: none */
    const char *keep_path, *identity; /* file of kept runs, null: none; what decides the numbers of a run but the filter */
    int progress;         /* show a bar on standard error */
} mk_campaign_t;

/* Of all complete runs; on rank 0 of the team. */
typedef struct {
    int estimators, runs_kept; /* runs_kept: of an earlier call */
    long steps_done;           /* of all runs of this call */
    int interrupted;
    mk_statistics_t statistics;
    double seconds;
} mk_result_t;

/* Runs it. A signal of mk_catch_signals ends it early with result->interrupted set. Returns 0, or an exit status of commands.h and an
   error: MK_EXIT_INPUT if nothing was run or written, MK_EXIT_FAILED if a node or a file failed under way, which the error names. The same
   on all processes of the team. */
int mk_campaign_run(const mk_campaign_t *campaign, const mk_source_t *source, mk_team_t *team, mk_result_t *result, mk_error_t *error);
void mk_result_free(mk_result_t *result);

#endif
