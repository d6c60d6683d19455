/* SPDX-License-Identifier: MIT */
#include "tracking/track_campaign.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "parallel.h"
#include "process.h"
#include "signals.h"
#include "tracking/track_log.h"

/* Bytes of logs that may wait in memory for those of the runs before them, and runs that a thread takes at a time. */
#define LOG_ROOM 268435456.0
enum { CHUNK = 8 };

typedef enum { NOT_RUN, DONE, STOPPED, FAILED } state_t;

/* What a thread needs. */
typedef struct {
    void *tracker;
    mk_run_events_t stream;
    mk_track_errors_t errors;
    double *work;
} worker_t;

typedef struct {
    state_t state;
    double seconds;
    mk_track_record_t record;
    mk_run_log_t log; /* of a run that waits */
    mk_error_t error;
} outcome_t;

typedef struct {
    const mk_track_campaign_t *c;
    mk_track_setting_t setting;
    int workers, chunk, next_run, shown;
    worker_t *worker;
    outcome_t *outcome;
    mk_run_log_t log;
    double *seconds; /* of each run */
    mk_track_result_t *result;
    mk_error_t *error;
} running_t;

static void add_mean(double *mean, long *count, double value) {
    if (isnan(value)) return;
    *mean += (value - *mean) / (double)++*count;
}

/* Means over the window of what is known. */
typedef struct {
    long position, velocity, nees, apart;
    long *node_position, *node_velocity, *node_nees;
} known_t;

static void add_window(mk_track_record_t *record, known_t *known, const mk_track_errors_t *errors, const mk_track_look_t *look) {
    double *const single = record->single;
    add_mean(&single[MK_TRACK_POSITION], &known->position, errors->position);
    add_mean(&single[MK_TRACK_VELOCITY], &known->velocity, errors->velocity);
    add_mean(&single[MK_TRACK_NEES], &known->nees, errors->nees);
    add_mean(&single[MK_TRACK_APART_SQUARE], &known->apart, errors->apart * errors->apart);
    for (int e = 0; e < record->estimators; e++) {
        single[MK_TRACK_NIS] += look->nis[e];
        single[MK_TRACK_NIS_ROWS] += look->nis_rows[e];
        add_mean(&record->node_position[e], &known->node_position[e], errors->node_position[e]);
        add_mean(&record->node_velocity[e], &known->node_velocity[e], errors->node_velocity[e]);
        add_mean(&record->node_nees[e], &known->node_nees[e], errors->node_nees[e]);
    }
}

static void finish_record(const mk_track_campaign_t *c, mk_track_record_t *record, const known_t *known, const mk_track_look_t *look, double last) {
    double *const single = record->single;
    const double nan = (double)NAN;
    if (!known->position) single[MK_TRACK_POSITION] = nan;
    if (!known->velocity) single[MK_TRACK_VELOCITY] = nan;
    if (!known->nees) single[MK_TRACK_NEES] = nan;
    if (!known->apart) single[MK_TRACK_APART_SQUARE] = nan;
    for (int e = 0; e < record->estimators; e++) {
        if (!known->node_position[e]) record->node_position[e] = nan;
        if (!known->node_velocity[e]) record->node_velocity[e] = nan;
        if (!known->node_nees[e]) record->node_nees[e] = nan;
    }
    single[MK_TRACK_TARGET_LOST] = sqrt(last) > c->lost_m;
    memcpy(single + MK_TRACK_COUNT, look->count, sizeof look->count);
}

static void add_instant(double *single, const mk_instant_t *instant) {
    single[MK_TRACK_READINGS] += instant->count;
    single[MK_TRACK_SCENARIO_LOST] += instant->lost;
    single[MK_TRACK_OUT_OF_RANGE] += instant->out_of_range;
    for (int i = 0; i < instant->count; i++) single[MK_TRACK_FAULTY] += instant->reading[i].faulty;
}

