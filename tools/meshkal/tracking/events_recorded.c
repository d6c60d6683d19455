/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <sodium.h>
#include <stdlib.h>
#include <string.h>

#include "csv.h"
#include "scenario_faults.h"
#include "simulation/statistics.h"
#include "tracking/events_parts.h"

/* One line of a file: a row of a reading, or one state of the truth (row 0). */
typedef struct {
    double t, value;
    long line;
    int id, row; /* node and row, or state and 0 */
} entry_t;

static int compare_entry(const void *a, const void *b) {
    const entry_t *x = a, *y = b;
    if (x->t != y->t) return x->t < y->t ? -1 : 1;
    if (x->id != y->id) return x->id < y->id ? -1 : 1;
    if (x->row != y->row) return x->row < y->row ? -1 : 1;
    return (x->line > y->line) - (x->line < y->line);
}

/* Sorts by time, node and row; most logs are sorted already. Lines that are there twice are left out and counted; another value for one place is
   an error. */
static int sort_entries(const char *path, entry_t *entry, size_t *count, long *repeated, mk_error_t *error) {
    size_t i = 1, kept = *count > 0;
    while (i < *count && compare_entry(&entry[i - 1], &entry[i]) < 0) i++;
    if (i < *count) qsort(entry, *count, sizeof *entry, compare_entry);
    for (i = 1; i < *count; i++) {
        const entry_t *const before = &entry[kept - 1];
        if (entry[i].t != before->t || entry[i].id != before->id || entry[i].row != before->row) {
            entry[kept++] = entry[i];
        } else if (entry[i].value == before->value) {
            ++*repeated;
        } else {
            return mk_fail(error, "%s:%ld: a second value for the same place: line %ld has it, too, and says %.15g, not %.15g: keep one of them, "
                                  "or give them different times",
                           path, entry[i].line, before->line, before->value, entry[i].value);
        }
    }
    *count = kept;
    return 1;
}

/* --- readings -------------------------------------------------------------------------------------------------------------- */

static entry_t *load_readings(const mk_scenario_t *s, const char *path, size_t *count, long *repeated, mk_error_t *error) {
    static const char *const names[] = {"t", "node", "row", "value"};
    mk_csv_t csv;
    if (!mk_csv_read(&csv, path, 4, names, error)) return NULL;
    entry_t *entry = mk_allocate(csv.rows, sizeof *entry);
    int good = csv.rows > 0 || mk_fail(error, "%s: no measurements", path);
    for (size_t i = 0; i < csv.rows && good; i++) {
        good = mk_csv_index(&csv, i, 1, "node", s->nodes, &entry[i].id, error);
        const int rows = good ? s->sensor[entry[i].id].rows : 0;
        if (good && rows == 0) good = mk_fail(error, "%s:%ld: node %d has no sensor", path, csv.line[i], entry[i].id);
        good = good && mk_csv_index(&csv, i, 2, "row", rows, &entry[i].row, error);
        entry[i].t = csv.value[4 * i];
        entry[i].value = csv.value[4 * i + 3];
        entry[i].line = csv.line[i];
    }
    *count = csv.rows;
    mk_csv_free(&csv);
    good = good && sort_entries(path, entry, count, repeated, error);
    if (good) return entry;
    free(entry);
    return NULL;
}

