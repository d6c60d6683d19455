/* SPDX-License-Identifier: MIT */
/* What a run of a navigation filter leaves behind, and the figures of many runs. */
#ifndef MESHKAL_NAVIGATION_NAV_RECORD_H
#define MESHKAL_NAVIGATION_NAV_RECORD_H

#include "navigation/navigator.h"

/* Single numbers of a run. Window: its epochs, from the one that the campaign names to the last. */
enum {
    MK_NAV_MEAN_POSITION, /* window: mean of |error|^2; NaN without truth */
    MK_NAV_MEAN_VELOCITY,
    MK_NAV_MEAN_ATTITUDE,
    MK_NAV_MEAN_NEES,
    MK_NAV_SUM_NIS,       /* window: sum of normalised innovations squared, and their degrees of freedom */
    MK_NAV_SUM_NIS_ROWS,
    MK_NAV_WEIGHT_FAULTY, /* mean weight of the faulty satellite while its fault is on, and of all readings else; NaN where there is none */
    MK_NAV_WEIGHT_OTHERS,
    MK_NAV_FIRST_COUNT,   /* the counts of mk_nav_look_t */
    MK_NAV_SINGLE = MK_NAV_FIRST_COUNT + MK_NAV_COUNTS
};

/* One block of `count` numbers. */
typedef struct {
    long steps;
    size_t count;
    double *value;
    double *single;                                    /* MK_NAV_SINGLE */
    double *time, *position, *velocity, *nees;         /* steps: s; squares; NaN where unknown */
    double *innovation, *weight;                       /* steps: of the faulty satellite; NaN where it was not read */
    double *alarm;                                     /* steps: 1 in alarm */
} mk_nav_record_t;

void mk_nav_record_open(mk_nav_record_t *record, long steps);
void mk_nav_record_close(mk_nav_record_t *record);

/* Fault-free until `from_s`, over after `to_s`; infinite where there is no fault, or no end. node: of the first one, or 0. */
typedef struct {
    int exists, node;
    double from_s, to_s;
} mk_nav_fault_span_t;
mk_nav_fault_span_t mk_nav_fault_span(const mk_scenario_t *scenario);

/* What the monitor said in a run. Times NaN where there is none. */
enum { MK_NAV_MOST_ENDS = 16 };
typedef struct {
    double alarm_s;             /* the first alarm after the fault began (without a fault: at all) */
    double last_alarm_s;        /* the last one */
    double first_false_s;       /* the first one before that */
    int isolated;               /* number of the satellite that was excluded first after it (exclude), or had the largest statistic then; 0: none */
    long false_alarms, clean;   /* epochs in alarm before any fault, of so many */
    long late_alarms, after;    /* epochs in alarm after the fault, of so many */
    long during;                /* epochs in alarm while it was on */
    double end_s[MK_NAV_MOST_ENDS];
    int ends;                   /* decisions that it is over, the first of them in end_s */
    double innovation_at_end;   /* m: of the faulty satellite in the fault's last epoch */
} mk_nav_story_t;

void mk_nav_story_start(mk_nav_story_t *story);
/* One epoch. */
void mk_nav_story_add(mk_nav_story_t *story, const mk_scenario_t *scenario, const mk_nav_fault_span_t *span, const mk_epoch_t *epoch,
                      const mk_nav_look_t *look);

/* Errors of an epoch: squares; NaN where unknown. */
typedef struct {
    double position, velocity, attitude, nees;
} mk_nav_errors_t;
mk_nav_errors_t mk_nav_judge(const mk_epoch_t *epoch, const mk_nav_look_t *look);

/* Of means over runs that know a value: the same bits for the same runs in the same order. */
typedef struct {
    int runs;
    mk_nav_record_t mean, squares, known; /* known: runs that have a number */
} mk_nav_statistics_t;

void mk_nav_statistics_open(mk_nav_statistics_t *statistics, long steps);
void mk_nav_statistics_close(mk_nav_statistics_t *statistics);
void mk_nav_statistics_add(mk_nav_statistics_t *statistics, const double *value);

#endif
