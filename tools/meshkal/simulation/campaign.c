/* SPDX-License-Identifier: MIT */
#include "simulation/campaign.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "design/design.h"
#include "parallel.h"
#include "process.h"
#include "signals.h"
#include "simulation/kept_runs.h"
#include "simulation/runner.h"

/* What became of one run, on its way to rank 0: followed by the record and by the bytes of its log. */
typedef struct {
    int run, state;
    long steps_done;
    uint64_t log_items;
    size_t log_length;
    mk_error_t error;
} outcome_t;

typedef struct {
    const mk_campaign_t *c;
    const mk_source_t *source;
    mk_team_t *team, *sharing; /* all processes; those that share one network with this one */
    mk_topology_t topology;
    double *tolerance, *schedule;
    int workers, chunk; /* threads with a network each, and runs that they take at a time */
    mk_runner_t *runner;
    outcome_t *outcome;
    mk_record_t *record; /* one for each outcome */
    mk_node_records_t *records;
    mk_run_log_t *part;  /* logs of runs that wait for those before them; null if none does */
    /* rank 0 */
    mk_run_log_t log;
    mk_kept_t kept;
    mk_result_t *result;
    mk_error_t *error;
    /* The same on all. */
    struct {
        int next_run, state;
    } shared;
    int watched_run, shown; /* of the progress bar: the run of the first worker; per cent */
} mk_running_t;

static void show_progress(void *context, int t) {
    mk_running_t *r = context;
    const mk_campaign_t *c = r->c;
    const double done = r->shared.next_run + (r->watched_run - r->shared.next_run + (t + 1.0) / c->steps) * r->workers * r->team->ranks;
    const int percent = (int)fmin(100.0 * done / c->runs, 100.0);
    if (percent == r->shown) return;
    r->shown = percent;
    (void)fprintf(stderr, "\r%-8s [%-40.*s] %3d %%", c->filter->name, percent * 40 / 100, "########################################", percent);
}

/* Runs are given to worker and rank in blocks, so that what is collected comes in order. */
static void run_one(void *context, int worker, long index) {
    mk_running_t *r = context;
    outcome_t *outcome = &r->outcome[index];
    const int rank = r->sharing == r->team ? 0 : r->team->rank, direct = !r->part || (rank == 0 && index == 0);
    mk_run_log_t *log = !r->c->log_path || r->sharing->rank > 0 ? NULL : direct ? &r->log : &r->part[index];
    mk_runner_t *runner = &r->runner[worker];
    memset(outcome, 0, sizeof *outcome);
    outcome->run = r->shared.next_run + rank * r->workers * r->chunk + (int)index;
    if (outcome->run >= r->c->runs) return;
    if (mk_stopped() && r->sharing->ranks == 1) {
        outcome->state = MK_RUN_STOPPED;
        return;
    }
    if (log && !direct) mk_log_keep(log);
    const long before = runner->steps_done;
    const int watched = r->c->progress && worker == 0 && r->team->rank == 0;
    if (watched) r->watched_run = outcome->run;
    outcome->state = (int)mk_runner_run(runner, outcome->run, &r->record[index], log, watched ? show_progress : NULL, r, &outcome->error);
    outcome->steps_done = runner->steps_done - before;
    if (!log || direct) return;
    outcome->log_items = log->items;
    outcome->log_length = log->out.used;
}

/* On rank 0, in the order of runs. After one that did not end well none counts, though some may be done: there are no gaps. */
static void commit(mk_running_t *r, const outcome_t *outcome, const double *record, const void *log) {
    if (r->shared.state != MK_RUN_DONE || outcome->state == MK_RUN_NONE) return;
    r->result->steps_done += outcome->steps_done;
    if (outcome->log_length > 0) mk_log_append(&r->log, log, outcome->log_length, outcome->log_items);
    r->shared.state = outcome->state;
    *r->error = outcome->error;
    if (outcome->state != MK_RUN_DONE) return;
    if (r->log.failed) (void)mk_fail(r->error, "writing the log: %s", strerror(r->log.failed));
    if (r->log.failed || (r->c->keep_path && !mk_kept_add(&r->kept, outcome->run, record, r->error))) {
        r->shared.state = MK_RUN_FAILED;
        return;
    }
    mk_statistics_add(&r->result->statistics, record);
    r->shared.next_run++;
}

