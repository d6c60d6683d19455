/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "admissible.h"
#include "c_header.h"
#include "commands.h"
#include "design.h"
#include "json_out.h"

/* The largest tolerance that the search for one at which the recursion no longer settles goes up to. */
#define SEARCH_LIMIT 10.0
/* Above this many nodes the guaranteed tolerances of all of them (milliseconds each) are made on request only. */
#define ALL_LIMIT 200

typedef struct {
    const char *json, *c_header, *real, *per_step, *tolerance, *c_max;
    int allow_unobservable;
} arguments_t;

typedef struct {
    const mk_scenario_t *scenario;
    mk_design_t design;
    mk_observability_t seen;
    mk_admissible_t central, *node; /* node: null if not made */
    int has_central;
    double settles; /* largest c that settles, at most SEARCH_LIMIT */
    double *schedule;
    long long steps;
    double seconds;
} results_t;

static int check_observability(results_t *r, int allow, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    if (!mk_check_observability(s, &r->seen, error)) return 0;
    if (r->seen.unreachable > 0 && !allow)
        return mk_fail(error, "the noise Q does not reach %d of %d state dimensions: covariances become singular (--allow-unobservable goes on)",
                       r->seen.unreachable, s->n);
    if (r->seen.blind_nodes == 0 || allow) return 1;
    char list[256] = "";
    int named = 0, first = -1;
    for (int k = 0; k < s->nodes; k++) {
        if (r->seen.node[k] == 0) continue;
        if (first < 0) first = k;
        char item[32];
        (void)snprintf(item, sizeof item, "%snode %d", named ? ", " : "", k);
        if (++named <= 10) (void)strncat(list, item, sizeof list - strlen(list) - 1);
    }
    if (named > 10) (void)strncat(list, ", ...", sizeof list - strlen(list) - 1);
    return mk_fail(error, "%s: with the neighbours' sensors %d of %d state dimensions are not observable%s (--allow-unobservable goes on)", list,
                   r->seen.node[first], s->n, named > 1 ? " at the first of them" : "");
}

static int make_bounds(results_t *r, const char *which, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    const int all = which ? strcmp(which, "all") == 0 : s->nodes <= ALL_LIMIT;
    if (which && strcmp(which, "none") == 0) return 1;
    if (which && !all && strcmp(which, "central") != 0) return mk_fail(error, "--c-max %s: must be none, central or all", which);
    mk_recursion_t recursion;
    mk_recursion_open(&recursion, s, 0.0);
    for (int k = 0; k < s->nodes; k++) mk_recursion_add(&recursion, &s->sensor[k]);
    r->has_central = mk_admissible(&recursion, &r->central);
    mk_recursion_close(&recursion);
    r->settles = mk_largest_settling(s, SEARCH_LIMIT);
    if (!all || !r->has_central) return 1;
    r->node = mk_allocate((size_t)s->nodes, sizeof *r->node);
    for (int k = 0; k < s->nodes; k++) {
        mk_recursion_open(&recursion, s, 0.0);
        for (int i = s->first[k]; i < s->first[k + 1]; i++) mk_recursion_add(&recursion, &s->sensor[s->slot[i]]);
        if (!mk_admissible(&recursion, &r->node[k])) r->node[k].count = 0;
        mk_recursion_close(&recursion);
    }
    return 1;
}

static double bound(const mk_admissible_t *a) { return a->count ? a->c[a->count - 1] : 0.0; }

static double trace(int n, const double *S) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += S[i * (i + 1) / 2 + i];
    return sum;
}

static json_t *steady_json(int n, const mk_steady_t *steady) {
    json_t *object = json_object();
    mk_json_set(object, "theta", steady->P ? json_real(steady->theta) : json_null());
    mk_json_set(object, "P", steady->P ? mk_json_symmetric(n, steady->P) : json_null());
    mk_json_set(object, "V", steady->V ? mk_json_symmetric(n, steady->V) : json_null());
    return object;
}

