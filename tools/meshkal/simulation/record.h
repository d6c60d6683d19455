/* SPDX-License-Identifier: MIT */
/* What a run leaves behind, and the figures of many runs. */
#ifndef MESHKAL_SIMULATION_RECORD_H
#define MESHKAL_SIMULATION_RECORD_H

#include <stddef.h>

/* One block of `count` numbers, all of them means over the run: over its steps, the second half of them where "steady". Squares are of errors
   x - xh. NaN without truth or position. */
typedef struct {
    int n, steps, estimators;
    size_t count;
    double *value;
    double *steady, *position_steady; /* mean over estimators of the squared deviation; of the position states */
    double *theta, *tolerance, *nis_ratio; /* steady; nis divided by its degrees of freedom */
    double *state_square;                  /* each state, over all steps and estimators of which the truth is known */
    double *msd, *position_msd;            /* over time, mean over estimators */
    double *node_msd;                      /* steady, one an estimator */
    /* Of a scenario with faults: MK_PHASES numbers, mean over steps and estimators of the squared deviation; of monitors: simulation/alerts.h. */
    size_t phases, alerts;
    double *phase_msd, *alert;
} mk_record_t;

/* The second half of the steps before the first fault, until the last one is over, afterwards. */
enum { MK_BEFORE, MK_DURING, MK_AFTER, MK_PHASES };

/* phases: MK_PHASES or 0; alerts: numbers of monitors. */
void mk_record_open(mk_record_t *record, int n, int steps, int estimators, size_t phases, size_t alerts);
void mk_record_close(mk_record_t *record);

/* Of mk_welford: the same bits for the same runs in the same order. */
typedef struct {
    int runs, room;
    mk_record_t mean, squares;
    double *alert; /* runs x alerts */
} mk_statistics_t;

/* Dimensions as those of a record; alerts of all runs are kept one after another as well. */
void mk_statistics_open(mk_statistics_t *statistics, const mk_record_t *like);
void mk_statistics_close(mk_statistics_t *statistics);
void mk_statistics_add(mk_statistics_t *statistics, const double *value);
/* After the last run: half-widths of 95 % confidence intervals of the means (Student) in place of the squares; NaN for fewer than two runs. */
void mk_statistics_finish(mk_statistics_t *statistics);

#endif
