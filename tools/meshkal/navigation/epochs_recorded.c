/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <sodium.h>
#include <stdlib.h>
#include <string.h>

#include "csv.h"
#include "navigation/epochs_parts.h"

/* An interval of samples at the start may be so much longer than the mean. */
#define LONG_START 2.0

/* Column t must ascend; strictly: no two lines of one time. */
static int check_times(const mk_csv_t *csv, int strictly, mk_error_t *error) {
    for (size_t i = 1; i < csv->rows; i++) {
        const double before = csv->value[(i - 1) * (size_t)csv->columns], t = csv->value[i * (size_t)csv->columns];
        if (t < before || (strictly && t == before))
            return mk_fail(error, "%s:%ld: t is %.15g, %s line %ld: times must ascend", csv->path, csv->line[i], t,
                           t < before ? "before that of" : "that of", csv->line[i - 1]);
    }
    return 1;
}

/* --- pseudoranges ----------------------------------------------------------------------------------------------------------- */

static int find_node(const mk_epochs_t *epochs, double number) {
    const mk_scenario_t *const s = epochs->scenario;
    int k = s->nodes - 1;
    while (k >= 0 && (double)s->navigation->satellite[k].number != number) k--;
    return k;
}

/* One line, into epoch `index`. */
static int take_reading(mk_epochs_t *epochs, const mk_csv_t *csv, size_t i, size_t begin, size_t *count, mk_error_t *error) {
    const double *const row = csv->value + 6 * i;
    const int k = find_node(epochs, row[1]);
    if (k < 0)
        return mk_fail(error, "%s:%ld: satellite %.15g is not among the scenario's nodes: add it there, or leave the line out", csv->path,
                       csv->line[i], row[1]);
    if (isnan(row[2])) return 1;
    for (int c = 3; c < 6; c++)
        if (isnan(row[c])) return mk_fail(error, "%s:%ld: a pseudorange without the satellite's position", csv->path, csv->line[i]);
    for (size_t j = begin; j < *count; j++)
        if (epochs->node[j] == k)
            return mk_fail(error, "%s:%ld: satellite %.15g twice at t = %.15g: keep one of them", csv->path, csv->line[i], row[1], row[0]);
    epochs->node[*count] = k;
    epochs->value[*count] = row[2];
    memcpy(epochs->from[*count], row + 3, 3 * sizeof *row);
    ++*count;
    return 1;
}

static int read_pseudoranges(mk_epochs_t *epochs, const mk_csv_t *csv, long steps, mk_error_t *error) {
    size_t count = 0, instants = 0, begin = 0;
    if (csv->rows == 0) return mk_fail(error, "%s: no measurements", csv->path);
    if (!check_times(csv, 0, error)) return 0;
    if (csv->value[0] < epochs->facts.start_s)
        return mk_fail(error, "%s:%ld: t is %.15g: before model.navigation.start_s, %.15g", csv->path, csv->line[0], csv->value[0], epochs->facts.start_s);
    epochs->time = mk_allocate(csv->rows, sizeof *epochs->time);
    epochs->first = mk_allocate(csv->rows + 1, sizeof *epochs->first);
    epochs->node = mk_allocate(csv->rows, sizeof *epochs->node);
    epochs->value = mk_allocate(csv->rows, sizeof *epochs->value);
    epochs->from = mk_allocate(csv->rows, sizeof *epochs->from);
    epochs->facts.fewest = epochs->scenario->nodes;
    for (size_t i = 0; i < csv->rows; i++) {
        const double t = csv->value[6 * i];
        if (instants == 0 || t != epochs->time[instants - 1]) {
            if (steps > 0 && instants == (size_t)steps) break;
            epochs->time[instants] = t;
            epochs->first[instants++] = begin = count;
        }
        if (!take_reading(epochs, csv, i, begin, &count, error)) return 0;
    }
    epochs->first[instants] = count;
    for (size_t e = 0; e < instants; e++) {
        const int there = (int)(epochs->first[e + 1] - epochs->first[e]);
        if (there < epochs->facts.fewest) epochs->facts.fewest = there;
    }
    epochs->facts.steps = (long)instants;
    epochs->facts.readings = (long)count;
    epochs->facts.last_s = epochs->time[instants - 1];
    return 1;
}

