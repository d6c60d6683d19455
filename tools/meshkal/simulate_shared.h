/* SPDX-License-Identifier: MIT */
/* What meshkal simulate does the same way for scenarios of several kinds. */
#ifndef MESHKAL_SIMULATE_SHARED_H
#define MESHKAL_SIMULATE_SHARED_H

#include <jansson.h>
#include <stdint.h>

#include "error.h"
#include "scenario.h"
#include "simulate_options.h"

typedef struct {
    long steps;
    int runs, threads;
    uint64_t seed;
} mk_simulate_numbers_t;

/* --steps, --runs, --seed and --threads of a nonlinear scenario, or what it says itself. 1, or 0 and *error. */
int mk_simulate_numbers(const mk_simulate_options_t *options, const mk_scenario_t *scenario, mk_simulate_numbers_t *numbers, mk_error_t *error);
/* --real: whether it is float32; and whether what is recorded is one run. 1, or 0 and *error. */
int mk_simulate_real(const mk_simulate_options_t *options, int runs, int *single, mk_error_t *error);

/* --monitor, --window and --false-alarm over the scenario's settings; jump is then known. 1, or 0 and *error. */
int mk_simulate_monitor(const mk_simulate_options_t *options, const mk_scenario_t *scenario, mk_monitor_settings_t *settings, mk_error_t *error);

/* A sentence for the summary's list. */
void mk_add_note(json_t *notes, const char *format, ...) MK_PRINTF(2, 3);

/* Work that fills the lists and returns an exit status (with *error), and the summary that is made of them, which it takes over. */
typedef struct {
    void *context;
    int (*work)(void *context, json_t *filters, json_t *notes, mk_error_t *error);
    json_t *(*summary)(void *context, json_t *filters, json_t *notes);
} mk_simulate_work_t;

/* Does it, with the summary in the file `json` (null: none), whose place is tried before the work. An exit status of commands.h. */
int mk_simulate_written(const mk_simulate_work_t *work, const char *json, mk_error_t *error);

#endif
