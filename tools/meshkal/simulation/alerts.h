/* SPDX-License-Identifier: MIT */
/* What the monitors of a run found, beside the faults that the scenario puts into it. */
#ifndef MESHKAL_ALERTS_H
#define MESHKAL_ALERTS_H

#include "design/node_config.h"
#include "host_monitor.h"
#include "simulation/team.h"

/* Faults that are followed, at most. */
#define MK_MOST_FOLLOWED 64

/* Of a run, counts over all estimators. Clean: before the first fault of the scenario begins, or always without faults. What comes later is
   not counted: estimates that a fault has spoilt travel further than the readings of its sensor. */
enum {
    MK_ALERT_CLEAN,     /* clean node-steps */
    MK_ALERT_FALSE,     /* of those, in alarm */
    MK_ALERT_BEGUN,     /* alarms that began in them */
    MK_ALERT_MISTAKEN,  /* exclusions that began in them */
    MK_ALERT_WRONG,     /* exclusions that began later, of a sensor without fault in the window */
    MK_ALERT_REFUSED,   /* epochs that a monitor could not take */
    MK_ALERT_COUNTS
};

/* Then of each fault, in this order. Times in seconds since it began, of the end since it was over: infinite where it never came about, NaN where
   there is no estimator that could. Median: over the estimators that hear the sensor (of the end: that held it faulty then). Isolated: excluded, or,
   by the other schemes, the sensor whose leaving out takes most from AIME in alarm. The end: of exclude that the sensor is back, of aime-improved the
   declared end. */
enum {
    MK_FOUND_HEARING, /* estimators that hear the sensor */
    MK_FOUND_ALARMED, /* of those, that were in alarm while it lasted */
    MK_FOUND_ALARM_FIRST,
    MK_FOUND_ALARM_MEDIAN,
    MK_FOUND_ISOLATED, /* that isolated the sensor while it lasted */
    MK_FOUND_ISOLATED_FIRST,
    MK_FOUND_ISOLATED_MEDIAN,
    MK_FOUND_HELD, /* that had it for faulty when it was over */
    MK_FOUND_ENDED, /* of those, that found the end */
    MK_FOUND_ENDED_FIRST,
    MK_FOUND_ENDED_MEDIAN,
    MK_FOUND_EARLY, /* ends that were found while it lasted */
    MK_FOUND_COUNT
};

/* Numbers of a run: MK_ALERT_COUNTS, then MK_FOUND_COUNT for each fault. */
size_t mk_alerts_numbers(const mk_scenario_t *scenario);

typedef struct {
    const mk_scenario_t *scenario;
    const mk_topology_t *topology; /* of the part that this process holds */
    int scheme;
    double window_s;
    mk_monitor_snapshot_t snapshot;
    size_t width;         /* numbers of an estimator's row */
    double *row, *whole;  /* whole: of all parts */
    uint8_t *was_alarm, *was_excluded;
    uint32_t *rejected;
} mk_alerts_t;

/* total: estimators of all parts. */
void mk_alerts_open(mk_alerts_t *alerts, const mk_scenario_t *scenario, const mk_topology_t *topology, const mk_monitor_settings_t *settings,
                    size_t real_size, int total);
void mk_alerts_close(mk_alerts_t *alerts);
/* A new run. */
void mk_alerts_start(mk_alerts_t *alerts);
/* The estimators begin .. end - 1 at step t, of which snapshot and rejected tell. Several threads may do this at once. */
void mk_alerts_take(mk_alerts_t *alerts, int t, int begin, int end);
/* The numbers of the run, on rank 0; all processes of the team together. */
void mk_alerts_finish(mk_alerts_t *alerts, mk_team_t *team, int total, double *numbers);

#endif
