/* SPDX-License-Identifier: MIT */
/* Monte Carlo runs of one filter, one after another, on a network that this process holds alone or with a team. */
#ifndef MESHKAL_RUNNER_H
#define MESHKAL_RUNNER_H

#include "simulation/alerts.h"
#include "simulation/campaign.h"
#include "simulation/node_records.h"
#include "simulation/ordered_runs.h"

typedef struct {
    const mk_campaign_t *c;
    const mk_source_t *source;
    mk_team_t *team;               /* that shares this network */
    const mk_topology_t *topology; /* of the part that this process holds */
    int total;                     /* estimators of all parts */
    mk_node_records_t *records;    /* of the first run; null: none */
    const double *schedule;        /* tolerances of each step, estimators of the part; null: as they were given */
    mk_stream_t stream;
    mk_alerts_t alerts; /* with a monitor */
    void *net;
    mk_snapshot_t snapshot;
    size_t slots;
    uint8_t *y_arrived, *psi_arrived;
    int threads; /* for what is done beside the network's own steps */
    double *estimate; /* a chunk for each of them */
    double *error, *node_square, *state_square, *state_known;
    /* Sums over estimators of some steps, waiting to be added up with those of the other parts; the first says who is in trouble. */
    mk_exact_t *sums;
    mk_exact_t *thread_sums; /* of the step, by threads but the first */
    int nis_steps;     /* of the steady half: those in which some estimator had a nis */
    int waiting, from; /* steps that wait, the first of them */
    unsigned char *send, *receive, *gathered;
    double *own_y; /* rows of the part's own sensors; null where the process holds all */
    int *own_first; /* of the rows of each estimator's own sensors; null without a log */
    int64_t failed; /* where this part failed first, in the order in which one process would have met it; -1: nowhere */
    int bad;
    long steps_done;
} mk_runner_t;

/* tolerance and schedule (steps x estimators, or null): of the part; they and the topology stay the caller's, to the end. threads work on
   each step. */
void mk_runner_open(mk_runner_t *runner, const mk_campaign_t *c, const mk_source_t *source, mk_team_t *team, const mk_topology_t *topology,
                    const double *tolerance, const double *schedule, int threads);
void mk_runner_close(mk_runner_t *runner);

/* Whether its estimators have monitors. */
int mk_runner_watches(const mk_runner_t *runner);

/* Parts of a run (runner_log.c): step t into the log, which only rank 0 has; bytes of the longest array that is gathered for it. */
void mk_runner_log(mk_runner_t *runner, mk_run_log_t *log, int run, int t);
size_t mk_runner_log_room(const mk_runner_t *runner);

/* One run into *record (complete on rank 0 of the team) and, item by item, into log if it is not null: only rank 0 has one, and only if the
   campaign has a log. progress, if not null, is called after each step. STOPPED: a signal came. FAILED: a node did, which the error names. */
mk_run_state_t mk_runner_run(mk_runner_t *runner, int run, mk_record_t *record, mk_run_log_t *log, void (*progress)(void *context, int t),
                             void *context, mk_error_t *error);

#endif