static state_t run_steps(running_t *r, worker_t *w, int run, outcome_t *outcome, mk_run_log_t *log) {
    const mk_track_campaign_t *const c = r->c;
    mk_track_record_t *const record = &outcome->record;
    mk_instant_t instant;
    const mk_track_look_t *look = NULL;
    long *const counts = mk_allocate(3 * (size_t)record->estimators, sizeof *counts);
    known_t known = {0, 0, 0, 0, counts, counts + record->estimators, counts + 2 * record->estimators};
    double last = (double)NAN;
    int more = 1;
    state_t state = DONE;
    mk_run_events_start(&w->stream, run);
    const mk_status_t status = c->tracker->start(w->tracker, run, w->stream.estimate);
    if (status != MK_OK) {
        (void)mk_fail(&outcome->error, "run %d: %s does not start: %s", run, c->filter->name, mk_status_name(status));
        state = FAILED;
    }
    for (long t = 0; t < record->steps && state == DONE; t++) {
        more = mk_run_events_next(&w->stream, &instant, &outcome->error);
        if (more <= 0) state = FAILED;
        if (state == DONE && mk_stopped()) state = STOPPED;
        if (state != DONE) break;
        const double from = mk_seconds();
        if (!c->tracker->step(w->tracker, t + 1, &instant, &outcome->error)) state = FAILED;
        outcome->seconds += mk_seconds() - from;
        if (state != DONE) break;
        look = c->tracker->look(w->tracker);
        mk_track_judge(&r->setting, look, instant.x, &w->errors, w->work);
        record->position[t] = w->errors.position;
        record->velocity[t] = w->errors.velocity;
        record->nees[t] = w->errors.nees;
        record->apart[t] = w->errors.apart;
        record->time[t] = instant.t;
        add_instant(record->single, &instant);
        if (t + 1 >= c->from) add_window(record, &known, &w->errors, look);
        last = w->errors.position;
        if (log) mk_track_log_item(log, c, &r->setting, run, t + 1, &instant, look, &w->errors, w->work);
        if (log && log->failed) {
            (void)mk_fail(&outcome->error, "writing the log: %s", strerror(log->failed));
            state = FAILED;
        }
    }
    if (state == FAILED && more == 0) (void)mk_fail(&outcome->error, "run %d ends early", run);
    if (state == DONE && look) finish_record(c, record, &known, look, last);
    free(counts);
    return state;
}

static void show_progress(running_t *r, int done) {
    const int percent = (int)(100.0 * done / r->c->runs);
    if (percent == r->shown) return;
    r->shown = percent;
    (void)fprintf(stderr, "\r%-12s [%-40.*s] %3d %%", r->c->filter->name, percent * 40 / 100, "########################################", percent);
}

static void run_one(void *context, int worker, long index) {
    running_t *const r = context;
    outcome_t *const outcome = &r->outcome[index];
    const int run = r->next_run + (int)index, direct = index == 0;
    mk_run_log_t *const log = !r->c->log_path ? NULL : direct ? &r->log : &outcome->log;
    outcome->state = NOT_RUN;
    outcome->seconds = 0.0;
    if (run >= r->c->runs) return;
    memset(outcome->record.value, 0, outcome->record.count * sizeof *outcome->record.value);
    if (log && !direct) mk_log_keep(log);
    outcome->state = run_steps(r, &r->worker[worker], run, outcome, log);
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
                mk_track_statistics_add(&r->result->statistics, outcome->record.value);
                r->seconds[r->next_run++] = outcome->seconds / (double)outcome->record.steps;
            }
        }
        free(outcome->log.out.buffer);
        memset(&outcome->log, 0, sizeof outcome->log);
    }
    return state;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static double median(double *values, int count) {
    if (count == 0) return (double)NAN;
    qsort(values, (size_t)count, sizeof *values, compare);
    return count % 2 ? values[count / 2] : 0.5 * (values[count / 2 - 1] + values[count / 2]);
}

