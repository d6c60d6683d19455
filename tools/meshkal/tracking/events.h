/* SPDX-License-Identifier: MIT */
/*
 * Where truth and readings of a tracking run come from: drawn from the scenario, or recorded in CSV files. A run is a sequence of instants,
 * ascending in time.
 *
 * Drawn: one instant every dt_s, the first one dt_s after x0, also those without readings. x(t + dt_s) = g(x(t)) + w, readings
 * h(x) + v + fault.
 * Draws belong to (seed, run, node, step), not to the order in which they are made: filters and threads do not change them.
 *
 * Recorded: measurements, columns t,node,row,value, t in seconds: any times, in any order (logs of several nodes can stand one behind the
 * other). Equal times, as numbers, are one instant. A line that is there twice counts once; a second, different value for the same t, node and row
 * is refused; a reading with some rows missing is dropped whole. Both are counted. Truth, columns t,state,value, also at any times: an instant has
 * the values of the time nearest to it if that is within half the median interval of the truth's times, of equally near ones the earlier; else
 * it is unknown. Nothing is interpolated. Truth that no instant has is refused: its clock is another one.
 */
#ifndef MESHKAL_TRACKING_EVENTS_H
#define MESHKAL_TRACKING_EVENTS_H

#include "random.h"
#include "tracking/models.h"

typedef struct {
    int node;
    int faulty;      /* drawn with a fault; 0 if recorded */
    const double *z; /* its rows */
} mk_reading_t;

typedef struct {
    double t;  /* s */
    double dt; /* since the instant before, or since x0 */
    int count;
    const mk_reading_t *reading; /* ascending in node */
    const double *x;             /* truth, n numbers; NaN where unknown */
    /* drawn */
    int lost_together;     /* 1: no reading of this instant arrived */
    int lost;              /* readings lost, singly or together */
    int out_of_range;      /* sensors that do not reach the target */
} mk_instant_t;

/* Does the sensor of node k, which has one, reach a target with the state x? */
int mk_in_range(const mk_scenario_t *scenario, int k, const double *x);

/* The same for all runs and threads. */
typedef struct mk_events mk_events_t;

/* models, which must outlive it, is for truth. */
mk_events_t *mk_events_draw(const mk_models_f64_t *models, uint64_t seed, long steps);
/* truth null: none. steps: instants at most, 0: all. x0 and P0 hold at model.start_s, or else at the first instant. Null and an error. */
mk_events_t *mk_events_record(const mk_models_f64_t *models, const char *measurements, const char *truth, long steps, mk_error_t *error);
void mk_events_free(mk_events_t *events);

typedef struct {
    int drawn, has_truth;
    long steps;             /* instants of a run */
    double start_s;         /* time of x0 */
    long readings, dropped; /* recorded: used, dropped for missing rows */
    long repeated;          /* recorded: lines of both files that were there before */
    long with_truth;        /* recorded: instants that have some */
    long half;              /* the instant that the second half begins with; recorded, with truth: of those that have some */
    double longest_gap_s, longest_gap_from_s; /* recorded: between instants; time of the one before it */
    double last_s;          /* recorded: time of the last instant */
    uint64_t known;         /* bit i: state i has truth, somewhere */
    const char *sha256;     /* of recorded times, readings and truth; empty if drawn */
} mk_events_facts_t;
mk_events_facts_t mk_events_facts(const mk_events_t *events);

/* One run under way; one for each thread. */
typedef struct {
    const mk_events_t *events;
    int run;
    long step;            /* of the next instant, from 1 */
    double t;
    double *x, *next, *z; /* n, n, all rows */
    mk_reading_t *reading;
    double *estimate;     /* n: the common initial estimate of this run, with covariance P0 */
    const double *truth;  /* x at start_s; null if recorded */
} mk_run_events_t;

void mk_run_events_open(mk_run_events_t *stream, const mk_events_t *events);
void mk_run_events_close(mk_run_events_t *stream);
/* Starts a run from 0 up; may be called again for another one. */
void mk_run_events_start(mk_run_events_t *stream, int run);
/* The next instant, valid until the next call. 1; 0: the run is over; -1 and an error: the drawn truth left the domain of a model, or the
   numbers. */
int mk_run_events_next(mk_run_events_t *stream, mk_instant_t *instant, mk_error_t *error);

#endif
