/* SPDX-License-Identifier: MIT */
/* Scenarios to standard output: random draws of the published example (spec 1.9), and those of tracking. */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "json_out.h"
#include "random.h"
#include "scenario_published.h"

enum { TRIES = 1000 };

typedef struct {
    int nodes;
    double (*place)[2]; /* in the unit square */
    unsigned char *pair; /* axis that a node does not measure: 0, 1 or 2 */
    int *edge, edges;
} draw_t;

static int join(int *group, int a) {
    while (group[a] != a) a = group[a] = group[group[a]];
    return a;
}

static int compare_real(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double distance(const draw_t *d, int a, int b) { return hypot(d->place[a][0] - d->place[b][0], d->place[a][1] - d->place[b][1]); }

/* Radius within which pairs of nodes give a mean of `density` neighbours, the node itself included: by rank where all pairs can be
   listed, by area beyond (the border then costs a little density). */
static double find_radius(const draw_t *d, double density) {
    const int n = d->nodes;
    if (n > 2000) return sqrt((density - 1.0) / (3.14159265358979 * n));
    const long pairs = (long)n * (n - 1) / 2;
    long wanted = lround((density - 1.0) * n / 2.0), at = 0;
    double *all = mk_allocate((size_t)pairs, sizeof *all);
    for (int a = 0; a < n; a++)
        for (int b = 0; b < a; b++) all[at++] = distance(d, a, b);
    qsort(all, (size_t)pairs, sizeof *all, compare_real);
    if (wanted > pairs) wanted = pairs;
    const double radius = wanted > 0 ? all[wanted - 1] : 0.0;
    free(all);
    return radius;
}

typedef struct {
    double length;
    int a, b;
} pair_t;

/* All pairs within the radius that join different groups, by cells of that size. */
static pair_t *find_pairs(const draw_t *d, double radius, int *group, size_t *count) {
    const int n = d->nodes, cells = (int)fmax(1.0, fmin(1.0 / radius, 4000.0));
    int *head = mk_allocate((size_t)cells * (size_t)cells, sizeof *head), *next = mk_allocate((size_t)n, sizeof *next);
    size_t room = 1024;
    pair_t *list = mk_allocate(room, sizeof *list);
    *count = 0;
    for (int k = 0; k < n; k++) {
        const int cx = (int)fmin(d->place[k][0] * cells, cells - 1), cy = (int)fmin(d->place[k][1] * cells, cells - 1);
        for (int x = cx > 0 ? cx - 1 : 0; x <= cx + 1 && x < cells; x++)
            for (int y = cy > 0 ? cy - 1 : 0; y <= cy + 1 && y < cells; y++)
                for (int other = head[y * cells + x] - 1; other >= 0; other = next[other] - 1) {
                    const pair_t pair = {distance(d, k, other), other, k};
                    if (pair.length > radius || (group && join(group, k) == join(group, other))) continue;
                    if (*count == room) {
                        pair_t *larger = realloc(list, (room *= 2) * sizeof *larger);
                        if (!larger) exit(MK_EXIT_FAILED);
                        list = larger;
                    }
                    list[(*count)++] = pair;
                }
        next[k] = head[cy * cells + cx];
        head[cy * cells + cx] = k + 1;
    }
    free(head);
    free(next);
    return list;
}

/* Edges between all pairs within the radius, then the shortest ones that connect what is apart: a large random network of moderate
   density is never connected by itself. */
static void join_neighbours(draw_t *d, double density) {
    int *group = mk_allocate((size_t)d->nodes, sizeof *group), groups = d->nodes;
    for (int k = 0; k < d->nodes; k++) group[k] = k;
    double radius = fmax(find_radius(d, density), 1e-6);
    for (int round = 0; groups > 1; round++, radius *= 1.5) {
        size_t count;
        pair_t *list = find_pairs(d, radius, round ? group : NULL, &count);
        if (round) qsort(list, count, sizeof *list, compare_real); /* a pair begins with its length */
        int *larger = realloc(d->edge, 2 * ((size_t)d->edges + count + 1) * sizeof *larger);
        if (!larger) exit(MK_EXIT_FAILED);
        d->edge = larger;
        for (size_t i = 0; i < count; i++) {
            const int a = join(group, list[i].a), b = join(group, list[i].b);
            if (round && a == b) continue;
            d->edge[2 * d->edges] = list[i].a;
            d->edge[2 * d->edges + 1] = list[i].b;
            d->edges++;
            groups -= a != b;
            group[a] = b;
        }
        free(list);
    }
    free(group);
}

/* 1 if every neighbourhood measures all three axes. Pairs of one node are drawn again where that helps. */
static int draw_pairs(draw_t *d, mk_random_t *random) {
    unsigned char *seen = mk_allocate((size_t)d->nodes, 1);
    for (int k = 0; k < d->nodes; k++) d->pair[k] = (unsigned char)(3.0 * mk_random_uniform(random));
    int missing = 1;
    for (int round = 0; round < TRIES && missing; round++) {
        missing = 0;
        for (int k = 0; k < d->nodes; k++) seen[k] = (unsigned char)(7 & ~(1 << d->pair[k]));
        for (int e = 0; e < d->edges; e++) {
            const int a = d->edge[2 * e], b = d->edge[2 * e + 1];
            seen[a] |= (unsigned char)(7 & ~(1 << d->pair[b]));
            seen[b] |= (unsigned char)(7 & ~(1 << d->pair[a]));
        }
        for (int k = 0; k < d->nodes; k++) {
            if (seen[k] == 7) continue;
            missing++;
            d->pair[k] = (unsigned char)(3.0 * mk_random_uniform(random));
        }
    }
    free(seen);
    return !missing;
}

static json_t *identity(int n, double scale) {
    json_t *rows = json_array();
    for (int i = 0; i < n; i++) {
        json_t *row = json_array();
        for (int j = 0; j < n; j++) (void)json_array_append_new(row, json_real(i == j ? scale : 0.0));
        (void)json_array_append_new(rows, row);
    }
    return rows;
}

static json_t *make_node(const draw_t *d, int k, double side, mk_random_t *random) {
    static const double level[3] = {0.5, 2.0, 3.5}; /* 0.5 (1, 4, 7) */
    int order[3] = {0, 1, 2}, rows[2], count = 0;
    for (int i = 2; i > 0; i--) {
        const int j = (int)((i + 1) * mk_random_uniform(random)), swap = order[i];
        order[i] = order[j];
        order[j] = swap;
    }
    for (int axis = 0; axis < 3; axis++)
        if (axis != d->pair[k]) rows[count++] = axis;
    json_t *node = json_object(), *C = json_array(), *R = json_array(), *position = json_array();
    for (int r = 0; r < 2; r++) {
        json_t *row = json_array(), *noise = json_array();
        for (int j = 0; j < 6; j++) (void)json_array_append_new(row, json_real(j == 3 + rows[r] ? 1.0 : 0.0));
        for (int j = 0; j < 2; j++) (void)json_array_append_new(noise, json_real(j == r ? sqrt(k + 1.0) * level[order[r]] : 0.0));
        (void)json_array_append_new(C, row);
        (void)json_array_append_new(R, noise);
        (void)json_array_append_new(position, json_real(side * d->place[k][r]));
    }
    mk_json_set(node, "C", C);
    mk_json_set(node, "R", R);
    mk_json_set(node, "position_m", position);
    return node;
}

static json_t *make_model(void) {
    static const double throw_m_s[3] = {20.0, 20.0, 100.0};
    const double delta = 0.1;
    json_t *model = json_object(), *A = identity(6, 1.0), *input = json_array(), *x0 = json_array(), *states = json_array();
    for (size_t i = 0; i < 3; i++) (void)json_array_set_new(json_array_get(A, 3 + i), i, json_real(delta));
    for (int i = 0; i < 6; i++) (void)json_array_append_new(input, json_real(i == 2 ? -10.0 * delta : 0.0));
    /* Errors do not depend on x0: this one makes a throw of 20 s over the field of sensors. */
    for (int i = 0; i < 6; i++) (void)json_array_append_new(x0, json_real(i < 3 ? throw_m_s[i] : 0.0));
    for (int i = 3; i < 6; i++) (void)json_array_append_new(states, json_integer(i));
    mk_json_set(model, "A", A);
    mk_json_set(model, "Q", identity(6, 0.001));
    mk_json_set(model, "input", input);
    mk_json_set(model, "x0", x0);
    mk_json_set(model, "P0", identity(6, 1.0));
    mk_json_set(model, "dt_s", json_real(delta));
    mk_json_set(model, "position_states", states);
    return model;
}

/* Node by node: all of them as one tree would take a hundred times the memory of the draw. Errors of standard output are main's to report. */
static void print_scenario(const draw_t *d, uint64_t seed, mk_random_t *random) {
    (void)printf("{\"name\":\"projectile-%d-%llu\",\"model\":", d->nodes, (unsigned long long)seed);
    mk_json_put(stdout, make_model());
    for (int k = 0; k < d->nodes; k++) {
        (void)fputs(k ? "," : ",\"nodes\":[", stdout);
        mk_json_put(stdout, make_node(d, k, 400.0 * sqrt(d->nodes / 20.0), random));
    }
    (void)fputs("],\"edges\":[", stdout);
    for (int e = 0; e < d->edges; e++) (void)printf("%s[%d,%d]", e ? "," : "", d->edge[2 * e], d->edge[2 * e + 1]);
    (void)printf("],\"weights\":\"relative-degree\",\"tolerance\":");
    mk_json_put(stdout, json_real(0.02));
    (void)printf(",\"steps\":200,\"seed\":%llu}\n", (unsigned long long)seed);
}

int mk_command_scenario(int argc, char **argv) {
    mk_error_t error;
    const char *nodes_text = NULL, *seed_text = NULL, *density_text = NULL, *limit_text = NULL, *kind;
    const mk_option_t options[] = {{"nodes", &nodes_text, NULL}, {"seed", &seed_text, NULL}, {"density", &density_text, NULL},
                                   {"range-limit", &limit_text, NULL}, {NULL, NULL, NULL}};
    long long nodes = 20, seed = 1;
    double density = 5.0, limit = 0.0;
    if (!mk_parse_options(argc, argv, options, "the kind of scenario", &kind, &error) ||
        !mk_option_integer("nodes", nodes_text, 2, 10000000, &nodes, &error) || !mk_option_integer("seed", seed_text, 0, INT64_MAX, &seed, &error) ||
        !mk_option_real("density", density_text, 1.0, 1e6, &density, &error) || !mk_option_real("range-limit", limit_text, 1e-3, 1e9, &limit, &error))
        return mk_complain(&error, MK_EXIT_INPUT);
    const int projectile = strcmp(kind, "projectile") == 0;
    if (projectile ? limit_text != NULL : nodes_text || density_text) {
        (void)mk_fail(&error, "scenario %s: --%s is for another kind", kind, projectile ? "range-limit" : nodes_text ? "nodes" : "density");
        return mk_complain(&error, MK_EXIT_INPUT);
    }
    if (!projectile) return mk_print_published(kind, (unsigned long long)seed, limit, &error) ? 0 : mk_complain(&error, MK_EXIT_INPUT);
    draw_t d;
    memset(&d, 0, sizeof d);
    d.nodes = (int)nodes;
    d.place = mk_allocate((size_t)nodes, sizeof *d.place);
    d.pair = mk_allocate((size_t)nodes, 1);
    mk_random_t random;
    mk_random_start(&random, (uint64_t)seed, 0, 0, 0, MK_DRAW_NETWORK);
    for (int k = 0; k < d.nodes; k++)
        for (int i = 0; i < 2; i++) d.place[k][i] = mk_random_uniform(&random);
    join_neighbours(&d, density);
    int status = 0;
    if (draw_pairs(&d, &random)) print_scenario(&d, (uint64_t)seed, &random);
    else {
        (void)mk_fail(&error, "no draw in %d lets every neighbourhood see all three axes", TRIES);
        status = mk_complain(&error, MK_EXIT_FAILED);
    }
    free(d.place);
    free(d.pair);
    free(d.edge);
    return status;
}
