/* SPDX-License-Identifier: MIT */
#include "design_report.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>

#include "json_out.h"
#include "process.h"

static double bound(const mk_admissible_t *a) { return a->count ? a->c[a->count - 1] : 0.0; }


/* --- JSON ------------------------------------------------------------------------------------------------------------------ */

static void put_member(FILE *stream, const char *key, json_t *value) {
    (void)fprintf(stream, ",\n\"%s\":", key);
    mk_json_put(stream, value);
}

static json_t *steady_json(int n, const mk_steady_t *steady, int kept) {
    json_t *object = json_object();
    mk_json_set(object, "theta", steady->exists ? json_real(steady->theta) : json_null());
    mk_json_set(object, "trace_P", steady->exists ? json_real(steady->trace_P) : json_null());
    mk_json_set(object, "trace_V", steady->exists ? json_real(steady->trace_V) : json_null());
    if (!kept) return object;
    mk_json_set(object, "P", steady->P ? mk_json_symmetric(n, steady->P) : json_null());
    mk_json_set(object, "V", steady->V ? mk_json_symmetric(n, steady->V) : json_null());
    return object;
}

static json_t *node_json(const mk_design_results_t *r, int k) {
    const mk_scenario_t *s = r->scenario;
    json_t *node = json_object();
    mk_json_set(node, "node", json_integer(k));
    mk_json_set(node, "degree", json_integer(s->first[k + 1] - s->first[k]));
    mk_json_set(node, "tolerance", json_real(r->design.local[k]));
    mk_json_set(node, "unobservable", json_integer(r->seen.node[k]));
    if (r->node) mk_json_set(node, "c_max", mk_json_number(bound(&r->node[k])));
    json_t *steady = steady_json(s->n, &r->design.node[k], r->design.block != NULL);
    (void)json_object_update(node, steady);
    json_decref(steady);
    return node;
}

static int put_schedule(FILE *stream, const mk_design_results_t *r, mk_error_t *error) {
    const size_t nodes = (size_t)r->scenario->nodes;
    double *c = mk_allocate(nodes, sizeof *c);
    int good = 1;
    (void)fputs(",\n\"per_step\":[", stream);
    for (long long t = 0; t < r->steps && good; t++) {
        good = mk_schedule_step(r->schedule, c, error);
        (void)fputs(t ? ",\n" : "\n", stream);
        if (good) mk_json_put(stream, mk_json_numbers(c, nodes));
    }
    (void)fputs("]", stream);
    free(c);
    return good;
}

int mk_write_design(FILE *stream, const mk_design_results_t *r, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    json_t *horizons = json_array();
    (void)fputs("{\"scenario\":", stream);
    mk_json_put(stream, json_string(s->name));
    put_member(stream, "scenario_sha256", json_string(s->sha256));
    put_member(stream, "tolerance", json_real(r->design.tolerance));
    put_member(stream, "central", steady_json(s->n, &r->design.central, 1));
    (void)fputs(",\n\"nodes\":[", stream);
    for (int k = 0; k < s->nodes; k++) {
        (void)fputs(k ? ",\n" : "\n", stream);
        mk_json_put(stream, node_json(r, k));
    }
    (void)fputs("]", stream);
    put_member(stream, "unobservable", json_integer(r->seen.global));
    put_member(stream, "unreachable", json_integer(r->seen.unreachable));
    if (r->has_central) {
        for (int i = 0; i < r->central.count; i++) {
            json_t *entry = json_object();
            mk_json_set(entry, "horizon", json_integer(r->central.horizon[i]));
            mk_json_set(entry, "c_max", mk_json_number(r->central.c[i]));
            (void)json_array_append_new(horizons, entry);
        }
        put_member(stream, "c_max", mk_json_number(bound(&r->central)));
        put_member(stream, "c_max_horizon", json_integer(r->central.horizon[r->central.count - 1]));
        put_member(stream, "c_settles", json_real(r->settles));
    }
    put_member(stream, "c_max_by_horizon", horizons);
    const int good = !r->schedule || put_schedule(stream, r, error);
    (void)fputs("}\n", stream);
    return good;
}

