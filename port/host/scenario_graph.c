/* SPDX-License-Identifier: MIT */
#include "scenario_graph.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int compare_int(const void *a, const void *b) {
    const int x = *(const int *)a, y = *(const int *)b;
    return (x > y) - (x < y);
}

static int bad_edge(mk_reader_t *reader, size_t index, const char *message, int a, int b) {
    char place[64];
    (void)snprintf(place, sizeof place, "edges[%zu]", index);
    return mk_read_bad(reader, place, message, a, b);
}

static int read_edges(mk_reader_t *reader, json_t *edges, mk_scenario_t *s) {
    if (!json_is_array(edges)) return mk_read_bad(reader, "edges", "must be an array of pairs of node numbers");
    const size_t count = json_array_size(edges);
    int *end = mk_allocate(2 * count, sizeof *end);
    s->first = mk_allocate((size_t)s->nodes + 1, sizeof *s->first);
    for (int k = 0; k < s->nodes; k++) s->first[k + 1] = 1;
    for (size_t i = 0; i < count; i++) {
        json_t *edge = json_array_get(edges, i);
        for (size_t j = 0; j < 2; j++) {
            json_t *node = json_is_array(edge) && json_array_size(edge) == 2 ? json_array_get(edge, j) : NULL;
            if (!node || !json_is_integer(node) || json_integer_value(node) < 0 || json_integer_value(node) >= s->nodes) {
                free(end);
                return bad_edge(reader, i, "must be two node numbers from %d to %d", 0, s->nodes - 1);
            }
            end[2 * i + j] = (int)json_integer_value(node);
        }
        if (end[2 * i] == end[2 * i + 1]) {
            const int node = end[2 * i];
            free(end);
            return bad_edge(reader, i, "joins node %d to itself: a node hears itself without an edge", node, node);
        }
        s->first[end[2 * i] + 1]++;
        s->first[end[2 * i + 1] + 1]++;
    }
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
    double *full = mk_read_matrix(reader, weights, "weights", s->nodes, s->nodes);
    if (!full) return 0;
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

int mk_read_graph(mk_reader_t *reader, json_t *root, mk_scenario_t *s) {
    json_t *edges = mk_read_member(reader, root, "", "edges", 1), *weights = json_object_get(root, "weights");
    if (!edges || !read_edges(reader, edges, s)) return 0;
    s->weight = mk_allocate((size_t)s->first[s->nodes], sizeof *s->weight);
    if (json_is_array(weights)) return read_weight_matrix(reader, weights, s);
    const char *rule = weights ? json_string_value(weights) : "relative-degree";
    if (!rule || (strcmp(rule, "relative-degree") != 0 && strcmp(rule, "metropolis") != 0 && strcmp(rule, "uniform") != 0))
        return mk_read_bad(reader, "weights", "must be \"relative-degree\", \"metropolis\", \"uniform\" or a matrix");
    for (int k = 0; k < s->nodes; k++) rule_weights(s, rule, k, s->weight + s->first[k]);
    return 1;
}
