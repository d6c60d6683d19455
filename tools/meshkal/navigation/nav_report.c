/* SPDX-License-Identifier: MIT */
#include "navigation/nav_report.h"

#include <math.h>
#include <meshkal/gate.h>
#include <meshkal/quantile.h>
#include <stdlib.h>

#include "json_out.h"
#include "process.h"
#include "report_cells.h"
#include "scenario_monitor.h"
#include "simulation/statistics.h"

/* Of a filter: what is made of its records. */
typedef struct {
    double position, position_half, velocity, velocity_half, attitude; /* RMSE over the window, half-widths of intervals */
    double nees, nees_low, nees_high, nees_inside;                     /* share of the window's epochs inside the band */
    double nis, weight_faulty, weight_others;
    int alarmed, right;                                                /* runs */
    double alarm, alarm_low, alarm_high;                               /* s after the fault began: mean, 5 % and 95 % quantiles */
    double end, end_low, end_high;                                     /* of the first declared end after the alarm, s after the fault's own */
    int ended;
    long false_alarms, clean, late_alarms, after;
} figures_t;

/* Values that are known, less `origin`: mean and quantiles. How many. */
static int spread(double *values, int count, double *mean, double *low, double *high) {
    double sum = 0.0;
    int known = 0;
    for (int i = 0; i < count; i++) {
        if (isnan(values[i])) continue;
        sum += values[i];
        values[known++] = values[i];
    }
    mk_sort(values, (size_t)known);
    *mean = known ? sum / known : (double)NAN;
    *low = mk_quantile(values, (size_t)known, 0.05);
    *high = mk_quantile(values, (size_t)known, 0.95);
    return known;
}

static double fault_begin(const mk_nav_campaign_t *c) { return c->span.exists ? c->span.from_s : 0.0; }
static int faulty_satellite(const mk_nav_campaign_t *c) { return c->span.exists ? c->scenario->navigation->satellite[c->span.node].number : 0; }

static void tell_stories(const mk_nav_campaign_t *c, const mk_nav_result_t *r, figures_t *f) {
    const int runs = r->statistics.runs;
    double *const times = mk_allocate(2 * (size_t)runs + 1, sizeof *times), *const ends = times + runs;
    for (int i = 0; i < runs; i++) {
        const mk_nav_story_t *const story = &r->story[i];
        times[i] = story->alarm_s - fault_begin(c);
        ends[i] = (double)NAN; /* before the alarm: of something else, that was none */
        for (int k = 0; k < story->ends && k < MK_NAV_MOST_ENDS && isnan(ends[i]) && isfinite(c->span.to_s); k++)
            if (story->end_s[k] > story->alarm_s) ends[i] = story->end_s[k] - c->span.to_s;
        f->right += story->isolated != 0 && story->isolated == faulty_satellite(c);
        f->false_alarms += story->false_alarms;
        f->clean += story->clean;
        f->late_alarms += story->late_alarms;
        f->after += story->after;
    }
    f->alarmed = spread(times, runs, &f->alarm, &f->alarm_low, &f->alarm_high);
    f->ended = spread(ends, runs, &f->end, &f->end_low, &f->end_high);
    free(times);
}

static double half_width(const mk_nav_statistics_t *s, int which) { return mk_half_width(s->known.single[which], s->squares.single[which]); }

static figures_t figures_of(const mk_nav_campaign_t *c, const mk_nav_result_t *r) {
    const mk_nav_statistics_t *const s = &r->statistics;
    const double *const mean = s->mean.single;
    figures_t f = {0};
    long inside = 0, known = 0;
    const double nan = (double)NAN, degrees = (double)MK_NAV_STATES * s->runs;
    f.position = s->known.single[MK_NAV_MEAN_POSITION] > 0.0 ? sqrt(mean[MK_NAV_MEAN_POSITION]) : nan;
    f.velocity = s->known.single[MK_NAV_MEAN_VELOCITY] > 0.0 ? sqrt(mean[MK_NAV_MEAN_VELOCITY]) : nan;
    f.attitude = s->known.single[MK_NAV_MEAN_ATTITUDE] > 0.0 ? sqrt(mean[MK_NAV_MEAN_ATTITUDE]) : nan;
    f.position_half = half_width(s, MK_NAV_MEAN_POSITION) / (2.0 * f.position);
    f.velocity_half = half_width(s, MK_NAV_MEAN_VELOCITY) / (2.0 * f.velocity);
    f.nees = s->known.single[MK_NAV_MEAN_NEES] > 0.0 ? mean[MK_NAV_MEAN_NEES] : nan;
    f.nees_low = mk_chi2_quantile(0.975, degrees) / s->runs;
    f.nees_high = mk_chi2_quantile(0.025, degrees) / s->runs;
    for (long t = c->from - 1; t < s->mean.steps; t++) {
        if (!(s->known.nees[t] > 0.0)) continue;
        known++;
        inside += s->mean.nees[t] >= f.nees_low && s->mean.nees[t] <= f.nees_high;
    }
    f.nees_inside = known ? (double)inside / (double)known : nan;
    f.nis = mean[MK_NAV_SUM_NIS] / mean[MK_NAV_SUM_NIS_ROWS];
    f.weight_faulty = s->known.single[MK_NAV_WEIGHT_FAULTY] > 0.0 ? mean[MK_NAV_WEIGHT_FAULTY] : nan;
    f.weight_others = s->known.single[MK_NAV_WEIGHT_OTHERS] > 0.0 ? mean[MK_NAV_WEIGHT_OTHERS] : nan;
    tell_stories(c, r, &f);
    return f;
}

