/* SPDX-License-Identifier: MIT */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "fit/consistency.h"
#include "fit/fit.h"
#include "json_out.h"

/* Longer tables show their worst rows only; the JSON file has all. */
#define SHOWN 12

typedef struct {
    const char *states, *measurements, *steps, *level, *json;
} arguments_t;

/* The runs: centralised (the exact check), plain and robust distributed filter. */
enum { RUNS = 3 };
static const char *const run_names[RUNS] = {"kfc", "kfd", "rkfdnu2"};

typedef struct {
    const mk_scenario_t *scenario;
    mk_fit_t fit;
    mk_consistency_t run[RUNS];
    char why_not[RUNS][sizeof(((mk_error_t *)0)->text)]; /* not empty: not run */
    int dropped;
} results_t;

/* --- text ------------------------------------------------------------------------------------------------------------------- */

static void print_head(const results_t *r) {
    const mk_fit_t *f = &r->fit;
    const mk_fit_block_t *all = &f->all;
    const mk_mismatch_t *m = &all->mismatch;
    (void)printf("%s: %d nodes, %d states, %d steps, %d of them with all readings; %d residuals a step\n",
                 r->scenario->name[0] ? r->scenario->name : "scenario", r->scenario->nodes, r->scenario->n, f->steps, f->complete_steps, all->rows);
    (void)printf("c is twice the Kullback-Leibler divergence (nats) of the residuals' normal law from the model's.\n\n");
    (void)printf("  c                 %.6g\n", fmax(all->c, 0.0));
    if (all->c < 0.0) (void)printf("    without bias    %.6g, taken as 0\n", all->c);
    (void)printf("  %.4g %% interval   %.6g to %.6g\n", 100.0 * f->level, all->low, all->high);
    (void)printf("  test of c = 0     chi-square %.2f with %.1f degrees, p = %.3g\n", all->statistic, all->degrees, all->p);
    (void)printf("  verdict           %s\n", f->consistent ? "consistent: c = 0" : "not consistent with the model");
    (void)printf("  tolerance         %.6g\n", f->tolerance);
    if (m->lags > 0 && m->spread * all->steps > 1.01) (void)printf("  correlated in time: %d steps count as %.0f\n", all->steps, 1.0 / m->spread);
    if (m->tails_p < 0.0027)
        (void)printf("  tails are not normal: kurtosis %.3f of the normal law's; c does not hold them, the interval is approximate\n", m->kurtosis);
    if (!f->joint)
        (void)printf("  sum over blocks, taken as independent: a joint fit of %d rows needs %d steps with all readings%s\n", all->rows,
                     all->rows + MK_FIT_SPARE,
                     f->complete_steps < all->rows + MK_FIT_SPARE ? "" : ", and more of these, correlated in time as they are");
    if (f->left_out) (void)printf("  %d node%s with too few readings left out\n", f->left_out, f->left_out == 1 ? "" : "s");
    if (r->dropped) (void)printf("  %d readings with some of their rows missing were left out whole\n", r->dropped);
}

static int by_p(const void *left, const void *right) {
    const mk_fit_block_t *a = left, *b = right;
    return (a->p > b->p) - (a->p < b->p);
}

static void print_blocks(const results_t *r) {
    const mk_fit_t *f = &r->fit;
    mk_fit_block_t *block = mk_allocate((size_t)f->blocks, sizeof *block);
    int count = 0;
    for (int b = 0; b < f->blocks; b++)
        if (f->block[b].enough) block[count++] = f->block[b];
    const int shown = count > SHOWN ? SHOWN : count;
    if (shown < count) qsort(block, (size_t)count, sizeof *block, by_p);
    (void)printf("\n%-16s %7s %5s %11s %11s %11s %10s %10s\n", "block", "steps", "rows", "c", "from", "to", "p", "p (Holm)");
    for (int b = 0; b < shown; b++) {
        char name[24];
        (void)printf("%-16s %7d %5d %11.5g ", mk_fit_name(block[b].node, name), block[b].steps, block[b].rows, block[b].c);
        if (isnan(block[b].low)) (void)printf("%11s %11s", "-", "-");
        else (void)printf("%11.5g %11.5g", block[b].low, block[b].high);
        (void)printf(" %10.3g %10.3g%s\n", block[b].p, block[b].p_holm, block[b].p_holm < 1.0 - f->level ? "  not consistent" : "");
    }
    if (shown < count) (void)printf("%d more with larger p\n", count - shown);
    (void)printf("%d of %d blocks are not consistent (Holm's correction for their number)\n", f->rejected, count);
    free(block);
}

static double departure(const mk_consistency_t *c, int e) {
    double worst = 0.0;
    const mk_mean_t *const means[] = {&c->nis[e], &c->nees[e]};
    for (int i = 0; i < 2; i++)
        if (!isnan(means[i]->mean)) worst = fmax(worst, fabs(means[i]->mean - 1.0) / (means[i]->high - means[i]->low));
    return worst;
}

