/* SPDX-License-Identifier: MIT */
#include "navigation/nav_campaign.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "navigation/nav_log.h"
#include "process.h"
#include "scenario_monitor.h"
#include "signals.h"
#include "simulation/ordered_runs.h"

typedef struct {
    mk_navigator_t *navigator;
    mk_run_epochs_t stream;
    double *work;
} worker_t;

typedef struct {
    double seconds;
    mk_nav_record_t record;
    mk_nav_story_t story;
} outcome_t;

typedef struct {
    const mk_nav_campaign_t *c;
    mk_nav_setting_t setting;
    mk_ordered_runs_t ordered;
    worker_t *worker;
    outcome_t *outcome;
    mk_nav_result_t *result;
    mk_error_t *error;
} running_t;

/* A mean of what is known. */
typedef struct {
    double sum;
    long count;
} mean_t;

static void add_mean(mean_t *mean, double value) {
    if (isnan(value)) return;
    mean->sum += value;
    mean->count++;
}

static double value_of(const mean_t *mean) { return mean->count ? mean->sum / (double)mean->count : (double)NAN; }

enum { MEANS = MK_NAV_FIRST_COUNT };

static void add_epoch(const mk_nav_campaign_t *c, mk_nav_record_t *record, mean_t *mean, long t, const mk_epoch_t *epoch, const mk_nav_look_t *look,
                      const mk_nav_errors_t *errors) {
    const int node = c->span.node;
    record->time[t] = epoch->t;
    record->position[t] = errors->position;
    record->velocity[t] = errors->velocity;
    record->nees[t] = errors->nees;
    record->innovation[t] = look->innovation[node];
    record->weight[t] = epoch->have[node] ? look->weight[node] : (double)NAN;
    record->alarm[t] = c->monitor.scheme == MK_MONITOR_NONE ? (double)NAN : (double)look->monitor.alarm[0];
    for (int k = 0; k < c->scenario->nodes; k++)
        if (epoch->have[k]) add_mean(&mean[epoch->fault[k] != 0.0 ? MK_NAV_WEIGHT_FAULTY : MK_NAV_WEIGHT_OTHERS], look->weight[k]);
    if (t + 1 < c->from) return;
    add_mean(&mean[MK_NAV_MEAN_POSITION], errors->position);
    add_mean(&mean[MK_NAV_MEAN_VELOCITY], errors->velocity);
    add_mean(&mean[MK_NAV_MEAN_ATTITUDE], errors->attitude);
    add_mean(&mean[MK_NAV_MEAN_NEES], errors->nees);
    mean[MK_NAV_SUM_NIS].sum += look->nis;
    mean[MK_NAV_SUM_NIS_ROWS].sum += look->nis_rows;
}

static mk_run_state_t run_epochs(const running_t *r, worker_t *w, int run, outcome_t *outcome, mk_run_log_t *log, mk_error_t *error) {
    const mk_nav_campaign_t *const c = r->c;
    mk_epoch_t epoch;
    mean_t mean[MEANS];
    memset(mean, 0, sizeof mean);
    mk_run_epochs_start(&w->stream, run);
    mk_nav_story_start(&outcome->story);
    const mk_status_t status = mk_navigator_start(w->navigator, &w->stream.estimate);
    if (status != MK_OK) {
        (void)mk_fail(error, "run %d: %s does not start: %s", run, mk_nav_filter_name(c->filter), mk_status_name(status));
        return MK_RUN_FAILED;
    }
    const mk_nav_look_t *look = NULL;
    for (long t = 0; mk_run_epochs_next(&w->stream, &epoch); t++) {
        if (mk_stopped()) return MK_RUN_STOPPED;
        const double from = mk_seconds();
        look = mk_navigator_step(w->navigator, &epoch);
        outcome->seconds += mk_seconds() - from;
        const mk_nav_errors_t errors = mk_nav_judge(&epoch, look);
        add_epoch(c, &outcome->record, mean, t, &epoch, look, &errors);
        mk_nav_story_add(&outcome->story, c->scenario, &c->span, &epoch, look);
        if (log) mk_nav_log_item(log, c, run, t + 1, &epoch, look, &errors, w->work);
    }
    for (int i = 0; i < MEANS; i++)
        outcome->record.single[i] = i == MK_NAV_SUM_NIS || i == MK_NAV_SUM_NIS_ROWS ? mean[i].sum : value_of(&mean[i]);
    if (look) memcpy(outcome->record.single + MK_NAV_FIRST_COUNT, look->count, sizeof look->count);
    return MK_RUN_DONE;
}

