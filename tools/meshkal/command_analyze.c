/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "analysis/analysis.h"
#include "commands.h"
#include "design/design.h"
#include "json_out.h"
#include "parallel.h"
#include "process.h"

/* Above this many nodes the nominal model, for the loss against it, is left out: it doubles the time. */
#define LOSS_LIMIT 200

typedef struct {
    const char *filter, *truth, *horizon, *tolerance, *node, *threads, *json;
    int per_step;
} arguments_t;

typedef struct {
    mk_analysis_t analysis; /* its filter: null for all of them */
    mk_least_favourable_t model;
    mk_performance_t result[MK_FILTERS], nominal[MK_FILTERS]; /* those of the filters asked for; nominal: where there is a loss to show */
    double seconds;
} results_t;

static double decibel(double msd) { return 10.0 * log10(msd); }

static int chosen(const results_t *r, int i) { return !r->analysis.filter || r->analysis.filter == &mk_filters[i]; }

/* --- checks before the work -------------------------------------------------------------------------------------------------- */

/* Every estimator has to have a fixed point: errors would grow over the horizon without end. */
static int check_convergence(const results_t *r, mk_error_t *error) {
    const mk_scenario_t *s = r->analysis.scenario;
    mk_design_t design;
    int good = mk_design_make(&design, s, r->analysis.tolerance, error);
    if (!good) return 0;
    int *none_may_grow = mk_allocate((size_t)s->nodes, sizeof *none_may_grow);
    double *steady = mk_allocate((size_t)s->nodes, sizeof *steady);
    memcpy(steady, design.local, (size_t)s->nodes * sizeof *steady);
    mk_design_free(&design);
    /* RKFDNU tends to RKFDNU2. */
    const mk_tolerance_mode_t modes[] = {MK_TOLERANCE_ZERO, MK_TOLERANCE_GLOBAL, MK_TOLERANCE_STEADY};
    for (size_t m = 0; m < 3 && good; m++) {
        int needed = 0;
        for (int i = 0; i < MK_FILTERS; i++) {
            const mk_tolerance_mode_t mode = mk_filters[i].mode == MK_TOLERANCE_SCHEDULE ? MK_TOLERANCE_STEADY : mk_filters[i].mode;
            needed |= chosen(r, i) && !mk_filters[i].central && mode == modes[m];
        }
        if (!needed) continue;
        memset(&design, 0, sizeof design);
        design.n = s->n;
        design.nodes = s->nodes;
        design.tolerance = r->analysis.tolerance;
        design.local = mk_allocate((size_t)s->nodes, sizeof *design.local);
        for (int k = 0; k < s->nodes; k++)
            design.local[k] = modes[m] == MK_TOLERANCE_STEADY ? steady[k] : modes[m] == MK_TOLERANCE_GLOBAL ? r->analysis.tolerance : 0.0;
        good = mk_design_nodes(&design, s, none_may_grow, 0, r->analysis.threads, error);
        mk_design_free(&design);
    }
    free(none_may_grow);
    free(steady);
    return good;
}

static int check_memory(const results_t *r, mk_error_t *error) {
    const mk_analysis_t *a = &r->analysis;
    const double errors = (double)a->scenario->nodes * a->scenario->n, steps = a->horizon + 1.0, there = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
    const int distributed = !a->filter || !a->filter->central;
    const double needed = (distributed ? 16.0 * errors * errors : 0.0) + steps * (36.0 * a->scenario->n * a->scenario->n + 24.0 * a->scenario->nodes);
    if (!(needed > 0.9 * there)) return 1;
    return mk_fail(error, "the covariance of %d errors of %d states over %d steps takes %.1f GiB; this machine has %.1f", a->scenario->nodes, a->scenario->n,
                   a->horizon, needed / 1073741824.0, there / 1073741824.0);
}

