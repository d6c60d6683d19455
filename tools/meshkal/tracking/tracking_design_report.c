/* SPDX-License-Identifier: MIT */
#include <jansson.h>
#include <math.h>

#include "json_out.h"
#include "tracking/tracking_design.h"

static const double accuracy[MK_ACCURACY_COUNT] = MK_ACCURACIES;

/* --- JSON ------------------------------------------------------------------------------------------------------------------ */

static json_t *runs_json(const mk_tracking_design_t *r, long count, int (*chosen)(const mk_tracking_design_t *r, long t)) {
    json_t *runs = json_array();
    for (long begin = 0; begin < count; begin++) {
        long end = begin;
        while (end < count && chosen(r, end)) end++;
        if (end == begin) continue;
        json_t *pair = json_array();
        (void)json_array_append_new(pair, json_integer(begin + 1));
        (void)json_array_append_new(pair, json_integer(end));
        (void)json_array_append_new(runs, pair);
        begin = end;
    }
    return runs;
}

static json_t *part_json(const mk_tracking_design_t *r, int part) {
    json_t *object = json_object(), *nodes = json_array();
    for (int k = 0; k < r->scenario->nodes; k++)
        if (r->parts.source[k] == part) (void)json_array_append_new(nodes, json_integer(k));
    mk_json_set(object, "nodes", nodes);
    mk_json_set(object, "bipartite", json_boolean(r->parts.period[part] == 2 || r->parts.size[part] == 1));
    return object;
}

static json_t *graph_json(const mk_tracking_design_t *r) {
    const mk_scenario_t *s = r->scenario;
    json_t *graph = json_object(), *parts = json_array(), *silent = json_array(), *isolated = json_array();
    for (int i = 0; i < r->parts.sources; i++) (void)json_array_append_new(parts, part_json(r, i));
    for (int k = 0; k < s->nodes; k++) {
        if (!r->sensing[k]) (void)json_array_append_new(silent, json_integer(k));
        if (s->first[k + 1] - s->first[k] == 1) (void)json_array_append_new(isolated, json_integer(k));
    }
    mk_json_set(graph, "nodes", json_integer(s->nodes));
    mk_json_set(graph, "links", json_integer((s->first[s->nodes] - s->nodes) / 2));
    mk_json_set(graph, "parts", parts);
    mk_json_set(graph, "isolated", isolated);
    mk_json_set(graph, "without_sensor", silent);
    return graph;
}

static const struct {
    const char *weights, *measuring;
} label[MK_CASE_COUNT] = {{"paper", "all"}, {"paper", "one"}, {"paper", "none"}, {"metropolis", NULL}, {"ratio", NULL}};

static json_t *case_json(const mk_tracking_design_t *r, int which) {
    const mk_case_t *c = &r->consensus[which];
    json_t *object = json_object(), *iterations = json_array();
    mk_json_set(object, "weights", json_string(label[which].weights));
    if (label[which].measuring) mk_json_set(object, "measuring", json_string(label[which].measuring));
    if (which == MK_CASE_ONE) {
        mk_json_set(object, "node", json_integer(c->node));
        mk_json_set(object, "tried", json_integer(r->tried));
    }
    mk_json_set(object, "converges", json_boolean(c->converges));
    mk_json_set(object, "period", json_integer(c->period));
    mk_json_set(object, "second_eigenvalue", json_real(c->rate.modulus));
    mk_json_set(object, "gap", json_real(1.0 - c->rate.modulus));
    mk_json_set(object, "error", json_real(c->rate.error));
    mk_json_set(object, "method", !c->converges ? json_null() : json_string(c->rate.steps ? "Lanczos" : "LAPACK"));
    for (int i = 0; i < MK_ACCURACY_COUNT; i++) {
        const long L = mk_iterations(c->rate.modulus, accuracy[i]);
        (void)json_array_append_new(iterations, L < 0 ? json_null() : json_integer(L));
    }
    mk_json_set(object, "iterations", iterations);
    mk_json_set(object, "left", json_real(pow(c->rate.modulus, r->scenario->tracking->iterations)));
    return object;
}

