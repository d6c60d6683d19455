/* SPDX-License-Identifier: MIT */
/* Runs of one process on several threads, whose results and logs are taken in the order of runs: what comes out does not depend on how many
   threads there are. */
#ifndef MESHKAL_ORDERED_RUNS_H
#define MESHKAL_ORDERED_RUNS_H

#include "error.h"
#include "run_log.h"

/* NONE: not run. STOPPED: a signal came. */
typedef enum { MK_RUN_NONE, MK_RUN_DONE, MK_RUN_STOPPED, MK_RUN_FAILED } mk_run_state_t;

typedef struct {
    int runs, threads;
    double log_bytes;     /* about those of one run's log, which bound the threads; 0: they do not */
    const char *name;     /* beside the progress bar on standard error; null: no bar */
    const char *log_path; /* null: no log; "-": standard output */
    void *context;
    /* Begins the log. */
    void (*header)(void *context, mk_run_log_t *log);
    /* Run `run` into slot `slot`, on thread `worker` (a place for its scratch memory); log: null where there is none. DONE, STOPPED or
       FAILED with *error. Called from several threads. */
    mk_run_state_t (*run)(void *context, int worker, int slot, int run, mk_run_log_t *log, mk_error_t *error);
    /* What is in the slot counts as run `run`: called for runs 0, 1, 2, ... that are DONE, and for none after one that is not. */
    void (*take)(void *context, int slot, int run);
    int workers, slots; /* set by mk_ordered_runs_plan */
} mk_ordered_runs_t;

/* From runs, threads, log_bytes and log_path: threads that are used, and slots, the runs of a round. */
void mk_ordered_runs_plan(mk_ordered_runs_t *ordered);

/* Runs them. A signal of mk_catch_signals ends it early with *interrupted set. 0, or an exit status of commands.h and *error: MK_EXIT_INPUT
   if the log cannot be opened and nothing was run, MK_EXIT_FAILED if a run or the log failed. */
int mk_ordered_runs(const mk_ordered_runs_t *ordered, int *interrupted, mk_error_t *error);

#endif
