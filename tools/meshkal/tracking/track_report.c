/* SPDX-License-Identifier: MIT */
#include "tracking/track_report.h"

#include <math.h>
#include <meshkal/quantile.h>
#include <stdlib.h>

#include "json_out.h"
#include "process.h"
#include "report_cells.h"
#include "simulation/statistics.h"

/* Of a filter: what is made of its records. */
typedef struct {
    double position, position_half, velocity, velocity_half;   /* RMSE over the window, half-widths of its interval */
    double position_all, velocity_all;                         /* RMSE over all steps */
    double log_position, log_velocity;                         /* mean over all steps of ln(mean over runs of the squared error) */
    double nees, nees_low, nees_high, nees_inside;             /* share of the window's steps inside the band */
    double nis, apart, apart_largest, ns;
} figures_t;

/* Mean over the steps from `from` on of f(value), of those that are known. */
static double over_time(const double *values, long from, long steps, double (*f)(double)) {
    double sum = 0.0;
    long known = 0;
    for (long t = from; t < steps; t++) {
        if (isnan(values[t])) continue;
        sum += f ? f(values[t]) : values[t];
        known++;
    }
    return known ? sum / (double)known : (double)NAN;
}

/* States whose truth is known: the degrees of freedom of NEES. */
static int states_judged(const mk_track_campaign_t *c) {
    int count = 0;
    for (uint64_t left = c->facts.known; left; left &= left - 1) count++;
    return count;
}

static figures_t figures_of(const mk_track_campaign_t *c, const mk_track_result_t *r) {
    const mk_track_statistics_t *const s = &r->statistics;
    const mk_track_record_t *const mean = &s->mean;
    const double degrees = (double)states_judged(c) * s->runs;
    const long T = mean->steps;
    figures_t f;
    long inside = 0, known = 0;
    f.position = sqrt(mean->single[MK_TRACK_POSITION]);
    f.velocity = sqrt(mean->single[MK_TRACK_VELOCITY]);
    f.position_half = mk_half_width(s->runs, s->squares.single[MK_TRACK_POSITION]) / (2.0 * f.position);
    f.velocity_half = mk_half_width(s->runs, s->squares.single[MK_TRACK_VELOCITY]) / (2.0 * f.velocity);
    f.position_all = sqrt(over_time(mean->position, 0, T, NULL));
    f.velocity_all = sqrt(over_time(mean->velocity, 0, T, NULL));
    f.log_position = over_time(mean->position, 0, T, log);
    f.log_velocity = over_time(mean->velocity, 0, T, log);
    f.nees = mean->single[MK_TRACK_NEES];
    f.nees_low = degrees > 0.0 ? mk_chi2_quantile(0.975, degrees) / s->runs : (double)NAN;
    f.nees_high = degrees > 0.0 ? mk_chi2_quantile(0.025, degrees) / s->runs : (double)NAN;
    for (long t = c->from - 1; t < T; t++) {
        if (isnan(mean->nees[t])) continue;
        known++;
        inside += mean->nees[t] >= f.nees_low && mean->nees[t] <= f.nees_high;
    }
    f.nees_inside = known ? (double)inside / (double)known : (double)NAN;
    f.nis = mean->single[MK_TRACK_NIS] / mean->single[MK_TRACK_NIS_ROWS];
    f.apart = sqrt(mean->single[MK_TRACK_APART_SQUARE]);
    f.apart_largest = over_time(s->largest.apart, c->from - 1, T, NULL);
    for (long t = c->from - 1; t < T; t++)
        if (s->largest.apart[t] > f.apart_largest) f.apart_largest = s->largest.apart[t];
    f.ns = 1e9 * r->step_seconds / r->estimators;
    return f;
}

/* All runs' count. */
static double total(const mk_track_result_t *r, int which) {
    return r->statistics.runs ? round(r->statistics.mean.single[MK_TRACK_COUNT + which] * r->statistics.runs) : 0.0;
}