static void take_outcomes(void *context, const void *bytes, size_t length) {
    mk_running_t *r = context;
    const unsigned char *next = bytes, *const end = next + length;
    const size_t record = r->record[0].count * sizeof(double);
    while (next < end) {
        outcome_t outcome;
        memcpy(&outcome, next, sizeof outcome);
        memcpy(r->record[0].value, next + sizeof outcome, record);
        commit(r, &outcome, r->record[0].value, next + sizeof outcome + record);
        next += sizeof outcome + record + outcome.log_length;
    }
}

/* The outcomes of a round to rank 0, and what it makes of them to all. */
static void finish_round(mk_running_t *r) {
    const int outcomes = r->workers * r->chunk;
    mk_cbor_t bytes = {NULL, 0, 0};
    for (int i = 0; i < outcomes; i++) {
        const outcome_t *outcome = &r->outcome[i];
        unsigned char *log = r->part ? r->part[i].out.buffer : NULL;
        if (r->team->rank == 0) {
            commit(r, outcome, r->record[i].value, log);
        } else if (r->sharing != r->team) { /* a shared network has one record, that of rank 0 */
            mk_cbor_append(&bytes, outcome, sizeof *outcome);
            mk_cbor_append(&bytes, r->record[i].value, r->record[i].count * sizeof(double));
            if (outcome->log_length > 0) mk_cbor_append(&bytes, log, outcome->log_length);
        }
        free(log);
        if (r->part) memset(&r->part[i], 0, sizeof r->part[i]);
    }
    r->team->collect(r->team, bytes.buffer, bytes.used, take_outcomes, r);
    free(bytes.buffer);
    if (mk_stopped() && r->shared.state == MK_RUN_DONE && r->shared.next_run < r->c->runs) r->shared.state = MK_RUN_STOPPED;
    r->team->spread(r->team, &r->shared, sizeof r->shared);
}

static void run_all(mk_running_t *r) {
    while (r->shared.next_run < r->c->runs && r->shared.state == MK_RUN_DONE) {
        mk_parallel(r->workers, (long)r->workers * r->chunk, run_one, r);
        finish_round(r);
    }
    if (r->c->progress && r->shown >= 0) (void)fputs("\r\033[K", stderr);
}

/* What an earlier call has kept is taken as if it were run now. */
static int take_kept(mk_running_t *r, mk_error_t *error) {
    int good = 1;
    if (r->c->keep_path && r->team->rank == 0) {
        good = mk_kept_open(&r->kept, r->c->keep_path, r->c->identity, r->c->filter->name, r->record[0].count, error);
        for (int i = 0; good && i < r->kept.runs && i < r->c->runs; i++) mk_statistics_add(&r->result->statistics, r->kept.records + (size_t)i * r->kept.count);
        r->result->runs_kept = r->shared.next_run = r->result->statistics.runs;
    }
    if (!r->team->agree(r->team, good, error)) return 0;
    r->team->spread(r->team, &r->shared, sizeof r->shared);
    return 1;
}

static int open_log(mk_running_t *r, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    const mk_scenario_t *s = c->scenario;
    int good = 1;
    if (c->log_path && r->team->rank == 0) {
        const mk_run_facts_t facts = {c->filter->name, c->network->name, r->source->truth == MK_TRUTH_RECORDED ? "recorded" : "drawn",
                                      mk_truth_name(r->source->truth), c->seed, c->runs, c->steps, c->filter->central ? 1 : s->nodes, c->loss,
                                      c->filter->central ? r->topology.first : s->first, c->filter->central ? r->topology.slot : s->slot, NULL, &c->monitor};
        good = mk_log_open(&r->log, c->log_path, error);
        if (good) mk_log_header(&r->log, s, &facts);
    }
    return r->team->agree(r->team, good, error);
}

