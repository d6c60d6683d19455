/* SPDX-License-Identifier: MIT */
#include "source.h"

#include <math.h>
#include <meshkal/base.h>
#include <stdlib.h>
#include <string.h>

#include "csv.h"

/* Lower triangular L with L L' = S, packed, S positive semidefinite: a pivot lost in rounding gives a zero column. */
static double *make_root(int n, const double *S) {
    double *L = mk_allocate((size_t)MK_PACKED(n), sizeof *L);
    for (int i = 0; i < n; i++) {
        double *row = L + i * (i + 1) / 2;
        for (int j = 0; j <= i; j++) {
            const double *other = L + j * (j + 1) / 2;
            double sum = S[i * (i + 1) / 2 + j];
            for (int k = 0; k < j; k++) sum -= row[k] * other[k];
            if (j < i) row[j] = other[j] > 0.0 ? sum / other[j] : 0.0;
            else row[i] = sum > 1e-14 * S[i * (i + 1) / 2 + i] ? sqrt(sum) : 0.0;
        }
    }
    return L;
}

/* target += L g, g standard normal. */
static void add_normal(mk_random_t *random, int n, const double *L, double *target) {
    double g[64];
    for (int i = 0; i < n; i++) g[i] = mk_random_normal(random);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) target[i] += L[i * (i + 1) / 2 + j] * g[j];
}

static void open_source(mk_source_t *source, const mk_scenario_t *s) {
    memset(source, 0, sizeof *source);
    source->scenario = s;
    source->row_first = mk_allocate((size_t)s->nodes + 1, sizeof *source->row_first);
    for (int k = 0; k < s->nodes; k++) source->row_first[k + 1] = source->row_first[k] + s->sensor[k].rows;
    source->x = mk_allocate((size_t)s->n, sizeof *source->x);
    source->y = mk_allocate((size_t)source->row_first[s->nodes], sizeof *source->y);
}

void mk_source_draw(mk_source_t *source, const mk_scenario_t *s, uint64_t seed) {
    open_source(source, s);
    source->seed = seed;
    source->has_truth = 1;
    source->root_P0 = make_root(s->n, s->P0);
    source->root_Q = make_root(s->n, s->Q);
    source->root_R = mk_allocate((size_t)s->nodes, sizeof *source->root_R);
    for (int k = 0; k < s->nodes; k++) source->root_R[k] = make_root(s->sensor[k].rows, s->sensor[k].R);
    source->next = mk_allocate((size_t)s->n, sizeof *source->next);
}

void mk_source_free(mk_source_t *source) {
    for (int k = 0; source->root_R && k < source->scenario->nodes; k++) free(source->root_R[k]);
    free(source->root_R);
    free(source->root_P0);
    free(source->root_Q);
    free(source->next);
    free(source->row_first);
    free(source->x);
    free(source->y);
    free(source->all_x);
    free(source->all_y);
    memset(source, 0, sizeof *source);
}

static void draw_step(mk_source_t *source, int run, int t) {
    const mk_scenario_t *s = source->scenario;
    const int n = s->n;
    mk_random_t random;
    double *x = source->x, *next = source->next;
    if (t == 0) {
        memcpy(x, s->x0, (size_t)n * sizeof *x);
        mk_random_start(&random, source->seed, (uint32_t)run, 0, 0, MK_DRAW_INITIAL);
        add_normal(&random, n, source->root_P0, x);
    } else {
        for (int i = 0; i < n; i++) {
            next[i] = s->input[i];
            for (int j = 0; j < n; j++) next[i] += s->A[i * n + j] * x[j];
        }
        mk_random_start(&random, source->seed, (uint32_t)run, 0, (uint32_t)t - 1, MK_DRAW_PROCESS);
        add_normal(&random, n, source->root_Q, next);
        memcpy(x, next, (size_t)n * sizeof *x);
    }
    for (int k = 0; k < s->nodes; k++) {
        const mk_sensor_t *sensor = &s->sensor[k];
        double *y = source->y + source->row_first[k];
        for (int r = 0; r < sensor->rows; r++) {
            y[r] = 0.0;
            for (int j = 0; j < n; j++) y[r] += sensor->C[r * n + j] * x[j];
        }
        mk_random_start(&random, source->seed, (uint32_t)run, (uint32_t)k, (uint32_t)t, MK_DRAW_MEASUREMENT);
        add_normal(&random, sensor->rows, source->root_R[k], y);
    }
}