/* Complete readings, gathered in instants of equal time. */
static void gather(mk_events_t *events, const entry_t *entry, size_t count, long steps) {
    const mk_scenario_t *s = events->models->scenario;
    size_t instants = 0, readings = 0, values = 0;
    events->time = mk_allocate(count, sizeof *events->time);
    events->first = mk_allocate(count + 1, sizeof *events->first);
    events->z = mk_allocate(count, sizeof *events->z);
    events->reading = mk_allocate(count, sizeof *events->reading);
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && entry[end].t == entry[i].t && entry[end].id == entry[i].id;) end++;
        const int is_new = instants == 0 || events->time[instants - 1] != entry[i].t;
        if (is_new && steps > 0 && instants == (size_t)steps) break;
        if (end - i != (size_t)s->sensor[entry[i].id].rows) {
            events->facts.dropped++;
            continue;
        }
        if (is_new) {
            events->time[instants] = entry[i].t;
            events->first[instants++] = readings;
        }
        events->reading[readings].node = entry[i].id;
        events->reading[readings++].z = events->z + values;
        for (size_t j = i; j < end; j++) events->z[values++] = entry[j].value;
    }
    events->first[instants] = readings;
    events->facts.steps = (long)instants;
    events->facts.readings = (long)readings;
    events->facts.half = (long)(instants / 2) + 1;
    events->facts.last_s = instants ? events->time[instants - 1] : 0.0;
    for (size_t i = 1; i < instants; i++) {
        const double gap = events->time[i] - events->time[i - 1];
        if (!(gap > events->facts.longest_gap_s)) continue;
        events->facts.longest_gap_s = gap;
        events->facts.longest_gap_from_s = events->time[i - 1];
    }
}

/* --- truth ----------------------------------------------------------------------------------------------------------------- */

static double median_interval(const entry_t *entry, size_t count) {
    double *interval = mk_allocate(count, sizeof *interval), median = 0.0;
    size_t intervals = 0;
    for (size_t i = 1; i < count; i++)
        if (entry[i].t != entry[i - 1].t) interval[intervals++] = entry[i].t - entry[i - 1].t;
    mk_sort(interval, intervals);
    if (intervals > 0) median = mk_median(interval, intervals);
    free(interval);
    return median;
}

/* Values of the truth's time that is nearest to each instant. Both run upwards. */
static void match(mk_events_t *events, const entry_t *entry, size_t count) {
    const size_t n = (size_t)events->models->n;
    const double window = 0.5 * median_interval(entry, count);
    size_t begin = 0, end = 0; /* of the entries with the time that is looked at, the last one not beyond the instant where there is one */
    while (end < count && entry[end].t == entry[0].t) end++;
    for (size_t i = 0; i < (size_t)events->facts.steps && count > 0; i++) {
        const double t = events->time[i];
        while (end < count && entry[end].t <= t) {
            const double next = entry[end].t;
            for (begin = end; end < count && entry[end].t == next;) end++;
        }
        size_t nearest = begin;
        if (end < count && entry[end].t - t < fabs(t - entry[begin].t)) nearest = end;
        if (fabs(entry[nearest].t - t) > window) continue;
        for (size_t j = nearest; j < count && entry[j].t == entry[nearest].t; j++) {
            events->x[i * n + (size_t)entry[j].id] = entry[j].value;
            events->facts.known |= (uint64_t)1 << entry[j].id;
        }
        events->facts.with_truth++;
    }
}

/* The instant with which the second half of those with truth begins. */
static long second_half(const mk_events_t *events) {
    const size_t n = (size_t)events->models->n;
    long seen = 0, i = 0;
    while (i < events->facts.steps) {
        int known = 0;
        for (size_t j = 0; j < n; j++) known |= !isnan(events->x[(size_t)i * n + j]);
        if (known && seen++ == events->facts.with_truth / 2) break;
        i++;
    }
    return i + 1;
}

static int read_truth(mk_events_t *events, const char *path, mk_error_t *error) {
    static const char *const names[] = {"t", "state", "value"};
    const mk_scenario_t *s = events->models->scenario;
    mk_csv_t csv;
    if (!mk_csv_read(&csv, path, 3, names, error)) return 0;
    entry_t *entry = mk_allocate(csv.rows, sizeof *entry);
    int good = 1;
    for (size_t i = 0; i < csv.rows && good; i++) {
        good = mk_csv_index(&csv, i, 1, "state", s->n, &entry[i].id, error);
        entry[i].t = csv.value[3 * i];
        entry[i].value = csv.value[3 * i + 2];
        entry[i].line = csv.line[i];
    }
    size_t count = csv.rows;
    good = good && sort_entries(path, entry, &count, &events->facts.repeated, error);
    good = good && (count > 0 || mk_fail(error, "%s: no truth", path));
    if (good) match(events, entry, count);
    if (good && events->facts.with_truth == 0)
        good = mk_fail(error, "%s: no truth at any instant: it is for %.15g to %.15g s, the measurements are for %.15g to %.15g s: two clocks, "
                              "or two units?",
                       path, entry[0].t, entry[count - 1].t, events->time[0], events->facts.last_s);
    if (good) events->facts.half = second_half(events);
    free(entry);
    mk_csv_free(&csv);
    return good;
}