static int read_arguments(results_t *r, const arguments_t *a, const mk_scenario_t *s, mk_error_t *error) {
    long long horizon = 200, node = -1, threads = mk_cores();
    mk_analysis_t *analysis = &r->analysis;
    analysis->scenario = s;
    analysis->tolerance = s->tolerance;
    if (!mk_option_integer("horizon", a->horizon, 1, 1000000, &horizon, error) || !mk_option_integer("node", a->node, 0, s->nodes - 1, &node, error) ||
        !mk_option_integer("threads", a->threads, 1, 1024, &threads, error) ||
        !mk_option_real("tolerance", a->tolerance, 0.0, 1e6, &analysis->tolerance, error) ||
        !mk_filter_find(a->filter ? a->filter : "rkfdnu2", &analysis->filter, error))
        return 0;
    analysis->nominal = a->truth && strcmp(a->truth, "nominal") == 0;
    if (a->truth && !analysis->nominal && strcmp(a->truth, "least-favourable") != 0)
        return mk_fail(error, "--truth %s: must be least-favourable or nominal", a->truth);
    if (a->per_step && !a->json) return mk_fail(error, "--per-step goes with --json");
    if (a->node && !a->json) return mk_fail(error, "--node goes with --json");
    if (a->node && analysis->filter && analysis->filter->central)
        return mk_fail(error, "--node %s: the filter %s is one estimator for all nodes", a->node, analysis->filter->name);
    analysis->horizon = (int)horizon;
    analysis->threads = (int)threads;
    analysis->per_step = a->per_step;
    analysis->node = (int)node;
    return check_memory(r, error);
}

static int analyze(results_t *r, mk_error_t *error) {
    const double from = mk_seconds();
    mk_analysis_t a = r->analysis;
    if (!check_convergence(r, error) || !mk_least_favourable_make(&r->model, a.scenario, a.tolerance, a.horizon, error)) return 0;
    a.model = &r->model;
    for (int i = 0; i < MK_FILTERS; i++) {
        if (!chosen(r, i)) continue;
        a.filter = &mk_filters[i];
        a.nominal = r->analysis.nominal;
        a.node = a.filter->central ? -1 : r->analysis.node;
        if (!mk_analyse(&a, &r->result[i], error)) return 0;
        if (a.nominal || a.scenario->nodes > LOSS_LIMIT) continue;
        a.nominal = 1;
        a.node = -1;
        if (!mk_analyse(&a, &r->nominal[i], error)) return 0;
    }
    r->seconds = mk_seconds() - from;
    return 1;
}

/* --- results ------------------------------------------------------------------------------------------------------------------ */

static json_t *matrix_json(int n, const double *S) {
    json_t *rows = json_array();
    for (int i = 0; i < n; i++) (void)json_array_append_new(rows, mk_json_numbers(S + i * n, (size_t)n));
    return rows;
}

static json_t *steps_json(const double *values, int steps, int estimators) {
    json_t *rows = json_array();
    for (int t = 0; t < steps; t++) (void)json_array_append_new(rows, mk_json_numbers(values + (size_t)t * (size_t)estimators, (size_t)estimators));
    return rows;
}

static json_t *covariance_json(const mk_scenario_t *s, int node, const mk_performance_t *p) {
    const int square = s->n * s->n, slots = s->first[node + 1] - s->first[node];
    json_t *object = json_object(), *neighbours = json_array();
    mk_json_set(object, "node", json_integer(node));
    mk_json_set(object, "step", json_integer(p->steady_step));
    mk_json_set(object, "own", matrix_json(s->n, p->covariance));
    for (int i = 1; i < slots; i++) {
        json_t *neighbour = json_object();
        mk_json_set(neighbour, "node", json_integer(s->slot[s->first[node] + i]));
        mk_json_set(neighbour, "block", matrix_json(s->n, p->covariance + i * square));
        (void)json_array_append_new(neighbours, neighbour);
    }
    mk_json_set(object, "neighbours", neighbours);
    mk_json_set(object, "central", matrix_json(s->n, p->covariance + slots * square));
    return object;
}

static void set_head(json_t *object, const results_t *r) {
    const mk_analysis_t *a = &r->analysis;
    mk_json_set(object, "scenario", json_string(a->scenario->name));
    mk_json_set(object, "scenario_sha256", json_string(a->scenario->sha256));
    mk_json_set(object, "truth", json_string(a->nominal ? "nominal" : "least-favourable"));
    mk_json_set(object, "tolerance", json_real(a->tolerance));
    mk_json_set(object, "horizon", json_integer(a->horizon));
}