static double total(const mk_nav_result_t *r, int which) {
    return r->statistics.runs ? round(r->statistics.mean.single[MK_NAV_FIRST_COUNT + which] * r->statistics.runs) : 0.0;
}

static double failures(const mk_nav_result_t *r) {
    double sum = 0.0;
    for (int i = 0; i < MK_STATUS_COUNT; i++) sum += total(r, MK_NAV_COUNT_FAILED + i);
    return sum;
}

/* --- table ------------------------------------------------------------------------------------------------------------------ */

void mk_nav_report_head(FILE *out, const mk_nav_campaign_t *c) {
    const mk_scenario_t *const s = c->scenario;
    const int watched = c->monitor.scheme != MK_MONITOR_NONE;
    (void)fprintf(out, "%s: %d satellite%s, %ld epoch%s, %d run%s, %s, seed %llu, %s data\n", s->name[0] ? s->name : "scenario", s->nodes,
                  s->nodes == 1 ? "" : "s", c->facts.steps, c->facts.steps == 1 ? "" : "s",
                  c->runs, c->runs == 1 ? "" : "s", c->precision->name, (unsigned long long)c->seed, c->facts.drawn ? "drawn" : "recorded");
    for (int i = 0; i < s->faults; i++) {
        const mk_sensor_fault_t *const fault = &s->fault[i];
        (void)fprintf(out, "fault: satellite %d, %g m + %g m/s from %g s to ", s->navigation->satellite[fault->node].number, fault->step, fault->rate,
                      fault->from_s);
        (void)(isfinite(fault->to_s) ? fprintf(out, "%g s\n", fault->to_s) : fprintf(out, "the end\n"));
    }
    if (watched)
        (void)fprintf(out, "monitor: %s, window %d, false alarm %g a test; alarm: seconds after the fault began, mean and quantiles over the runs; end: of "
                           "the first declared end after the alarm, seconds after the fault's own.\n",
                      mk_monitor_name(c->monitor.scheme), c->monitor.window, c->monitor.false_alarm);
    (void)fprintf(out, "RMSE, NEES and NIS over epochs %ld to %ld, with 95 %% confidence intervals of the runs. NEES of an exact filter: %d.\n\n", c->from,
                  c->facts.steps, MK_NAV_STATES);
    (void)fprintf(out, "%-8s %12s %8s %12s %8s %11s %7s %13s %-14s %8s %8s %8s", "filter", "position [m]", "+-", "vel. [m/s]", "+-", "att. [mrad]", "NEES",
                  "band", "", "NIS/rows", "w faulty", "w others");
    if (watched)
        (void)fprintf(out, " %9s %8s %8s %8s %9s %12s %9s %8s %8s %8s %12s", "alarmed", "alarm", "5 %", "95 %", "isolated", "false alarms", "ended", "end",
                      "5 %", "95 %", "late alarms");
    (void)fprintf(out, " %7s %10s\n", "failed", "us an epoch");
}