static double failures(const mk_track_result_t *r) {
    double sum = 0.0;
    for (int i = 0; i < MK_STATUS_COUNT; i++) sum += total(r, MK_TRACK_FAILED + i);
    return sum;
}

void mk_track_report_head(FILE *out, const mk_track_campaign_t *c) {
    (void)fprintf(out, "%s: %d nodes, %d states, %ld steps, %d run%s, %s, seed %llu, %s data", c->scenario->name[0] ? c->scenario->name : "scenario",
                  c->scenario->nodes, c->scenario->n, c->facts.steps, c->runs, c->runs == 1 ? "" : "s", c->tracker->name, (unsigned long long)c->seed,
                  c->facts.drawn ? "drawn" : "recorded");
    if (c->loss > 0.0) (void)fprintf(out, ", %g of messages lost", c->loss);
    (void)fprintf(out, "\nRMSE, NEES and NIS over steps %ld to %ld, with 95 %% confidence intervals of the runs; ln MSE: mean over all steps of the "
                       "natural logarithm.\n",
                  c->from, c->facts.steps);
    if (c->facts.known) (void)fprintf(out, "NEES of an exact filter: %d; band: where its mean over the runs is in 95 of 100 steps.\n", states_judged(c));
    (void)fputs("\n", out);
    (void)fprintf(out, "%-12s %12s %8s %12s %8s %9s %9s %8s %15s %-14s %8s %10s %9s %9s %9s %7s %8s %6s %6s %10s %7s\n", "filter", "position [m]", "+-",
                  "vel. [m/s]", "+-", "ln MSE p", "ln MSE v", "NEES", "band", "", "NIS/rows", "apart [m]", "accepted", "rejected", "inflated", "lost",
                  "P := P0", "rule", "failed", "ns a step", "x ukf");
}

void mk_track_report_row(FILE *out, const mk_track_campaign_t *c, const mk_track_result_t *r, double ukf_seconds) {
    const figures_t f = figures_of(c, r);
    char band[40];
    (void)snprintf(band, sizeof band, "%.3f..%.3f", f.nees_low, f.nees_high);
    (void)fprintf(out, "%-12s", c->filter->name);
    mk_print_cell(out, 12, 5, f.position);
    mk_print_cell(out, 8, 5, f.position_half);
    mk_print_cell(out, 12, 5, f.velocity);
    mk_print_cell(out, 8, 5, f.velocity_half);
    mk_print_cell(out, 9, 3, f.log_position);
    mk_print_cell(out, 9, 3, f.log_velocity);
    mk_print_cell(out, 8, 3, f.nees);
    (void)fprintf(out, " %15s %-14s", isnan(f.nees) ? "-" : band, mk_nees_verdict(f.nees, f.nees_low, f.nees_high));
    mk_print_cell(out, 8, 4, f.nis);
    if (r->estimators > 1) (void)fprintf(out, " %10.3g", f.apart_largest);
    else mk_print_cell(out, 10, 0, (double)NAN);
    mk_print_cell(out, 9, 0, total(r, MK_TRACK_ACCEPTED));
    mk_print_cell(out, 9, 0, total(r, MK_TRACK_REJECTED));
    mk_print_cell(out, 9, 0, total(r, MK_TRACK_INFLATED));
    mk_print_cell(out, 7, 0, total(r, MK_TRACK_LOST));
    mk_print_cell(out, 8, 0, total(r, MK_TRACK_REINITIALISED));
    mk_print_cell(out, 6, 0, total(r, MK_TRACK_RULE));
    mk_print_cell(out, 6, 0, failures(r));
    mk_print_cell(out, 10, 0, f.ns);
    mk_print_cell(out, 7, 2, r->step_seconds / r->estimators / ukf_seconds);
    (void)fputs("\n", out);
}