static json_t *filter_json(const results_t *r, int i) {
    const mk_analysis_t *a = &r->analysis;
    const mk_performance_t *p = &r->result[i];
    const size_t steps = (size_t)p->horizon + 1, E = (size_t)p->estimators;
    const int position = a->scenario->position_count > 0, at = p->steady_step;
    json_t *object = json_object(), *central = json_object();
    set_head(object, r);
    mk_json_set(object, "filter", json_string(mk_filters[i].name));
    mk_json_set(object, "msd", mk_json_numbers(p->msd, steps));
    mk_json_set(object, "position_msd", position ? mk_json_numbers(p->position_msd, steps) : json_null());
    mk_json_set(object, "steady", json_boolean(p->steady));
    mk_json_set(object, "steady_step", json_integer(at));
    mk_json_set(object, "msd_db", p->steady ? mk_json_number(decibel(p->msd[at])) : json_null());
    mk_json_set(object, "position_msd_db", p->steady && position ? mk_json_number(decibel(p->position_msd[at])) : json_null());
    mk_json_set(object, "node_msd", mk_json_numbers(p->node_msd, E));
    mk_json_set(object, "node_position_msd", position ? mk_json_numbers(p->node_position_msd, E) : json_null());
    mk_json_set(object, "mean_tolerance", mk_json_number(p->mean_tolerance));
    mk_json_set(object, "mean_theta", mk_json_number(p->mean_theta));
    mk_json_set(object, "node_tolerance", mk_json_numbers(p->node_tolerance, E));
    mk_json_set(object, "node_theta", mk_json_numbers(p->node_theta, E));
    mk_json_set(central, "msd", mk_json_numbers(p->central_msd, steps));
    mk_json_set(central, "position_msd", position ? mk_json_numbers(p->central_position_msd, steps) : json_null());
    mk_json_set(central, "msd_db", p->steady ? mk_json_number(decibel(p->central_msd[at])) : json_null());
    mk_json_set(central, "position_msd_db", p->steady && position ? mk_json_number(decibel(p->central_position_msd[at])) : json_null());
    mk_json_set(central, "theta", mk_json_number(p->central_theta));
    mk_json_set(central, "trace_V", mk_json_number(p->central_trace_V));
    mk_json_set(object, "central", central);
    mk_json_set(object, "seconds", mk_json_number(p->seconds));
    mk_json_set(object, "peak_memory_bytes", json_integer((json_int_t)mk_peak_memory()));
    if (p->tolerance) {
        mk_json_set(object, "tolerance_over_time", steps_json(p->tolerance, p->horizon + 1, p->estimators));
        mk_json_set(object, "theta_over_time", steps_json(p->theta, p->horizon + 1, p->estimators));
    }
    if (p->covariance) mk_json_set(object, "covariance", covariance_json(a->scenario, a->node, p));
    return object;
}

static json_t *make_json(const results_t *r) {
    json_t *root = json_object(), *filters = json_array();
    for (int i = 0; i < MK_FILTERS; i++) {
        if (!chosen(r, i)) continue;
        if (r->analysis.filter) {
            json_decref(root);
            json_decref(filters);
            return filter_json(r, i);
        }
        (void)json_array_append_new(filters, filter_json(r, i));
    }
    set_head(root, r);
    mk_json_set(root, "filters", filters);
    mk_json_set(root, "seconds", mk_json_number(r->seconds));
    mk_json_set(root, "peak_memory_bytes", json_integer((json_int_t)mk_peak_memory()));
    return root;
}

static void print_cell(int width, int digits, double value) {
    if (isfinite(value)) (void)printf(" %*.*f", width, digits, value);
    else (void)printf(" %*s", width, "-");
}

/* One filter: means, and the node that fares worst. */
static void print_filter(const results_t *r, int i) {
    const mk_performance_t *p = &r->result[i], *nominal = &r->nominal[i];
    const int at = p->steady_step, position = r->analysis.scenario->position_count > 0;
    int worst = 0;
    for (int e = 1; e < p->estimators; e++)
        if (p->node_msd[e] > p->node_msd[worst]) worst = e;
    (void)printf("%-8s", mk_filters[i].name);
    print_cell(9, 4, p->steady ? decibel(p->msd[at]) : (double)NAN);
    print_cell(13, 4, p->steady && position ? decibel(p->position_msd[at]) : (double)NAN);
    print_cell(14, 4, p->steady && nominal->msd ? decibel(p->msd[at] / nominal->msd[at]) : (double)NAN);
    (void)printf(" %9.5f %8.4f", p->mean_tolerance, p->mean_theta);
    if (mk_filters[i].central) (void)printf(" %8s %9s\n", "-", "-");
    else (void)printf(" %8d %9.4f\n", worst, decibel(p->node_msd[worst]));
}