void mk_source_step(mk_source_t *source, int run, int t) {
    const mk_scenario_t *s = source->scenario;
    if (!source->recorded) {
        draw_step(source, run, t);
        return;
    }
    const size_t rows = (size_t)source->row_first[s->nodes], n = (size_t)s->n;
    memcpy(source->x, source->all_x + (size_t)t * n, n * sizeof *source->x);
    memcpy(source->y, source->all_y + (size_t)t * rows, rows * sizeof *source->y);
}

static double *all_missing(size_t count) {
    double *values = mk_allocate(count, sizeof *values);
    for (size_t i = 0; i < count; i++) values[i] = (double)NAN;
    return values;
}

static int store(const mk_csv_t *csv, size_t i, double *place, mk_error_t *error) {
    if (!isnan(*place)) return mk_fail(error, "%s:%ld: a second value for the same place", csv->path, csv->line[i]);
    *place = csv->value[i * (size_t)csv->columns + (size_t)csv->columns - 1];
    return 1;
}

/* Column `column` of row i as an integer from 0 to limit - 1. */
static int whole(const mk_csv_t *csv, size_t i, int column, const char *name, int limit, int *result, mk_error_t *error) {
    const double value = csv->value[i * (size_t)csv->columns + (size_t)column];
    if (!(value >= 0.0 && value < limit && value == floor(value)))
        return mk_fail(error, "%s:%ld: %s is %.15g: must be an integer from 0 to %d", csv->path, csv->line[i], name, value, limit - 1);
    *result = (int)value;
    return 1;
}

/* A node's reading is used whole: one with rows missing is dropped. */
static void drop_partial(mk_source_t *source) {
    const mk_scenario_t *s = source->scenario;
    const size_t rows = (size_t)source->row_first[s->nodes];
    for (int t = 0; t < source->steps; t++)
        for (int k = 0; k < s->nodes; k++) {
            double *y = source->all_y + (size_t)t * rows + source->row_first[k];
            int missing = 0;
            for (int r = 0; r < s->sensor[k].rows; r++) missing += isnan(y[r]);
            if (missing == 0 || missing == s->sensor[k].rows) continue;
            source->dropped_readings++;
            for (int r = 0; r < s->sensor[k].rows; r++) y[r] = (double)NAN;
        }
}

int mk_source_record(mk_source_t *source, const mk_scenario_t *s, const char *measurements, const char *truth, int steps,
                     mk_error_t *error) {
    static const char *const y_names[] = {"t", "node", "row", "value"}, *const x_names[] = {"t", "state", "value"};
    open_source(source, s);
    source->recorded = 1;
    mk_csv_t y_file = {0}, x_file = {0};
    int good = mk_csv_read(&y_file, measurements, 4, y_names, error);
    if (good && truth) good = mk_csv_read(&x_file, truth, 3, x_names, error);
    source->has_truth = truth != NULL;
    const size_t rows = (size_t)source->row_first[s->nodes];
    int last = -1, t = 0, node = 0, row = 0, state = 0;
    for (size_t i = 0; i < y_file.rows && good; i++) {
        good = whole(&y_file, i, 0, "t", 1000000000, &t, error);
        if (t > last) last = t;
    }
    if (good && last < 0) good = mk_fail(error, "%s: no measurements", measurements);
    source->steps = steps > 0 ? steps : last + 1;
    if (good && (double)source->steps * ((double)rows + s->n) > 4e9)
        good = mk_fail(error, "%s: t up to %d for %zu rows does not fit in memory", measurements, last, rows);
    if (good) {
        source->all_y = all_missing((size_t)source->steps * rows);
        source->all_x = all_missing((size_t)source->steps * (size_t)s->n);
    }
    for (size_t i = 0; i < y_file.rows && good; i++) {
        good = whole(&y_file, i, 0, "t", 1000000000, &t, error) && whole(&y_file, i, 1, "node", s->nodes, &node, error) &&
               whole(&y_file, i, 2, "row", s->sensor[node].rows, &row, error);
        if (good && t < source->steps)
            good = store(&y_file, i, source->all_y + (size_t)t * rows + source->row_first[node] + row, error);
    }
    for (size_t i = 0; i < x_file.rows && good; i++) {
        good = whole(&x_file, i, 0, "t", 1000000000, &t, error) && whole(&x_file, i, 1, "state", s->n, &state, error);
        if (good && t < source->steps) good = store(&x_file, i, source->all_x + (size_t)t * (size_t)s->n + state, error);
    }
    mk_csv_free(&y_file);
    mk_csv_free(&x_file);
    if (good) drop_partial(source);
    else mk_source_free(source);
    return good;
}
