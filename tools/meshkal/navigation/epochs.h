/* SPDX-License-Identifier: MIT */
/*
 * Where truth, inertial samples and pseudoranges of a navigation run come from: drawn from the scenario, or recorded in CSV files. A run is a sequence
 * of epochs, ascending in time.
 *
 * Drawn: one epoch every dt_s, the first one dt_s after start_s. The flight is that of flight.h in every run; biases, clock, noise and the error
 * of the initial estimate are drawn. Pseudorange: distance to the satellite, clock bias, noise, fault. A satellite stands still at satellite_range_m from
 * the origin in its direction: in 418 s it would go 1600 km, which turns its line of sight by a few degrees; the experiment has none of that.
 * Draws belong to (seed, run, satellite, epoch): filters and threads do not change them.
 *
 * Recorded: pseudoranges, columns t,satellite,value,x,y,z: satellite numbers of the scenario, ranges and positions in metres in the local frame;
 * any of them in each epoch; an empty or NaN value is none. Samples, columns t,wx,wy,wz,fx,fy,fz: means over the interval that ends at t and
 * begins at the t before it; they fill the time from start_s to the last epoch, and an interval is cut where an epoch lies within. Truth: columns
 * MK_NAV_TRUTH_COLUMNS, empty or NaN where unknown: an epoch has the line nearest in time, if that is within half the mean interval of these lines.
 * Times ascend. The scenario's faults are added.
 */
#ifndef MESHKAL_NAVIGATION_EPOCHS_H
#define MESHKAL_NAVIGATION_EPOCHS_H

#include "navigation/strapdown.h"

#define MK_NAV_PSEUDORANGE_COLUMNS {"t", "satellite", "value", "x", "y", "z"}
#define MK_NAV_INERTIAL_COLUMNS {"t", "wx", "wy", "wz", "fx", "fy", "fz"}
#define MK_NAV_TRUTH_COLUMNS                                                                                                  \
    {"t", "roll", "pitch", "heading", "ve", "vn", "vu", "pe", "pn", "pu", "gx", "gy", "gz", "ax", "ay", "az", "clock_bias", "clock_drift"}

typedef struct {
    double t, dt;                  /* s; dt: since the epoch before, or since start_s */
    long samples;
    const mk_inertial_t *inertial; /* they fill dt */
    const uint8_t *have;           /* nodes */
    const double *value;           /* nodes: m; NaN where none */
    const double (*satellite)[3];  /* nodes: m, in the local frame; NaN where none */
    const double *fault;           /* nodes: part of the value that was added */
    const mk_nav_state_t *truth;   /* NaN where unknown; null: all unknown */
} mk_epoch_t;

/* The same for all runs and threads. */
typedef struct mk_epochs mk_epochs_t;

/* Null and an error: too many samples. The scenario must outlive it. */
mk_epochs_t *mk_epochs_draw(const mk_scenario_t *scenario, uint64_t seed, long steps, mk_error_t *error);
/* truth null: none. steps: epochs at most, 0: all. */
mk_epochs_t *mk_epochs_record(const mk_scenario_t *scenario, const char *measurements, const char *inertial, const char *truth, long steps,
                              mk_error_t *error);
void mk_epochs_free(mk_epochs_t *epochs);

typedef struct {
    int drawn, has_truth;
    long steps;                 /* epochs of a run */
    double start_s, last_s;
    double gap_s, gap_from_s;   /* recorded: the longest interval of samples; its begin */
    double interval_s;          /* recorded: their mean interval */
    long readings, with_truth;  /* recorded: pseudoranges; epochs that have some truth */
    int fewest;                 /* recorded: pseudoranges in an epoch; drawn: all */
    const char *sha256;         /* of the recorded numbers; empty if drawn */
} mk_epochs_facts_t;
mk_epochs_facts_t mk_epochs_facts(const mk_epochs_t *epochs);

/* One run under way; one for each thread. */
typedef struct {
    const mk_epochs_t *epochs;
    int run;
    long step;               /* of the next epoch, from 1 */
    double t;
    mk_nav_state_t truth, estimate; /* estimate: the initial one; truth of recorded runs: of the last epoch */
    long row;                /* recorded: next sample */
    long room;
    mk_inertial_t *inertial;
    uint8_t *have;
    double *value, (*satellite)[3], *fault;
} mk_run_epochs_t;

void mk_run_epochs_open(mk_run_epochs_t *stream, const mk_epochs_t *epochs);
void mk_run_epochs_close(mk_run_epochs_t *stream);
/* Starts a run from 0 up; may be called again for another one. */
void mk_run_epochs_start(mk_run_epochs_t *stream, int run);
/* The next epoch, valid until the next call. 0: the run is over. */
int mk_run_epochs_next(mk_run_epochs_t *stream, mk_epoch_t *epoch);

#endif