static json_t *make_json(const results_t *r) {
    const mk_scenario_t *s = r->scenario;
    json_t *root = json_object(), *nodes = json_array(), *horizons = json_array();
    mk_json_set(root, "scenario", json_string(s->name));
    mk_json_set(root, "scenario_sha256", json_string(s->sha256));
    mk_json_set(root, "tolerance", json_real(r->design.tolerance));
    mk_json_set(root, "central", steady_json(s->n, &r->design.central));
    for (int k = 0; k < s->nodes; k++) {
        json_t *node = steady_json(s->n, &r->design.node[k]);
        mk_json_set(node, "node", json_integer(k));
        mk_json_set(node, "degree", json_integer(s->first[k + 1] - s->first[k]));
        mk_json_set(node, "tolerance", json_real(r->design.local[k]));
        mk_json_set(node, "unobservable", json_integer(r->seen.node[k]));
        if (r->node) mk_json_set(node, "c_max", mk_json_number(bound(&r->node[k])));
        (void)json_array_append_new(nodes, node);
    }
    mk_json_set(root, "nodes", nodes);
    mk_json_set(root, "unobservable", json_integer(r->seen.global));
    mk_json_set(root, "unreachable", json_integer(r->seen.unreachable));
    if (r->has_central) {
        for (int i = 0; i < r->central.count; i++) {
            json_t *entry = json_object();
            mk_json_set(entry, "horizon", json_integer(r->central.horizon[i]));
            mk_json_set(entry, "c_max", mk_json_number(r->central.c[i]));
            (void)json_array_append_new(horizons, entry);
        }
        mk_json_set(root, "c_max", mk_json_number(bound(&r->central)));
        mk_json_set(root, "c_max_horizon", json_integer(r->central.horizon[r->central.count - 1]));
        mk_json_set(root, "c_settles", json_real(r->settles));
    }
    mk_json_set(root, "c_max_by_horizon", horizons);
    if (r->schedule) {
        json_t *steps = json_array();
        for (long long t = 0; t < r->steps; t++)
            (void)json_array_append_new(steps, mk_json_numbers(r->schedule + (size_t)t * (size_t)s->nodes, (size_t)s->nodes));
        mk_json_set(root, "per_step", steps);
    }
    return root;
}

static void print_bound(const char *text, double c) {
    if (isinf(c)) (void)printf("%s every c", text);
    else if (c > 0.0) (void)printf("%s c < %.4g", text, c);
    else (void)printf("%s none", text);
}

/* One line of the table; width: of the first column. */
static void print_line(const results_t *r, const char *name, int degree, double tolerance, const mk_steady_t *steady, const mk_admissible_t *limit) {
    const int n = r->scenario->n;
    (void)printf("%7s %6d %12.6g", name, degree, tolerance);
    if (steady->P) (void)printf(" %10.5g %12.6g %12.6g", steady->theta, trace(n, steady->P), trace(n, steady->V));
    else (void)printf(" %10s %12s %12s", "-", "grows", "grows");
    if (!limit) (void)printf(" %12s\n", "-");
    else if (isinf(bound(limit))) (void)printf(" %12s\n", "every c");
    else (void)printf(" %12.4g\n", bound(limit));
}