/* --- samples ---------------------------------------------------------------------------------------------------------------- */

/* Most samples of an epoch, those cut in two counted twice. */
static long most_samples(const mk_epochs_t *epochs) {
    long most = 2, row = 0;
    for (long e = 0; e < epochs->facts.steps; e++) {
        const long begin = row;
        while (row < epochs->rows && epochs->sample[7 * row] <= epochs->time[e]) row++;
        if (row - begin + 2 > most) most = row - begin + 2;
    }
    return most;
}

static int read_samples(mk_epochs_t *epochs, const mk_csv_t *csv, mk_error_t *error) {
    const double start = epochs->facts.start_s, last = epochs->facts.last_s;
    if (csv->rows < 2) return mk_fail(error, "%s: needs two samples at least", csv->path);
    if (!check_times(csv, 1, error)) return 0;
    const double begin = csv->value[0], end = csv->value[7 * (csv->rows - 1)];
    const double mean = (end - begin) / (double)(csv->rows - 1);
    epochs->facts.interval_s = mean;
    if (begin - start > LONG_START * mean)
        return mk_fail(error, "%s:%ld: the samples begin at t = %.15g, %.6g s after model.navigation.start_s, %.15g: the run can begin no sooner than "
                              "they do: set start_s, and the estimate of that time",
                       csv->path, csv->line[0], begin, begin - start, start);
    if (last - end > 1e-6 * mean)
        return mk_fail(error, "%s:%ld: the samples end at t = %.15g, %.6g s before the last pseudorange, t = %.15g: give samples for all the time, or "
                              "fewer epochs with --steps",
                       csv->path, csv->line[csv->rows - 1], end, last - end, last);
    size_t skip = 0;
    while (skip < csv->rows && csv->value[7 * skip] <= start) skip++;
    epochs->rows = (long)(csv->rows - skip);
    epochs->sample = mk_allocate((size_t)epochs->rows * 7 + 1, sizeof *epochs->sample);
    memcpy(epochs->sample, csv->value + 7 * skip, (size_t)epochs->rows * 7 * sizeof *epochs->sample);
    double before = start;
    for (long i = 0; i < epochs->rows && before < last; i++) {
        const double gap = epochs->sample[7 * i] - before;
        if (gap > epochs->facts.gap_s) {
            epochs->facts.gap_s = gap;
            epochs->facts.gap_from_s = before;
        }
        before = epochs->sample[7 * i];
    }
    epochs->most_samples = most_samples(epochs);
    return 1;
}

/* --- truth ------------------------------------------------------------------------------------------------------------------ */

static int read_truth(mk_epochs_t *epochs, const mk_csv_t *csv, mk_error_t *error) {
    const size_t columns = (size_t)csv->columns, steps = (size_t)epochs->facts.steps;
    if (csv->rows == 0) return mk_fail(error, "%s: no truth", csv->path);
    if (!check_times(csv, 1, error)) return 0;
    const double first = csv->value[0], last = csv->value[(csv->rows - 1) * columns];
    const double window = csv->rows > 1 ? 0.5 * (last - first) / (double)(csv->rows - 1) : 0.0;
    epochs->truth = mk_allocate(steps, sizeof *epochs->truth);
    size_t i = 0;
    for (size_t e = 0; e < steps; e++) {
        const double t = epochs->time[e];
        double unknown[MK_NAV_STATES];
        for (int c = 0; c < MK_NAV_STATES; c++) unknown[c] = (double)NAN;
        while (i + 1 < csv->rows && fabs(csv->value[(i + 1) * columns] - t) < fabs(csv->value[i * columns] - t)) i++;
        const double *const row = csv->value + i * columns;
        const int near = fabs(row[0] - t) <= window;
        mk_nav_state_take(near ? row + 1 : unknown, &epochs->truth[e]);
        epochs->facts.with_truth += near;
    }
    if (epochs->facts.with_truth == 0)
        return mk_fail(error, "%s: no truth at any epoch: it is for %.15g to %.15g s, the pseudoranges are for %.15g to %.15g s: two clocks, or two units?",
                       csv->path, first, last, epochs->time[0], epochs->facts.last_s);
    return 1;
}