/* The object of each thread. 1, or 0 and an error. */
static int open_workers(running_t *r) {
    const mk_track_campaign_t *const c = r->c;
    const mk_scenario_t *const s = c->scenario;
    const size_t E = (size_t)r->setting.topology.estimators, n = (size_t)s->n, room = mk_track_log_room(&r->setting);
    size_t numbers = 2 * (size_t)MK_PACKED(n) + n;
    if (room > numbers) numbers = room;
    r->workers = c->threads < c->runs ? c->threads : c->runs;
    r->chunk = c->log_path ? 1 : c->runs / (4 * r->workers) + 1;
    if (r->chunk > CHUNK) r->chunk = CHUNK;
    if (c->log_path) r->workers = (int)fmin(r->workers, 1.0 + floor(LOG_ROOM / (8.0 * (double)room * (double)c->facts.steps)));
    r->worker = mk_allocate((size_t)r->workers, sizeof *r->worker);
    r->outcome = mk_allocate((size_t)(r->workers * r->chunk), sizeof *r->outcome);
    for (int i = 0; i < r->workers * r->chunk; i++) mk_track_record_open(&r->outcome[i].record, c->facts.steps, (int)E);
    for (int i = 0; i < r->workers; i++) {
        worker_t *const w = &r->worker[i];
        w->tracker = c->tracker->open(c->models, &r->setting, r->error);
        if (!w->tracker) return 0;
        mk_run_events_open(&w->stream, c->events);
        w->errors.node_position = mk_allocate(4 * E, sizeof *w->errors.node_position);
        w->errors.node_velocity = w->errors.node_position + E;
        w->errors.node_nees = w->errors.node_velocity + E;
        w->errors.error = w->errors.node_nees + E;
        w->work = mk_allocate(numbers, sizeof *w->work);
    }
    return 1;
}

static void close_workers(running_t *r) {
    for (int i = 0; i < r->workers && r->worker[i].tracker; i++) {
        r->c->tracker->close(r->worker[i].tracker);
        mk_run_events_close(&r->worker[i].stream);
        free(r->worker[i].errors.node_position);
        free(r->worker[i].work);
    }
    for (int i = 0; i < r->workers * r->chunk; i++) mk_track_record_close(&r->outcome[i].record);
    free(r->worker);
    free(r->outcome);
}

static int run_all(running_t *r) {
    const mk_track_campaign_t *const c = r->c;
    if (!open_workers(r)) return MK_EXIT_INPUT;
    if (c->log_path) {
        if (!mk_log_open(&r->log, c->log_path, r->error)) return MK_EXIT_INPUT;
        mk_track_log_header(&r->log, c, &r->setting);
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
    r->result->step_seconds = median(r->seconds, r->next_run);
    int good = state != FAILED;
    if (c->log_path) {
        mk_error_t log_error;
        const int written = mk_log_close(&r->log, !good ? "failed" : state == STOPPED ? "interrupted" : "complete", &log_error);
        if (good && !written) *r->error = log_error;
        good = good && written;
    }
    return good ? 0 : MK_EXIT_FAILED;
}

int mk_track_campaign_run(const mk_track_campaign_t *c, mk_track_result_t *result, mk_error_t *error) {
    running_t r;
    memset(&r, 0, sizeof r);
    memset(result, 0, sizeof *result);
    const int central = c->filter->kind == MK_TRACK_CENTRAL;
    r.c = c;
    r.result = result;
    r.error = error;
    r.shown = -1;
    r.setting.scenario = c->scenario;
    r.setting.filter = c->filter;
    r.setting.topology = central ? mk_central_topology(c->scenario) : mk_distributed_topology(c->scenario);
    r.setting.space = c->space;
    r.setting.seed = c->seed;
    r.setting.loss = c->loss;
    r.setting.iterations = c->filter->kind == MK_TRACK_INFORMATION ? c->scenario->tracking->iterations : 0;
    r.setting.watch = c->log_path != NULL;
    r.setting.known = c->facts.known;
    r.seconds = mk_allocate((size_t)c->runs, sizeof *r.seconds);
    result->estimators = r.setting.topology.estimators;
    mk_track_statistics_open(&result->statistics, c->facts.steps, result->estimators);
    const int status = run_all(&r);
    close_workers(&r);
    if (central) mk_central_free(&r.setting.topology);
    free(r.seconds);
    return status;
}

void mk_track_result_free(mk_track_result_t *result) {
    mk_track_statistics_close(&result->statistics);
    memset(result, 0, sizeof *result);
}