/* --- table ----------------------------------------------------------------------------------------------------------------- */

static void print_cost(const mk_design_results_t *r) {
    const double bytes = mk_peak_memory();
    (void)printf("read in %.2f s, designed in %.2f s on %d thread%s; peak memory %.0f MiB, %.0f bytes a node\n", r->loaded, r->seconds, r->threads,
                 r->threads > 1 ? "s" : "", bytes / 1048576.0, bytes / r->scenario->nodes);
}

static void print_bound(const char *text, double c) {
    if (isinf(c)) (void)printf("%s every c", text);
    else if (c > 0.0) (void)printf("%s c < %.4g", text, c);
    else (void)printf("%s none", text);
}

/* One line of the table. */
static void print_line(const char *name, int degree, double tolerance, const mk_steady_t *steady, const mk_admissible_t *limit) {
    (void)printf("%7s %6d %12.6g", name, degree, tolerance);
    if (steady->exists) (void)printf(" %10.5g %12.6g %12.6g", steady->theta, steady->trace_P, steady->trace_V);
    else (void)printf(" %10s %12s %12s", "-", "grows", "grows");
    if (!limit) (void)printf(" %12s\n", "-");
    else if (isinf(bound(limit))) (void)printf(" %12s\n", "every c");
    else (void)printf(" %12.4g\n", bound(limit));
}

void mk_print_design(const mk_design_results_t *r) {
    const mk_scenario_t *s = r->scenario;
    const mk_design_t *d = &r->design;
    const int many = s->nodes > 40;
    double local = 0.0, theta = 0.0, least = (double)INFINITY, most = 0.0;
    int over = 0, settled = 0;
    (void)printf("%s: %d nodes, %d states; c = %g (twice the Kullback-Leibler divergence, nats)\n\n", s->name[0] ? s->name : "scenario", s->nodes, s->n,
                 d->tolerance);
    (void)printf("%7s %6s %12s %10s %12s %12s %12s\n", "node", "degree", "tolerance", "theta", "trace P", "trace V", "guaranteed <");
    print_line("central", s->nodes, d->tolerance, &d->central, r->has_central ? &r->central : NULL);
    for (int k = 0; k < s->nodes; k++) {
        char name[16];
        local += d->local[k] / s->nodes;
        least = fmin(least, d->local[k]);
        most = fmax(most, d->local[k]);
        over += r->node && d->local[k] > bound(&r->node[k]);
        if (d->node[k].exists) {
            theta += d->node[k].theta;
            settled++;
        }
        if (many && k >= 10 && k < s->nodes - 3) continue;
        (void)snprintf(name, sizeof name, "%d", k);
        print_line(name, s->first[k + 1] - s->first[k], d->local[k], &d->node[k], r->node ? &r->node[k] : NULL);
        if (many && k == 9) (void)puts("    ...");
    }
    (void)printf("\nmean tolerance %.6g (%.6g to %.6g), mean theta %.5g\n", local, least, most, settled ? theta / settled : 0.0);
    if (r->seen.unreachable) (void)printf("not reached by Q: %d of %d state dimensions\n", r->seen.unreachable, s->n);
    if (r->seen.blind_nodes) (void)printf("nodes that do not observe all states: %d\n", r->seen.blind_nodes);
    if (r->has_central) {
        print_bound("convergence of the centralised filter: guaranteed for", bound(&r->central));
        (void)printf(" (%d steps); seen %s c = %.3g\n", r->central.horizon[r->central.count - 1],
                     r->settles >= MK_SEARCH_LIMIT ? "at least up to" : "up to", r->settles);
        if (over)
            (void)printf("%d nodes have a tolerance above the guaranteed one, which is sufficient, not necessary%s\n", over,
                         settled == s->nodes ? ": all converged" : "");
    }
    print_cost(r);
}
