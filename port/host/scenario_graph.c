/* SPDX-License-Identifier: MIT */
#include "scenario_graph.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "first_error.h"
#include "parallel.h"

/* Two slots an edge and one a node are counted in 31 bits. */
enum { LARGEST = 1000000000 };

static int compare_int(const void *a, const void *b) {
    const int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

static int bad_edge(mk_reader_t *reader, size_t index, const char *message, int a, int b) {
    char place[64];
    (void)snprintf(place, sizeof place, "edges[%zu]", index);
    return mk_read_bad(reader, place, message, a, b);
}

typedef struct {
    const mk_reader_t *reader;
    const mk_elements_t *edges;
    int nodes, *end; /* end: two nodes an edge */
    mk_first_error_t first;
} edges_t;

static void read_edge(void *context, int worker, long index) {
    edges_t *e = context;
    mk_error_t error = {""};
    mk_reader_t reader = *e->reader;
    (void)worker;
    reader.error = &error;
    if (mk_first_error_before(&e->first, index)) return;
    json_t *edge = mk_element(e->edges, (size_t)index);
    int *const end = e->end + 2 * index, good = edge != NULL;
    for (size_t j = 0; j < 2 && good; j++) {
        json_t *node = json_is_array(edge) && json_array_size(edge) == 2 ? json_array_get(edge, j) : NULL;
        good = node && json_is_integer(node) && json_integer_value(node) >= 0 && json_integer_value(node) < e->nodes;
        if (good) end[j] = (int)json_integer_value(node);
        else (void)bad_edge(&reader, (size_t)index, "must be two node numbers from %d to %d", 0, e->nodes - 1);
    }
    if (good && end[0] == end[1])
        good = bad_edge(&reader, (size_t)index, "joins node %d to itself: a node hears itself without an edge", end[0], end[0]);
    json_decref(edge);
    if (!good) mk_first_error_put(&e->first, index, &error);
}

static int read_ends(mk_reader_t *reader, const mk_elements_t *edges, int nodes, int *end) {
    edges_t e = {.reader = reader, .edges = edges, .nodes = nodes, .end = end};
    mk_first_error_open(&e.first);
    mk_parallel(mk_cores(), (long)edges->count, read_edge, &e);
    if (e.first.index >= 0) {
        json_t *edge = mk_element(edges, (size_t)e.first.index);
        reader->no_json = !edge;
        json_decref(edge);
    }
    return mk_first_error_close(&e.first, reader->error);
}

static int read_edges(mk_reader_t *reader, const mk_elements_t *edges, mk_scenario_t *s) {
    if (!json_is_array(edges->array)) return mk_read_bad(reader, "edges", "must be an array of pairs of node numbers");
    const size_t count = edges->count;
    if (count > LARGEST) return mk_read_bad(reader, "edges", "has %zu edges; at most %d", count, LARGEST);
    int *end = mk_allocate(2 * count, sizeof *end);
    if (!read_ends(reader, edges, s->nodes, end)) {
        free(end);
        return 0;
    }
    s->first = mk_allocate((size_t)s->nodes + 1, sizeof *s->first);
    for (int k = 0; k < s->nodes; k++) s->first[k + 1] = 1;
    for (size_t i = 0; i < 2 * count; i++) s->first[end[i] + 1]++;
    for (int k = 0; k < s->nodes; k++) {
        if (s->first[k + 1] > UINT16_MAX) {
            const int degree = s->first[k + 1] - 1;
            free(end);
            return mk_read_bad(reader, "edges", "node %d has %d neighbours; at most %d", k, degree, UINT16_MAX - 1);
        }
        s->first[k + 1] += s->first[k];
    }
    s->slot = mk_allocate((size_t)s->first[s->nodes], sizeof *s->slot);
    int *fill = mk_allocate((size_t)s->nodes, sizeof *fill);
    for (int k = 0; k < s->nodes; k++) {
        s->slot[s->first[k]] = k;
        fill[k] = s->first[k] + 1;
    }
    for (size_t i = 0; i < count; i++) {
        const int a = end[2 * i], b = end[2 * i + 1];
        s->slot[fill[a]++] = b;
        s->slot[fill[b]++] = a;
    }
    free(fill);
    int good = 1;
    for (int k = 0; k < s->nodes; k++) {
        int *list = s->slot + s->first[k] + 1;
        const int length = s->first[k + 1] - s->first[k] - 1;
        qsort(list, (size_t)length, sizeof *list, compare_int);
        for (int i = 1; i < length && good; i++) {
            if (list[i] != list[i - 1]) continue;
            /* Name the second of the two in the file. */
            size_t repeat = 0, seen = 0;
            for (size_t e = 0; e < count && seen < 2; e++)
                if ((end[2 * e] == k && end[2 * e + 1] == list[i]) || (end[2 * e + 1] == k && end[2 * e] == list[i])) {
                    repeat = e;
                    seen++;
                }
            good = bad_edge(reader, repeat, "repeats the edge between nodes %d and %d", k, list[i]);
        }
    }
    free(end);
    return good;
}

/* Column k of the weights for a named rule (spec 1.4); degrees count the node itself. */
static void rule_weights(const mk_scenario_t *s, const char *rule, int k, double *weight) {
    const int *slot = s->slot + s->first[k], degree = s->first[k + 1] - s->first[k];
    double total = 0.0;
    for (int i = 0; i < degree; i++) {
        const int other = s->first[slot[i] + 1] - s->first[slot[i]];
        if (rule[0] == 'r') weight[i] = other;
        else if (rule[0] == 'u') weight[i] = 1.0;
        else weight[i] = i == 0 ? 0.0 : 1.0 / (other > degree ? other : degree);
        total += weight[i];
    }
    if (rule[0] == 'm') weight[0] = 1.0 - total;
    else
        for (int i = 0; i < degree; i++) weight[i] /= total;
}

static int read_weight_matrix(mk_reader_t *reader, json_t *weights, mk_scenario_t *s) {
    const size_t nodes = (size_t)s->nodes;
    if (json_array_size(weights) != nodes) return mk_read_bad(reader, "weights", "must be an array of %d rows of %d numbers", s->nodes, s->nodes);
    double *full = mk_allocate(nodes * nodes, sizeof *full);
    if (!mk_read_matrix(reader, weights, "weights", s->nodes, s->nodes, full)) {
        free(full);
        return 0;
    }
    char *neighbour = mk_allocate((size_t)s->nodes, 1);
    int good = 1;
    for (int k = 0; k < s->nodes && good; k++) {
        double sum = 0.0;
        for (int i = s->first[k]; i < s->first[k + 1]; i++) {
            neighbour[s->slot[i]] = 1;
            s->weight[i] = full[(size_t)s->slot[i] * (size_t)s->nodes + (size_t)k];
        }
        for (int l = 0; l < s->nodes && good; l++) {
            const double w = full[(size_t)l * (size_t)s->nodes + (size_t)k];
            char place[64];
            (void)snprintf(place, sizeof place, "weights[%d][%d]", l, k);
            if (w < 0.0) good = mk_read_bad(reader, place, "is negative");
            else if (w > 0.0 && !neighbour[l]) good = mk_read_bad(reader, place, "must be 0: nodes %d and %d are not neighbours", l, k);
            sum += w;
        }
        if (good && fabs(sum - 1.0) > 1e-9)
            good = mk_read_bad(reader, "weights", "column %d sums to %.12g, not to 1 (weights[l][k] goes from l to k)", k, sum);
        for (int i = s->first[k]; i < s->first[k + 1]; i++) neighbour[s->slot[i]] = 0;
    }
    free(neighbour);
    free(full);
    return good;
}

int mk_read_graph(mk_reader_t *reader, json_t *root, const mk_elements_t *edges, mk_scenario_t *s) {
    json_t *weights = json_object_get(root, "weights");
    if (!mk_read_member(reader, root, "", "edges", 1) || !read_edges(reader, edges, s)) return 0;
    s->weight = mk_allocate((size_t)s->first[s->nodes], sizeof *s->weight);
    if (json_is_array(weights)) return read_weight_matrix(reader, weights, s);
    const char *rule = weights ? json_string_value(weights) : "relative-degree";
    if (!rule || (strcmp(rule, "relative-degree") != 0 && strcmp(rule, "metropolis") != 0 && strcmp(rule, "uniform") != 0))
        return mk_read_bad(reader, "weights", "must be \"relative-degree\", \"metropolis\", \"uniform\" or a matrix");
    for (int k = 0; k < s->nodes; k++) rule_weights(s, rule, k, s->weight + s->first[k]);
    return 1;
}
