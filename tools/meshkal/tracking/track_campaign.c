/* SPDX-License-Identifier: MIT */
#include "tracking/track_campaign.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "process.h"
#include "signals.h"
#include "simulation/ordered_runs.h"
#include "simulation/statistics.h"
#include "tracking/track_log.h"

/* What a thread needs. */
typedef struct {
    void *tracker;
    mk_run_events_t stream;
    mk_track_errors_t errors;
    double *work;
} worker_t;

typedef struct {
    double seconds;
    mk_track_record_t record;
} outcome_t;

typedef struct {
    const mk_track_campaign_t *c;
    mk_track_setting_t setting;
    mk_ordered_runs_t ordered;
    worker_t *worker;
    outcome_t *outcome;
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

static mk_run_state_t run_steps(const running_t *r, worker_t *w, int run, outcome_t *outcome, mk_run_log_t *log, mk_error_t *error) {
    const mk_track_campaign_t *const c = r->c;
    mk_track_record_t *const record = &outcome->record;
    mk_instant_t instant;
    const mk_track_look_t *look = NULL;
    long *const counts = mk_allocate(3 * (size_t)record->estimators, sizeof *counts);
    known_t known = {0, 0, 0, 0, counts, counts + record->estimators, counts + 2 * record->estimators};
    double last = (double)NAN;
    int more = 1;
    mk_run_state_t state = MK_RUN_DONE;
    mk_run_events_start(&w->stream, run);
    const mk_status_t status = c->tracker->start(w->tracker, run, w->stream.estimate);
    if (status != MK_OK) {
        (void)mk_fail(error, "run %d: %s does not start: %s", run, c->filter->name, mk_status_name(status));
        state = MK_RUN_FAILED;
    }
    for (long t = 0; t < record->steps && state == MK_RUN_DONE; t++) {
        more = mk_run_events_next(&w->stream, &instant, error);
        if (more <= 0) state = MK_RUN_FAILED;
        if (state == MK_RUN_DONE && mk_stopped()) state = MK_RUN_STOPPED;
        if (state != MK_RUN_DONE) break;
        const double from = mk_seconds();
        if (!c->tracker->step(w->tracker, t + 1, &instant, error)) state = MK_RUN_FAILED;
        outcome->seconds += mk_seconds() - from;
        if (state != MK_RUN_DONE) break;
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
            (void)mk_fail(error, "writing the log: %s", strerror(log->failed));
            state = MK_RUN_FAILED;
        }
    }
    if (state == MK_RUN_FAILED && more == 0) (void)mk_fail(error, "run %d ends early", run);
    if (state == MK_RUN_DONE && look) finish_record(c, record, &known, look, last);
    free(counts);
    return state;
}

static void put_header(void *context, mk_run_log_t *log) {
    const running_t *const r = context;
    mk_track_log_header(log, r->c, &r->setting);
}

static mk_run_state_t run_one(void *context, int worker, int slot, int run, mk_run_log_t *log, mk_error_t *error) {
    running_t *const r = context;
    outcome_t *const outcome = &r->outcome[slot];
    outcome->seconds = 0.0;
    memset(outcome->record.value, 0, outcome->record.count * sizeof *outcome->record.value);
    return run_steps(r, &r->worker[worker], run, outcome, log, error);
}

static void take(void *context, int slot, int run) {
    running_t *const r = context;
    const outcome_t *const outcome = &r->outcome[slot];
    mk_track_statistics_add(&r->result->statistics, outcome->record.value);
    r->seconds[run] = outcome->seconds / (double)outcome->record.steps;
}

/* The object of each thread. 1, or 0 and an error. */
static int open_workers(running_t *r) {
    const mk_track_campaign_t *const c = r->c;
    const mk_scenario_t *const s = c->scenario;
    const size_t E = (size_t)r->setting.topology.estimators, n = (size_t)s->n, room = mk_track_log_room(&r->setting);
    size_t numbers = 2 * (size_t)MK_PACKED(n) + n;
    if (room > numbers) numbers = room;
    r->worker = mk_allocate((size_t)r->ordered.workers, sizeof *r->worker);
    r->outcome = mk_allocate((size_t)r->ordered.slots, sizeof *r->outcome);
    for (int i = 0; i < r->ordered.slots; i++) mk_track_record_open(&r->outcome[i].record, c->facts.steps, (int)E);
    for (int i = 0; i < r->ordered.workers; i++) {
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
    for (int i = 0; i < r->ordered.workers && r->worker[i].tracker; i++) {
        r->c->tracker->close(r->worker[i].tracker);
        mk_run_events_close(&r->worker[i].stream);
        free(r->worker[i].errors.node_position);
        free(r->worker[i].work);
    }
    for (int i = 0; i < r->ordered.slots; i++) mk_track_record_close(&r->outcome[i].record);
    free(r->worker);
    free(r->outcome);
}

int mk_track_campaign_run(const mk_track_campaign_t *c, mk_track_result_t *result, mk_error_t *error) {
    running_t r;
    memset(&r, 0, sizeof r);
    memset(result, 0, sizeof *result);
    const int central = c->filter->kind == MK_TRACK_CENTRAL;
    r.c = c;
    r.result = result;
    r.error = error;
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
    r.ordered = (mk_ordered_runs_t){.runs = c->runs, .threads = c->threads, .name = c->progress ? c->filter->name : NULL,
                                    .log_bytes = 8.0 * (double)mk_track_log_room(&r.setting) * (double)c->facts.steps,
                                    .log_path = c->log_path, .context = &r, .header = put_header, .run = run_one, .take = take};
    mk_ordered_runs_plan(&r.ordered);
    const int status = open_workers(&r) ? mk_ordered_runs(&r.ordered, &result->interrupted, error) : MK_EXIT_INPUT;
    mk_sort(r.seconds, (size_t)result->statistics.runs);
    result->step_seconds = mk_median(r.seconds, (size_t)result->statistics.runs);
    close_workers(&r);
    if (central) mk_central_free(&r.setting.topology);
    free(r.seconds);
    return status;
}

void mk_track_result_free(mk_track_result_t *result) {
    mk_track_statistics_close(&result->statistics);
    memset(result, 0, sizeof *result);
}