static json_t *consensus_json(const mk_tracking_design_t *r) {
    const mk_tracking_t *tracking = r->scenario->tracking;
    json_t *object = json_object(), *cases = json_array();
    mk_json_set(object, "protocol", json_string(mk_protocol_name(tracking->protocol)));
    mk_json_set(object, "iterations", json_integer(tracking->iterations));
    mk_json_set(object, "accuracies", mk_json_numbers(accuracy, MK_ACCURACY_COUNT));
    for (int i = 0; i < MK_CASE_COUNT; i++)
        if (r->consensus[i].exists) (void)json_array_append_new(cases, case_json(r, i));
    mk_json_set(object, "cases", cases);
    mk_json_set(object, "perron_weights", r->pi ? mk_json_numbers(r->pi, (size_t)r->scenario->nodes) : json_null());
    mk_json_set(object, "perron_scales", r->pi ? json_array() : json_null());
    for (int k = 0; k < r->scenario->nodes && r->pi; k++)
        (void)json_array_append_new(json_object_get(object, "perron_scales"), json_real(1.0 / (r->scenario->nodes * r->pi[k])));
    return object;
}

static json_t *windows_json(const mk_windows_t *all) {
    json_t *object = json_object();
    mk_json_set(object, "steps_heard", json_integer(all->heard));
    mk_json_set(object, "smallest_eigenvalue", json_real(all->smallest));
    mk_json_set(object, "worst_window", json_integer(all->worst + 1));
    mk_json_set(object, "largest_condition", all->condition > 0.0 ? json_real(all->condition) : json_null());
    mk_json_set(object, "least_states_seen", json_integer(all->least_seen));
    mk_json_set(object, "windows_unseen", json_integer(all->unseen));
    mk_json_set(object, "windows_ill_conditioned", json_integer(all->ill));
    return object;
}

static json_t *sight_json(const mk_tracking_design_t *r) {
    const mk_trajectory_t *p = &r->trajectory;
    json_t *object = json_object(), *network = windows_json(&r->network), *nodes = json_array();
    json_t *smallest = json_array(), *condition = json_array(), *seen = json_array(), *measuring = json_array();
    for (long w = 0; w < r->windows; w++) {
        (void)json_array_append_new(smallest, json_real(r->window[w].smallest));
        (void)json_array_append_new(condition, mk_json_number(r->window[w].condition));
        (void)json_array_append_new(seen, json_integer(r->window[w].seen));
    }
    for (long t = 0; t < p->instants; t++) (void)json_array_append_new(measuring, json_integer(p->measuring[t]));
    for (int k = 0; k < p->nodes; k++) {
        json_t *node = windows_json(&r->node[k]);
        mk_json_set(node, "node", json_integer(k));
        mk_json_set(node, "steps_measured", json_integer(r->node[k].readings));
        (void)json_array_append_new(nodes, node);
    }
    mk_json_set(object, "trajectory", json_string(r->settings.truth ? "recorded" : "mean"));
    mk_json_set(object, "steps", json_integer(p->instants));
    mk_json_set(object, "window", json_integer(r->length));
    mk_json_set(object, "condition_limit", json_real(r->settings.condition));
    mk_json_set(network, "eigenvalue_by_window", smallest);
    mk_json_set(network, "condition_by_window", condition);
    mk_json_set(network, "states_seen_by_window", seen);
    mk_json_set(network, "unseen", runs_json(r, r->windows, mk_window_unseen));
    mk_json_set(network, "ill_conditioned", runs_json(r, r->windows, mk_window_ill));
    mk_json_set(object, "network", network);
    mk_json_set(object, "nodes", nodes);
    mk_json_set(object, "measuring_nodes", measuring);
    mk_json_set(object, "nobody_measures", runs_json(r, p->instants, mk_nobody_measures));
    mk_json_set(object, "fewer_than_two_measure", runs_json(r, p->instants, mk_fewer_than_two_measure));
    return object;
}

