/* SPDX-License-Identifier: MIT */
/* Networks in parts, without MPI: both sides of every cut agree, whatever the division, and METIS divides well. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "partition.h"
#include "random.h"
#include "simulation/division.h"

#define MOST_PARTS 9

/* --- networks ------------------------------------------------------------------------------------------------------------- */

/* Slots as a scenario has them: the node itself, then its neighbours in ascending order. Nodes i and j are linked where linked says so. */
static void open_network(mk_scenario_t *s, int nodes, int (*linked)(int i, int j)) {
    memset(s, 0, sizeof *s);
    s->nodes = nodes;
    s->first = mk_allocate((size_t)nodes + 1, sizeof *s->first);
    s->slot = mk_allocate((size_t)nodes * (size_t)nodes, sizeof *s->slot);
    s->weight = mk_allocate((size_t)nodes * (size_t)nodes, sizeof *s->weight);
    for (int k = 0; k < nodes; k++) {
        int used = s->first[k];
        s->slot[used++] = k;
        for (int j = 0; j < nodes; j++)
            if (j != k && linked(k < j ? k : j, k < j ? j : k)) s->slot[used++] = j;
        s->first[k + 1] = used;
    }
    for (int i = 0; i < s->first[nodes]; i++) s->weight[i] = 1.0 / (i + 2.0);
}

static void close_network(mk_scenario_t *s) {
    free(s->first);
    free(s->slot);
    free(s->weight);
}

static double draw(int i, int j) {
    mk_random_t random;
    mk_random_start(&random, 3, (uint32_t)i, (uint32_t)j, 0, MK_DRAW_INITIAL);
    return mk_random_uniform(&random);
}

static int nothing(int i, int j) { return i < 0 && j < 0; }
static int everything(int i, int j) { return i < j; }
static int path(int i, int j) { return j == i + 1; }
static int star(int i, int j) { return i == 0 && j > 0; }
static int some(int i, int j) { return draw(i, j) < 0.05; }
static int islands(int i, int j) { return i / 7 == j / 7 && draw(i, j) < 0.7; }
#define WIDTH 40
static int grid(int i, int j) { return j == i + WIDTH || (j == i + 1 && j % WIDTH); }

static int (*const kinds[])(int, int) = {nothing, everything, path, star, some, islands, grid};
#define KINDS ((int)(sizeof kinds / sizeof *kinds))

/* --- divisions ------------------------------------------------------------------------------------------------------------ */

static int count_links(const mk_scenario_t *s, const int *part, int k, int other) {
    int links = 0;
    for (int i = s->first[k]; i < s->first[k + 1]; i++) links += part[s->slot[i]] == other;
    return links;
}

/* The estimators of one part, and where the estimates of their slots come from. */
static void check_part(const mk_scenario_t *s, const int *part, const mk_division_t *d, int own, int *seen) {
    const mk_topology_t *t = &d->topology;
    int outside = 0;
    assert_in_range(t->interior, 0, t->estimators);
    for (int e = 0; e < t->estimators; e++) {
        const int k = t->id[e], slots = s->first[k + 1] - s->first[k];
        assert_int_equal(part[k], own);
        seen[k]++;
        assert_int_equal(e < t->interior, count_links(s, part, k, own) == slots);
        assert_int_equal(t->first[e + 1] - t->first[e], slots);
        for (int i = 0; i < slots; i++) {
            const int at = t->first[e] + i, from = s->first[k] + i, node = s->slot[from], origin = t->origin[at];
            assert_int_equal(t->slot[at], node);
            assert_memory_equal(&t->weight[at], &s->weight[from], sizeof *t->weight);
            assert_in_range(origin + t->halo, 0, t->halo + t->estimators - 1);
            assert_int_equal(origin >= 0, part[node] == own);
            assert_int_equal(origin >= 0 ? t->id[origin] : t->halo_node[-1 - origin], node);
            outside += origin < 0;
        }
    }
    assert_int_equal(outside, d->cut_edges);
    assert_int_equal(d->send_first[d->peers], t->sends);
    assert_int_equal(d->halo_first[d->peers], t->halo);
}

static int peer_place(const mk_division_t *d, int part) {
    for (int p = 0; p < d->peers; p++)
        if (d->peer[p] == part) return p;
    return -1;
}