void mk_nav_report_row(FILE *out, const mk_nav_campaign_t *c, const mk_nav_result_t *r) {
    const figures_t f = figures_of(c, r);
    char text[60];
    (void)snprintf(text, sizeof text, "%.2f..%.2f", f.nees_low, f.nees_high);
    (void)fprintf(out, "%-8s", mk_nav_filter_name(c->filter));
    mk_print_cell(out, 12, 4, f.position);
    mk_print_cell(out, 8, 4, f.position_half);
    mk_print_cell(out, 12, 5, f.velocity);
    mk_print_cell(out, 8, 5, f.velocity_half);
    mk_print_cell(out, 11, 4, 1e3 * f.attitude);
    mk_print_cell(out, 7, 2, f.nees);
    (void)fprintf(out, " %13s %-14s", isnan(f.nees) ? "-" : text, mk_nees_verdict(f.nees, f.nees_low, f.nees_high));
    mk_print_cell(out, 8, 3, f.nis);
    mk_print_cell(out, 8, 3, f.weight_faulty);
    mk_print_cell(out, 8, 3, f.weight_others);
    if (c->monitor.scheme != MK_MONITOR_NONE) {
        (void)snprintf(text, sizeof text, "%d/%d", f.alarmed, r->statistics.runs);
        (void)fprintf(out, " %9s", text);
        mk_print_cell(out, 8, 2, f.alarm);
        mk_print_cell(out, 8, 1, f.alarm_low);
        mk_print_cell(out, 8, 1, f.alarm_high);
        (void)snprintf(text, sizeof text, "%d/%d", f.right, f.alarmed);
        (void)fprintf(out, " %9s", c->span.exists ? text : "-");
        (void)snprintf(text, sizeof text, "%ld/%ld", f.false_alarms, f.clean);
        (void)fprintf(out, " %12s", text);
        (void)snprintf(text, sizeof text, "%d/%d", f.ended, r->statistics.runs);
        (void)fprintf(out, " %9s", text);
        mk_print_cell(out, 8, 2, f.end);
        mk_print_cell(out, 8, 1, f.end_low);
        mk_print_cell(out, 8, 1, f.end_high);
        (void)snprintf(text, sizeof text, "%ld/%ld", f.late_alarms, f.after);
        (void)fprintf(out, " %12s", text);
    }
    mk_print_cell(out, 7, 0, failures(r));
    mk_print_cell(out, 10, 1, 1e6 * r->epoch_seconds);
    (void)fputs("\n", out);
}

void mk_nav_report_foot(FILE *out, const mk_nav_campaign_t *c, const mk_nav_result_t *last, json_t *notes) {
    size_t i;
    json_t *note;
    (void)fputs("\n", out);
    json_array_foreach(notes, i, note) (void)fprintf(out, "%s\n", json_string_value(note));
    if (!c->facts.drawn)
        (void)fprintf(out, "%ld pseudoranges in %.6g s, of %d of %d satellites in the poorest epoch; longest interval of samples %.3g s, mean %.3g s; "
                           "%ld epochs have some truth\n",
                      c->facts.readings, c->facts.last_s - c->facts.start_s, c->facts.fewest, c->scenario->nodes, c->facts.gap_s, c->facts.interval_s,
                      c->facts.with_truth);
    if (last->interrupted) (void)fprintf(out, "interrupted: the figures are of the runs that were complete, %d of %d\n", last->statistics.runs, c->runs);
    (void)fprintf(out, "%d thread%s, peak memory %.0f MiB\n", c->threads, c->threads == 1 ? "" : "s", mk_peak_memory() / 1048576.0);
}

/* --- JSON ------------------------------------------------------------------------------------------------------------------- */

/* null where no run knows it. */
static json_t *series(const mk_nav_result_t *r, const double *mean, const double *known, int rooted) {
    json_t *array = json_array();
    for (long t = 0; t < r->statistics.mean.steps && r->statistics.runs; t++)
        (void)json_array_append_new(array, mk_json_number(!(known[t] > 0.0) ? (double)NAN : rooted ? sqrt(mean[t]) : mean[t]));
    return array;
}

/* One number of each run. */
enum { ALARM_S, LAST_ALARM_S, FIRST_FALSE_S, INNOVATION, ISOLATED, FALSE_ALARMS, DURING, LATE_ALARMS };
static json_t *each_run(const mk_nav_result_t *r, int what) {
    json_t *array = json_array();
    for (int i = 0; i < r->statistics.runs; i++) {
        const mk_nav_story_t *const s = &r->story[i];
        const double real[] = {s->alarm_s, s->last_alarm_s, s->first_false_s, s->innovation_at_end};
        const long whole[] = {s->isolated, s->false_alarms, s->during, s->late_alarms};
        json_t *const value = what < ISOLATED ? mk_json_number(real[what])
                              : what == ISOLATED && s->isolated == 0 ? json_null()
                                                                     : json_integer(whole[what - ISOLATED]);
        (void)json_array_append_new(array, value);
    }
    return array;
}

static json_t *ends_of(const mk_nav_result_t *r) {
    json_t *array = json_array();
    for (int i = 0; i < r->statistics.runs; i++) {
        const mk_nav_story_t *const story = &r->story[i];
        (void)json_array_append_new(array, mk_json_numbers(story->end_s, (size_t)(story->ends < MK_NAV_MOST_ENDS ? story->ends : MK_NAV_MOST_ENDS)));
    }
    return array;
}

