/* SPDX-License-Identifier: MIT */
#include "simulation/source.h"

#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>
#include <string.h>

#include "design/design.h"
#include "parallel.h"
#include "scenario_faults.h"
#include "simulation/gaussian.h"

/* Readings that a thread draws at once. */
enum { CHUNK = 1024 };

/* target += M v, M rows x columns. */
static void add_product(int rows, int columns, const double *M, const double *v, double *target) {
    for (int i = 0; i < rows; i++) {
        double sum = target[i];
        for (int j = 0; j < columns; j++) sum += M[i * columns + j] * v[j];
        target[i] = sum;
    }
}

const char *mk_truth_name(mk_truth_t truth) {
    static const char *const name[] = {"nominal", "least-favourable", "recorded"};
    return name[truth];
}

void mk_source_open(mk_source_t *source, const mk_scenario_t *s, mk_truth_t truth) {
    memset(source, 0, sizeof *source);
    source->scenario = s;
    source->truth = truth;
    source->row_first = mk_allocate((size_t)s->nodes + 1, sizeof *source->row_first);
    for (int k = 0; k < s->nodes; k++) source->row_first[k + 1] = source->row_first[k] + s->sensor[k].rows;
}

void mk_source_draw(mk_source_t *source, const mk_scenario_t *s, uint64_t seed) {
    mk_source_open(source, s, MK_TRUTH_NOMINAL);
    source->seed = seed;
    source->has_truth = 1;
    source->root_P0 = mk_allocate((size_t)MK_PACKED(s->n), 2 * sizeof *source->root_P0);
    source->root_Q = source->root_P0 + MK_PACKED(s->n);
    mk_gaussian_root(s->n, s->P0, source->root_P0);
    mk_gaussian_root(s->n, s->Q, source->root_Q);
    source->root_first = mk_allocate((size_t)s->nodes + 1, sizeof *source->root_first);
    for (int k = 0; k < s->nodes; k++) source->root_first[k + 1] = source->root_first[k] + (size_t)MK_PACKED(s->sensor[k].rows);
    source->root_R = mk_allocate(source->root_first[s->nodes], sizeof *source->root_R);
    for (int k = 0; k < s->nodes; k++) mk_gaussian_root(s->sensor[k].rows, s->sensor[k].R, source->root_R + source->root_first[k]);
}

int mk_source_draw_worst(mk_source_t *source, const mk_scenario_t *s, uint64_t seed, double tolerance, int horizon, mk_error_t *error) {
    const int n = s->n;
    mk_source_draw(source, s, seed);
    source->truth = MK_TRUTH_LEAST_FAVOURABLE;
    if (!mk_least_favourable_make(&source->worst, s, tolerance, horizon, error)) {
        mk_source_free(source);
        return 0;
    }
    source->F = mk_allocate((size_t)source->row_first[s->nodes] * (size_t)n, sizeof *source->F);
    source->S = mk_allocate((size_t)(n * n + MK_PACKED(n)), sizeof *source->S);
    double *own = source->S + n * n;
    for (int k = 0; k < s->nodes; k++) {
        mk_sensor_matrices(n, &s->sensor[k], source->F + (size_t)source->row_first[k] * (size_t)n, own, NULL);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) source->S[i * n + j] += own[i > j ? MK_AT(i, j) : MK_AT(j, i)];
    }
    return 1;
}

void mk_source_free(mk_source_t *source) {
    free(source->row_first);
    free(source->root_P0);
    free(source->root_first);
    free(source->root_R);
    if (source->truth == MK_TRUTH_LEAST_FAVOURABLE) mk_least_favourable_free(&source->worst);
    free(source->F);
    free(source->S);
    free(source->all_x);
    free(source->all_y);
    memset(source, 0, sizeof *source);
}

