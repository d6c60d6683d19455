/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <sodium.h>
#include <stdlib.h>
#include <string.h>

#include "csv.h"
#include "simulation/source.h"

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

/* What the files say, however they say it. */
static void hash(mk_source_t *source, size_t rows) {
    const size_t steps = (size_t)source->steps, states = source->has_truth ? (size_t)source->scenario->n : 0;
    unsigned char digest[crypto_hash_sha256_BYTES];
    crypto_hash_sha256_state state;
    (void)crypto_hash_sha256_init(&state);
    (void)crypto_hash_sha256_update(&state, (const unsigned char *)source->all_y, steps * rows * sizeof *source->all_y);
    (void)crypto_hash_sha256_update(&state, (const unsigned char *)source->all_x, steps * states * sizeof *source->all_x);
    (void)crypto_hash_sha256_final(&state, digest);
    (void)sodium_bin2hex(source->sha256, sizeof source->sha256, digest, sizeof digest);
}

int mk_source_record(mk_source_t *source, const mk_scenario_t *s, const char *measurements, const char *truth, int steps,
                     mk_error_t *error) {
    static const char *const y_names[] = {"t", "node", "row", "value"}, *const x_names[] = {"t", "state", "value"};
    mk_source_open(source, s, MK_TRUTH_RECORDED);
    mk_csv_t y_file = {0}, x_file = {0};
    int good = mk_csv_read(&y_file, measurements, 4, y_names, error);
    if (good && truth) good = mk_csv_read(&x_file, truth, 3, x_names, error);
    source->has_truth = truth != NULL;
    const size_t rows = (size_t)source->row_first[s->nodes];
    int last = -1, t = 0, node = 0, row = 0, state = 0;
    for (size_t i = 0; i < y_file.rows && good; i++) {
        good = mk_csv_index(&y_file, i, 0, "t", 1000000000, &t, error);
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
        good = mk_csv_index(&y_file, i, 0, "t", 1000000000, &t, error) && mk_csv_index(&y_file, i, 1, "node", s->nodes, &node, error) &&
               mk_csv_index(&y_file, i, 2, "row", s->sensor[node].rows, &row, error);
        if (good && t < source->steps)
            good = store(&y_file, i, source->all_y + (size_t)t * rows + source->row_first[node] + row, error);
    }
    for (size_t i = 0; i < x_file.rows && good; i++) {
        good = mk_csv_index(&x_file, i, 0, "t", 1000000000, &t, error) && mk_csv_index(&x_file, i, 1, "state", s->n, &state, error);
        if (good && t < source->steps) good = store(&x_file, i, source->all_x + (size_t)t * (size_t)s->n + state, error);
    }
    mk_csv_free(&y_file);
    mk_csv_free(&x_file);
    if (good) {
        drop_partial(source);
        hash(source, rows);
    } else {
        mk_source_free(source);
    }
    return good;
}