void mk_track_report_foot(FILE *out, const mk_track_campaign_t *c, const mk_track_result_t *last, json_t *notes) {
    const double *const single = last->statistics.mean.single, runs = last->statistics.runs;
    size_t i;
    json_t *note;
    (void)fputs("\n", out);
    json_array_foreach(notes, i, note) (void)fprintf(out, "%s\n", json_string_value(note));
    if (c->facts.drawn)
        (void)fprintf(out, "Sensors gave %.0f readings, %.0f of them faulty; %.0f were lost by the scenario, %.0f times the target was out of "
                           "range.\n",
                      single[MK_TRACK_READINGS] * runs, single[MK_TRACK_FAULTY] * runs, single[MK_TRACK_SCENARIO_LOST] * runs,
                      single[MK_TRACK_OUT_OF_RANGE] * runs);
    else
        (void)fprintf(out, "%ld readings at %ld instants in %.6g s, longest gap %.3g s; %ld instants have some truth. Left out: %ld readings with "
                           "some of their rows missing, %ld lines that were there before.\n",
                      c->facts.readings, c->facts.steps, c->facts.last_s - c->facts.start_s, c->facts.longest_gap_s, c->facts.with_truth,
                      c->facts.dropped, c->facts.repeated);
    if (last->interrupted)
        (void)fprintf(out, "interrupted: the figures are of the runs that were complete, %d of %d\n", last->statistics.runs, c->runs);
    (void)fprintf(out, "%d thread%s, peak memory %.0f MiB\n", c->threads, c->threads == 1 ? "" : "s", mk_peak_memory() / 1048576.0);
}

/* The same for each element: f of it. */
static json_t *mapped(const double *values, size_t count, double (*f)(double)) {
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++) (void)json_array_append_new(array, mk_json_number(f(values[i])));
    return array;
}

static json_t *readings_of(const mk_track_result_t *r) {
    json_t *object = json_object();
    static const char *const name[] = {"accepted", "rejected", "inflated", "refused", "lost", "updates", "rule_fired", "reinitialised", "isolated",
                                       "uninformed", "unfused"};
    for (int i = MK_TRACK_ACCEPTED; i < MK_TRACK_FAILED; i++) mk_json_set_number(object, name[i], total(r, i));
    return object;
}

static json_t *failures_of(const mk_track_result_t *r) {
    json_t *object = json_object();
    for (int i = 0; i < MK_STATUS_COUNT; i++)
        if (total(r, MK_TRACK_FAILED + i) > 0.0) mk_json_set_number(object, mk_status_name((mk_status_t)i), total(r, MK_TRACK_FAILED + i));
    return object;
}

json_t *mk_track_report_filter(const mk_track_campaign_t *c, const mk_track_result_t *r, double ukf_seconds) {
    const mk_track_record_t *const mean = &r->statistics.mean;
    const figures_t f = figures_of(c, r);
    const size_t T = r->statistics.runs ? (size_t)mean->steps : 0, E = (size_t)r->estimators;
    json_t *object = json_object();
    mk_json_set(object, "filter", json_string(c->filter->name));
    mk_json_set(object, "estimators", json_integer(r->estimators));
    mk_json_set(object, "runs_done", json_integer(r->statistics.runs));
    mk_json_set(object, "interrupted", json_boolean(r->interrupted));
    mk_json_set_number(object, "position_rmse", f.position);
    mk_json_set_number(object, "position_rmse_ci95", f.position_half);
    mk_json_set_number(object, "velocity_rmse", f.velocity);
    mk_json_set_number(object, "velocity_rmse_ci95", f.velocity_half);
    mk_json_set_number(object, "position_rmse_all_steps", f.position_all);
    mk_json_set_number(object, "velocity_rmse_all_steps", f.velocity_all);
    mk_json_set_number(object, "mean_log_mse_position", f.log_position);
    mk_json_set_number(object, "mean_log_mse_velocity", f.log_velocity);
    mk_json_set_number(object, "nees", f.nees);
    mk_json_set_number(object, "nees_low", f.nees_low);
    mk_json_set_number(object, "nees_high", f.nees_high);
    mk_json_set(object, "nees_verdict", json_string(mk_nees_verdict(f.nees, f.nees_low, f.nees_high)));
    mk_json_set_number(object, "nees_steps_inside", f.nees_inside);
    mk_json_set_number(object, "nis_ratio", f.nis);
    if (E > 1) {
        mk_json_set_number(object, "disagreement_rms", f.apart);
        mk_json_set_number(object, "disagreement_largest", f.apart_largest);
        mk_json_set(object, "node_position_rmse", mapped(mean->node_position, E, sqrt));
        mk_json_set(object, "node_velocity_rmse", mapped(mean->node_velocity, E, sqrt));
        mk_json_set(object, "node_nees", mk_json_numbers(mean->node_nees, E));
        mk_json_set(object, "disagreement_over_time", mk_json_numbers(mean->apart, T));
    }
    mk_json_set(object, "counts", readings_of(r));
    mk_json_set(object, "failures", failures_of(r));
    if (isfinite(c->lost_m)) mk_json_set_number(object, "targets_lost", round(mean->single[MK_TRACK_TARGET_LOST] * r->statistics.runs));
    mk_json_set_number(object, "ns_per_step", f.ns);
    mk_json_set_number(object, "time_ratio_to_ukf", r->step_seconds / r->estimators / ukf_seconds);
    mk_json_set(object, "time_s", mk_json_numbers(mean->time, T));
    mk_json_set(object, "log_mse_position_over_time", mapped(mean->position, T, log));
    mk_json_set(object, "log_mse_velocity_over_time", mapped(mean->velocity, T, log));
    mk_json_set(object, "position_rmse_over_time", mapped(mean->position, T, sqrt));
    mk_json_set(object, "velocity_rmse_over_time", mapped(mean->velocity, T, sqrt));
    mk_json_set(object, "nees_over_time", mk_json_numbers(mean->nees, T));
    return object;
}