void mk_stream_open(mk_stream_t *stream, const mk_source_t *source, const mk_topology_t *part, mk_team_t *team, int threads) {
    const mk_scenario_t *s = source->scenario;
    const size_t n = (size_t)s->n;
    memset(stream, 0, sizeof *stream);
    stream->source = source;
    stream->part = part;
    stream->team = team;
    stream->threads = threads;
    stream->x = mk_allocate(6 * n, sizeof *stream->x);
    stream->e = stream->x + n;
    stream->w = stream->e + n;
    stream->g = stream->w + n;
    stream->bias = stream->g + n;
    stream->next = stream->bias + n;
    stream->y = mk_allocate((size_t)source->row_first[s->nodes], sizeof *stream->y);
    if (s->faults) stream->fault = mk_allocate((size_t)source->row_first[s->nodes], sizeof *stream->fault);
    stream->sum = mk_allocate((size_t)threads * n, sizeof *stream->sum);
}

void mk_stream_close(mk_stream_t *stream) {
    free(stream->x);
    free(stream->y);
    free(stream->fault);
    free(stream->sum);
}

/* x(0) of a run, and the adversary at rest. */
static void draw_start(mk_stream_t *stream, int run) {
    const mk_source_t *source = stream->source;
    const mk_scenario_t *s = source->scenario;
    mk_random_t random;
    memcpy(stream->x, s->x0, (size_t)s->n * sizeof *stream->x);
    mk_random_start(&random, source->seed, (uint32_t)run, 0, 0, MK_DRAW_INITIAL);
    mk_gaussian_add(&random, s->n, source->root_P0, stream->x);
    for (int i = 0; i < s->n; i++) stream->e[i] = stream->x[i] - s->x0[i];
    memset(stream->w, 0, 3 * (size_t)s->n * sizeof *stream->w); /* w, g, bias */
    memset(stream->sum, 0, (size_t)s->n * sizeof *stream->sum);
}

/* x(t) from x(t - 1) and w(t - 1), of which the adversary's part stands in w. */
static void draw_state(mk_stream_t *stream, int run, int t) {
    const mk_source_t *source = stream->source;
    const mk_scenario_t *s = source->scenario;
    const int n = s->n;
    mk_random_t random;
    mk_random_start(&random, source->seed, (uint32_t)run, 0, (uint32_t)t - 1, MK_DRAW_PROCESS);
    mk_gaussian_add(&random, n, source->root_Q, stream->w);
    for (int i = 0; i < n; i++) {
        stream->next[i] = s->input[i] + stream->w[i];
        stream->e[i] += stream->w[i];
    }
    add_product(n, n, s->A, stream->x, stream->next);
    memcpy(stream->x, stream->next, (size_t)n * sizeof *stream->x);
    memset(stream->w, 0, (size_t)n * sizeof *stream->w);
}

typedef struct {
    mk_stream_t *stream;
    int run, t, count;
} readings_t;

/* y_k(t) = C_k (x - bias) + v0_k, x - bias in `next`. With an adversary F_k v0_k goes into the sums. */
static void draw_some_readings(void *context, int worker, long index) {
    const readings_t *readings = context;
    mk_stream_t *stream = readings->stream;
    const mk_source_t *source = stream->source;
    const mk_scenario_t *s = source->scenario;
    const int n = s->n, begin = (int)index * CHUNK, end = begin + CHUNK < readings->count ? begin + CHUNK : readings->count;
    mk_exact_t *sum = stream->sum + worker * n;
    for (int i = begin; i < end; i++) {
        const int k = stream->part ? mk_topology_id(stream->part, i) : i;
        const mk_sensor_t *sensor = &s->sensor[k];
        const double *F = source->F ? source->F + (size_t)source->row_first[k] * (size_t)n : NULL;
        double *y = stream->y + source->row_first[k];
        mk_random_t random;
        memset(y, 0, (size_t)sensor->rows * sizeof *y);
        mk_random_start(&random, source->seed, (uint32_t)readings->run, (uint32_t)k, (uint32_t)readings->t, MK_DRAW_MEASUREMENT);
        mk_gaussian_add(&random, sensor->rows, source->root_R + source->root_first[k], y);
        for (int r = 0; F && r < sensor->rows; r++)
            for (int j = 0; j < n; j++) mk_exact_add(&sum[j], F[r * n + j] * y[r]);
        add_product(sensor->rows, n, sensor->C, stream->next, y);
    }
}