static json_t *coverage_json(const mk_coverage_t *c) {
    json_t *object = json_object();
    const double all = (double)c->runs * (double)c->steps;
    mk_json_set(object, "runs", json_integer(c->runs));
    mk_json_set(object, "steps", json_integer(c->steps));
    mk_json_set(object, "fewer_than_two_measure", json_real((double)c->few / all));
    mk_json_set(object, "nobody_measures", json_real((double)c->none / all));
    mk_json_set(object, "runs_with_fewer_than_two", json_integer(c->runs_few));
    mk_json_set(object, "longest", json_integer(c->longest));
    return object;
}

void mk_write_tracking_design(FILE *stream, const mk_tracking_design_t *r) {
    json_t *root = json_object(), *warnings = json_array();
    for (int i = 0; i < r->warnings; i++) (void)json_array_append_new(warnings, json_string(r->warning[i]));
    mk_json_set(root, "scenario", json_string(r->scenario->name));
    mk_json_set(root, "scenario_sha256", json_string(r->scenario->sha256));
    mk_json_set(root, "failure", r->failure.text[0] ? json_string(r->failure.text) : json_null());
    mk_json_set(root, "warnings", warnings);
    mk_json_set(root, "graph", graph_json(r));
    mk_json_set(root, "consensus", consensus_json(r));
    mk_json_set(root, "observability", sight_json(r));
    mk_json_set(root, "drawn", r->coverage.runs ? coverage_json(&r->coverage) : json_null());
    mk_json_put(stream, root);
    (void)fputs("\n", stream);
}

/* --- tables ---------------------------------------------------------------------------------------------------------------- */

static void print_case(const mk_tracking_design_t *r, int which) {
    const mk_case_t *c = &r->consensus[which];
    const int iterations = r->scenario->tracking->iterations;
    char name[64];
    if (!c->exists) return;
    if (which == MK_CASE_ONE) (void)snprintf(name, sizeof name, "paper, node %d alone", c->node);
    else
        (void)snprintf(name, sizeof name, "%s%s", label[which].weights,
                       which == MK_CASE_ALL ? ", all measure" : which == MK_CASE_NONE ? ", none does" : "");
    (void)printf("%-22s", name);
    if (!c->converges) {
        (void)printf(r->parts.sources > 1 ? " never: %d parts\n" : " never: bipartite, swings with period %d\n",
                     r->parts.sources > 1 ? r->parts.sources : c->period);
        return;
    }
    (void)printf(" %10.7f %9.3g", c->rate.modulus, 1.0 - c->rate.modulus);
    for (int i = 0; i < MK_ACCURACY_COUNT; i++) {
        const long L = mk_iterations(c->rate.modulus, accuracy[i]);
        if (L < 0) (void)printf(" %6s", "-");
        else (void)printf(" %6ld", L);
    }
    (void)printf(" %10.2g%s\n", pow(c->rate.modulus, iterations), mk_scenario_case(r->scenario->tracking) == which ? " *" : "");
}

static void print_consensus(const mk_tracking_design_t *r) {
    const mk_scenario_t *s = r->scenario;
    int lanczos = 0, least = 0, most = 0;
    double error = 0.0;
    for (int i = 0; i < r->parts.sources && i < 10 && r->parts.sources > 1; i++) {
        char text[256];
        mk_nodes_text(s->nodes, r->parts.source, i, text, sizeof text);
        (void)printf("part %d: %s%s\n%s", i, text, r->parts.period[i] == 2 ? ", bipartite" : "",
                     i + 1 == r->parts.sources ? "\n" : i == 9 ? "...\n\n" : "");
    }
    (void)printf("%-22s %10s %9s %6s %6s %6s %6s %6s   at L = %-d\n", "consensus, L for", "2nd eigenv.", "gap", "1e-1", "1e-2", "1e-3", "1e-6", "1e-9",
                 s->tracking->iterations);
    for (int i = 0; i < MK_CASE_COUNT; i++) {
        print_case(r, i);
        lanczos |= r->consensus[i].rate.steps > 0;
        error = fmax(error, r->consensus[i].rate.error);
    }
    (void)printf("* the scenario's protocol, %s. Numbers are of the disagreement that is left, in the worst case",
                 mk_protocol_name(s->tracking->protocol));
    if (lanczos) (void)printf("; eigenvalues by Lanczos, error at most %.1g", error);
    (void)printf(lanczos && r->tried < r->sensors ? "; worst of %d nodes that were tried\n" : "\n", r->tried);
    if (!r->pi) return;
    for (int k = 1; k < s->nodes; k++) {
        if (r->pi[k] < r->pi[least]) least = k;
        if (r->pi[k] > r->pi[most]) most = k;
    }
    (void)printf("limit of paper: node %d counts N pi = %.4g times, node %d %.4g times; their scales 1 / (N pi): %.4g, %.4g\n", least,
                 s->nodes * r->pi[least], most, s->nodes * r->pi[most], 1.0 / (s->nodes * r->pi[least]), 1.0 / (s->nodes * r->pi[most]));
}

