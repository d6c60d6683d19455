/* SPDX-License-Identifier: MIT */
#include "simulate_report.h"

#include <math.h>
#include <stdlib.h>

#include "json_out.h"
#include "monitor_report.h"
#include "process.h"
#include "report_cells.h"

static double decibel(double msd) { return 10.0 * log10(msd); }
/* Half-width of an interval of an msd, in dB. */
static double decibel_width(double msd, double half) { return half / msd * 10.0 / log(10.0); }

/* Numbers that cross the network in one step: readings and estimates sent, and what the central unit sends. */
static void communication(const mk_scenario_t *s, const mk_filter_t *filter, double *sent, double *from_centre) {
    *sent = *from_centre = 0.0;
    for (int k = 0; k < s->nodes; k++) *sent += s->sensor[k].rows + (filter->central ? 0 : s->n);
    if (filter->mode == MK_TOLERANCE_SCHEDULE) *from_centre = s->nodes;
}

static double node_steps_per_second(const mk_result_t *r) { return (double)r->steps_done * r->estimators / r->seconds; }

void mk_report_head(FILE *out, const mk_campaign_t *c, const mk_source_t *source, const mk_team_t *team) {
    (void)fprintf(out, "%s: %d nodes, %d states, %d steps, %d run%s, %s, seed %llu, ", c->scenario->name[0] ? c->scenario->name : "scenario",
                  c->scenario->nodes, c->scenario->n, c->steps, c->runs, c->runs == 1 ? "" : "s", c->network->name, (unsigned long long)c->seed);
    if (source->truth == MK_TRUTH_RECORDED) (void)fputs("recorded data", out);
    else if (source->truth == MK_TRUTH_LEAST_FAVOURABLE)
        (void)fprintf(out, "least favourable truth of c = %g up to step %d", c->tolerance, source->worst.horizon);
    else (void)fputs("nominal truth", out);
    if (c->loss > 0.0 || c->arrivals) (void)fprintf(out, ", %g of messages lost%s", c->loss, c->arrivals ? " as recorded" : "");
    if (team->ranks > 1) (void)fprintf(out, "; %d processes share the %s", team->ranks, c->split_nodes ? "nodes" : "runs");
    (void)fprintf(out, "\nMean squared deviation over the second half of the steps, 95 %% confidence intervals of the runs; c in twice the "
                       "Kullback-Leibler divergence (nats).\n\n");
    (void)fprintf(out, "%-8s %9s %8s %13s %8s %9s %8s %8s %9s %8s %11s %12s %13s\n", "filter", "MSD [dB]", "+-", "position [dB]", "+-", "mean c", "theta",
                  "+-", "NIS/rows", "+-", "sent a step", "from centre", "node-steps/s");
}

void mk_report_row(FILE *out, const mk_campaign_t *c, const mk_result_t *r) {
    const mk_record_t *mean = &r->statistics.mean, *half = &r->statistics.squares;
    double sent, from_centre;
    communication(c->scenario, c->filter, &sent, &from_centre);
    (void)fprintf(out, "%-8s", c->filter->name);
    mk_print_cell(out, 9, 4, decibel(*mean->steady));
    mk_print_cell(out, 8, 4, decibel_width(*mean->steady, *half->steady));
    mk_print_cell(out, 13, 4, decibel(*mean->position_steady));
    mk_print_cell(out, 8, 4, decibel_width(*mean->position_steady, *half->position_steady));
    mk_print_cell(out, 9, 5, *mean->tolerance);
    mk_print_cell(out, 8, 4, *mean->theta);
    mk_print_cell(out, 8, 4, *half->theta);
    mk_print_cell(out, 9, 4, *mean->nis_ratio);
    mk_print_cell(out, 8, 4, *half->nis_ratio);
    mk_print_cell(out, 11, 0, sent);
    mk_print_cell(out, 12, 0, from_centre);
    mk_print_cell(out, 13, 0, node_steps_per_second(r));
    (void)fputs("\n", out);
}

void mk_report_foot(FILE *out, const mk_campaign_t *c, const mk_source_t *source, const mk_team_t *team, const mk_result_t *last) {
    const double bytes = mk_peak_memory();
    if (last->interrupted) (void)fprintf(out, "interrupted: the figures are of the runs that were complete, %d of %d\n", last->statistics.runs, c->runs);
    if (last->runs_kept) (void)fprintf(out, "%d runs were there from an earlier call\n", last->runs_kept);
    if (source->dropped_readings)
        (void)fprintf(out, "\n%d readings with some of their rows missing were left out whole.\n", source->dropped_readings);
    (void)fprintf(out, "\n%d thread%s, peak memory %.0f MiB", c->threads, c->threads == 1 ? "" : "s", bytes / 1048576.0);
    if (c->scenario->nodes >= 1000) (void)fprintf(out, " (%.0f bytes a node)", bytes / c->scenario->nodes);
    if (team->ranks > 1 && c->split_nodes)
        (void)fprintf(out, " of rank 0; %.0f bytes exchanged a step, %ld of %d links cut", team->bytes_a_step, team->cut_edges,
                      (c->scenario->first[c->scenario->nodes] - c->scenario->nodes) / 2);
    (void)fputs("\n", out);
}