static json_t *monitor_of(const mk_nav_campaign_t *c, const mk_nav_result_t *r, const figures_t *f) {
    json_t *object = json_object();
    mk_json_set(object, "alarmed", json_integer(f->alarmed));
    mk_json_set_number(object, "time_to_alarm_s", f->alarm);
    mk_json_set_number(object, "time_to_alarm_s_5", f->alarm_low);
    mk_json_set_number(object, "time_to_alarm_s_95", f->alarm_high);
    if (c->span.exists) mk_json_set(object, "isolated_right", json_integer(f->right));
    mk_json_set(object, "false_alarm_epochs", json_integer(f->false_alarms));
    mk_json_set(object, "clean_epochs", json_integer(f->clean));
    mk_json_set(object, "late_alarm_epochs", json_integer(f->late_alarms));
    mk_json_set(object, "epochs_after", json_integer(f->after));
    mk_json_set(object, "ended", json_integer(f->ended));
    mk_json_set_number(object, "first_end_after_s", f->end);
    mk_json_set_number(object, "first_end_after_s_5", f->end_low);
    mk_json_set_number(object, "first_end_after_s_95", f->end_high);
    mk_json_set(object, "alarm_s", each_run(r, ALARM_S));
    mk_json_set(object, "last_alarm_s", each_run(r, LAST_ALARM_S));
    mk_json_set(object, "first_false_alarm_s", each_run(r, FIRST_FALSE_S));
    mk_json_set(object, "isolated", each_run(r, ISOLATED));
    mk_json_set(object, "ends_s", ends_of(r));
    mk_json_set(object, "false_alarms", each_run(r, FALSE_ALARMS));
    mk_json_set(object, "alarms_during_fault", each_run(r, DURING));
    mk_json_set(object, "alarms_after_fault", each_run(r, LATE_ALARMS));
    mk_json_set(object, "alarm_share_over_time", series(r, r->statistics.mean.alarm, r->statistics.known.alarm, 0));
    return object;
}

static json_t *counts_of(const mk_nav_result_t *r) {
    static const char *const name[] = {"used", "refused", "weighted", "excluded", "all_unused", "fewer_than_four"};
    json_t *object = json_object();
    for (int i = 0; i < MK_NAV_COUNT_FAILED; i++) mk_json_set_number(object, name[i], total(r, i));
    return object;
}

static json_t *failures_of(const mk_nav_result_t *r) {
    json_t *object = json_object();
    for (int i = 0; i < MK_STATUS_COUNT; i++)
        if (total(r, MK_NAV_COUNT_FAILED + i) > 0.0) mk_json_set_number(object, mk_status_name((mk_status_t)i), total(r, MK_NAV_COUNT_FAILED + i));
    return object;
}

json_t *mk_nav_report_filter(const mk_nav_campaign_t *c, const mk_nav_result_t *r) {
    const mk_nav_record_t *const mean = &r->statistics.mean, *const known = &r->statistics.known;
    const figures_t f = figures_of(c, r);
    json_t *object = json_object();
    mk_json_set(object, "filter", json_string(mk_nav_filter_name(c->filter)));
    mk_json_set(object, "runs_done", json_integer(r->statistics.runs));
    mk_json_set(object, "interrupted", json_boolean(r->interrupted));
    mk_json_set_number(object, "position_rmse", f.position);
    mk_json_set_number(object, "position_rmse_ci95", f.position_half);
    mk_json_set_number(object, "velocity_rmse", f.velocity);
    mk_json_set_number(object, "velocity_rmse_ci95", f.velocity_half);
    mk_json_set_number(object, "attitude_rmse", f.attitude);
    mk_json_set_number(object, "nees", f.nees);
    mk_json_set_number(object, "nees_low", f.nees_low);
    mk_json_set_number(object, "nees_high", f.nees_high);
    mk_json_set(object, "nees_verdict", json_string(mk_nees_verdict(f.nees, f.nees_low, f.nees_high)));
    mk_json_set_number(object, "nees_steps_inside", f.nees_inside);
    mk_json_set_number(object, "nis_ratio", f.nis);
    mk_json_set_number(object, "weight_faulty", f.weight_faulty);
    mk_json_set_number(object, "weight_others", f.weight_others);
    mk_json_set(object, "counts", counts_of(r));
    mk_json_set(object, "failures", failures_of(r));
    mk_json_set_number(object, "us_per_epoch", 1e6 * r->epoch_seconds);
    if (c->span.exists) mk_json_set(object, "innovation_at_fault_end", each_run(r, INNOVATION));
    if (c->monitor.scheme != MK_MONITOR_NONE) mk_json_set(object, "monitor", monitor_of(c, r, &f));
    mk_json_set(object, "time_s", mk_json_numbers(mean->time, r->statistics.runs ? (size_t)mean->steps : 0));
    mk_json_set(object, "position_rmse_over_time", series(r, mean->position, known->position, 1));
    mk_json_set(object, "velocity_rmse_over_time", series(r, mean->velocity, known->velocity, 1));
    mk_json_set(object, "nees_over_time", series(r, mean->nees, known->nees, 0));
    mk_json_set(object, "innovation_over_time", series(r, mean->innovation, known->innovation, 0));
    mk_json_set(object, "weight_over_time", series(r, mean->weight, known->weight, 0));
    return object;
}