/* --- all ------------------------------------------------------------------------------------------------------------------- */

/* What the files say, however they say it. */
static void hash(mk_events_t *events) {
    const size_t instants = (size_t)events->facts.steps;
    const size_t states = events->facts.has_truth ? instants * (size_t)events->models->n : 0;
    unsigned char digest[crypto_hash_sha256_BYTES];
    crypto_hash_sha256_state state;
    (void)crypto_hash_sha256_init(&state);
    (void)crypto_hash_sha256_update(&state, (const unsigned char *)events->time, instants * sizeof *events->time);
    for (size_t i = 0; i < instants; i++)
        for (size_t j = events->first[i]; j < events->first[i + 1]; j++) {
            const mk_reading_t *reading = &events->reading[j];
            const uint64_t place[2] = {i, (uint64_t)reading->node};
            const size_t rows = (size_t)events->models->scenario->sensor[reading->node].rows;
            (void)crypto_hash_sha256_update(&state, (const unsigned char *)place, sizeof place);
            (void)crypto_hash_sha256_update(&state, (const unsigned char *)reading->z, rows * sizeof *reading->z);
        }
    (void)crypto_hash_sha256_update(&state, (const unsigned char *)events->x, states * sizeof *events->x);
    (void)crypto_hash_sha256_final(&state, digest);
    (void)sodium_bin2hex(events->sha256, sizeof events->sha256, digest, sizeof digest);
}

static void add_faults(mk_events_t *events) {
    const mk_scenario_t *s = events->models->scenario;
    for (size_t i = 0; i < (size_t)events->facts.steps && s->faults; i++)
        for (size_t j = events->first[i]; j < events->first[i + 1]; j++) {
            mk_reading_t *const reading = &events->reading[j];
            reading->faulty = mk_faults_add(s, reading->node, events->time[i], events->z + (reading->z - events->z));
        }
}

mk_events_t *mk_events_record(const mk_models_f64_t *models, const char *measurements, const char *truth, long steps, mk_error_t *error) {
    const mk_scenario_t *s = models->scenario;
    const mk_tracking_t *tracking = s->tracking;
    size_t count;
    long repeated = 0;
    entry_t *entry = load_readings(s, measurements, &count, &repeated, error);
    if (!entry) return NULL;
    if (tracking->has_start_s && entry[0].t < tracking->start_s) {
        (void)mk_fail(error, "%s:%ld: t is %.17g: before model.start_s, %.17g", measurements, entry[0].line, entry[0].t, tracking->start_s);
        free(entry);
        return NULL;
    }
    mk_events_t *events = mk_events_open(models);
    gather(events, entry, count, steps);
    free(entry);
    events->facts.repeated = repeated;
    events->facts.has_truth = truth != NULL;
    events->facts.start_s = tracking->has_start_s || events->facts.steps == 0 ? tracking->start_s : events->time[0];
    const size_t numbers = (size_t)s->n * (size_t)(truth ? events->facts.steps : 1);
    events->x = mk_allocate(numbers, sizeof *events->x);
    for (size_t i = 0; i < numbers; i++) events->x[i] = (double)NAN;
    int good = events->facts.steps > 0 || mk_fail(error, "%s: no reading has all its rows", measurements);
    good = good && (!truth || read_truth(events, truth, error));
    if (good) {
        hash(events);
        add_faults(events);
        return events;
    }
    mk_events_free(events);
    return NULL;
}