static void put_header(void *context, mk_run_log_t *log) {
    const running_t *const r = context;
    mk_nav_log_header(log, r->c);
}

static mk_run_state_t run_one(void *context, int worker, int slot, int run, mk_run_log_t *log, mk_error_t *error) {
    running_t *const r = context;
    outcome_t *const outcome = &r->outcome[slot];
    outcome->seconds = 0.0;
    memset(outcome->record.value, 0, outcome->record.count * sizeof *outcome->record.value);
    return run_epochs(r, &r->worker[worker], run, outcome, log, error);
}

static void take(void *context, int slot, int run) {
    running_t *const r = context;
    const outcome_t *const outcome = &r->outcome[slot];
    mk_nav_statistics_add(&r->result->statistics, outcome->record.value);
    r->result->story[run] = outcome->story;
    r->result->epoch_seconds += outcome->seconds / (double)outcome->record.steps / r->c->runs;
}

/* The objects of each thread. 1, or 0 and an error. */
static int open_workers(running_t *r) {
    const mk_nav_campaign_t *const c = r->c;
    r->worker = mk_allocate((size_t)r->ordered.workers, sizeof *r->worker);
    r->outcome = mk_allocate((size_t)r->ordered.slots, sizeof *r->outcome);
    for (int i = 0; i < r->ordered.slots; i++) mk_nav_record_open(&r->outcome[i].record, c->facts.steps);
    for (int i = 0; i < r->ordered.workers; i++) {
        worker_t *const w = &r->worker[i];
        w->navigator = mk_navigator_open(&r->setting, c->precision, r->error);
        if (!w->navigator) return 0;
        mk_run_epochs_open(&w->stream, c->epochs);
        w->work = mk_allocate(mk_nav_log_room(c), sizeof *w->work);
    }
    return 1;
}

static void close_workers(running_t *r) {
    for (int i = 0; i < r->ordered.workers && r->worker[i].navigator; i++) {
        mk_navigator_close(r->worker[i].navigator);
        mk_run_epochs_close(&r->worker[i].stream);
        free(r->worker[i].work);
    }
    for (int i = 0; i < r->ordered.slots; i++) mk_nav_record_close(&r->outcome[i].record);
    free(r->worker);
    free(r->outcome);
}

int mk_nav_campaign_run(const mk_nav_campaign_t *c, mk_nav_result_t *result, mk_error_t *error) {
    running_t r;
    memset(&r, 0, sizeof r);
    memset(result, 0, sizeof *result);
    r.c = c;
    r.result = result;
    r.error = error;
    r.setting.scenario = c->scenario;
    r.setting.filter = c->filter;
    r.setting.monitor = &c->monitor;
    result->story = mk_allocate((size_t)c->runs, sizeof *result->story);
    mk_nav_statistics_open(&result->statistics, c->facts.steps);
    r.ordered = (mk_ordered_runs_t){.runs = c->runs, .threads = c->threads, .name = c->progress ? mk_nav_filter_name(c->filter) : NULL,
                                    .log_path = c->log_path, .context = &r, .header = put_header, .run = run_one, .take = take};
    mk_ordered_runs_plan(&r.ordered);
    const int status = open_workers(&r) ? mk_ordered_runs(&r.ordered, &result->interrupted, error) : MK_EXIT_INPUT;
    close_workers(&r);
    return status;
}

void mk_nav_result_free(mk_nav_result_t *result) {
    mk_nav_statistics_close(&result->statistics);
    free(result->story);
    memset(result, 0, sizeof *result);
}
