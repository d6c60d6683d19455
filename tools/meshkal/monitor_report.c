/* SPDX-License-Identifier: MIT */
#include "monitor_report.h"

#include <math.h>
#include <stdlib.h>

#include "distributions.h"
#include "json_out.h"
#include "simulation/alerts.h"
#include "simulation/statistics.h"

static const char *const phases[MK_PHASES] = {"before", "during", "after"};

/* --- for programs ---------------------------------------------------------------------------------------------------------- */

/* One number of every run in which there was something to find, null where it never was. */
static json_t *of_runs(const mk_statistics_t *s, size_t i) {
    json_t *array = json_array();
    for (int run = 0; run < s->runs; run++) {
        const double value = s->alert[(size_t)run * s->mean.alerts + i];
        if (!isnan(value)) (void)json_array_append_new(array, mk_json_number(value));
    }
    return array;
}

static double sum_of_runs(const mk_statistics_t *s, size_t i) {
    double sum = 0.0;
    for (int run = 0; run < s->runs; run++) sum += s->alert[(size_t)run * s->mean.alerts + i];
    return sum;
}

static json_t *times_of(const mk_statistics_t *s, size_t hearing, size_t count, size_t least, size_t median) {
    json_t *object = json_object();
    mk_json_set(object, "estimators", mk_json_number(sum_of_runs(s, count)));
    mk_json_set(object, "of", mk_json_number(sum_of_runs(s, hearing)));
    mk_json_set(object, "first_s", of_runs(s, least));
    mk_json_set(object, "median_s", of_runs(s, median));
    return object;
}

static json_t *found(const mk_statistics_t *s, const mk_sensor_fault_t *fault, size_t at) {
    json_t *object = json_object();
    mk_json_set(object, "node", json_integer(fault->node));
    mk_json_set(object, "row", json_integer(fault->row));
    mk_json_set(object, "from_s", json_real(fault->from_s));
    mk_json_set_number(object, "to_s", fault->to_s);
    mk_json_set(object, "rate", json_real(fault->rate));
    mk_json_set(object, "step", json_real(fault->step));
    mk_json_set(object, "alarm", times_of(s, at + MK_FOUND_HEARING, at + MK_FOUND_ALARMED, at + MK_FOUND_ALARM_FIRST, at + MK_FOUND_ALARM_MEDIAN));
    mk_json_set(object, "isolated",
                times_of(s, at + MK_FOUND_HEARING, at + MK_FOUND_ISOLATED, at + MK_FOUND_ISOLATED_FIRST, at + MK_FOUND_ISOLATED_MEDIAN));
    mk_json_set(object, "ended", times_of(s, at + MK_FOUND_HELD, at + MK_FOUND_ENDED, at + MK_FOUND_ENDED_FIRST, at + MK_FOUND_ENDED_MEDIAN));
    mk_json_set(object, "early_ends", mk_json_number(sum_of_runs(s, at + MK_FOUND_EARLY)));
    return object;
}

void mk_report_alerts(json_t *object, const mk_campaign_t *c, const mk_result_t *r) {
    const mk_statistics_t *s = &r->statistics;
    for (size_t i = 0; i < s->mean.phases; i += MK_PHASES) {
        json_t *split = json_object();
        for (int phase = 0; phase < MK_PHASES; phase++) {
            const double pair[2] = {s->mean.phase_msd[phase], s->squares.phase_msd[phase]};
            mk_json_set(split, phases[phase], mk_json_numbers(pair, 2));
        }
        mk_json_set(object, "phase_msd", split);
    }
    if (c->monitor.scheme == MK_MONITOR_NONE) return;
    static const char *const counts[MK_ALERT_COUNTS] = {"clean_node_steps",   "false_alarm_node_steps", "false_alarms_begun",
                                                        "mistaken_exclusions", "wrong_exclusions",       "epochs_refused"};
    json_t *monitor = json_object(), *faults = json_array();
    double interval[2];
    for (size_t i = 0; i < MK_ALERT_COUNTS; i++) mk_json_set(monitor, counts[i], mk_json_number(sum_of_runs(s, i)));
    const double clean = sum_of_runs(s, MK_ALERT_CLEAN), alarms = sum_of_runs(s, MK_ALERT_FALSE);
    mk_share_interval(alarms, clean, 0.025, &interval[0], &interval[1]);
    mk_json_set(monitor, "false_alarm_rate", mk_json_number(alarms / clean));
    mk_json_set(monitor, "false_alarm_rate_ci95", mk_json_numbers(interval, 2));
    for (int f = 0; f < c->scenario->faults; f++)
        (void)json_array_append_new(faults, found(s, &c->scenario->fault[f], MK_ALERT_COUNTS + (size_t)f * MK_FOUND_COUNT));
    mk_json_set(monitor, "faults", faults);
    mk_json_set(object, "monitor", monitor);
}

/* --- for people ------------------------------------------------------------------------------------------------------------ */

static double member(json_t *object, const char *key) {
    json_t *value = json_object_get(object, key);
    return json_is_number(value) ? json_number_value(value) : (double)NAN;
}

static const char *name_of(json_t *filter) { return json_string_value(json_object_get(filter, "filter")); }