static void print_table(const results_t *r) {
    const mk_scenario_t *s = r->scenario;
    const mk_design_t *d = &r->design;
    const int many = s->nodes > 40;
    double local = 0.0, theta = 0.0, least = (double)INFINITY, most = 0.0;
    int over = 0, settled = 0;
    (void)printf("%s: %d nodes, %d states; c = %g (twice the Kullback-Leibler divergence, nats)\n\n", s->name[0] ? s->name : "scenario", s->nodes, s->n,
                 d->tolerance);
    (void)printf("%7s %6s %12s %10s %12s %12s %12s\n", "node", "degree", "tolerance", "theta", "trace P", "trace V", "guaranteed <");
    print_line(r, "central", s->nodes, d->tolerance, &d->central, r->has_central ? &r->central : NULL);
    for (int k = 0; k < s->nodes; k++) {
        char name[16];
        local += d->local[k] / s->nodes;
        least = fmin(least, d->local[k]);
        most = fmax(most, d->local[k]);
        over += r->node && d->local[k] > bound(&r->node[k]);
        if (d->node[k].P) {
            theta += d->node[k].theta;
            settled++;
        }
        if (many && k >= 10 && k < s->nodes - 3) continue;
        (void)snprintf(name, sizeof name, "%d", k);
        print_line(r, name, s->first[k + 1] - s->first[k], d->local[k], &d->node[k], r->node ? &r->node[k] : NULL);
        if (many && k == 9) (void)puts("    ...");
    }
    (void)printf("\nmean tolerance %.6g (%.6g to %.6g), mean theta %.5g, %.2f s\n", local, least, most, theta / settled, r->seconds);
    if (r->seen.unreachable) (void)printf("not reached by Q: %d of %d state dimensions\n", r->seen.unreachable, s->n);
    if (r->seen.blind_nodes) (void)printf("nodes that do not observe all states: %d\n", r->seen.blind_nodes);
    if (!r->has_central) return;
    print_bound("convergence of the centralised filter: guaranteed for", bound(&r->central));
    (void)printf(" (%d steps); seen %s c = %.3g\n", r->central.horizon[r->central.count - 1],
                 r->settles >= SEARCH_LIMIT ? "at least up to" : "up to", r->settles);
    if (over)
        (void)printf("%d nodes have a tolerance above the guaranteed one, which is sufficient, not necessary%s\n", over,
                     settled == s->nodes ? ": all converged" : "");
}

static void free_results(results_t *r) {
    mk_design_free(&r->design);
    free(r->seen.node);
    free(r->node);
    free(r->schedule);
}

static int design(results_t *r, const arguments_t *a, mk_error_t *error) {
    struct timespec from, to;
    double tolerance = r->scenario->tolerance;
    (void)clock_gettime(CLOCK_MONOTONIC, &from);
    if (!mk_option_real("tolerance", a->tolerance, 0.0, 1e6, &tolerance, error) ||
        !mk_option_integer("per-step", a->per_step, 1, 100000000, &r->steps, error))
        return 0;
    if (a->real && strcmp(a->real, "float32") != 0 && strcmp(a->real, "float64") != 0)
        return mk_fail(error, "--real %s: must be float32 or float64", a->real);
    if (a->per_step && !a->json) return mk_fail(error, "--per-step goes with --json");
    if (!check_observability(r, a->allow_unobservable, error) || !mk_design_make(&r->design, r->scenario, tolerance, error) ||
        !mk_design_nodes(&r->design, r->scenario, r->seen.node, error) || !make_bounds(r, a->c_max, error))
        return 0;
    if (a->per_step && !(r->schedule = mk_design_schedule(r->scenario, tolerance, (int)r->steps, error))) return 0;
    (void)clock_gettime(CLOCK_MONOTONIC, &to);
    r->seconds = (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec);
    return 1;
}

int mk_command_design(int argc, char **argv) {
    mk_error_t error;
    arguments_t a;
    mk_scenario_t scenario;
    results_t r;
    const char *path;
    memset(&a, 0, sizeof a);
    memset(&r, 0, sizeof r);
    const mk_option_t options[] = {{"json", &a.json, NULL},
                                   {"c-header", &a.c_header, NULL},
                                   {"real", &a.real, NULL},
                                   {"per-step", &a.per_step, NULL},
                                   {"tolerance", &a.tolerance, NULL},
                                   {"c-max", &a.c_max, NULL},
                                   {"allow-unobservable", NULL, &a.allow_unobservable},
                                   {NULL, NULL, NULL}};
    if (!mk_parse_options(argc, argv, options, "the scenario file", &path, &error) || !mk_scenario_load(&scenario, path, &error))
        return mk_complain(&error, MK_EXIT_INPUT);
    r.scenario = &scenario;
    mk_output_t file;
    /* The place of the results is tried before the work. */
    int status = a.json && !mk_open_output(&file, a.json, &error) ? MK_EXIT_INPUT : 0;
    const int opened = a.json && !status;
    if (!status && !design(&r, &a, &error)) status = MK_EXIT_INPUT;
    if (!status && a.c_header && !mk_write_headers(a.c_header, a.real ? a.real : "float64", &scenario, &r.design, &error))
        status = MK_EXIT_FAILED;
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
