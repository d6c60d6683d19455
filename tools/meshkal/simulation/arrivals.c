/* SPDX-License-Identifier: MIT */
#include "simulation/arrivals.h"

#include <sodium.h>
#include <stdlib.h>
#include <string.h>

#include "csv.h"

static int compare(const void *a, const void *b) {
    const mk_arrival_t *x = a, *y = b;
    if (x->place != y->place) return x->place < y->place ? -1 : 1;
    return x->line < y->line ? -1 : x->line > y->line;
}

/* Slot in which node `to` hears `from`, or -1. Slots after the node's own ascend. */
static int find_slot(const mk_scenario_t *s, int from, int to) {
    int low = s->first[to] + 1, high = s->first[to + 1];
    const int end = high;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (s->slot[middle] < from) low = middle + 1;
        else high = middle;
    }
    return low < end && s->slot[low] == from ? low : -1;
}

/* Row i: its step and place. */
static int read_row(const mk_scenario_t *s, const mk_csv_t *csv, size_t i, int *t, uint64_t *place, mk_error_t *error) {
    int stage = 0, from = 0, to = 0;
    if (!mk_csv_index(csv, i, 0, "t", 1000000000, t, error) || !mk_csv_index(csv, i, 1, "stage", 1000000000, &stage, error) ||
        !mk_csv_index(csv, i, 2, "from", s->nodes, &from, error) || !mk_csv_index(csv, i, 3, "to", s->nodes, &to, error))
        return 0;
    const char *path = csv->path;
    const long line = csv->line[i];
    if (stage != 1 && stage != 2) return mk_fail(error, "%s:%ld: stage is %d: must be 1 (reading) or 2 (estimate)", path, line, stage);
    if (from == to) return mk_fail(error, "%s:%ld: from and to are node %d: a node always hears itself, leave the line out", path, line, to);
    const int slot = find_slot(s, from, to);
    if (slot < 0) return mk_fail(error, "%s:%ld: node %d does not hear node %d: the scenario has no edge between them", path, line, to, from);
    *place = 2 * (uint64_t)slot + (uint64_t)(stage - 1);
    return 1;
}

/* Sorts each step; the first line that says again what another said is refused. */
static int sort(mk_arrivals_t *arrivals, int steps, const mk_csv_t *csv, mk_error_t *error) {
    long twice = 0;
    for (int t = 0; t < steps; t++) {
        const size_t begin = arrivals->first[t], end = arrivals->first[t + 1];
        if (end > begin) qsort(arrivals->entry + begin, end - begin, sizeof *arrivals->entry, compare);
        for (size_t i = begin + 1; i < end; i++) {
            const mk_arrival_t *entry = &arrivals->entry[i];
            if (entry->place == entry[-1].place && (!twice || entry->line < twice)) twice = entry->line;
        }
    }
    return twice ? mk_fail(error, "%s:%ld: this arrival stands in the file already", csv->path, twice) : 1;
}

static void hash(mk_arrivals_t *arrivals, int steps) {
    unsigned char digest[crypto_hash_sha256_BYTES];
    crypto_hash_sha256_state state;
    (void)crypto_hash_sha256_init(&state);
    for (int t = 0; t < steps; t++)
        for (size_t i = arrivals->first[t]; i < arrivals->first[t + 1]; i++) {
            const uint64_t what[2] = {(uint64_t)t, arrivals->entry[i].place};
            (void)crypto_hash_sha256_update(&state, (const unsigned char *)what, sizeof what);
        }
    (void)crypto_hash_sha256_final(&state, digest);
    (void)sodium_bin2hex(arrivals->sha256, sizeof arrivals->sha256, digest, sizeof digest);
}

static int take(mk_arrivals_t *arrivals, int steps, const mk_csv_t *csv, mk_error_t *error) {
    const mk_scenario_t *s = arrivals->scenario;
    size_t *const first = mk_allocate((size_t)steps + 2, sizeof *first);
    uint64_t place;
    int t;
    arrivals->first = first;
    arrivals->entry = mk_allocate(csv->rows + 1, sizeof *arrivals->entry);
    for (size_t i = 0; i < csv->rows; i++) {
        if (!read_row(s, csv, i, &t, &place, error)) return 0;
        if (t < steps) first[t + 2]++;
    }
    for (t = 0; t < steps; t++) first[t + 2] += first[t + 1];
    /* first[t + 1] now grows from where step t begins to where it ends. */
    for (size_t i = 0; i < csv->rows; i++) {
        (void)read_row(s, csv, i, &t, &place, error);
        if (t >= steps) continue;
        mk_arrival_t *entry = &arrivals->entry[first[t + 1]++];
        entry->place = place;
        entry->line = csv->line[i];
    }
    return sort(arrivals, steps, csv, error);
}

int mk_arrivals_read(mk_arrivals_t *arrivals, const mk_scenario_t *s, int steps, const char *path, mk_error_t *error) {
    static const char *const names[] = {"t", "stage", "from", "to"};
    mk_csv_t csv;
    memset(arrivals, 0, sizeof *arrivals);
    if (!mk_csv_read(&csv, path, 4, names, error)) return 0;
    arrivals->scenario = s;
    const int good = take(arrivals, steps, &csv, error);
    mk_csv_free(&csv);
    if (!good) {
        mk_arrivals_free(arrivals);
        return 0;
    }
    const double messages = 2.0 * steps * (s->first[s->nodes] - s->nodes);
    arrivals->missing = messages > 0.0 ? 1.0 - (double)arrivals->first[steps] / messages : 0.0;
    hash(arrivals, steps);
    return 1;
}

void mk_arrivals_free(mk_arrivals_t *arrivals) {
    free(arrivals->first);
    free(arrivals->entry);
    memset(arrivals, 0, sizeof *arrivals);
}

void mk_arrivals_links(const mk_arrivals_t *arrivals, int t, const mk_topology_t *topology, int begin, int end, uint8_t *readings,
                       uint8_t *estimates) {
    const int *first = arrivals->scenario->first;
    const mk_arrival_t *const stop = arrivals->entry + arrivals->first[t + 1];
    for (int e = begin; e < end; e++) {
        const int k = mk_topology_id(topology, e), own = topology->first[e], slots = topology->first[e + 1] - own;
        const uint64_t base = 2 * (uint64_t)first[k];
        memset(readings + own + 1, 0, (size_t)slots - 1);
        memset(estimates + own + 1, 0, (size_t)slots - 1);
        /* The first entry of this node. */
        const mk_arrival_t *entry = arrivals->entry + arrivals->first[t];
        for (size_t count = (size_t)(stop - entry); count > 0;) {
            const size_t half = count / 2;
            if (entry[half].place < base) {
                entry += half + 1;
                count -= half + 1;
            } else {
                count = half;
            }
        }
        for (; entry < stop && entry->place < base + 2 * (uint64_t)slots; entry++)
            (entry->place % 2 ? estimates : readings)[own + (int)((entry->place - base) / 2)] = 1;
    }
}
