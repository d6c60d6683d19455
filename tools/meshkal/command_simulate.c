/* SPDX-License-Identifier: MIT */
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "campaign.h"
#include "commands.h"
#include "design.h"
#include "json_out.h"

typedef struct {
    const char *filter, *steps, *seed, *runs, *real, *loss, *tolerance, *measurements, *truth, *out, *json;
} arguments_t;

static double decibel(double msd) { return 10.0 * log10(msd); }

/* Numbers that cross the network in one step: readings and estimates sent, and what the central unit sends. */
static void communication(const mk_scenario_t *s, const mk_filter_t *filter, double *sent, double *from_centre) {
    *sent = *from_centre = 0.0;
    for (int k = 0; k < s->nodes; k++) *sent += s->sensor[k].rows + (filter->central ? 0 : s->n);
    if (filter->mode == MK_TOLERANCE_SCHEDULE) *from_centre = s->nodes;
}

static void print_head(FILE *out, const mk_campaign_t *c, const mk_source_t *source) {
    (void)fprintf(out, "%s: %d nodes, %d states, %d steps, %d run%s, %s, seed %llu, %s", c->scenario->name[0] ? c->scenario->name : "scenario",
                  c->scenario->nodes, c->scenario->n, c->steps, c->runs, c->runs == 1 ? "" : "s", c->network->name,
                  (unsigned long long)c->seed, source->recorded ? "recorded data" : "nominal truth");
    if (c->loss > 0.0) (void)fprintf(out, ", %g of messages lost", c->loss);
    (void)fprintf(out, "\nMean squared deviation over the second half of the steps; c in twice the Kullback-Leibler divergence (nats).\n\n");
    (void)fprintf(out, "%-8s %9s %8s %12s %9s %8s %8s %11s %12s %13s\n", "filter", "MSD [dB]", "+- 95 %", "position [dB]", "mean c",
                  "theta", "NIS/rows", "sent a step", "from centre", "node-steps/s");
}

static void print_cell(FILE *out, int width, int digits, double value) {
    if (isfinite(value)) (void)fprintf(out, " %*.*f", width, digits, value);
    else (void)fprintf(out, " %*s", width, "-");
}

static void print_row(FILE *out, const mk_campaign_t *c, const mk_result_t *r) {
    double sent, from_centre;
    communication(c->scenario, c->filter, &sent, &from_centre);
    (void)fprintf(out, "%-8s", c->filter->name);
    print_cell(out, 9, 4, decibel(r->steady));
    print_cell(out, 8, 4, r->steady_ci95 / r->steady * 10.0 / log(10.0));
    print_cell(out, 13, 4, decibel(r->position_steady));
    print_cell(out, 9, 5, r->tolerance);
    print_cell(out, 8, 4, r->theta);
    print_cell(out, 8, 4, r->nis_ratio);
    print_cell(out, 11, 0, sent);
    print_cell(out, 12, 0, from_centre);
    print_cell(out, 13, 0, (double)r->steps_done * r->estimators / r->seconds);
    (void)fputs("\n", out);
}

