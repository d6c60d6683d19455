/* SPDX-License-Identifier: MIT */
#include "simulation/team.h"

#include <stdlib.h>
#include <string.h>

#include "simulation/division.h"

enum { FEW_NODES = 4096 };

static int agree(mk_team_t *team, int good, mk_error_t *error) {
    (void)team;
    (void)error;
    return good;
}

static int same(mk_team_t *team, const char *text, mk_error_t *error) {
    (void)team;
    (void)text;
    (void)error;
    return 1;
}

static void collect(mk_team_t *team, const void *bytes, size_t length, void (*take)(void *, const void *, size_t), void *context) {
    (void)team;
    take(context, bytes, length);
}

static void spread(mk_team_t *team, void *bytes, size_t length) {
    (void)team;
    (void)bytes;
    (void)length;
}

/* A small network is near itself in any order. */
static int divide(mk_team_t *team, const mk_scenario_t *scenario, size_t real_size, mk_topology_t *topology, mk_error_t *error) {
    (void)real_size;
    (void)error;
    *topology = mk_distributed_topology(scenario);
    if (scenario->nodes < FEW_NODES) return 1;
    mk_division_t *division = team->context = mk_allocate(1, sizeof *division);
    int *part = mk_allocate((size_t)scenario->nodes, sizeof *part);
    mk_division_make(division, scenario, part, 1, 0);
    free(part);
    *topology = division->topology;
    return 1;
}

static void release(mk_team_t *team, mk_topology_t *topology) {
    (void)topology;
    if (team->context) mk_division_free(team->context);
    free(team->context);
    team->context = NULL;
}

static void sum(mk_team_t *team, mk_exact_t *sums, size_t count) {
    (void)team;
    (void)sums;
    (void)count;
}

static void begin(mk_team_t *team, mk_exchange_t stage, const void *send, void *receive) {
    (void)team;
    (void)stage;
    (void)send;
    (void)receive;
}

static void finish(mk_team_t *team) { (void)team; }

static void gather(mk_team_t *team, const mk_topology_t *topology, const void *local, const int *first, size_t width, void *all) {
    (void)team;
    const char *next = local;
    for (int e = 0; e < topology->estimators; e++) {
        const size_t k = (size_t)mk_topology_id(topology, e), from = first ? (size_t)first[k] : k, to = first ? (size_t)first[k + 1] : k + 1;
        memcpy((char *)all + from * width, next, (to - from) * width);
        next += (to - from) * width;
    }
}

mk_team_t mk_team_alone = {0, 1, agree, same, collect, spread, divide, release, sum, begin, finish, gather, 0.0, 0, NULL};