/* What a sends to b is what b expects of a: every node of a with a neighbour in b, once, in one order. */
static void check_pair(const mk_scenario_t *s, const int *part, const mk_division_t *d, int a, int b) {
    const int to = peer_place(&d[a], b), from = peer_place(&d[b], a);
    int wanted = 0;
    for (int k = 0; k < s->nodes; k++) wanted += part[k] == a && count_links(s, part, k, b) > 0;
    assert_int_equal(to >= 0, wanted > 0);
    assert_int_equal(from >= 0, wanted > 0);
    if (wanted == 0) return;
    const int *send = d[a].topology.send_estimator + d[a].send_first[to], *halo = d[b].topology.halo_node + d[b].halo_first[from];
    assert_int_equal(d[a].send_first[to + 1] - d[a].send_first[to], wanted);
    assert_int_equal(d[b].halo_first[from + 1] - d[b].halo_first[from], wanted);
    for (int i = 0; i < wanted; i++) {
        const int k = d[a].topology.id[send[i]];
        assert_int_equal(k, halo[i]);
        assert_true(count_links(s, part, k, b) > 0);
        if (i > 0) assert_true(halo[i - 1] < halo[i]);
    }
}

static void check_division(const mk_scenario_t *s, const int *part, int parts) {
    mk_division_t d[MOST_PARTS];
    int *seen = mk_allocate((size_t)s->nodes, sizeof *seen);
    for (int p = 0; p < parts; p++) {
        mk_division_make(&d[p], s, part, parts, p);
        check_part(s, part, &d[p], p, seen);
    }
    for (int k = 0; k < s->nodes; k++) assert_int_equal(seen[k], 1);
    for (int a = 0; a < parts; a++) {
        assert_int_equal(peer_place(&d[a], a), -1);
        for (int b = 0; b < parts; b++)
            if (a != b) check_pair(s, part, d, a, b);
    }
    for (int p = 0; p < parts; p++) mk_division_free(&d[p]);
    free(seen);
}

static void any_division(void **unused) {
    static const int sizes[] = {1, 2, 7, 60};
    (void)unused;
    for (int kind = 0; kind < KINDS; kind++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            mk_scenario_t s;
            int part[60];
            open_network(&s, sizes[i], kinds[kind]);
            for (int parts = 1; parts <= MOST_PARTS; parts++) {
                /* Neither balanced nor connected; some parts may be empty. */
                for (int k = 0; k < s.nodes; k++) part[k] = (int)(draw(k + 1000 * parts, kind) * parts);
                check_division(&s, part, parts);
            }
            close_network(&s);
        }
}

/* --- METIS ---------------------------------------------------------------------------------------------------------------- */

static void divided_by_metis(void **unused) {
    static const int sizes[] = {1, 3, 9, 200};
    (void)unused;
    for (int kind = 0; kind < KINDS; kind++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            mk_scenario_t s;
            mk_error_t error;
            int part[200], again[200];
            open_network(&s, sizes[i], kinds[kind]);
            for (int parts = 1; parts <= MOST_PARTS; parts++) {
                assert_true(mk_partition(&s, parts, part, &error));
                for (int k = 0; k < s.nodes; k++) assert_in_range(part[k], 0, parts - 1);
                assert_true(mk_partition(&s, parts, again, &error));
                assert_memory_equal(part, again, (size_t)s.nodes * sizeof *part);
                check_division(&s, part, parts);
            }
            close_network(&s);
        }
}

/* Shares of the work (slots, and four more for each node) within a tenth of each other, and fewer links cut than between rows of the
   grid. */
static void balanced(void **unused) {
    mk_scenario_t s;
    mk_error_t error;
    int part[WIDTH * 25];
    (void)unused;
    open_network(&s, WIDTH * 25, grid);
    for (int parts = 2; parts <= MOST_PARTS; parts++) {
        int work[MOST_PARTS] = {0}, cut = 0;
        assert_true(mk_partition(&s, parts, part, &error));
        for (int k = 0; k < s.nodes; k++) {
            work[part[k]] += s.first[k + 1] - s.first[k] + 4;
            cut += s.first[k + 1] - s.first[k] - count_links(&s, part, k, part[k]);
        }
        const double all = s.first[s.nodes] + 4.0 * s.nodes;
        for (int p = 0; p < parts; p++) assert_in_range(work[p] * parts, 0.9 * all, 1.1 * all);
        assert_in_range(cut / 2, 25, WIDTH * (parts - 1));
    }
    close_network(&s);
}

static void more_parts_than_nodes(void **unused) {
    mk_scenario_t s;
    mk_error_t error;
    int part[4];
    (void)unused;
    open_network(&s, 4, path);
    assert_true(mk_partition(&s, 7, part, &error));
    for (int k = 0; k < 4; k++) assert_int_equal(part[k], k); /* a node each, and processes without one */
    close_network(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(any_division), cmocka_unit_test(divided_by_metis), cmocka_unit_test(balanced),
                                       cmocka_unit_test(more_parts_than_nodes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
