/* SPDX-License-Identifier: MIT */
#include "simulation/ordered_runs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "parallel.h"
#include "process.h"
#include "signals.h"

/* Bytes of logs that may wait in memory for those of the runs before them, and runs that a thread takes at a time. */
#define LOG_ROOM 268435456.0
enum { CHUNK = 8 };

typedef struct {
    mk_run_state_t state;
    mk_run_log_t log; /* of a run that waits */
    mk_error_t error;
} slot_t;

typedef struct {
    const mk_ordered_runs_t *o;
    int next_run, shown; /* shown: per cent of the bar */
    slot_t *slot;
    mk_run_log_t log;
    mk_error_t *error;
} running_t;

void mk_ordered_runs_plan(mk_ordered_runs_t *o) {
    o->workers = o->threads < o->runs ? o->threads : o->runs;
    /* Several runs at a time keep threads busy; with a log they would wait in memory. */
    int chunk = o->log_path ? 1 : o->runs / (4 * o->workers) + 1;
    if (chunk > CHUNK) chunk = CHUNK;
    if (o->log_path && o->log_bytes > 0.0) o->workers = (int)fmin(o->workers, 1.0 + floor(LOG_ROOM / o->log_bytes));
    o->slots = o->workers * chunk;
}

static void show_progress(running_t *r) {
    const int percent = (int)(100.0 * r->next_run / r->o->runs);
    if (percent == r->shown) return;
    r->shown = percent;
    (void)fprintf(stderr, "\r%-12s [%-40.*s] %3d %%", r->o->name, percent * 40 / 100, "########################################", percent);
}

/* The first run of a round has none before it to wait for: it writes to the file. */
static void run_one(void *context, int worker, long index) {
    running_t *const r = context;
    slot_t *const slot = &r->slot[index];
    const int run = r->next_run + (int)index, direct = index == 0;
    mk_run_log_t *const log = !r->o->log_path ? NULL : direct ? &r->log : &slot->log;
    slot->state = MK_RUN_NONE;
    if (run >= r->o->runs) return;
    if (log && !direct) mk_log_keep(log);
    slot->state = r->o->run(r->o->context, worker, (int)index, run, log, &slot->error);
}

/* In the order of runs; after one that did not end well none counts. */
static mk_run_state_t commit(running_t *r) {
    mk_run_state_t state = MK_RUN_DONE;
    for (int i = 0; i < r->o->slots; i++) {
        slot_t *const slot = &r->slot[i];
        if (state == MK_RUN_DONE && slot->state != MK_RUN_NONE) {
            if (slot->log.out.used > 0) mk_log_append(&r->log, slot->log.out.buffer, slot->log.out.used, slot->log.items);
            state = slot->state;
            if (state == MK_RUN_FAILED) *r->error = slot->error;
            if (state == MK_RUN_DONE && r->log.failed) {
                (void)mk_fail(r->error, "writing the log: %s", strerror(r->log.failed));
                state = MK_RUN_FAILED;
            }
            if (state == MK_RUN_DONE) r->o->take(r->o->context, i, r->next_run++);
        }
        free(slot->log.out.buffer);
        memset(&slot->log, 0, sizeof slot->log);
    }
    return state;
}

static mk_run_state_t run_all(running_t *r) {
    const mk_ordered_runs_t *const o = r->o;
    mk_run_state_t state = MK_RUN_DONE;
    while (r->next_run < o->runs && state == MK_RUN_DONE) {
        if (o->name) show_progress(r);
        mk_parallel(o->workers, o->slots, run_one, r);
        state = commit(r);
        if (mk_stopped() && state == MK_RUN_DONE && r->next_run < o->runs) state = MK_RUN_STOPPED;
    }
    if (r->shown >= 0) (void)fputs("\r\033[K", stderr);
    return state;
}

int mk_ordered_runs(const mk_ordered_runs_t *o, int *interrupted, mk_error_t *error) {
    running_t r;
    memset(&r, 0, sizeof r);
    r.o = o;
    r.shown = -1;
    r.error = error;
    *interrupted = 0;
    if (o->log_path) {
        if (!mk_log_open(&r.log, o->log_path, error)) return MK_EXIT_INPUT;
        o->header(o->context, &r.log);
    }
    r.slot = mk_allocate((size_t)o->slots, sizeof *r.slot);
    const mk_run_state_t state = run_all(&r);
    free(r.slot);
    *interrupted = state == MK_RUN_STOPPED;
    int good = state != MK_RUN_FAILED;
    if (o->log_path) {
        mk_error_t log_error;
        const int written = mk_log_close(&r.log, !good ? "failed" : *interrupted ? "interrupted" : "complete", &log_error);
        if (good && !written) *error = log_error;
        good = good && written;
    }
    return good ? 0 : MK_EXIT_FAILED;
}
