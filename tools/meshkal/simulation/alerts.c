/* SPDX-License-Identifier: MIT */
#include "simulation/alerts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_faults.h"
#include "simulation/statistics.h"

/* An estimator's row: MK_ALERT_COUNTS, then of each fault. NaN in ALARM: it does not hear the sensor. */
enum { ALARM, ISOLATED, ENDED, EARLY, TIMES };

size_t mk_alerts_numbers(const mk_scenario_t *s) { return MK_ALERT_COUNTS + (size_t)s->faults * MK_FOUND_COUNT; }

void mk_alerts_open(mk_alerts_t *a, const mk_scenario_t *s, const mk_topology_t *topology, const mk_monitor_settings_t *settings, size_t real_size,
                    int total) {
    const size_t E = (size_t)topology->estimators, slots = (size_t)topology->first[E];
    a->scenario = s;
    a->topology = topology;
    a->scheme = settings->scheme;
    a->window_s = settings->window * s->dt_s;
    a->snapshot = mk_monitor_snapshot_make(real_size, settings->scheme, topology->estimators, slots);
    a->width = MK_ALERT_COUNTS + (size_t)s->faults * TIMES;
    a->row = mk_allocate(E * a->width, sizeof *a->row);
    a->whole = mk_allocate((size_t)total * (a->width + 1), sizeof *a->whole); /* and what is sorted for a median */
    a->was_alarm = mk_allocate(E, 1);
    a->was_excluded = mk_allocate(slots, 1);
    a->rejected = mk_allocate(E, sizeof *a->rejected);
}

void mk_alerts_close(mk_alerts_t *a) {
    mk_monitor_snapshot_free(&a->snapshot);
    free(a->row);
    free(a->whole);
    free(a->was_alarm);
    free(a->was_excluded);
    free(a->rejected);
}

/* Slot of estimator e that hears node k; -1. */
static int slot_of(const mk_topology_t *topology, int e, int k) {
    for (int i = topology->first[e]; i < topology->first[e + 1]; i++)
        if (topology->slot[i] == k) return i;
    return -1;
}

void mk_alerts_start(mk_alerts_t *a) {
    const mk_scenario_t *s = a->scenario;
    const mk_topology_t *topology = a->topology;
    const size_t E = (size_t)topology->estimators;
    memset(a->row, 0, E * a->width * sizeof *a->row);
    memset(a->was_alarm, 0, E);
    memset(a->was_excluded, 0, (size_t)topology->first[E]);
    for (int e = 0; e < topology->estimators; e++)
        for (int f = 0; f < s->faults; f++) {
            double *const times = a->row + (size_t)e * a->width + MK_ALERT_COUNTS + f * TIMES;
            const int hears = slot_of(topology, e, s->fault[f].node) >= 0;
            times[ALARM] = times[ISOLATED] = hears ? (double)INFINITY : (double)NAN;
            times[ENDED] = (double)NAN;
        }
}

/* The window may hold readings of a faulty node k. */
static int is_guilty(const mk_alerts_t *a, int k, double t_s) {
    const mk_scenario_t *s = a->scenario;
    for (int f = 0; f < s->faults; f++)
        if (s->fault[f].node == k && t_s > s->fault[f].from_s && t_s <= s->fault[f].to_s + a->window_s) return 1;
    return 0;
}

static int is_largest(const mk_alerts_t *a, int e, int slot) {
    for (int i = a->topology->first[e]; i < a->topology->first[e + 1]; i++)
        if (mk_monitor_isolation(&a->snapshot, i) > mk_monitor_isolation(&a->snapshot, slot)) return 0;
    return mk_monitor_isolation(&a->snapshot, slot) > 0.0;
}

static void follow(mk_alerts_t *a, int e, const mk_sensor_fault_t *fault, double t_s, double *times) {
    const mk_monitor_snapshot_t *snapshot = &a->snapshot;
    const int slot = slot_of(a->topology, e, fault->node);
    if (slot < 0 || t_s <= fault->from_s) return;
    const int excludes = a->scheme == MK_MONITOR_EXCLUDE, alarm = snapshot->alarm[e], on = mk_fault_is_on(fault, t_s);
    const int isolated = excludes ? snapshot->excluded[slot] : alarm && is_largest(a, e, slot);
    const int ended = excludes ? a->was_excluded[slot] && !snapshot->excluded[slot] : a->scheme == MK_MONITOR_IMPROVED && snapshot->ended[e];
    if (!on) {
        if (isinf(times[ENDED]) && ended) times[ENDED] = t_s - fault->to_s;
        return;
    }
    if (alarm && isinf(times[ALARM])) times[ALARM] = t_s - fault->from_s;
    if (isolated && isinf(times[ISOLATED])) times[ISOLATED] = t_s - fault->from_s;
    times[EARLY] += ended;
    const int held = excludes ? snapshot->excluded[slot] : a->scheme == MK_MONITOR_IMPROVED && !isinf(times[ALARM]);
    times[ENDED] = held ? (double)INFINITY : (double)NAN;
}