static void print_nodes(const results_t *r, int i) {
    const mk_scenario_t *s = r->analysis.scenario;
    const mk_performance_t *p = &r->result[i], *nominal = &r->nominal[i];
    const int many = p->estimators > 40;
    (void)printf("\n%7s %6s %12s %10s %9s %14s %15s\n", "node", "degree", "tolerance", "theta", "MSD [dB]", "position [dB]", "loss [dB]");
    for (int k = 0; k < p->estimators; k++) {
        if (many && k >= 10 && k < p->estimators - 3) continue;
        (void)printf("%7d %6d %12.6g %10.5g", k, s->first[k + 1] - s->first[k], p->node_tolerance[k], p->node_theta[k]);
        print_cell(9, 4, decibel(p->node_msd[k]));
        print_cell(14, 4, s->position_count ? decibel(p->node_position_msd[k]) : (double)NAN);
        print_cell(15, 4, nominal->msd ? decibel(p->node_msd[k] / nominal->node_msd[k]) : (double)NAN);
        (void)puts("");
        if (many && k == 9) (void)puts("    ...");
    }
}

static void print_table(const results_t *r) {
    const mk_analysis_t *a = &r->analysis;
    const mk_scenario_t *s = a->scenario;
    const mk_performance_t *last = NULL;
    int steady = 1;
    (void)printf("%s: %d nodes, %d states, %s model over %d steps; c = %g (twice the Kullback-Leibler divergence, nats)\n"
                 "Mean squared deviation at t = %d, by covariances. Loss: against the same filter under the nominal model.\n\n",
                 s->name[0] ? s->name : "scenario", s->nodes, s->n, a->nominal ? "nominal" : "least favourable", a->horizon, a->tolerance, a->horizon / 2);
    (void)printf("%-8s %9s %13s %14s %9s %8s %8s %9s\n", "filter", "MSD [dB]", "position [dB]", "loss [dB]", "mean c", "theta", "worst", "MSD [dB]");
    for (int i = 0; i < MK_FILTERS; i++) {
        if (!chosen(r, i)) continue;
        print_filter(r, i);
        last = &r->result[i];
        steady &= last->steady;
    }
    if (steady) (void)printf("\nRKFC itself here: %.4f dB, theta %.4f; its trace V, %.4f dB, is not its error\n", decibel(last->central_msd[last->steady_step]), last->central_theta, decibel(last->central_trace_V));
    for (int i = 0; i < MK_FILTERS; i++)
        if (a->filter == &mk_filters[i] && !a->filter->central) print_nodes(r, i);
    if (!steady)
        (void)printf("\nnot steady at t = %d: the horizon T = %d is too short for both of its ends to die out; try --horizon %d\n", a->horizon / 2,
                     a->horizon, a->horizon < 100 ? 200 : 2 * a->horizon);
    (void)printf("\n%.2f s, %.0f MiB\n", r->seconds, mk_peak_memory() / 1048576.0);
}

static void free_results(results_t *r) {
    for (int i = 0; i < MK_FILTERS; i++) {
        mk_performance_free(&r->result[i]);
        mk_performance_free(&r->nominal[i]);
    }
    mk_least_favourable_free(&r->model);
}

int mk_command_analyze(int argc, char **argv) {
    mk_error_t error;
    arguments_t a;
    mk_scenario_t scenario;
    results_t r;
    const char *path;
    memset(&a, 0, sizeof a);
    memset(&r, 0, sizeof r);
    const mk_option_t options[] = {{"filter", &a.filter, NULL}, {"truth", &a.truth, NULL},     {"horizon", &a.horizon, NULL},      {"tolerance", &a.tolerance, NULL},
                                   {"node", &a.node, NULL},     {"threads", &a.threads, NULL}, {"per-step", NULL, &a.per_step}, {"json", &a.json, NULL},
                                   {NULL, NULL, NULL}};
    if (!mk_parse_options(argc, argv, options, "the scenario file", &path, &error) || !mk_scenario_load(&scenario, path, &error))
        return mk_complain(&error, MK_EXIT_INPUT);
    mk_output_t file;
    /* The place of the results is tried before the work. */
    int status = !read_arguments(&r, &a, &scenario, &error) || (a.json && !mk_open_output(&file, a.json, &error)) ? MK_EXIT_INPUT : 0;
    const int opened = a.json && !status;
    if (!status && !analyze(&r, &error)) status = MK_EXIT_INPUT;
    if (opened) {
        mk_error_t file_error;
        if (!status) {
            json_t *root = make_json(&r);
            (void)json_dumpf(root, file.stream, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
            json_decref(root);
        }
        if (!mk_close_output(&file, !status, &file_error)) {
            error = file_error;
            status = MK_EXIT_FAILED;
        }
    }
    if (status) (void)mk_complain(&error, status);
    else print_table(&r);
    free_results(&r);
    mk_scenario_free(&scenario);
    return status;
}