static json_t *settings_of(const mk_nav_campaign_t *c) {
    const mk_monitor_settings_t *const m = &c->monitor;
    json_t *object = json_object();
    mk_json_set(object, "name", json_string(mk_monitor_name(m->scheme)));
    if (m->scheme == MK_MONITOR_NONE) return object;
    double threshold[MK_NAV_SATELLITES];
    if (mk_gate_thresholds_f64(m->false_alarm, c->scenario->nodes, threshold) == MK_OK)
        mk_json_set(object, "threshold", json_real(threshold[c->scenario->nodes - 1]));
    mk_json_set(object, "window", json_integer(m->window));
    mk_json_set_number(object, "false_alarm", m->false_alarm);
    if (m->scheme == MK_MONITOR_IMPROVED) mk_json_set_number(object, "jump", m->jump);
    if (m->scheme != MK_MONITOR_EXCLUDE) return object;
    mk_json_set_number(object, "evidence", m->evidence);
    mk_json_set_number(object, "separation", m->separation);
    mk_json_set(object, "most", json_integer(m->most));
    return object;
}

static json_t *faults_of(const mk_scenario_t *s) {
    json_t *array = json_array();
    for (int i = 0; i < s->faults; i++) {
        json_t *fault = json_object();
        mk_json_set(fault, "satellite", json_integer(s->navigation->satellite[s->fault[i].node].number));
        mk_json_set_number(fault, "from_s", s->fault[i].from_s);
        mk_json_set_number(fault, "to_s", s->fault[i].to_s);
        mk_json_set_number(fault, "rate", s->fault[i].rate);
        mk_json_set_number(fault, "step", s->fault[i].step);
        (void)json_array_append_new(array, fault);
    }
    return array;
}

json_t *mk_nav_report_summary(const mk_nav_campaign_t *c, json_t *filters, json_t *notes) {
    const mk_scenario_t *const s = c->scenario;
    json_t *root = json_object(), *satellites = json_array();
    for (int k = 0; k < s->nodes; k++) (void)json_array_append_new(satellites, json_integer(s->navigation->satellite[k].number));
    mk_json_set(root, "kind", json_string("navigation"));
    mk_json_set(root, "scenario", json_string(s->name));
    mk_json_set(root, "scenario_sha256", json_string(s->sha256));
    mk_json_set(root, "source", json_string(c->facts.drawn ? "drawn" : "recorded"));
    if (!c->facts.drawn) {
        mk_json_set(root, "data_sha256", json_string(c->facts.sha256));
        mk_json_set(root, "readings", json_integer(c->facts.readings));
        mk_json_set(root, "longest_interval_s", json_real(c->facts.gap_s));
        mk_json_set(root, "epochs_with_truth", json_integer(c->facts.with_truth));
    }
    mk_json_set(root, "real", json_string(c->precision->name));
    mk_json_set(root, "satellites", satellites);
    mk_json_set(root, "states", json_integer(MK_NAV_STATES));
    mk_json_set(root, "steps", json_integer(c->facts.steps));
    mk_json_set(root, "from_step", json_integer(c->from));
    mk_json_set(root, "start_s", json_real(c->facts.start_s));
    mk_json_set(root, "runs", json_integer(c->runs));
    mk_json_set(root, "seed", json_integer((json_int_t)c->seed));
    mk_json_set(root, "monitor", settings_of(c));
    mk_json_set(root, "faults", faults_of(s));
    mk_json_set(root, "threads", json_integer(c->threads));
    mk_json_set(root, "peak_memory_bytes", json_real(mk_peak_memory()));
    mk_json_set(root, "notes", notes);
    mk_json_set(root, "filters", filters);
    return root;
}