void mk_alerts_take(mk_alerts_t *a, int t, int begin, int end) {
    const mk_scenario_t *s = a->scenario;
    const mk_topology_t *topology = a->topology;
    const double t_s = t * s->dt_s;
    int clean = 1;
    for (int f = 0; f < s->faults; f++) clean &= !mk_fault_is_on(&s->fault[f], t_s) && t_s <= s->fault[f].from_s;
    for (int e = begin; e < end; e++) {
        double *const row = a->row + (size_t)e * a->width;
        const int alarm = a->snapshot.alarm[e];
        row[MK_ALERT_CLEAN] += clean;
        row[MK_ALERT_FALSE] += clean && alarm;
        row[MK_ALERT_BEGUN] += clean && alarm && !a->was_alarm[e];
        row[MK_ALERT_REFUSED] = a->rejected[e];
        for (int f = 0; f < s->faults; f++) follow(a, e, &s->fault[f], t_s, row + MK_ALERT_COUNTS + f * TIMES);
        a->was_alarm[e] = (uint8_t)alarm;
        for (int i = topology->first[e]; i < topology->first[e + 1]; i++) {
            const uint8_t excluded = a->snapshot.excluded[i];
            if (excluded && !a->was_excluded[i]) {
                row[MK_ALERT_MISTAKEN] += clean;
                row[MK_ALERT_WRONG] += !clean && !is_guilty(a, topology->slot[i], t_s);
            }
            a->was_excluded[i] = excluded;
        }
    }
}

/* Of those that are numbers: how many are finite, the least and the median. Returns how many there are. */
static double summarise(const mk_alerts_t *a, int total, size_t column, double *sorted, double *finite, double *least, double *median) {
    size_t count = 0;
    *finite = 0.0;
    *least = *median = (double)NAN;
    for (int e = 0; e < total; e++) {
        const double value = a->whole[(size_t)e * a->width + column];
        if (isnan(value)) continue;
        sorted[count++] = value;
        *finite += !isinf(value);
    }
    if (count == 0) return 0.0;
    mk_sort(sorted, count);
    *least = sorted[0];
    *median = mk_median(sorted, count);
    return (double)count;
}

void mk_alerts_finish(mk_alerts_t *a, mk_team_t *team, int total, double *numbers) {
    double *const sorted = a->whole + (size_t)total * a->width;
    team->gather(team, a->topology, a->row, NULL, a->width * sizeof *a->row, a->whole);
    for (size_t i = 0; i < MK_ALERT_COUNTS; i++) {
        numbers[i] = 0.0;
        for (int e = 0; e < total; e++) numbers[i] += a->whole[(size_t)e * a->width + i];
    }
    for (int f = 0; f < a->scenario->faults; f++) {
        double *const found = numbers + MK_ALERT_COUNTS + f * MK_FOUND_COUNT;
        const size_t column = MK_ALERT_COUNTS + (size_t)f * TIMES;
        found[MK_FOUND_HEARING] =
            summarise(a, total, column + ALARM, sorted, &found[MK_FOUND_ALARMED], &found[MK_FOUND_ALARM_FIRST], &found[MK_FOUND_ALARM_MEDIAN]);
        (void)summarise(a, total, column + ISOLATED, sorted, &found[MK_FOUND_ISOLATED], &found[MK_FOUND_ISOLATED_FIRST],
                        &found[MK_FOUND_ISOLATED_MEDIAN]);
        found[MK_FOUND_HELD] =
            summarise(a, total, column + ENDED, sorted, &found[MK_FOUND_ENDED], &found[MK_FOUND_ENDED_FIRST], &found[MK_FOUND_ENDED_MEDIAN]);
        found[MK_FOUND_EARLY] = 0.0;
        for (int e = 0; e < total; e++) found[MK_FOUND_EARLY] += a->whole[(size_t)e * a->width + column + EARLY];
    }
}
