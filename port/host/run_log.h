/* SPDX-License-Identifier: MIT */
/* Writer of the run log, log-format.md: a CBOR sequence to a file or to standard output. */
#ifndef MESHKAL_HOST_RUN_LOG_H
#define MESHKAL_HOST_RUN_LOG_H

#include <stdint.h>
#include <stdio.h>

#include "cbor_out.h"
#include "error.h"
#include "scenario.h"

typedef struct {
    FILE *stream;
    int is_standard_output, failed;
    uint64_t items;
    mk_cbor_t out;
} mk_run_log_t;

typedef struct {
    const char *filter, *real, *source, *truth;
    uint64_t seed;
    int runs, steps, estimators;
    double loss;
    const int *first, *slot;   /* slots of the estimators, as in mk_scenario_t */
    const int *estimator_node; /* node of each, where not every node has one; otherwise null */
    const mk_monitor_settings_t *monitor; /* of all estimators; null or its scheme MK_MONITOR_NONE: there is none */
} mk_run_facts_t;

/* path "-" is standard output. 1, or 0 and *error. */
int mk_log_open(mk_run_log_t *log, const char *path, mk_error_t *error);
void mk_log_header(mk_run_log_t *log, const mk_scenario_t *scenario, const mk_run_facts_t *facts);
/* Of a tracking scenario: also when the run starts, and the iterations of consensus in a step. */
void mk_log_header_tracking(mk_run_log_t *log, const mk_scenario_t *scenario, const mk_run_facts_t *facts, double start_s, int iterations);
/* Of a navigation scenario: also when the run starts, and the numbers of the satellites. */
void mk_log_header_navigation(mk_run_log_t *log, const mk_scenario_t *scenario, const mk_run_facts_t *facts, double start_s);
/* A step item: begin with the number of arrays, then each array, then end. Arrays: float64, float32 (real_size 8 or 4), uint32, uint8. */
void mk_log_begin(mk_run_log_t *log, int run, int64_t step, int arrays);
void mk_log_reals(mk_run_log_t *log, const char *key, const void *values, size_t real_size, size_t count);
void mk_log_uint32(mk_run_log_t *log, const char *key, const uint32_t *values, size_t count);
void mk_log_uint8(mk_run_log_t *log, const char *key, const uint8_t *values, size_t count);
void mk_log_end(mk_run_log_t *log);
/* A log that keeps its step items in out.buffer (free it) instead of writing them, and what puts them into another. */
void mk_log_keep(mk_run_log_t *log);
void mk_log_append(mk_run_log_t *log, const void *bytes, size_t length, uint64_t items);
/* The end item by itself: for streams that are not files. */
void mk_log_put_end(mk_cbor_t *out, const char *how, uint64_t items);
/* The end item, unless nothing was ever written, and the file closed. 1, or 0 and *error if any write failed. */
int mk_log_close(mk_run_log_t *log, const char *how, mk_error_t *error);

#endif
