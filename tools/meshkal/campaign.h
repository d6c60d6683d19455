/* SPDX-License-Identifier: MIT */
/* Monte Carlo runs of one filter over one source of truth and measurements. */
#ifndef MESHKAL_CAMPAIGN_H
#define MESHKAL_CAMPAIGN_H

#include "filter.h"
#include "network.h"
#include "run_log.h"
#include "source.h"

typedef struct {
    const mk_scenario_t *scenario;
    const mk_filter_t *filter;
    const mk_network_t *network;
    int runs, steps;
    uint64_t seed;
    double loss;
    double tolerance;   /* c of the design */
    const char *log_path; /* null: no log; "-": standard output */
    int progress;       /* show a bar on standard error */
} mk_campaign_t;

/* Averages; steady: over the second half of the steps. Squares are of errors x - xh. */
typedef struct {
    int estimators, steps, runs_done, steps_done; /* steps_done: of all runs */
    int interrupted;
    double *msd, *position_msd; /* over time, mean over estimators and runs; NaN without truth */
    double *node_msd;           /* steady, one an estimator */
    double steady, position_steady, steady_ci95; /* half-width, NaN for fewer than two runs */
    double *state_rmse;         /* each state, over all steps, estimators and runs; NaN where no truth is known */
    double theta, tolerance, nis_ratio;          /* steady means */
    double seconds;
} mk_result_t;

/* Runs it. A signal of mk_catch_signals ends it early with result->interrupted set. Returns 0, or an exit status of commands.h and an
   error: MK_EXIT_INPUT if nothing was run or written, MK_EXIT_FAILED if a node or the log failed under way, which the error names. */
int mk_campaign_run(const mk_campaign_t *campaign, mk_source_t *source, mk_result_t *result, mk_error_t *error);
void mk_result_free(mk_result_t *result);

/* From now on SIGINT and SIGTERM end a campaign between two steps. */
void mk_catch_signals(void);

#endif