static void print_mean(const mk_mean_t *mean) {
    if (isnan(mean->mean)) (void)printf(" %9s %17s %-10s", "-", "-", "-");
    else (void)printf(" %9.4f %8.4f %8.4f %-10s", mean->mean, mean->low, mean->high, mk_consistency_verdict(mean));
}

static void print_run(const mk_consistency_t *c) {
    const int shown = c->estimators > SHOWN ? SHOWN : c->estimators;
    char *done = mk_allocate((size_t)c->estimators, 1);
    int apart[2] = {0, 0};
    for (int e = 0; e < c->estimators; e++) {
        apart[0] += c->nis[e].mean < c->nis[e].low || c->nis[e].mean > c->nis[e].high;
        apart[1] += c->nees[e].mean < c->nees[e].low || c->nees[e].mean > c->nees[e].high;
    }
    for (int i = 0; i < shown; i++) {
        /* In their order if all are shown, else the next worst. */
        int e = i;
        for (int other = 0; other < c->estimators && shown < c->estimators; other++)
            if (!done[other] && (done[e] || departure(c, other) > departure(c, e))) e = other;
        done[e] = 1;
        (void)printf("%-8s", c->filter->name);
        if (c->filter->central) (void)printf(" %7s", "centre");
        else (void)printf(" %7d", e);
        print_mean(&c->nis[e]);
        print_mean(&c->nees[e]);
        (void)printf("\n");
    }
    if (shown < c->estimators)
        (void)printf("%-8s %7d more; outside the interval: %d of %d by NIS, %d by NEES\n", c->filter->name, c->estimators - shown, apart[0],
                     c->estimators, apart[1]);
    free(done);
}

static void print_runs(const results_t *r) {
    (void)printf("\nFilters on these data, second half of the steps; 1 is expected, the intervals hold for all nodes of a filter together.\n"
                 "kfc has exactly this law under the model. V of a node is not diffused, and widened if c > 0: its NEES may differ.\n\n");
    (void)printf("%-8s %7s %9s %17s %-10s %9s %17s %s\n", "filter", "node", "NIS/rows", "interval", "", "NEES/n", "interval", "");
    for (int i = 0; i < RUNS; i++) {
        if (r->why_not[i][0]) (void)printf("%-8s not run: %s\n", run_names[i], r->why_not[i]);
        else print_run(&r->run[i]);
    }
}

/* --- JSON ------------------------------------------------------------------------------------------------------------------- */

static json_t *block_json(const mk_fit_block_t *b) {
    char name[24];
    json_t *object = json_object();
    mk_json_set(object, "block", json_string(mk_fit_name(b->node, name)));
    if (b->node >= 0) mk_json_set(object, "node", json_integer(b->node));
    mk_json_set(object, "rows", json_integer(b->rows));
    mk_json_set(object, "steps", json_integer(b->steps));
    mk_json_set(object, "left_out", json_boolean(!b->enough));
    if (!b->enough) return object;
    mk_json_set(object, "c", mk_json_number(b->c));
    mk_json_set(object, "low", mk_json_number(b->low));
    mk_json_set(object, "high", mk_json_number(b->high));
    mk_json_set(object, "c_with_bias", mk_json_number(b->mismatch.raw));
    mk_json_set(object, "statistic", mk_json_number(b->statistic));
    mk_json_set(object, "degrees", mk_json_number(b->degrees));
    mk_json_set(object, "p", mk_json_number(b->p));
    if (b->node != MK_FIT_ALL) mk_json_set(object, "p_holm", mk_json_number(b->p_holm));
    mk_json_set(object, "effective_steps", mk_json_number(1.0 / b->mismatch.spread));
    mk_json_set(object, "lags", json_integer(b->mismatch.lags));
    mk_json_set(object, "white_p", mk_json_number(b->mismatch.white_p));
    mk_json_set(object, "kurtosis", mk_json_number(b->mismatch.kurtosis));
    mk_json_set(object, "kurtosis_p", mk_json_number(b->mismatch.tails_p));
    return object;
}

static json_t *means_json(const mk_mean_t *means, int count) {
    json_t *array = json_array();
    for (int e = 0; e < count; e++) {
        json_t *object = json_object();
        mk_json_set(object, "mean", mk_json_number(means[e].mean));
        mk_json_set(object, "low", mk_json_number(means[e].low));
        mk_json_set(object, "high", mk_json_number(means[e].high));
        mk_json_set(object, "verdict", json_string(mk_consistency_verdict(&means[e])));
        (void)json_array_append_new(array, object);
    }
    return array;
}