static int open_records(mk_running_t *r, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    if (!c->record_path) return 1;
    r->records = mk_node_records_open(c, &r->topology, r->tolerance, c->threads / r->workers, error);
    for (int i = 0; i < r->workers; i++) r->runner[i].records = r->records;
    return r->records != NULL;
}

/* The work and its files, once everything that can be refused is known to be good. */
static int run_logged(mk_running_t *r, mk_error_t *error) {
    if (!open_records(r, error) || !take_kept(r, error) || !open_log(r, error)) return MK_EXIT_INPUT;
    const double from = mk_seconds();
    run_all(r);
    r->result->seconds = mk_seconds() - from;
    r->result->interrupted = r->shared.state == MK_RUN_STOPPED;
    int good = r->shared.state != MK_RUN_FAILED;
    if (r->c->log_path && r->team->rank == 0) {
        mk_error_t log_error;
        const int written = mk_log_close(&r->log, !good ? "failed" : r->result->interrupted ? "interrupted" : "complete", &log_error);
        if (good && !written) *error = log_error;
        good = good && written;
    }
    if (r->records) {
        mk_error_t records_error;
        const int written = mk_node_records_close(r->records, &records_error);
        if (good && !written) *error = records_error;
        good = good && written;
    }
    return r->team->agree(r->team, good, error) ? 0 : MK_EXIT_FAILED;
}

/* Bytes of logs that may wait in memory for those of the runs before them. */
#define LOG_ROOM 268435456.0

/* About the bytes of a run's log. */
static double log_bytes(const mk_running_t *r, int estimators) {
    const mk_scenario_t *s = r->c->scenario;
    const int monitor = r->c->monitor.scheme != MK_MONITOR_NONE;
    const double numbers = (1 + (s->faults > 0)) * r->source->row_first[s->nodes] + (double)estimators * (s->n + MK_PACKED(s->position_count) + 7 + 6 * monitor);
    return r->c->steps * (8.0 * numbers + (2.0 + 17.0 * monitor) * s->first[s->nodes]);
}

static void open_record(const mk_campaign_t *c, mk_record_t *record) {
    const size_t alerts = c->monitor.scheme == MK_MONITOR_NONE ? 0 : mk_alerts_numbers(c->scenario);
    mk_record_open(record, c->scenario->n, c->steps, c->filter->central ? 1 : c->scenario->nodes, c->scenario->faults ? MK_PHASES : 0, alerts);
}

static void open_runners(mk_running_t *r) {
    const mk_campaign_t *c = r->c;
    const int alone = r->sharing->ranks == 1, share = (c->runs + r->team->ranks - 1) / r->team->ranks;
    const int E = c->filter->central ? 1 : c->scenario->nodes;
    r->workers = !alone ? 1 : c->threads < share ? c->threads : share;
    /* With long logs the threads share the nodes of one run instead. */
    if (c->log_path) r->workers = (int)fmin(r->workers, 1.0 + floor(LOG_ROOM / log_bytes(r, E)));
    /* Several runs at a time keep threads busy; with a log they would wait in memory. */
    r->chunk = !alone || c->log_path ? 1 : share / (4 * r->workers) + 1;
    if (r->chunk > 16) r->chunk = 16;
    const int outcomes = r->workers * r->chunk;
    r->runner = mk_allocate((size_t)r->workers, sizeof *r->runner);
    r->outcome = mk_allocate((size_t)outcomes, sizeof *r->outcome);
    r->record = mk_allocate((size_t)outcomes, sizeof *r->record);
    for (int i = 0; i < outcomes; i++) open_record(c, &r->record[i]);
    for (int i = 0; i < r->workers; i++)
        mk_runner_open(&r->runner[i], c, r->source, r->sharing, &r->topology, r->tolerance, r->schedule, c->threads / r->workers);
    if (c->log_path && alone && r->workers * r->team->ranks > 1) r->part = mk_allocate((size_t)outcomes, sizeof *r->part);
}

