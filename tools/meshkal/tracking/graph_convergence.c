/* SPDX-License-Identifier: MIT */
#include "tracking/graph_convergence.h"

#include <stdlib.h>

#include "error.h"

/* Tarjan's strongly connected components with a stack of its own: chains of a million nodes are deep. */
typedef struct {
    const mk_links_t *links;
    int *order, *low; /* order: 0 before the visit */
    int *next;        /* the link of each open node that comes next */
    int *path, *open; /* two stacks: the way here, and nodes whose component is not known yet */
    int *component;   /* -1: not known */
    int visited, depth, waiting, components;
} search_t;

static void enter(search_t *s, int k) {
    s->order[k] = s->low[k] = ++s->visited;
    s->next[k] = s->links->first[k];
    s->path[s->depth++] = k;
    s->open[s->waiting++] = k;
}

static void leave(search_t *s, int k) {
    s->depth--;
    if (s->low[k] == s->order[k]) {
        int member;
        do {
            member = s->open[--s->waiting];
            s->component[member] = s->components;
        } while (member != k);
        s->components++;
    }
    if (s->depth == 0) return;
    const int parent = s->path[s->depth - 1];
    if (s->low[k] < s->low[parent]) s->low[parent] = s->low[k];
}

static void visit(search_t *s, int root) {
    enter(s, root);
    while (s->depth > 0) {
        const int k = s->path[s->depth - 1];
        if (s->next[k] == s->links->first[k + 1]) {
            leave(s, k);
            continue;
        }
        const int heard = s->links->slot[s->next[k]++];
        if (s->order[heard] == 0) enter(s, heard);
        else if (s->component[heard] < 0 && s->order[heard] < s->low[k]) s->low[k] = s->order[heard];
    }
}

static int *integers(int count) { return mk_allocate((size_t)count + 1, sizeof(int)); }

static void find_components(search_t *s, const mk_links_t *links) {
    const int nodes = links->nodes;
    s->links = links;
    s->order = integers(nodes);
    s->low = integers(nodes);
    s->next = integers(nodes);
    s->path = integers(nodes);
    s->open = integers(nodes);
    s->component = integers(nodes);
    for (int k = 0; k < nodes; k++) s->component[k] = -1;
    for (int k = 0; k < nodes; k++)
        if (s->order[k] == 0) visit(s, k);
}

static void close_search(search_t *s) {
    free(s->order);
    free(s->low);
    free(s->next);
    free(s->path);
    free(s->open);
    free(s->component);
}

static int divisor(int a, int b) {
    while (b != 0) {
        const int rest = a % b;
        a = b;
        b = rest;
    }
    return a < 0 ? -a : a;
}

/* The common divisor of the cycle lengths of the source of `root`: of level(k) + 1 - level(j) over its links k, j, with the distances from
   the root as levels. level: -1 before; queue: room. A source of one silent node has no cycle: 0. */
static int find_period(const mk_links_t *links, const unsigned char *measures, int root, int *level, int *queue) {
    int begin = 0, end = 0, period = 0;
    level[root] = 0;
    queue[end++] = root;
    while (begin < end) {
        const int k = queue[begin++];
        if (measures && measures[k]) period = 1;
        for (int i = links->first[k]; i < links->first[k + 1]; i++) {
            const int heard = links->slot[i];
            if (heard == k) continue;
            if (level[heard] < 0) {
                level[heard] = level[k] + 1;
                queue[end++] = heard;
            }
            period = divisor(period, level[k] + 1 - level[heard]);
        }
    }
    return period;
}

void mk_convergence_make(mk_convergence_t *result, const mk_links_t *links, const unsigned char *measures) {
    const int nodes = links->nodes;
    search_t s = {0};
    find_components(&s, links);
    /* Components that hear another one are no sources. Their numbers are used up: those of the sources follow the nodes. */
    int *leaks = integers(s.components), *number = integers(s.components);
    for (int c = 0; c < s.components; c++) number[c] = -1;
    for (int k = 0; k < nodes; k++)
        for (int i = links->first[k]; i < links->first[k + 1]; i++) leaks[s.component[k]] |= s.component[links->slot[i]] != s.component[k];
    result->source = integers(nodes);
    result->period = integers(s.components);
    result->size = integers(s.components);
    result->sources = 0;
    int *const level = s.order, *const queue = s.low;
    for (int k = 0; k < nodes; k++) level[k] = -1;
    for (int k = 0; k < nodes; k++) {
        const int c = s.component[k];
        if (leaks[c]) {
            result->source[k] = -1;
            continue;
        }
        if (number[c] < 0) {
            const int period = find_period(links, measures, k, level, queue);
            number[c] = result->sources++;
            result->period[number[c]] = period ? period : 1;
        }
        result->source[k] = number[c];
        result->size[number[c]]++;
    }
    result->converges = result->sources == 1 && result->period[0] == 1;
    free(leaks);
    free(number);
    close_search(&s);
}

void mk_convergence_free(mk_convergence_t *result) {
    free(result->source);
    free(result->period);
    free(result->size);
}