static json_t *make_json(const results_t *r) {
    const mk_fit_t *f = &r->fit;
    json_t *root = json_object(), *blocks = json_array(), *runs = json_array();
    mk_json_set(root, "scenario", json_string(r->scenario->name));
    mk_json_set(root, "scenario_sha256", json_string(r->scenario->sha256));
    mk_json_set(root, "steps", json_integer(f->steps));
    mk_json_set(root, "complete_steps", json_integer(f->complete_steps));
    mk_json_set(root, "level", json_real(f->level));
    mk_json_set(root, "joint", json_boolean(f->joint));
    mk_json_set(root, "nodes_left_out", json_integer(f->left_out));
    mk_json_set(root, "consistent", json_boolean(f->consistent));
    mk_json_set(root, "tolerance", mk_json_number(f->tolerance));
    mk_json_set(root, "all", block_json(&f->all));
    for (int b = 0; b < f->blocks; b++) (void)json_array_append_new(blocks, block_json(&f->block[b]));
    mk_json_set(root, "blocks", blocks);
    mk_json_set(root, "blocks_rejected", json_integer(f->rejected));
    for (int i = 0; i < RUNS; i++) {
        json_t *object = json_object();
        mk_json_set(object, "filter", json_string(run_names[i]));
        if (r->why_not[i][0]) {
            mk_json_set(object, "not_run", json_string(r->why_not[i]));
        } else {
            mk_json_set(object, "tolerance", json_real(r->run[i].tolerance));
            mk_json_set(object, "steps", json_integer(r->run[i].steps));
            mk_json_set(object, "nis", means_json(r->run[i].nis, r->run[i].estimators));
            mk_json_set(object, "nees", means_json(r->run[i].nees, r->run[i].estimators));
        }
        (void)json_array_append_new(runs, object);
    }
    mk_json_set(root, "filters", runs);
    return root;
}

/* --- command ---------------------------------------------------------------------------------------------------------------- */

/* A filter that cannot run on these data does not take the fit away: its row says why. */
static void run_filters(results_t *r, mk_source_t *source) {
    for (int i = 0; i < RUNS; i++) {
        const mk_filter_t *filter = mk_filters;
        while (strcmp(filter->name, run_names[i]) != 0) filter++;
        const double tolerance = filter->mode == MK_TOLERANCE_STEADY ? r->fit.tolerance : 0.0;
        mk_error_t error;
        if (filter->mode == MK_TOLERANCE_STEADY && r->fit.consistent)
            (void)snprintf(r->why_not[i], sizeof r->why_not[i], "with c = 0 it is kfd");
        else if (!mk_consistency_make(&r->run[i], source, filter, tolerance, r->fit.level, &error))
            (void)snprintf(r->why_not[i], sizeof r->why_not[i], "%s", error.text);
    }
}

static int fit(results_t *r, mk_source_t *source, const arguments_t *a, double level, mk_error_t *error) {
    mk_output_t file;
    if (a->json && !mk_open_output(&file, a->json, error)) return MK_EXIT_INPUT;
    int status = mk_fit_make(&r->fit, source, a->states, a->measurements, level, error) ? 0 : MK_EXIT_INPUT;
    if (!status) {
        r->dropped = source->dropped_readings;
        run_filters(r, source);
        print_head(r);
        print_blocks(r);
        print_runs(r);
    }
    if (a->json) {
        mk_error_t file_error;
        json_t *root = status ? NULL : make_json(r);
        if (root) (void)json_dumpf(root, file.stream, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
        json_decref(root);
        if (!mk_close_output(&file, !status, &file_error)) {
            *error = file_error;
            status = MK_EXIT_FAILED;
        }
    }
    for (int i = 0; i < RUNS; i++) mk_consistency_free(&r->run[i]);
    mk_fit_free(&r->fit);
    return status;
}

int mk_command_fit(int argc, char **argv) {
    mk_error_t error;
    arguments_t a;
    mk_scenario_t scenario;
    mk_source_t source;
    const char *path;
    memset(&a, 0, sizeof a);
    const mk_option_t options[] = {{"states", &a.states, NULL}, {"measurements", &a.measurements, NULL}, {"steps", &a.steps, NULL},
                                   {"level", &a.level, NULL},   {"json", &a.json, NULL},                 {NULL, NULL, NULL}};
    long long steps = 0;
    double level = 0.95;
    if (!mk_parse_options(argc, argv, options, "the scenario file", &path, &error) ||
        !mk_option_integer("steps", a.steps, 2, 1000000000, &steps, &error) || !mk_option_real("level", a.level, 0.5, 0.9999, &level, &error))
        return mk_complain(&error, MK_EXIT_INPUT);
    if (!a.states || !a.measurements) {
        (void)mk_fail(&error, "fit: --states FILE.csv and --measurements FILE.csv are both needed");
        return mk_complain(&error, MK_EXIT_INPUT);
    }
    if (!mk_scenario_load(&scenario, path, &error)) return mk_complain(&error, MK_EXIT_INPUT);
    int status = MK_EXIT_INPUT;
    if (mk_source_record(&source, &scenario, a.measurements, a.states, (int)steps, &error)) {
        results_t *results = mk_allocate(1, sizeof *results);
        results->scenario = &scenario;
        status = fit(results, &source, &a, level, &error);
        free(results);
        mk_source_free(&source);
    }
    mk_scenario_free(&scenario);
    return status ? mk_complain(&error, status) : 0;
}
