/* SPDX-License-Identifier: MIT */
#include "run_log.h"

#include <errno.h>
#include <meshkal/base.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_monitor.h"
#include "scenario_navigation.h"
#include "scenario_tracking.h"

/* Items go out whole, so that what a reader finds is cut between items unless the system itself stops in a write. */
static void put(mk_run_log_t *log, const void *bytes, size_t length) {
    if (!log->failed && fwrite(bytes, 1, length, log->stream) != length) log->failed = errno ? errno : EIO;
}

static void send_item(mk_run_log_t *log) {
    if (!log->stream) return;
    put(log, log->out.buffer, log->out.used);
    log->out.used = 0;
}

/* A pipe's reader shows the run while it goes on. */
static void show(mk_run_log_t *log) {
    if (log->is_standard_output && fflush(log->stream) != 0 && !log->failed) log->failed = errno;
}

int mk_log_open(mk_run_log_t *log, const char *path, mk_error_t *error) {
    memset(log, 0, sizeof *log);
    log->is_standard_output = strcmp(path, "-") == 0;
    log->stream = log->is_standard_output ? stdout : fopen(path, "wb");
    return log->stream ? 1 : mk_fail(error, "%s: %s", path, strerror(errno));
}

/* more: pairs that the caller puts behind these. */
static void put_header(mk_run_log_t *log, const mk_scenario_t *s, const mk_run_facts_t *facts, size_t more) {
    const mk_monitor_settings_t *monitor = facts->monitor && facts->monitor->scheme != MK_MONITOR_NONE ? facts->monitor : NULL;
    mk_cbor_map(&log->out, (size_t)20 + (facts->estimator_node != NULL) + (monitor ? 3 : 0) + more);
    mk_cbor_pair(&log->out, "format", "meshkal-log");
    mk_cbor_count(&log->out, "format_version", 1);
    mk_cbor_pair(&log->out, "program", "meshkal " MK_VERSION);
    mk_cbor_key(&log->out, "scenario");
    mk_cbor_text(&log->out, s->text, s->text_length);
    mk_cbor_pair(&log->out, "scenario_sha256", s->sha256);
    mk_cbor_pair(&log->out, "filter", facts->filter);
    mk_cbor_pair(&log->out, "real", facts->real);
    mk_cbor_pair(&log->out, "source", facts->source);
    mk_cbor_pair(&log->out, "truth", facts->truth);
    mk_cbor_count(&log->out, "seed", facts->seed);
    mk_cbor_count(&log->out, "runs", (uint64_t)facts->runs);
    mk_cbor_count(&log->out, "steps", (uint64_t)facts->steps);
    mk_cbor_key(&log->out, "loss");
    mk_cbor_double(&log->out, facts->loss);
    mk_cbor_key(&log->out, "dt_s");
    mk_cbor_double(&log->out, s->dt_s);
    mk_cbor_count(&log->out, "states", (uint64_t)s->n);
    mk_cbor_count(&log->out, "positions", (uint64_t)s->position_count);
    mk_cbor_count(&log->out, "nodes", (uint64_t)s->nodes);
    mk_cbor_count(&log->out, "estimators", (uint64_t)facts->estimators);
    mk_cbor_key(&log->out, "rows");
    mk_cbor_array(&log->out, (size_t)s->nodes);
    for (int k = 0; k < s->nodes; k++) mk_cbor_uint(&log->out, (uint64_t)s->sensor[k].rows);
    mk_cbor_key(&log->out, "slots");
    mk_cbor_array(&log->out, (size_t)facts->estimators);
    for (int e = 0; e < facts->estimators; e++) {
        mk_cbor_array(&log->out, (size_t)(facts->first[e + 1] - facts->first[e]));
        for (int i = facts->first[e]; i < facts->first[e + 1]; i++) mk_cbor_uint(&log->out, (uint64_t)facts->slot[i]);
    }
    if (facts->estimator_node) {
        mk_cbor_key(&log->out, "estimator_nodes");
        mk_cbor_array(&log->out, (size_t)facts->estimators);
        for (int e = 0; e < facts->estimators; e++) mk_cbor_uint(&log->out, (uint64_t)facts->estimator_node[e]);
    }
    if (!monitor) return;
    mk_cbor_pair(&log->out, "monitor", mk_monitor_name(monitor->scheme));
    mk_cbor_count(&log->out, "monitor_window", (uint64_t)monitor->window);
    mk_cbor_key(&log->out, "monitor_false_alarm");
    mk_cbor_double(&log->out, monitor->false_alarm);
}