json_t *mk_track_report_summary(const mk_track_campaign_t *c, json_t *filters, json_t *notes) {
    json_t *root = json_object();
    mk_json_set(root, "kind", json_string("tracking"));
    mk_json_set(root, "scenario", json_string(c->scenario->name));
    mk_json_set(root, "scenario_sha256", json_string(c->scenario->sha256));
    mk_json_set(root, "source", json_string(c->facts.drawn ? "drawn" : "recorded"));
    if (!c->facts.drawn) {
        mk_json_set(root, "data_sha256", json_string(c->facts.sha256));
        mk_json_set(root, "readings", json_integer(c->facts.readings));
        mk_json_set(root, "readings_dropped", json_integer(c->facts.dropped));
        mk_json_set(root, "lines_repeated", json_integer(c->facts.repeated));
        mk_json_set(root, "duration_s", json_real(c->facts.last_s - c->facts.start_s));
        mk_json_set(root, "longest_gap_s", json_real(c->facts.longest_gap_s));
        mk_json_set(root, "instants_with_truth", json_integer(c->facts.with_truth));
    }
    mk_json_set(root, "real", json_string(c->tracker->name));
    mk_json_set(root, "nodes", json_integer(c->scenario->nodes));
    mk_json_set(root, "states", json_integer(c->scenario->n));
    mk_json_set(root, "steps", json_integer(c->facts.steps));
    mk_json_set(root, "from_step", json_integer(c->from));
    mk_json_set(root, "nees_states", json_integer(states_judged(c)));
    mk_json_set(root, "start_s", json_real(c->facts.start_s));
    mk_json_set(root, "runs", json_integer(c->runs));
    mk_json_set(root, "seed", json_integer((json_int_t)c->seed));
    mk_json_set(root, "loss", json_real(c->loss));
    mk_json_set(root, "iterations", json_integer(c->scenario->tracking->iterations));
    mk_json_set(root, "protocol", json_string(mk_protocol_name(c->scenario->tracking->protocol)));
    mk_json_set(root, "tolerance", json_real(c->scenario->tolerance));
    mk_json_set(root, "threads", json_integer(c->threads));
    mk_json_set(root, "peak_memory_bytes", json_real(mk_peak_memory()));
    mk_json_set(root, "notes", notes);
    mk_json_set(root, "filters", filters);
    return root;
}