static void close_runners(mk_running_t *r) {
    for (int i = 0; i < r->workers; i++) mk_runner_close(&r->runner[i]);
    for (int i = 0; i < r->workers * r->chunk; i++) mk_record_close(&r->record[i]);
    free(r->runner);
    free(r->outcome);
    free(r->record);
    free(r->part);
}

static int find_tolerances(mk_running_t *r, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    r->tolerance = mk_allocate((size_t)r->topology.estimators, sizeof *r->tolerance);
    const int good = mk_filter_tolerances(c->filter, c->scenario, c->tolerance, c->steps, &r->topology, c->threads, r->tolerance, &r->schedule, error);
    if (r->team->agree(r->team, good, error)) return 1;
    if (r->sharing->ranks > 1 && r->team->rank == 0) {
        /* Several parts may have failed: which node would one process name? */
        const mk_topology_t whole = mk_distributed_topology(c->scenario);
        double *tolerance = mk_allocate((size_t)whole.estimators, sizeof *tolerance), *schedule;
        (void)mk_filter_tolerances(c->filter, c->scenario, c->tolerance, c->steps, &whole, c->threads, tolerance, &schedule, error);
        free(tolerance);
        free(schedule);
    }
    r->team->spread(r->team, error, sizeof *error);
    return 0;
}

static int check_monitors(const mk_running_t *r, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    if (c->monitor.scheme == MK_MONITOR_NONE) return 1;
    if (c->scenario->faults > MK_MOST_FOLLOWED)
        return mk_fail(error, "--monitor: %d faults in the scenario; at most %d are followed", c->scenario->faults, MK_MOST_FOLLOWED);
    for (int e = 0; e < r->topology.estimators; e++) {
        const int rows = mk_monitor_rows(&r->topology, c->scenario, e), sensors = r->topology.first[e + 1] - r->topology.first[e];
        if (rows <= MK_MONITOR_ROWS) continue;
        if (c->filter->central)
            return mk_fail(error, "--monitor: %s hears %d sensors of up to %d rows; a monitor takes %d rows: choose a distributed filter with --filter",
                           c->filter->name, sensors, rows / sensors, MK_MONITOR_ROWS);
        return mk_fail(error, "--monitor: node %d hears %d sensors of up to %d rows; a monitor takes %d rows: fewer links", mk_topology_id(&r->topology, e),
                       sensors, rows / sensors, MK_MONITOR_ROWS);
    }
    return 1;
}

int mk_campaign_run(const mk_campaign_t *c, const mk_source_t *source, mk_team_t *team, mk_result_t *result, mk_error_t *error) {
    const mk_scenario_t *s = c->scenario;
    mk_running_t r;
    memset(&r, 0, sizeof r);
    memset(result, 0, sizeof *result);
    r.c = c;
    r.source = source;
    r.result = result;
    r.team = team;
    r.sharing = c->split_nodes && !c->filter->central ? team : &mk_team_alone;
    r.error = error;
    r.shown = -1;
    r.shared.state = MK_RUN_DONE;
    int good = 1;
    if (c->filter->central) r.topology = mk_central_topology(s);
    else good = r.sharing->divide(r.sharing, s, c->network->real_size, &r.topology, error);
    if (!good) return MK_EXIT_INPUT;
    result->estimators = c->filter->central ? 1 : s->nodes;
    mk_record_t like;
    open_record(c, &like);
    mk_statistics_open(&result->statistics, &like);
    mk_record_close(&like);
    int status = MK_EXIT_INPUT;
    good = r.team->agree(r.team, check_monitors(&r, error), error);
    if (good && find_tolerances(&r, error)) {
        open_runners(&r);
        status = run_logged(&r, error);
        close_runners(&r);
        mk_statistics_finish(&result->statistics);
        if (c->keep_path) mk_kept_close(&r.kept);
    }
    free(r.tolerance);
    free(r.schedule);
    if (c->filter->central) mk_central_free(&r.topology);
    else r.sharing->release(r.sharing, &r.topology);
    if (status) mk_result_free(result);
    return status;
}

void mk_result_free(mk_result_t *result) {
    mk_statistics_close(&result->statistics);
    memset(result, 0, sizeof *result);
}