void mk_log_header(mk_run_log_t *log, const mk_scenario_t *s, const mk_run_facts_t *facts) {
    put_header(log, s, facts, 0);
    send_item(log);
}

void mk_log_header_tracking(mk_run_log_t *log, const mk_scenario_t *s, const mk_run_facts_t *facts, double start_s, int iterations) {
    const mk_tracking_t *const tracking = s->tracking;
    put_header(log, s, facts, 6);
    mk_cbor_pair(&log->out, "kind", "tracking");
    mk_cbor_key(&log->out, "start_s");
    mk_cbor_double(&log->out, start_s);
    mk_cbor_count(&log->out, "iterations", (uint64_t)iterations);
    mk_cbor_pair(&log->out, "protocol", mk_protocol_name(tracking->protocol));
    mk_cbor_count(&log->out, "increments", (uint64_t)tracking->increments);
    mk_cbor_key(&log->out, "gate");
    mk_cbor_double(&log->out, mk_tracking_gates(tracking, facts->filter) ? tracking->gate.significance : 0.0);
    send_item(log);
}

void mk_log_header_navigation(mk_run_log_t *log, const mk_scenario_t *s, const mk_run_facts_t *facts, double start_s) {
    put_header(log, s, facts, 3);
    mk_cbor_pair(&log->out, "kind", "navigation");
    mk_cbor_key(&log->out, "start_s");
    mk_cbor_double(&log->out, start_s);
    mk_cbor_key(&log->out, "satellites");
    mk_cbor_array(&log->out, (size_t)s->nodes);
    for (int k = 0; k < s->nodes; k++) mk_cbor_uint(&log->out, (uint64_t)s->navigation->satellite[k].number);
    send_item(log);
}

void mk_log_begin(mk_run_log_t *log, int run, int64_t step, int arrays) {
    mk_cbor_map(&log->out, (size_t)arrays + 2);
    mk_cbor_count(&log->out, "run", (uint64_t)run);
    mk_cbor_count(&log->out, "step", (uint64_t)step);
}

void mk_log_reals(mk_run_log_t *log, const char *key, const void *values, size_t real_size, size_t count) {
    mk_cbor_typed(&log->out, key, real_size == 4 ? MK_CBOR_FLOAT32 : MK_CBOR_FLOAT64, values, real_size, count);
}

void mk_log_uint32(mk_run_log_t *log, const char *key, const uint32_t *values, size_t count) {
    mk_cbor_typed(&log->out, key, MK_CBOR_UINT32, values, 4, count);
}

void mk_log_uint8(mk_run_log_t *log, const char *key, const uint8_t *values, size_t count) {
    mk_cbor_typed(&log->out, key, MK_CBOR_UINT8, values, 1, count);
}

void mk_log_end(mk_run_log_t *log) {
    log->items++;
    send_item(log);
    show(log);
}

void mk_log_keep(mk_run_log_t *log) { memset(log, 0, sizeof *log); }

void mk_log_append(mk_run_log_t *log, const void *bytes, size_t length, uint64_t items) {
    put(log, bytes, length);
    log->items += items;
    show(log);
}

void mk_log_put_end(mk_cbor_t *out, const char *how, uint64_t items) {
    mk_cbor_map(out, 2);
    mk_cbor_pair(out, "end", how);
    mk_cbor_count(out, "items", items);
}

int mk_log_close(mk_run_log_t *log, const char *how, mk_error_t *error) {
    mk_log_put_end(&log->out, how, log->items);
    send_item(log);
    if (fflush(log->stream) != 0 && !log->failed) log->failed = errno;
    if (!log->is_standard_output && fclose(log->stream) != 0 && !log->failed) log->failed = errno;
    free(log->out.buffer);
    return log->failed ? mk_fail(error, "writing the log: %s", strerror(log->failed)) : 1;
}
