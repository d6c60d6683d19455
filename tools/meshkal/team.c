/* SPDX-License-Identifier: MIT */
#include "team.h"

#include <string.h>

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

static int divide(mk_team_t *team, const mk_scenario_t *scenario, size_t real_size, mk_topology_t *topology, mk_error_t *error) {
    (void)team;
    (void)real_size;
    (void)error;
    *topology = mk_distributed_topology(scenario);
    return 1;
}

static void release(mk_team_t *team, mk_topology_t *topology) {
    (void)team;
    (void)topology;
}

static void sum(mk_team_t *team, mk_exact_t *sums, size_t count) {
    (void)team;
    (void)sums;
    (void)count;
}

static void begin(mk_team_t *team, mk_stage_t stage, const void *send, void *receive) {
    (void)team;
    (void)stage;
    (void)send;
    (void)receive;
}

static void finish(mk_team_t *team) { (void)team; }

static void gather(mk_team_t *team, const mk_topology_t *topology, const void *local, const int *first, size_t width, void *all) {
    (void)team;
    const size_t elements = first ? (size_t)first[topology->estimators] : (size_t)topology->estimators;
    memcpy(all, local, elements * width);
}

mk_team_t mk_team_alone = {0, 1, agree, same, collect, spread, divide, release, sum, begin, finish, gather, 0.0, 0, NULL};