static void print_sight_line(const char *name, long own, const mk_windows_t *w) {
    (void)printf("%7s %9ld %7ld %12.4g %7ld", name, own, w->heard, w->smallest, w->worst + 1);
    if (w->condition > 0.0) (void)printf(" %12.4g", w->condition);
    else (void)printf(" %12s", "-");
    (void)printf(" %7ld %7d %7ld\n", w->unseen, w->least_seen, w->ill);
}

static void print_sight(const mk_tracking_design_t *r) {
    const mk_trajectory_t *p = &r->trajectory;
    const int many = p->nodes > 40;
    (void)printf("\nobservability along %s, %ld steps, %ld windows of %ld; information relative to P0: 1 is as much as the prior\n",
                 r->settings.truth ? r->settings.truth : "the mean trajectory from x0", p->instants, r->windows, r->length);
    if (p->filled_velocity) (void)printf("the file has no velocity: differences of its positions stand in for it\n");
    if (p->kept_states) (void)printf("states that the file does not have stay as in x0: %d\n", p->kept_states);
    (void)printf("%7s %9s %7s %12s %7s %12s %7s %7s %7s\n", "", "measures", "hears", "least eigenv.", "window", "condition", "unseen", "states", "ill");
    print_sight_line("network", r->network.readings, &r->network);
    for (int k = 0; k < p->nodes; k++) {
        char name[16];
        if (many && k >= 10 && k < p->nodes - 3) continue;
        (void)snprintf(name, sizeof name, "%d", k);
        print_sight_line(name, r->node[k].readings, &r->node[k]);
        if (many && k == 9) (void)puts("    ...");
    }
    (void)printf("a node: with its neighbours, without consensus. window: the first step of the worst. unseen: windows that see less than %d states,\n"
                 "states: the least they see. ill: windows with a condition above %.3g\n", p->n, r->settings.condition);
    if (r->coverage.runs && r->coverage.few == 0) (void)printf("%ld drawn runs: always two nodes or more measure\n", r->coverage.runs);
    else if (r->coverage.runs)
        (void)printf("%ld drawn runs: fewer than two nodes measure at %.2g %% of the steps, at some in %ld runs, up to %ld in a row; nobody at %.2g %%\n",
                     r->coverage.runs, 100.0 * (double)r->coverage.few / (double)(r->coverage.runs * r->coverage.steps), r->coverage.runs_few,
                     r->coverage.longest, 100.0 * (double)r->coverage.none / (double)(r->coverage.runs * r->coverage.steps));
}

void mk_print_tracking_design(const mk_tracking_design_t *r) {
    const mk_scenario_t *s = r->scenario;
    (void)printf("%s: %d nodes, %d with a sensor, %d links, %d states\n\n", s->name[0] ? s->name : "scenario", s->nodes, r->sensors,
                 (s->first[s->nodes] - s->nodes) / 2, s->n);
    print_consensus(r);
    print_sight(r);
    if (r->warnings) (void)printf("\n");
    for (int i = 0; i < r->warnings; i++) (void)printf("warning: %s\n", r->warning[i]);
    (void)printf("checked in %.2f s on %d thread%s\n", r->seconds, r->settings.threads, r->settings.threads > 1 ? "s" : "");
}