static json_t *make_json(const mk_campaign_t *c, const mk_result_t *r) {
    double sent, from_centre;
    communication(c->scenario, c->filter, &sent, &from_centre);
    json_t *object = json_object();
    mk_json_set(object, "filter", json_string(c->filter->name));
    mk_json_set(object, "runs_done", json_integer(r->runs_done));
    mk_json_set(object, "interrupted", json_boolean(r->interrupted));
    mk_json_set(object, "msd", mk_json_number(r->steady));
    mk_json_set(object, "msd_ci95", mk_json_number(r->steady_ci95));
    mk_json_set(object, "msd_db", mk_json_number(decibel(r->steady)));
    mk_json_set(object, "position_msd_db", mk_json_number(decibel(r->position_steady)));
    mk_json_set(object, "mean_tolerance", mk_json_number(r->tolerance));
    mk_json_set(object, "mean_theta", mk_json_number(r->theta));
    mk_json_set(object, "nis_ratio", mk_json_number(r->nis_ratio));
    mk_json_set(object, "state_rmse", mk_json_numbers(r->state_rmse, (size_t)c->scenario->n));
    mk_json_set(object, "node_msd", mk_json_numbers(r->node_msd, (size_t)r->estimators));
    mk_json_set(object, "msd_over_time", mk_json_numbers(r->msd, r->runs_done ? (size_t)r->steps : 0));
    mk_json_set(object, "numbers_sent_per_step", mk_json_number(sent));
    mk_json_set(object, "numbers_from_centre_per_step", mk_json_number(from_centre));
    mk_json_set(object, "seconds", mk_json_number(r->seconds));
    mk_json_set(object, "node_steps_per_second", mk_json_number((double)r->steps_done * r->estimators / r->seconds));
    return object;
}

static json_t *make_summary(const mk_campaign_t *c, const mk_source_t *source, json_t *filters) {
    json_t *root = json_object();
    mk_json_set(root, "scenario", json_string(c->scenario->name));
    mk_json_set(root, "scenario_sha256", json_string(c->scenario->sha256));
    mk_json_set(root, "source", json_string(source->recorded ? "recorded" : "drawn"));
    mk_json_set(root, "real", json_string(c->network->name));
    mk_json_set(root, "nodes", json_integer(c->scenario->nodes));
    mk_json_set(root, "steps", json_integer(c->steps));
    mk_json_set(root, "steady_from", json_integer(c->steps / 2));
    mk_json_set(root, "runs", json_integer(c->runs));
    mk_json_set(root, "seed", json_integer((json_int_t)c->seed));
    mk_json_set(root, "loss", json_real(c->loss));
    mk_json_set(root, "tolerance", json_real(c->tolerance));
    mk_json_set(root, "filters", filters);
    return root;
}

static int read_arguments(int argc, char **argv, arguments_t *a, const char **path, mk_error_t *error) {
    const mk_option_t options[] = {{"filter", &a->filter, NULL}, {"steps", &a->steps, NULL},         {"seed", &a->seed, NULL},
                                   {"runs", &a->runs, NULL},     {"real", &a->real, NULL},           {"loss", &a->loss, NULL},
                                   {"tolerance", &a->tolerance, NULL}, {"measurements", &a->measurements, NULL}, {"truth", &a->truth, NULL},
                                   {"out", &a->out, NULL},       {"json", &a->json, NULL},           {NULL, NULL, NULL}};
    return mk_parse_options(argc, argv, options, "the scenario file", path, error);
}

/* Everything that is known before the scenario is read, and everything that depends on it. */
static int set_campaign(mk_campaign_t *c, const arguments_t *a, const mk_scenario_t *s, mk_error_t *error) {
    long long steps = s->steps, runs = 1, seed = (long long)s->seed;
    c->scenario = s;
    c->tolerance = s->tolerance;
    if (!mk_option_integer("steps", a->steps, 1, 1000000000, &steps, error) || !mk_option_integer("runs", a->runs, 1, 100000000, &runs, error) ||
        !mk_option_integer("seed", a->seed, 0, INT64_MAX, &seed, error) || !mk_option_real("loss", a->loss, 0.0, 1.0, &c->loss, error) ||
        !mk_option_real("tolerance", a->tolerance, 0.0, 1e6, &c->tolerance, error))
        return 0;
    c->steps = (int)steps;
    c->runs = (int)runs;
    c->seed = (uint64_t)seed;
    c->network = &mk_network_f64;
    if (a->real && strcmp(a->real, "float32") == 0) c->network = &mk_network_f32;
    else if (a->real && strcmp(a->real, "float64") != 0) return mk_fail(error, "--real %s: must be float32 or float64", a->real);
    if (a->truth && !a->measurements) return mk_fail(error, "--truth goes with --measurements");
    if (a->measurements && c->runs != 1) return mk_fail(error, "--runs: recorded measurements can be run once only");
    if (!mk_filter_find(a->filter ? a->filter : "rkfdnu2", &c->filter, error)) return 0;
    if (!c->filter && a->out) return mk_fail(error, "--out: a log holds one filter; choose one with --filter");
    if (s->nodes > UINT16_MAX && (!c->filter || c->filter->central))
        return mk_fail(error, "a centralised filter takes at most %d nodes, not %d", UINT16_MAX, s->nodes);
    return 1;
}