/* --- all -------------------------------------------------------------------------------------------------------------------- */

static void hash(const mk_csv_t *csv, int count, char *sha256) {
    unsigned char digest[crypto_hash_sha256_BYTES];
    crypto_hash_sha256_state state;
    (void)crypto_hash_sha256_init(&state);
    for (int i = 0; i < count; i++)
        (void)crypto_hash_sha256_update(&state, (const unsigned char *)csv[i].value, csv[i].rows * (size_t)csv[i].columns * sizeof *csv[i].value);
    (void)crypto_hash_sha256_final(&state, digest);
    (void)sodium_bin2hex(sha256, 65, digest, sizeof digest);
}

mk_epochs_t *mk_epochs_record(const mk_scenario_t *s, const char *measurements, const char *inertial, const char *truth, long steps, mk_error_t *error) {
    static const char *const range_names[] = MK_NAV_PSEUDORANGE_COLUMNS, *const sample_names[] = MK_NAV_INERTIAL_COLUMNS,
                            *const truth_names[] = MK_NAV_TRUTH_COLUMNS;
    mk_csv_t csv[3];
    mk_epochs_t *const epochs = mk_allocate(1, sizeof *epochs);
    memset(csv, 0, sizeof csv);
    epochs->scenario = s;
    epochs->facts.start_s = s->navigation->start_s;
    epochs->facts.has_truth = truth != NULL;
    epochs->facts.sha256 = epochs->sha256;
    int good = mk_csv_read_gaps(&csv[0], measurements, 6, range_names, 0x3cul, error) && read_pseudoranges(epochs, &csv[0], steps, error) &&
               mk_csv_read(&csv[1], inertial, 7, sample_names, error) && read_samples(epochs, &csv[1], error);
    if (good && truth) good = mk_csv_read_gaps(&csv[2], truth, 1 + MK_NAV_STATES, truth_names, ~1ul, error) && read_truth(epochs, &csv[2], error);
    if (good) hash(csv, 2 + (truth != NULL), epochs->sha256);
    for (int i = 0; i < 3; i++) mk_csv_free(&csv[i]);
    if (good) return epochs;
    mk_epochs_free(epochs);
    return NULL;
}

void mk_recorded_epoch(mk_run_epochs_t *stream, mk_epoch_t *epoch) {
    const mk_epochs_t *const epochs = stream->epochs;
    const size_t e = (size_t)stream->step - 1;
    double now = stream->t;
    epoch->t = epochs->time[e];
    epoch->dt = epoch->t - now;
    while (now < epoch->t) {
        const double *const row = epochs->sample + 7 * (stream->row < epochs->rows ? stream->row : epochs->rows - 1);
        const int whole = row[0] - epoch->t <= 1e-9 * epochs->facts.interval_s;
        const double end = whole && stream->row < epochs->rows ? row[0] : epoch->t;
        mk_inertial_t *const sample = &stream->inertial[epoch->samples++];
        sample->h = end - now;
        memcpy(sample->w, row + 1, sizeof sample->w);
        memcpy(sample->f, row + 4, sizeof sample->f);
        now = end;
        stream->row += whole;
    }
    for (int k = 0; k < epochs->scenario->nodes; k++) {
        stream->have[k] = 0;
        stream->value[k] = stream->satellite[k][0] = stream->satellite[k][1] = stream->satellite[k][2] = (double)NAN;
    }
    for (size_t i = epochs->first[e]; i < epochs->first[e + 1]; i++) {
        const int k = epochs->node[i];
        stream->have[k] = 1;
        stream->value[k] = epochs->value[i];
        memcpy(stream->satellite[k], epochs->from[i], sizeof stream->satellite[k]);
    }
    if (!epochs->truth) return;
    stream->truth = epochs->truth[e];
    epoch->truth = &stream->truth;
}