/* Means and half-widths of their intervals. */
static void set_means(json_t *object, const char *key, const char *key_half, const double *mean, const double *half, size_t count) {
    mk_json_set(object, key, mk_json_numbers(mean, count));
    mk_json_set(object, key_half, mk_json_numbers(half, count));
}

static void set_mean(json_t *object, const char *key, const char *key_half, double mean, double half) {
    mk_json_set(object, key, mk_json_number(mean));
    mk_json_set(object, key_half, mk_json_number(half));
}

json_t *mk_report_filter(const mk_campaign_t *c, const mk_result_t *r) {
    const mk_record_t *mean = &r->statistics.mean, *half = &r->statistics.squares;
    const size_t n = (size_t)c->scenario->n, steps = r->statistics.runs ? (size_t)c->steps : 0;
    double sent, from_centre, *rmse = mk_allocate(2 * n, sizeof *rmse);
    communication(c->scenario, c->filter, &sent, &from_centre);
    json_t *object = json_object();
    mk_json_set(object, "filter", json_string(c->filter->name));
    mk_json_set(object, "runs_done", json_integer(r->statistics.runs));
    mk_json_set(object, "runs_kept", json_integer(r->runs_kept));
    mk_json_set(object, "interrupted", json_boolean(r->interrupted));
    set_mean(object, "msd", "msd_ci95", *mean->steady, *half->steady);
    mk_json_set(object, "msd_db", mk_json_number(decibel(*mean->steady)));
    set_mean(object, "position_msd", "position_msd_ci95", *mean->position_steady, *half->position_steady);
    mk_json_set(object, "position_msd_db", mk_json_number(decibel(*mean->position_steady)));
    set_mean(object, "mean_tolerance", "mean_tolerance_ci95", *mean->tolerance, *half->tolerance);
    set_mean(object, "mean_theta", "mean_theta_ci95", *mean->theta, *half->theta);
    set_mean(object, "nis_ratio", "nis_ratio_ci95", *mean->nis_ratio, *half->nis_ratio);
    for (size_t i = 0; i < n; i++) {
        rmse[i] = sqrt(mean->state_square[i]);
        rmse[n + i] = half->state_square[i] / (2.0 * rmse[i]);
    }
    set_means(object, "state_rmse", "state_rmse_ci95", rmse, rmse + n, n);
    set_means(object, "node_msd", "node_msd_ci95", mean->node_msd, half->node_msd, (size_t)r->estimators);
    mk_report_alerts(object, c, r);
    set_means(object, "msd_over_time", "msd_over_time_ci95", mean->msd, half->msd, steps);
    mk_json_set(object, "numbers_sent_per_step", mk_json_number(sent));
    mk_json_set(object, "numbers_from_centre_per_step", mk_json_number(from_centre));
    mk_json_set(object, "seconds", mk_json_number(r->seconds));
    mk_json_set(object, "node_steps_per_second", mk_json_number(node_steps_per_second(r)));
    free(rmse);
    return object;
}

json_t *mk_report_summary(const mk_campaign_t *c, const mk_source_t *source, const mk_team_t *team, json_t *filters) {
    json_t *root = json_object();
    mk_json_set(root, "scenario", json_string(c->scenario->name));
    mk_json_set(root, "scenario_sha256", json_string(c->scenario->sha256));
    mk_json_set(root, "source", json_string(source->truth == MK_TRUTH_RECORDED ? "recorded" : "drawn"));
    mk_json_set(root, "truth", json_string(mk_truth_name(source->truth)));
    if (source->truth == MK_TRUTH_LEAST_FAVOURABLE) mk_json_set(root, "horizon", json_integer(source->worst.horizon));
    mk_json_set(root, "real", json_string(c->network->name));
    mk_json_set(root, "nodes", json_integer(c->scenario->nodes));
    mk_json_set(root, "steps", json_integer(c->steps));
    mk_json_set(root, "steady_from", json_integer(c->steps / 2));
    mk_json_set(root, "runs", json_integer(c->runs));
    mk_json_set(root, "seed", json_integer((json_int_t)c->seed));
    mk_json_set(root, "loss", json_real(c->loss));
    mk_json_set(root, "monitor", json_string(mk_monitor_name(c->monitor.scheme)));
    if (c->monitor.scheme != MK_MONITOR_NONE) {
        mk_json_set(root, "monitor_window", json_integer(c->monitor.window));
        mk_json_set(root, "monitor_false_alarm", json_real(c->monitor.false_alarm));
    }
    if (c->arrivals) mk_json_set(root, "arrivals_sha256", json_string(c->arrivals->sha256));
    mk_json_set(root, "tolerance", json_real(c->tolerance));
    mk_json_set(root, "threads", json_integer(c->threads));
    mk_json_set(root, "peak_memory_bytes", json_real(mk_peak_memory()));
    if (team->ranks > 1) {
        mk_json_set(root, "processes", json_integer(team->ranks));
        mk_json_set(root, "split", json_string(c->split_nodes ? "nodes" : "runs"));
        if (c->split_nodes) {
            mk_json_set(root, "bytes_exchanged_per_step", json_real(team->bytes_a_step));
            mk_json_set(root, "cut_links", json_integer(team->cut_edges));
        }
    }
    mk_json_set(root, "filters", filters);
    return root;
}
