/* SPDX-License-Identifier: MIT */
/* What a run of a tracking filter leaves behind, and the figures of many runs. */
#ifndef MESHKAL_TRACKING_TRACK_RECORD_H
#define MESHKAL_TRACKING_TRACK_RECORD_H

#include "tracking/tracker.h"

/* Single numbers of a run. Those of the window are over its steps, from the one that the campaign names to the last, and over estimators. */
enum {
    MK_TRACK_POSITION,     /* window: mean of |position error|^2; NaN without truth or position */
    MK_TRACK_VELOCITY,     /* the same of the velocity */
    MK_TRACK_NEES,         /* window: mean */
    MK_TRACK_NIS,          /* window: sum of normalised innovations squared, and their degrees of freedom */
    MK_TRACK_NIS_ROWS,
    MK_TRACK_APART_SQUARE, /* window: mean square of the disagreement */
    MK_TRACK_TARGET_LOST,  /* 1: at the end the position error is above the campaign's limit */
    MK_TRACK_READINGS,     /* taken by sensors that reached the target and were not lost by the scenario */
    MK_TRACK_SCENARIO_LOST,
    MK_TRACK_OUT_OF_RANGE,
    MK_TRACK_FAULTY,
    MK_TRACK_COUNT,        /* the counts of mk_track_look_t */
    MK_TRACK_SINGLE = MK_TRACK_COUNT + MK_TRACK_COUNTS
};

/* One block of `count` numbers. */
typedef struct {
    long steps;
    int estimators;
    size_t count;
    double *value;
    double *single;                                   /* MK_TRACK_SINGLE */
    double *position, *velocity, *apart, *nees;       /* steps: mean squares over estimators; disagreement; mean NEES */
    double *time;                                     /* steps: s */
    double *node_position, *node_velocity, *node_nees; /* estimators: means over the window */
} mk_track_record_t;

void mk_track_record_open(mk_track_record_t *record, long steps, int estimators);
void mk_track_record_close(mk_track_record_t *record);

/* Mean and sum of squared differences from it, run by run (Welford): the same bits for the same runs in the same order. largest: of each number
   over the runs. */
typedef struct {
    int runs;
    mk_track_record_t mean, squares, largest;
} mk_track_statistics_t;

void mk_track_statistics_open(mk_track_statistics_t *statistics, long steps, int estimators);
void mk_track_statistics_close(mk_track_statistics_t *statistics);
void mk_track_statistics_add(mk_track_statistics_t *statistics, const double *value);

/* What a step says of its errors. Disagreement: the largest distance between the positions of two estimators. */
typedef struct {
    double position, velocity, nees, apart; /* means over estimators of squares and NEES; NaN where unknown */
    double *node_position, *node_velocity, *node_nees, *error; /* E; error: of all states whose truth is known */
} mk_track_errors_t;

/* x: truth, NaN where unknown; null: all unknown. NEES: of the states that truth has somewhere (setting->known); NaN where one of them is unknown
   now. The arrays of *errors are the caller's; work: 2 packed n + n numbers. */
void mk_track_judge(const mk_track_setting_t *setting, const mk_track_look_t *look, const double *x, mk_track_errors_t *errors, double *work);

#endif
