/* SPDX-License-Identifier: MIT */
#include "simulation/node_records.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "design/node_config.h"
#include "design/steady.h"
#include "host_node.h"
#include "parallel.h"
#include "scenario_read.h"

/* Bytes that wait in memory: of all nodes together, and of one. */
#define ALL_ROOM ((size_t)64 << 20)
#define LEAST_ROOM ((size_t)1 << 12)
#define MOST_ROOM ((size_t)1 << 16)

/* Nodes that a thread takes at once; fewer than some of those are not worth threads. */
enum { CHUNK = 32, WORTH_THREADS = 2 * CHUNK };

/* What is the same in both precisions. */
struct mk_node_records {
    const mk_campaign_t *c;
    const mk_topology_t *topology;
    const double *tolerance;
    int threads, nodes, made; /* made: nodes whose files exist */
    const char *directory;
    int *all;      /* 0 .. nodes - 1 */
    void *psi;     /* of all simulated nodes */
    double *x;
    char **failed; /* what went wrong with a node, or null */
    void *node;
    /* Of the call. */
    const double *schedule, *y;
    const int *row_first;
    const uint8_t *arrived, *excluded;
    int t, good;
    void (*phase)(mk_node_records_t *r, int k);
};

static void fail_node(mk_node_records_t *r, int k, const char *format, ...) MK_PRINTF(3, 4);
static void fail_node(mk_node_records_t *r, int k, const char *format, ...) {
    mk_error_t error;
    va_list arguments;
    if (r->failed[k]) return;
    va_start(arguments, format);
    (void)mk_vfail(&error, format, arguments);
    va_end(arguments);
    r->failed[k] = mk_allocate(strlen(error.text) + 1, 1);
    memcpy(r->failed[k], error.text, strlen(error.text) + 1);
}

/* 0: the path is too long. */
static int path_of(const mk_node_records_t *r, int k, char *path, size_t room) {
    const int length = snprintf(path, room, "%s/node_%0*d.record", r->directory, mk_node_digits(r->nodes), k);
    return length >= 0 && (size_t)length < room;
}

/* To the end of a file, which is open only meanwhile: a network has more nodes than a process may have files. */
static void write_out(mk_node_records_t *r, int k, mk_recorder_t *recorder) {
    char path[4096];
    (void)path_of(r, k, path, sizeof path);
    FILE *file = recorder->used ? fopen(path, "ab") : NULL;
    int good = !recorder->used || file;
    if (file) good = fwrite(recorder->bytes, 1, recorder->used, file) == recorder->used;
    if (file) good = fclose(file) == 0 && good;
    if (!good) fail_node(r, k, "%s: %s", path, strerror(errno));
    recorder->used = 0;
}

static void run_chunk(void *context, int worker, long index) {
    mk_node_records_t *r = context;
    (void)worker;
    for (int k = (int)index * CHUNK; k < r->nodes && k < ((int)index + 1) * CHUNK; k++) r->phase(r, k);
}

/* Does something for all nodes. 1, or 0 and the error of the lowest that failed. */
static int run_phase(mk_node_records_t *r, void (*phase)(mk_node_records_t *r, int k), int *bad, mk_error_t *error) {
    r->phase = phase;
    mk_parallel(r->nodes < WORTH_THREADS ? 1 : r->threads, (r->nodes + CHUNK - 1) / CHUNK, run_chunk, r);
    for (int k = 0; k < r->nodes; k++) {
        if (!r->failed[k]) continue;
        *bad = k;
        return mk_fail(error, "%s", r->failed[k]);
    }
    return 1;
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "simulation/node_records.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "simulation/node_records.tmpl.h"
#undef MK_BITS

static int is_f32(const mk_node_records_t *r) { return r->c->network->real_size == sizeof(float); }

static int make_file(mk_node_records_t *r, int k, mk_error_t *error) {
    char path[4096];
    if (!path_of(r, k, path, sizeof path)) return mk_fail(error, "--record %s: the path is too long", r->directory);
    FILE *file = fopen(path, "wb");
    if (!file || fclose(file) != 0) return mk_fail(error, "%s: %s", path, strerror(errno));
    return 1;
}

static void release(mk_node_records_t *r) {
    for (int k = 0; k < r->nodes; k++) {
        if (is_f32(r)) close_f32(r, k);
        else close_f64(r, k);
        free(r->failed[k]);
    }
    free(r->node);
    free(r->failed);
    free(r->all);
    free(r->psi);
    free(r->x);
    free(r);
}

mk_node_records_t *mk_node_records_open(const mk_campaign_t *c, const mk_topology_t *topology, const double *tolerance, int threads, mk_error_t *error) {
    mk_node_records_t *r = mk_allocate(1, sizeof *r);
    const size_t nodes = (size_t)topology->estimators, n = (size_t)c->scenario->n;
    int bad = 0;
    r->c = c;
    r->topology = topology;
    r->tolerance = tolerance;
    r->threads = threads;
    r->nodes = topology->estimators;
    r->directory = c->record_path;
    r->all = mk_allocate(nodes, sizeof *r->all);
    for (int k = 0; k < r->nodes; k++) r->all[k] = k;
    r->psi = mk_allocate(nodes * n, c->network->real_size);
    r->x = mk_allocate(nodes * n, sizeof *r->x);
    r->failed = mk_allocate(nodes, sizeof *r->failed);
    r->node = mk_allocate(nodes, is_f32(r) ? sizeof(recorded_f32_t) : sizeof(recorded_f64_t));
    int good = mkdir(r->directory, 0777) == 0 || errno == EEXIST || mk_fail(error, "--record %s: %s", r->directory, strerror(errno));
    while (good && r->made < r->nodes) {
        good = make_file(r, r->made, error);
        r->made += good;
    }
    good = good && run_phase(r, is_f32(r) ? open_f32 : open_f64, &bad, error);
    if (good) return r;
    for (int k = 0; k < r->made; k++) {
        char path[4096];
        if (path_of(r, k, path, sizeof path)) (void)remove(path);
    }
    release(r);
    return NULL;
}

int mk_node_records_incremental(mk_node_records_t *r, int t, const double *schedule, const double *y, const int *row_first, const uint8_t *arrived,
                                const uint8_t *excluded, void *network, int good, int *bad, mk_error_t *error) {
    r->t = t;
    r->schedule = schedule;
    r->y = y;
    r->row_first = row_first;
    r->arrived = arrived;
    r->excluded = excluded;
    r->good = good;
    r->c->network->intermediate(network, r->all, r->nodes, r->psi);
    return run_phase(r, is_f32(r) ? measure_f32 : measure_f64, bad, error) && run_phase(r, is_f32(r) ? increment_f32 : increment_f64, bad, error);
}

int mk_node_records_diffuse(mk_node_records_t *r, int t, const uint8_t *arrived, void *network, int good, int *bad, mk_error_t *error) {
    r->t = t;
    r->arrived = arrived;
    r->good = good;
    r->c->network->estimate(network, 0, r->nodes, r->x);
    return run_phase(r, is_f32(r) ? diffuse_f32 : diffuse_f64, bad, error);
}

int mk_node_records_close(mk_node_records_t *r, mk_error_t *error) {
    int bad;
    /* Earlier failures have been told. */
    for (int k = 0; k < r->nodes; k++) {
        free(r->failed[k]);
        r->failed[k] = NULL;
    }
    const int good = run_phase(r, is_f32(r) ? flush_f32 : flush_f64, &bad, error);
    release(r);
    return good;
}