static void draw_readings(mk_stream_t *stream, int run, int t) {
    const mk_scenario_t *s = stream->source->scenario;
    const int n = s->n, count = stream->part ? stream->part->estimators : s->nodes;
    readings_t readings = {stream, run, t, count};
    for (int i = 0; i < n; i++) stream->next[i] = stream->x[i] - stream->bias[i];
    mk_parallel(stream->threads, (count + CHUNK - 1) / CHUNK, draw_some_readings, &readings);
    for (int i = n; i < stream->threads * n && stream->source->F; i++) mk_exact_move(&stream->sum[i % n], &stream->sum[i]);
}

/* g ~ N(N Ag e, N) and what it displaces. */
static void draw_adversary(mk_stream_t *stream, int run, int t) {
    const mk_least_favourable_t *worst = &stream->source->worst;
    const int n = worst->n;
    const size_t square = (size_t)t * (size_t)(n * n);
    mk_random_t random;
    memset(stream->g, 0, 3 * (size_t)n * sizeof *stream->g); /* g, bias, next */
    add_product(n, n, worst->Ag + square, stream->e, stream->next);
    add_product(n, n, worst->N + square, stream->next, stream->g);
    mk_random_start(&random, stream->source->seed, (uint32_t)run, 0, (uint32_t)t, MK_DRAW_ADVERSARY);
    for (int i = 0; i < n; i++) stream->next[i] = mk_random_normal(&random);
    add_product(n, n, worst->root_N + square, stream->next, stream->g);
    add_product(n, n, worst->MA + square, stream->g, stream->bias);
}

/* e(t + 1) = Ag e + w - A M sum F_k v_k, sum F_k v_k = sum F_k v0_k - S bias, but for w0, which draw_state adds. */
static void move_error(mk_stream_t *stream, int t) {
    const mk_source_t *source = stream->source;
    const mk_scenario_t *s = source->scenario;
    const int n = s->n;
    const double *Ag = source->worst.Ag + (size_t)t * (size_t)(n * n), *MA = source->worst.MA + (size_t)t * (size_t)(n * n);
    stream->team->sum(stream->team, stream->sum, (size_t)n);
    memset(stream->next, 0, (size_t)n * sizeof *stream->next);
    add_product(n, n, Ag, stream->e, stream->next);
    for (int i = 0; i < n; i++) {
        double heard = mk_exact_value(&stream->sum[i]);
        for (int j = 0; j < n; j++) heard -= source->S[i * n + j] * stream->bias[j];
        for (int j = 0; j < n; j++) stream->next[j] -= MA[i * n + j] * heard; /* A M = (M A')' */
        for (int j = 0; j < n; j++) stream->w[i] += s->Q[i > j ? MK_AT(i, j) : MK_AT(j, i)] * stream->g[j];
    }
    memcpy(stream->e, stream->next, (size_t)n * sizeof *stream->e);
    memset(stream->sum, 0, (size_t)n * sizeof *stream->sum);
}

/* Rows of other parts, of which nothing is asked, get it, too. */
static void add_faults(mk_stream_t *stream, int t) {
    const mk_source_t *source = stream->source;
    const mk_scenario_t *s = source->scenario;
    if (!stream->fault) return;
    mk_faults_at(s, source->row_first, t * s->dt_s, stream->fault);
    for (int i = 0; i < source->row_first[s->nodes]; i++) stream->y[i] += stream->fault[i];
}

void mk_stream_step(mk_stream_t *stream, int run, int t) {
    const mk_source_t *source = stream->source;
    const mk_scenario_t *s = source->scenario;
    const size_t rows = (size_t)source->row_first[s->nodes], n = (size_t)s->n;
    if (source->truth == MK_TRUTH_RECORDED) {
        memcpy(stream->x, source->all_x + (size_t)t * n, n * sizeof *stream->x);
        memcpy(stream->y, source->all_y + (size_t)t * rows, rows * sizeof *stream->y);
    } else {
        if (t == 0) draw_start(stream, run);
        else draw_state(stream, run, t);
        if (source->truth == MK_TRUTH_LEAST_FAVOURABLE) draw_adversary(stream, run, t);
        draw_readings(stream, run, t);
        if (source->truth == MK_TRUTH_LEAST_FAVOURABLE) move_error(stream, t);
    }
    add_faults(stream, t);
}
