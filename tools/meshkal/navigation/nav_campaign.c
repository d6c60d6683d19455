/* SPDX-License-Identifier: MIT */
#include "navigation/nav_campaign.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "navigation/nav_log.h"
#include "parallel.h"
#include "process.h"
#include "scenario_monitor.h"
#include "signals.h"

/* Runs that a thread takes at a time; one where they write logs, which wait in memory for those of the runs before them. */
enum { CHUNK = 8 };

typedef enum { NOT_RUN, DONE, STOPPED, FAILED } state_t;

typedef struct {
    mk_navigator_t *navigator;
    mk_run_epochs_t stream;
    double *work;
} worker_t;

typedef struct {
    state_t state;
    double seconds;
    mk_nav_record_t record;
    mk_nav_story_t story;
    mk_run_log_t log;
    mk_error_t error;
} outcome_t;

typedef struct {
    const mk_nav_campaign_t *c;
    mk_nav_setting_t setting;
    int workers, chunk, next_run, shown;
    worker_t *worker;
    outcome_t *outcome;
    mk_run_log_t log;
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

static state_t run_epochs(running_t *r, worker_t *w, int run, outcome_t *outcome, mk_run_log_t *log) {
    const mk_nav_campaign_t *const c = r->c;
    mk_epoch_t epoch;
    mean_t mean[MEANS];
    memset(mean, 0, sizeof mean);
    mk_run_epochs_start(&w->stream, run);
    mk_nav_story_start(&outcome->story);
    const mk_status_t status = mk_navigator_start(w->navigator, &w->stream.estimate);
    if (status != MK_OK) {
        (void)mk_fail(&outcome->error, "run %d: %s does not start: %s", run, mk_nav_filter_name(c->filter), mk_status_name(status));
        return FAILED;
    }
    const mk_nav_look_t *look = NULL;
    for (long t = 0; mk_run_epochs_next(&w->stream, &epoch); t++) {
        if (mk_stopped()) return STOPPED;
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
    return DONE;
}

static void show_progress(running_t *r, int done) {
    const int percent = (int)(100.0 * done / r->c->runs);
    if (percent == r->shown) return;
    r->shown = percent;
    (void)fprintf(stderr, "\r%-12s [%-40.*s] %3d %%", mk_nav_filter_name(r->c->filter), percent * 40 / 100,
                  "########################################", percent);
}

static void run_one(void *context, int worker, long index) {
    running_t *const r = context;
    outcome_t *const outcome = &r->outcome[index];
    const int run = r->next_run + (int)index;
    outcome->state = NOT_RUN;
    outcome->seconds = 0.0;
    if (run >= r->c->runs) return;
    memset(outcome->record.value, 0, outcome->record.count * sizeof *outcome->record.value);
    if (r->c->log_path) mk_log_keep(&outcome->log);
    outcome->state = run_epochs(r, &r->worker[worker], run, outcome, r->c->log_path ? &outcome->log : NULL);
}

/* In the order of runs; after one that did not end well none counts. */
static state_t commit(running_t *r) {
    state_t state = DONE;
    for (int i = 0; i < r->workers * r->chunk; i++) {
        outcome_t *const outcome = &r->outcome[i];
        if (state == DONE && outcome->state != NOT_RUN) {
            if (outcome->log.out.used > 0) mk_log_append(&r->log, outcome->log.out.buffer, outcome->log.out.used, outcome->log.items);
            state = outcome->state;
            if (state == FAILED) *r->error = outcome->error;
            if (state == DONE && r->log.failed) {
                (void)mk_fail(r->error, "writing the log: %s", strerror(r->log.failed));
                state = FAILED;
            }
            if (state == DONE) {
                mk_nav_statistics_add(&r->result->statistics, outcome->record.value);
                r->result->story[r->next_run++] = outcome->story;
                r->result->epoch_seconds += outcome->seconds / (double)outcome->record.steps / r->c->runs;
            }
        }
        free(outcome->log.out.buffer);
        memset(&outcome->log, 0, sizeof outcome->log);
    }
    return state;
}

/* The objects of each thread. 1, or 0 and an error. */
static int open_workers(running_t *r) {
    const mk_nav_campaign_t *const c = r->c;
    r->workers = c->threads < c->runs ? c->threads : c->runs;
    r->chunk = c->log_path ? 1 : c->runs / (4 * r->workers) + 1;
    if (r->chunk > CHUNK) r->chunk = CHUNK;
    r->worker = mk_allocate((size_t)r->workers, sizeof *r->worker);
    r->outcome = mk_allocate((size_t)(r->workers * r->chunk), sizeof *r->outcome);
    for (int i = 0; i < r->workers * r->chunk; i++) mk_nav_record_open(&r->outcome[i].record, c->facts.steps);
    for (int i = 0; i < r->workers; i++) {
        worker_t *const w = &r->worker[i];
        w->navigator = mk_navigator_open(&r->setting, c->precision, r->error);
        if (!w->navigator) return 0;
        mk_run_epochs_open(&w->stream, c->epochs);
        w->work = mk_allocate(mk_nav_log_room(c), sizeof *w->work);
    }
    return 1;
}

static void close_workers(running_t *r) {
    for (int i = 0; i < r->workers && r->worker[i].navigator; i++) {
        mk_navigator_close(r->worker[i].navigator);
        mk_run_epochs_close(&r->worker[i].stream);
        free(r->worker[i].work);
    }
    for (int i = 0; i < r->workers * r->chunk; i++) mk_nav_record_close(&r->outcome[i].record);
    free(r->worker);
    free(r->outcome);
}

static int run_all(running_t *r) {
    const mk_nav_campaign_t *const c = r->c;
    if (!open_workers(r)) return MK_EXIT_INPUT;
    if (c->log_path) {
        if (!mk_log_open(&r->log, c->log_path, r->error)) return MK_EXIT_INPUT;
        mk_nav_log_header(&r->log, c);
    }
    state_t state = DONE;
    while (r->next_run < c->runs && state == DONE) {
        if (c->progress) show_progress(r, r->next_run);
        mk_parallel(r->workers, (long)r->workers * r->chunk, run_one, r);
        state = commit(r);
        if (mk_stopped() && state == DONE && r->next_run < c->runs) state = STOPPED;
    }
    if (c->progress && r->shown >= 0) (void)fputs("\r\033[K", stderr);
    r->result->interrupted = state == STOPPED;
    int good = state != FAILED;
    if (c->log_path) {
        mk_error_t log_error;
        const int written = mk_log_close(&r->log, !good ? "failed" : state == STOPPED ? "interrupted" : "complete", &log_error);
        if (good && !written) *r->error = log_error;
        good = good && written;
    }
    return good ? 0 : MK_EXIT_FAILED;
}

int mk_nav_campaign_run(const mk_nav_campaign_t *c, mk_nav_result_t *result, mk_error_t *error) {
    running_t r;
    memset(&r, 0, sizeof r);
    memset(result, 0, sizeof *result);
    r.c = c;
    r.result = result;
    r.error = error;
    r.shown = -1;
    r.setting.scenario = c->scenario;
    r.setting.filter = c->filter;
    r.setting.monitor = &c->monitor;
    result->story = mk_allocate((size_t)c->runs, sizeof *result->story);
    mk_nav_statistics_open(&result->statistics, c->facts.steps);
    const int status = run_all(&r);
    close_workers(&r);
    return status;
}

void mk_nav_result_free(mk_nav_result_t *result) {
    mk_nav_statistics_close(&result->statistics);
    free(result->story);
    memset(result, 0, sizeof *result);
}
