/* SPDX-License-Identifier: MIT */
#include "run_log.h"

#include <cbor.h>
#include <errno.h>
#include <meshkal/base.h>
#include <stdlib.h>
#include <string.h>

/* RFC 8746 tags: little-endian typed arrays. */
enum { TAG_UINT8 = 64, TAG_UINT32 = 70, TAG_FLOAT32 = 85, TAG_FLOAT64 = 86 };

static unsigned char *reserve(mk_run_log_t *log, size_t more) {
    if (log->used + more > log->room) {
        while (log->used + more > log->room) log->room = log->room ? 2 * log->room : 4096;
        unsigned char *larger = realloc(log->buffer, log->room);
        if (!larger) {
            (void)fputs("meshkal: out of memory for the log\n", stderr);
            exit(1);
        }
        log->buffer = larger;
    }
    return log->buffer + log->used;
}

#define HEAD 16 /* more than any CBOR item head */
static void put_map(mk_run_log_t *log, size_t count) { log->used += cbor_encode_map_start(count, reserve(log, HEAD), HEAD); }
static void put_array(mk_run_log_t *log, size_t count) { log->used += cbor_encode_array_start(count, reserve(log, HEAD), HEAD); }
static void put_uint(mk_run_log_t *log, uint64_t value) { log->used += cbor_encode_uint(value, reserve(log, HEAD), HEAD); }
static void put_double(mk_run_log_t *log, double value) { log->used += cbor_encode_double(value, reserve(log, HEAD), HEAD); }

static void put_bytes(mk_run_log_t *log, const void *bytes, size_t length) {
    memcpy(reserve(log, length), bytes, length);
    log->used += length;
}

static void put_text(mk_run_log_t *log, const char *text, size_t length) {
    log->used += cbor_encode_string_start(length, reserve(log, HEAD), HEAD);
    put_bytes(log, text, length);
}

static void put_key(mk_run_log_t *log, const char *key) { put_text(log, key, strlen(key)); }

static void put_pair(mk_run_log_t *log, const char *key, const char *text) {
    put_key(log, key);
    put_key(log, text);
}

static void put_count(mk_run_log_t *log, const char *key, uint64_t value) {
    put_key(log, key);
    put_uint(log, value);
}

static void put_typed(mk_run_log_t *log, const char *key, uint64_t tag, const void *values, size_t size, size_t count) {
    const uint16_t probe = 1;
    unsigned char low;
    memcpy(&low, &probe, 1);
    put_key(log, key);
    log->used += cbor_encode_tag(tag, reserve(log, HEAD), HEAD);
    log->used += cbor_encode_bytestring_start(size * count, reserve(log, HEAD), HEAD);
    const size_t start = log->used;
    put_bytes(log, values, size * count);
    if (low == 1) return;
    /* Big-endian host: the tags promise little-endian elements. */
    for (size_t i = 0; i < count; i++)
        for (size_t a = 0, b = size - 1; a < b; a++, b--) {
            unsigned char *element = log->buffer + start + i * size, swap = element[a];
            element[a] = element[b];
            element[b] = swap;
        }
}

/* Items go out whole, so that what a reader finds is cut between items unless the system itself stops in a write. */
static void send_item(mk_run_log_t *log) {
    if (!log->failed && fwrite(log->buffer, 1, log->used, log->stream) != log->used) log->failed = errno ? errno : EIO;
    log->used = 0;
}

int mk_log_open(mk_run_log_t *log, const char *path, mk_error_t *error) {
    memset(log, 0, sizeof *log);
    log->is_standard_output = strcmp(path, "-") == 0;
    log->stream = log->is_standard_output ? stdout : fopen(path, "wb");
    return log->stream ? 1 : mk_fail(error, "%s: %s", path, strerror(errno));
}

void mk_log_header(mk_run_log_t *log, const mk_scenario_t *s, const mk_run_facts_t *facts) {
    put_map(log, 19);
    put_pair(log, "format", "meshkal-log");
    put_count(log, "format_version", 1);
    put_pair(log, "program", "meshkal " MK_VERSION);
    put_key(log, "scenario");
    put_text(log, s->text, s->text_length);
    put_pair(log, "scenario_sha256", s->sha256);
    put_pair(log, "filter", facts->filter);
    put_pair(log, "real", facts->real);
    put_pair(log, "source", facts->source);
    put_count(log, "seed", facts->seed);
    put_count(log, "runs", (uint64_t)facts->runs);
    put_count(log, "steps", (uint64_t)facts->steps);
    put_key(log, "loss");
    put_double(log, facts->loss);
    put_key(log, "dt_s");
    put_double(log, s->dt_s);
    put_count(log, "states", (uint64_t)s->n);
    put_count(log, "positions", (uint64_t)s->position_count);
    put_count(log, "nodes", (uint64_t)s->nodes);
    put_count(log, "estimators", (uint64_t)facts->estimators);
    put_key(log, "rows");
    put_array(log, (size_t)s->nodes);
    for (int k = 0; k < s->nodes; k++) put_uint(log, (uint64_t)s->sensor[k].rows);
    put_key(log, "slots");
    put_array(log, (size_t)facts->estimators);
    for (int e = 0; e < facts->estimators; e++) {
        put_array(log, (size_t)(facts->first[e + 1] - facts->first[e]));
        for (int i = facts->first[e]; i < facts->first[e + 1]; i++) put_uint(log, (uint64_t)facts->slot[i]);
    }
    send_item(log);
}

void mk_log_begin(mk_run_log_t *log, int run, int step, int arrays) {
    put_map(log, (size_t)arrays + 2);
    put_count(log, "run", (uint64_t)run);
    put_count(log, "step", (uint64_t)step);
}

void mk_log_reals(mk_run_log_t *log, const char *key, const void *values, size_t real_size, size_t count) {
    put_typed(log, key, real_size == 4 ? TAG_FLOAT32 : TAG_FLOAT64, values, real_size, count);
}

void mk_log_uint32(mk_run_log_t *log, const char *key, const uint32_t *values, size_t count) {
    put_typed(log, key, TAG_UINT32, values, 4, count);
}

void mk_log_uint8(mk_run_log_t *log, const char *key, const uint8_t *values, size_t count) {
    put_typed(log, key, TAG_UINT8, values, 1, count);
}

void mk_log_end(mk_run_log_t *log) {
    log->items++;
    send_item(log);
    /* A pipe's reader shows the run while it goes on. */
    if (log->is_standard_output && fflush(log->stream) != 0 && !log->failed) log->failed = errno;
}

int mk_log_close(mk_run_log_t *log, const char *how, mk_error_t *error) {
    put_map(log, 2);
    put_pair(log, "end", how);
    put_count(log, "items", log->items);
    send_item(log);
    if (fflush(log->stream) != 0 && !log->failed) log->failed = errno;
    if (!log->is_standard_output && fclose(log->stream) != 0 && !log->failed) log->failed = errno;
    free(log->buffer);
    return log->failed ? mk_fail(error, "writing the log: %s", strerror(log->failed)) : 1;
}