/* Runs the campaign's filter, or all of them if it has none, into the table and the JSON list. An exit status. */
static int run_filters(mk_campaign_t *c, mk_source_t *source, json_t *filters, int *interrupted, mk_error_t *error) {
    const mk_filter_t *only = c->filter;
    FILE *table = c->log_path && strcmp(c->log_path, "-") == 0 ? stderr : stdout;
    *interrupted = 0;
    for (int i = 0; i < MK_FILTERS && !*interrupted; i++) {
        mk_result_t result;
        if (only && only != &mk_filters[i]) continue;
        c->filter = &mk_filters[i];
        const int status = mk_campaign_run(c, source, &result, error);
        if (status) return status;
        if (json_array_size(filters) == 0) print_head(table, c, source);
        print_row(table, c, &result);
        (void)json_array_append_new(filters, make_json(c, &result));
        *interrupted = result.interrupted;
        mk_result_free(&result);
    }
    if (*interrupted) (void)fputs("interrupted: the figures are of the runs that were complete\n", table);
    if (source->dropped_readings)
        (void)fprintf(table, "\n%d readings with some of their rows missing were left out whole.\n", source->dropped_readings);
    return 0;
}

static int simulate(mk_campaign_t *c, mk_source_t *source, const char *json, mk_error_t *error) {
    json_t *filters = json_array();
    mk_output_t file;
    int interrupted = 0;
    /* The summary's place is tried before hours are spent on what goes there. */
    int status = json && !mk_open_output(&file, json, error) ? MK_EXIT_INPUT : 0;
    if (!status) {
        mk_error_t file_error;
        status = run_filters(c, source, filters, &interrupted, error);
        if (json) {
            json_t *summary = make_summary(c, source, json_incref(filters));
            if (!status) (void)json_dumpf(summary, file.stream, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
            json_decref(summary);
            if (!mk_close_output(&file, !status, &file_error)) {
                *error = file_error;
                status = MK_EXIT_FAILED;
            }
        }
    }
    json_decref(filters);
    if (status) return mk_complain(error, status);
    return interrupted ? MK_EXIT_FAILED : 0;
}

int mk_command_simulate(int argc, char **argv) {
    mk_error_t error;
    arguments_t a;
    mk_scenario_t scenario;
    mk_campaign_t c;
    mk_source_t source;
    const char *path;
    memset(&a, 0, sizeof a);
    memset(&c, 0, sizeof c);
    if (!read_arguments(argc, argv, &a, &path, &error) || !mk_scenario_load(&scenario, path, &error)) return mk_complain(&error, MK_EXIT_INPUT);
    int good = set_campaign(&c, &a, &scenario, &error);
    if (good && a.measurements) {
        good = mk_source_record(&source, &scenario, a.measurements, a.truth, a.steps ? c.steps : 0, &error);
        if (good) c.steps = source.steps;
    } else if (good) {
        mk_source_draw(&source, &scenario, c.seed);
    }
    int status = MK_EXIT_INPUT;
    if (good) {
        mk_catch_signals();
        c.log_path = a.out;
        c.progress = isatty(STDERR_FILENO) == 1;
        status = simulate(&c, &source, a.json, &error);
        mk_source_free(&source);
    } else {
        (void)mk_complain(&error, status);
    }
    mk_scenario_free(&scenario);
    return status;
}
