/* SPDX-License-Identifier: MIT */
/* The processes that work on one campaign. A program without others is a team of one. With several, either every process holds the whole
   network and they share out the runs, or every process holds a part of the network and they exchange what nodes send each other. */
#ifndef MESHKAL_TEAM_H
#define MESHKAL_TEAM_H

#include "design/node_config.h"
#include "exact_sum.h"

typedef enum { MK_EXCHANGE_READINGS, MK_EXCHANGE_ESTIMATES, MK_EXCHANGES } mk_exchange_t;

/* Every function is called by all processes of the team together. */
typedef struct mk_team mk_team_t;
struct mk_team {
    int rank, ranks;
    /* 1 on all if good on all; else 0 on all, with the error of the lowest rank that failed. */
    int (*agree)(mk_team_t *team, int good, mk_error_t *error);
    /* 1 if all hold the same text, pairs of a name and a value between blanks; else 0 and an error that names the first pair that differs. */
    int (*same)(mk_team_t *team, const char *text, mk_error_t *error);
    /* Rank 0 calls take(context, bytes, length) for what every rank brings, in the order of ranks; the others only bring. */
    void (*collect)(mk_team_t *team, const void *bytes, size_t length, void (*take)(void *context, const void *bytes, size_t length), void *context);
    /* The bytes of rank 0 on all. */
    void (*spread)(mk_team_t *team, void *bytes, size_t length);

    /* --- a network in parts --- */
    /* This process's part of a distributed network, in *topology (release gives it back); psi of real_size. 1, or 0 on all and an error. */
    int (*divide)(mk_team_t *team, const mk_scenario_t *scenario, size_t real_size, mk_topology_t *topology, mk_error_t *error);
    void (*release)(mk_team_t *team, mk_topology_t *topology);
    /* Sums of all parts, on all. */
    void (*sum)(mk_team_t *team, mk_exact_t *sums, size_t count);
    /* Begins to exchange the values of topology.send, one after another, for those of topology.halo: rows as doubles, or psi. Neither buffer
       is touched until finish has returned. */
    void (*begin)(mk_team_t *team, mk_exchange_t stage, const void *send, void *receive);
    void (*finish)(mk_team_t *team);
    /* Values of all estimators of all parts, in the order of their numbers, on rank 0. Estimator e has (first ? first[e + 1] - first[e] : 1)
       elements of `width` bytes; `local` holds those of this part in its order; `all` may be null on other ranks. */
    void (*gather)(mk_team_t *team, const mk_topology_t *topology, const void *local, const int *first, size_t width, void *all);
    /* Facts of the division for the report. */
    double bytes_a_step;  /* sent by all ranks */
    long cut_edges;
    void *context;
};

extern mk_team_t mk_team_alone;

#endif