static void print_phases(FILE *out, json_t *filters) {
    (void)fprintf(out, "\nMSD [dB] of steps  %-21s %-21s %s\n", "before (second half)", "during the faults", "after");
    for (size_t i = 0; i < json_array_size(filters); i++) {
        json_t *filter = json_array_get(filters, i), *split = json_object_get(filter, "phase_msd");
        (void)fprintf(out, "%-17s", name_of(filter));
        for (int phase = 0; phase < MK_PHASES; phase++) {
            json_t *pair = json_object_get(split, phases[phase]);
            const double mean = json_number_value(json_array_get(pair, 0)), half = json_number_value(json_array_get(pair, 1));
            if (!(mean > 0.0)) (void)fprintf(out, "  %-20s", "-");
            else if (half > 0.0) (void)fprintf(out, "  %8.4f +- %-8.4f", 10.0 * log10(mean), half / mean * 10.0 / log(10.0));
            else (void)fprintf(out, "  %8.4f%-12s", 10.0 * log10(mean), "");
        }
        (void)fputs("\n", out);
    }
}

static void print_false_alarms(FILE *out, const mk_campaign_t *c, json_t *filters) {
    (void)fprintf(out, "\nMonitor %s, window %d steps, false alarm %g. Before any fault:\n", mk_monitor_name(c->monitor.scheme), c->monitor.window,
                  c->monitor.false_alarm);
    (void)fprintf(out, "%-8s %11s %9s %11s %25s %7s %11s %9s %8s\n", "filter", "node-steps", "in alarm", "rate", "95 % interval", "begun", "exclusions",
                  "of others", "refused");
    for (size_t i = 0; i < json_array_size(filters); i++) {
        json_t *filter = json_array_get(filters, i), *monitor = json_object_get(filter, "monitor");
        json_t *ci = json_object_get(monitor, "false_alarm_rate_ci95");
        (void)fprintf(out, "%-8s %11.0f %9.0f %11.3g    %9.3g to %9.3g %7.0f %11.0f %9.0f %8.0f\n", name_of(filter), member(monitor, "clean_node_steps"),
                      member(monitor, "false_alarm_node_steps"), member(monitor, "false_alarm_rate"), json_number_value(json_array_get(ci, 0)),
                      json_number_value(json_array_get(ci, 1)), member(monitor, "false_alarms_begun"), member(monitor, "mistaken_exclusions"),
                      member(monitor, "wrong_exclusions"), member(monitor, "epochs_refused"));
    }
    (void)fprintf(out, "exclusions: of a good sensor, before any fault; of others: of one that has no fault, later. Windows overlap, so that alarms "
                       "come in rows and the interval is too narrow.\n");
}

/* Median over runs; null is never. */
static void print_median(FILE *out, json_t *runs) {
    const size_t count = json_array_size(runs);
    double *value = mk_allocate(count, sizeof *value);
    for (size_t i = 0; i < count; i++) {
        json_t *number = json_array_get(runs, i);
        value[i] = json_is_number(number) ? json_number_value(number) : (double)INFINITY;
    }
    mk_sort(value, count);
    const double median = mk_median(value, count);
    if (isfinite(median)) (void)fprintf(out, " %8g", median);
    else (void)fprintf(out, " %8s", "never");
    free(value);
}

static void print_fault(FILE *out, json_t *filters, size_t f) {
    static const char *const events[] = {"alarm", "isolated", "ended"};
    for (size_t i = 0; i < json_array_size(filters); i++) {
        json_t *filter = json_array_get(filters, i);
        json_t *fault = json_array_get(json_object_get(json_object_get(filter, "monitor"), "faults"), f);
        if (i == 0) {
            (void)fprintf(out, "\nFault on node %.0f row %.0f from %g s", member(fault, "node"), member(fault, "row"), member(fault, "from_s"));
            if (isfinite(member(fault, "to_s"))) (void)fprintf(out, " to %g s", member(fault, "to_s"));
            (void)fprintf(out, ", %g + %g a second. Seconds since its begin, of the end since that: median of runs; share of the estimators that\n"
                               "hear the sensor (end: that held it)\n", member(fault, "step"), member(fault, "rate"));
            (void)fprintf(out, "%-8s %-28s %-28s %-28s %s\n", "", "alarm: first, median, share", "isolated", "end", "early ends");
        }
        (void)fprintf(out, "%-8s", name_of(filter));
        for (int event = 0; event < 3; event++) {
            json_t *times = json_object_get(fault, events[event]);
            const double of = member(times, "of");
            print_median(out, json_object_get(times, "first_s"));
            print_median(out, json_object_get(times, "median_s"));
            if (of > 0.0) (void)fprintf(out, " %8.2f  ", member(times, "estimators") / of);
            else (void)fprintf(out, " %8s  ", "-");
        }
        (void)fprintf(out, "%6.0f\n", member(fault, "early_ends"));
    }
}

/* Seconds are easily taken for steps. */
static void print_faults_outside(FILE *out, const mk_campaign_t *c) {
    const double last = (c->steps - 1) * c->scenario->dt_s;
    for (int f = 0; f < c->scenario->faults; f++)
        if (!(c->scenario->fault[f].from_s <= last))
            (void)fprintf(out, "\nfaults[%d] begins at %g s: after the last step, %.15g s\n", f, c->scenario->fault[f].from_s, last);
}

void mk_report_alert_tables(FILE *out, const mk_campaign_t *c, json_t *filters) {
    if (json_array_size(filters) == 0) return;
    if (c->scenario->faults) print_phases(out, filters);
    if (c->monitor.scheme != MK_MONITOR_NONE) {
        print_false_alarms(out, c, filters);
        for (int f = 0; f < c->scenario->faults; f++) print_fault(out, filters, (size_t)f);
    }
    print_faults_outside(out, c);
}
