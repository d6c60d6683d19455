/* SPDX-License-Identifier: MIT */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "c_header.h"
#include "commands.h"
#include "design/steady.h"
#include "design_report.h"
#include "design_tracking.h"
#include "file.h"
#include "first_error.h"
#include "parallel.h"
#include "process.h"

/* Above this many nodes the guaranteed tolerances of all of them (milliseconds each) are made on request only. */
#define ALL_LIMIT 200
/* Above this many nodes P and V of all of them (a kilobyte each and more, as JSON) are kept and written on request only. */
#define COVARIANCES_LIMIT 10000

typedef struct {
    const char *json, *c_header, *real, *per_step, *tolerance, *c_max, *threads, *frozen;
    const char *truth, *models, *window, *condition, *runs; /* tracking */
    int allow_unobservable, covariances;
    double close;
} arguments_t;

static int check_observability(mk_design_results_t *r, int allow, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    if (!mk_check_observability(s, r->threads, &r->seen, error)) return 0;
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

static void node_bound(void *context, int worker, long k) {
    mk_design_results_t *r = context;
    mk_recursion_t recursion;
    (void)worker;
    mk_recursion_open(&recursion, r->scenario, 0.0);
    mk_neighbourhood_information(r->scenario, k, recursion.S);
    if (!mk_admissible(&recursion, &r->node[k])) r->node[k].count = 0;
    mk_recursion_close(&recursion);
}

static int make_bounds(mk_design_results_t *r, const char *which, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    const int all = which ? strcmp(which, "all") == 0 : s->nodes <= ALL_LIMIT;
    if (which && strcmp(which, "none") == 0) return 1;
    if (which && !all && strcmp(which, "central") != 0) return mk_fail(error, "--c-max %s: must be none, central or all", which);
    mk_recursion_t recursion;
    mk_recursion_open(&recursion, s, 0.0);
    for (int k = 0; k < s->nodes; k++) mk_recursion_add(&recursion, &s->sensor[k]);
    r->has_central = mk_admissible(&recursion, &r->central);
    r->settles = mk_largest_settling(&recursion, s, MK_SEARCH_LIMIT);
    mk_recursion_close(&recursion);
    if (!all || !r->has_central) return 1;
    r->node = mk_allocate((size_t)s->nodes, sizeof *r->node);
    mk_parallel(r->threads, s->nodes, node_bound, r);
    return 1;
}

static void free_results(mk_design_results_t *r) {
    if (r->schedule) mk_schedule_close(r->schedule);
    mk_design_free(&r->design);
    free(r->seen.node);
    free(r->node);
}

static int check_arguments(mk_design_results_t *r, arguments_t *a, double *tolerance, mk_error_t *error) {
    long long threads = mk_cores();
    if (!mk_option_real("tolerance", a->tolerance, 0.0, 1e6, tolerance, error) ||
        !mk_option_integer("per-step", a->per_step, 1, 100000000, &r->steps, error) ||
        !mk_option_integer("threads", a->threads, 1, 1024, &threads, error) ||
        !mk_option_real("frozen", a->frozen, MK_LEAST_CLOSE, MK_MOST_CLOSE, &a->close, error))
        return 0;
    r->threads = (int)threads;
    if (a->real && strcmp(a->real, "float32") != 0 && strcmp(a->real, "float64") != 0)
        return mk_fail(error, "--real %s: must be float32 or float64", a->real);
    if (a->frozen && !a->c_header) return mk_fail(error, "--frozen goes with --c-header");
    return !a->per_step || a->json || mk_fail(error, "--per-step goes with --json");
}

static int design(mk_design_results_t *r, arguments_t *a, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    const double begin = mk_seconds();
    double tolerance = s->tolerance;
    if (!check_arguments(r, a, &tolerance, error) || !check_observability(r, a->allow_unobservable, error) ||
        !mk_design_central(&r->design, s, tolerance, error))
        return 0;
    r->design.local = mk_allocate((size_t)s->nodes, sizeof *r->design.local);
    if (!mk_design_local(&r->design, s, NULL, s->nodes, r->threads, r->design.local, error) ||
        !mk_design_nodes(&r->design, s, r->seen.node, a->json && (a->covariances || s->nodes <= COVARIANCES_LIMIT), r->threads, error) ||
        !make_bounds(r, a->c_max, error))
        return 0;
    if (a->per_step) r->schedule = mk_schedule_open(s, tolerance, NULL, s->nodes, r->threads);
    r->seconds = mk_seconds() - begin;
    return 1;
}

/* Each kind of scenario has options that the other kind cannot follow. */
static int fits_kind(const arguments_t *a, int tracking, mk_error_t *error) {
    const char *linear = a->c_header ? "c-header" : a->real ? "real" : a->per_step ? "per-step" : a->tolerance ? "tolerance" : a->c_max ? "c-max" :
                         a->frozen ? "frozen" : a->covariances ? "covariances" : NULL;
    const char *nonlinear = a->truth ? "truth" : a->models ? "models" : a->window ? "window" : a->condition ? "condition" :
                            a->runs ? "runs" : NULL;
    if (tracking && linear) return mk_fail(error, "design: --%s is for linear scenarios; this one tracks a target (model.motion)", linear);
    if (!tracking && nonlinear) return mk_fail(error, "design: --%s is for scenarios that track a target (model.motion); this one is linear", nonlinear);
    return 1;
}

int mk_command_design(int argc, char **argv) {
    mk_error_t error;
    arguments_t a;
    mk_scenario_t scenario;
    mk_design_results_t r;
    const char *path;
    memset(&a, 0, sizeof a);
    memset(&r, 0, sizeof r);
    const mk_option_t options[] = {{"json", &a.json, NULL},
                                   {"c-header", &a.c_header, NULL},
                                   {"real", &a.real, NULL},
                                   {"per-step", &a.per_step, NULL},
                                   {"tolerance", &a.tolerance, NULL},
                                   {"c-max", &a.c_max, NULL},
                                   {"threads", &a.threads, NULL},
                                   {"covariances", NULL, &a.covariances},
                                   {"frozen", &a.frozen, NULL},
                                   {"truth", &a.truth, NULL},
                                   {"models", &a.models, NULL},
                                   {"window", &a.window, NULL},
                                   {"condition", &a.condition, NULL},
                                   {"runs", &a.runs, NULL},
                                   {"allow-unobservable", NULL, &a.allow_unobservable},
                                   {NULL, NULL, NULL}};
    const double begin = mk_seconds();
    if (!mk_parse_options(argc, argv, options, "the scenario file", &path, &error) || !mk_scenario_load_any(&scenario, path, &error))
        return mk_complain(&error, MK_EXIT_INPUT);
    if (scenario.navigation) {
        mk_scenario_free(&scenario);
        (void)mk_fail(&error, "%s: a navigation scenario: design is for linear and tracking ones", path);
        return mk_complain(&error, MK_EXIT_INPUT);
    }
    if (!fits_kind(&a, scenario.tracking != NULL, &error)) {
        mk_scenario_free(&scenario);
        return mk_complain(&error, MK_EXIT_INPUT);
    }
    if (scenario.tracking) {
        const mk_design_tracking_arguments_t tracking = {a.json, a.truth, a.models, a.window, a.condition, a.runs, a.threads, a.allow_unobservable};
        const int status = mk_design_tracking(&scenario, &tracking);
        mk_scenario_free(&scenario);
        return status;
    }
    r.scenario = &scenario;
    r.loaded = mk_seconds() - begin;
    mk_output_t file;
    /* The place of the results is tried before the work. */
    int status = a.json && !mk_open_output(&file, a.json, &error) ? MK_EXIT_INPUT : 0;
    const int opened = a.json && !status;
    if (!status && !design(&r, &a, &error)) status = MK_EXIT_INPUT;
    if (!status && a.c_header && !mk_write_headers(a.c_header, a.real ? a.real : "float64", &scenario, &r.design, a.close, stderr, &error))
        status = MK_EXIT_FAILED;
    if (opened) {
        mk_error_t file_error;
        if (!status && !mk_write_design(file.stream, &r, &error)) status = MK_EXIT_FAILED;
        if (!mk_close_output(&file, !status, &file_error)) {
            error = file_error;
            status = MK_EXIT_FAILED;
        }
    }
    if (status) (void)mk_complain(&error, status);
    else mk_print_design(&r);
    free_results(&r);
    mk_scenario_free(&scenario);
    return status;
}
