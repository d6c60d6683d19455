/* SPDX-License-Identifier: MIT */
#include "tracking/tracking_design.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "process.h"

/* Above MK_DENSE_NODES nodes, of which the worst is sought. */
enum { TRIED = 8, NAMED = 10 };

static void MK_PRINTF(2, 3) warn(mk_tracking_design_t *r, const char *format, ...) {
    mk_error_t text;
    va_list arguments;
    va_start(arguments, format);
    (void)mk_vfail(&text, format, arguments);
    va_end(arguments);
    char **more = mk_allocate((size_t)r->warnings + 1, sizeof *more);
    if (r->warnings) memcpy(more, r->warning, (size_t)r->warnings * sizeof *more);
    free(r->warning);
    r->warning = more;
    more[r->warnings] = mk_allocate(strlen(text.text) + 1, 1);
    (void)strcpy(more[r->warnings++], text.text);
}

void mk_nodes_text(int nodes, const int *flag, int value, char *text, unsigned long room) {
    int count = 0;
    for (int k = 0; k < nodes; k++) count += flag[k] == value;
    (void)snprintf(text, room, count == 1 ? "node" : "nodes");
    for (int k = 0, named = 0; k < nodes && named <= NAMED; k++) {
        if (flag[k] != value) continue;
        char item[24];
        if (named == NAMED) (void)snprintf(item, sizeof item, ", ...");
        else (void)snprintf(item, sizeof item, named ? ", %d" : " %d", k);
        named++;
        (void)strncat(text, item, room - strlen(text) - 1);
    }
}

/* --- consensus ------------------------------------------------------------------------------------------------------------- */

static int judge_case(mk_tracking_design_t *r, int which, const unsigned char *measures, mk_error_t *error) {
    mk_case_t *const c = &r->consensus[which];
    const mk_averaging_t averaging = {&r->links, measures, which == MK_CASE_METROPOLIS};
    mk_convergence_t judged;
    mk_convergence_make(&judged, &r->links, measures);
    c->exists = 1;
    c->converges = judged.converges;
    c->period = 1;
    for (int i = 0; i < judged.sources; i++)
        if (judged.period[i] > c->period) c->period = judged.period[i];
    mk_convergence_free(&judged);
    const mk_rate_t none = {1.0, 0.0, 0};
    c->rate = none;
    return !c->converges || mk_rate(&averaging, &c->rate) || mk_fail(error, "LAPACK finds no eigenvalues of the protocol's matrix");
}

/* The node farthest from this one, by links. */
static int farthest(const mk_links_t *links, int from) {
    int *distance = mk_allocate((size_t)links->nodes, sizeof *distance), *queue = mk_allocate((size_t)links->nodes, sizeof *queue), end = 0, last = from;
    distance[from] = 1;
    queue[end++] = from;
    for (int begin = 0; begin < end; begin++) {
        last = queue[begin];
        for (int i = links->first[last]; i < links->first[last + 1]; i++)
            if (distance[links->slot[i]] == 0) {
                distance[links->slot[i]] = distance[last] + 1;
                queue[end++] = links->slot[i];
            }
    }
    free(distance);
    free(queue);
    return last;
}

static int judge_one(mk_tracking_design_t *r, mk_error_t *error) {
    const int nodes = r->scenario->nodes;
    mk_case_t *const worst = &r->consensus[MK_CASE_ONE];
    if (r->parts.sources > 1) { /* Whoever measures, it does not converge. */
        unsigned char *alone = mk_allocate((size_t)nodes, 1);
        for (int k = 0; k < nodes && !worst->exists; k++)
            if (r->sensing[k]) {
                alone[k] = 1;
                worst->node = k;
                (void)judge_case(r, MK_CASE_ONE, alone, error);
            }
        free(alone);
        r->tried = r->sensors;
        return 1;
    }
    worst->exists = worst->converges = worst->period = 1;
    worst->rate.modulus = -1.0;
    if (nodes <= MK_DENSE_NODES) {
        double *modulus = mk_allocate((size_t)nodes, sizeof *modulus);
        const int good = mk_rates_single(&r->links, modulus);
        for (int k = 0; k < nodes; k++) {
            r->tried += r->sensing[k];
            /* Equal but for rounding: the first. */
            if (!r->sensing[k] || !(modulus[k] > worst->rate.modulus + 1e-13)) continue;
            worst->rate.modulus = modulus[k];
            worst->node = k;
        }
        worst->rate.error = 1e-14;
        free(modulus);
        return good || mk_fail(error, "LAPACK finds no eigenvalues of the protocol's matrix");
    }
    unsigned char *alone = mk_allocate((size_t)nodes, 1);
    int good = 1;
    const int end = farthest(&r->links, 0), other = farthest(&r->links, end);
    for (int i = 0; i < TRIED && good; i++) {
        int k = i == 0 ? end : i == 1 ? other : (int)((double)nodes * (i - 2) / (TRIED - 2));
        while (!r->sensing[k]) k = (k + 1) % nodes;
        mk_rate_t rate;
        const mk_averaging_t averaging = {&r->links, alone, 0};
        alone[k] = 1;
        good = mk_rate(&averaging, &rate) || mk_fail(error, "LAPACK finds no eigenvalues of the protocol's matrix");
        alone[k] = 0;
        r->tried++;
        if (!good || rate.modulus <= worst->rate.modulus) continue;
        worst->rate = rate;
        worst->node = k;
    }
    free(alone);
    return good;
}

static int judge_consensus(mk_tracking_design_t *r, mk_error_t *error) {
    const mk_scenario_t *s = r->scenario;
    const size_t nodes = (size_t)s->nodes;
    unsigned char *every = mk_allocate(nodes, 1), *none = mk_allocate(nodes, 1);
    r->links.nodes = s->nodes;
    r->links.first = s->first;
    r->links.slot = s->slot;
    r->sensing = mk_allocate(nodes, 1);
    for (int k = 0; k < s->nodes; k++) {
        every[k] = 1;
        r->sensing[k] = s->tracking->node[k].kind != MK_SENSOR_NONE;
        r->sensors += r->sensing[k];
    }
    mk_convergence_make(&r->parts, &r->links, NULL);
    const int good = judge_case(r, MK_CASE_NONE, none, error) && judge_case(r, MK_CASE_METROPOLIS, every, error) &&
                     judge_case(r, MK_CASE_RATIO, every, error) &&
                     (r->sensors == 0 || (judge_case(r, MK_CASE_ALL, r->sensing, error) && judge_one(r, error)));
    if (r->consensus[MK_CASE_ALL].converges) {
        const mk_averaging_t averaging = {&r->links, r->sensing, 0};
        r->pi = mk_allocate(nodes, sizeof *r->pi);
        (void)mk_perron(&averaging, r->pi);
    }
    free(every);
    free(none);
    return good;
}

/* --- what to say ----------------------------------------------------------------------------------------------------------- */

int mk_nobody_measures(const mk_tracking_design_t *r, long t) { return r->trajectory.measuring[t] == 0; }
int mk_fewer_than_two_measure(const mk_tracking_design_t *r, long t) { return r->trajectory.measuring[t] < 2; }
int mk_window_unseen(const mk_tracking_design_t *r, long w) { return r->window[w].seen < r->scenario->n; }
int mk_window_ill(const mk_tracking_design_t *r, long w) { return !mk_window_unseen(r, w) && r->window[w].condition > r->settings.condition; }

void mk_runs_text(const mk_tracking_design_t *r, long count, int (*chosen)(const mk_tracking_design_t *r, long t), char *text, unsigned long room) {
    text[0] = 0;
    for (long begin = 0; begin < count;) {
        long end = begin;
        char item[64];
        while (end < count && chosen(r, end)) end++;
        if (end == begin) {
            begin++;
            continue;
        }
        (void)snprintf(item, sizeof item, end == begin + 1 ? "%s%ld" : "%s%ld-%ld", text[0] ? ", " : "", begin + 1, end);
        if (strlen(text) + strlen(item) + sizeof ", ..." > room) {
            (void)strcat(text, ", ...");
            return;
        }
        (void)strcat(text, item);
        begin = end;
    }
}

int mk_scenario_case(const mk_tracking_t *tracking) {
    return tracking->protocol == MK_PROTOCOL_METROPOLIS ? MK_CASE_METROPOLIS : tracking->protocol == MK_PROTOCOL_RATIO ? MK_CASE_RATIO : MK_CASE_ALL;
}

static void warn_graph(mk_tracking_design_t *r) {
    const mk_scenario_t *s = r->scenario;
    const mk_tracking_t *tracking = s->tracking;
    char text[256];
    int *alone = mk_allocate((size_t)s->nodes, sizeof *alone), isolated = 0;
    for (int k = 0; k < s->nodes; k++) {
        alone[k] = s->nodes > 1 && r->parts.size[r->parts.source[k]] == 1;
        isolated += alone[k];
    }
    mk_nodes_text(s->nodes, alone, 1, text, sizeof text);
    if (isolated) warn(r, "%s %s no links", text, isolated == 1 ? "has" : "have");
    if (r->parts.sources > 1) {
        mk_nodes_text(s->nodes, r->parts.source, 0, text, sizeof text);
        (void)mk_fail(&r->failure, "the graph falls into %d parts (%s is one) that never agree: add links (--allow-unobservable goes on)",
                      r->parts.sources, text);
    }
    if (r->sensors == 0) (void)mk_fail(&r->failure, "no node has a sensor (--allow-unobservable goes on)");
    free(alone);
    if (tracking->iterations == 0 && s->nodes > 1) warn(r, "iterations 0: every node uses its own readings only");
    const mk_case_t *c = &r->consensus[mk_scenario_case(tracking)];
    const double left = pow(c->rate.modulus, tracking->iterations);
    if (c->converges && tracking->iterations > 0 && left > 0.01)
        warn(r, "L = %d iterations of protocol %s leave up to %.2g of a disagreement", tracking->iterations, mk_protocol_name(tracking->protocol), left);
    if (!r->pi || tracking->protocol != MK_PROTOCOL_PAPER) return;
    double least = (double)INFINITY, most = 0.0;
    for (int k = 0; k < s->nodes; k++) {
        least = fmin(least, s->nodes * r->pi[k]);
        most = fmax(most, s->nodes * r->pi[k]);
    }
    if (most > 1.01 || least < 0.99)
        warn(r, "protocol paper does not reach the average: nodes count %.3g to %.3g times what they should; perron, metropolis and ratio reach it",
             least, most);
}

static void warn_sight(mk_tracking_design_t *r) {
    const mk_trajectory_t *p = &r->trajectory;
    const mk_windows_t *net = &r->network;
    char text[200];
    long few = 0, none = 0;
    for (long t = 0; t < p->instants; t++) {
        few += p->measuring[t] < 2;
        none += p->measuring[t] == 0;
    }
    if (p->undefined)
        warn(r, "%ld readings have no derivative (a target on its sensor) and count as missing; the first: node %d at step %ld", p->undefined,
             p->undefined_node, p->undefined_instant + 1);
    mk_runs_text(r, p->instants, mk_nobody_measures, text, sizeof text);
    if (none) warn(r, "nobody measures at %ld of %ld steps: %s", none, p->instants, text);
    mk_runs_text(r, p->instants, mk_fewer_than_two_measure, text, sizeof text);
    if (few)
        warn(r, "fewer than two nodes measure at %ld of %ld steps: %s; ranges then fit mirror images of the target as well as the target",
             few, p->instants, text);
    if (r->coverage.runs_few && !few)
        warn(r, "in %ld of %ld drawn runs, with noise and losses, fewer than two nodes measure at times; along the mean trajectory never",
             r->coverage.runs_few, r->coverage.runs);
    mk_runs_text(r, r->windows, mk_window_unseen, text, sizeof text);
    if (net->unseen)
        warn(r, "the network does not see all %d states (%d at least) in %ld of %ld windows, which begin at steps %s", p->n,
             net->least_seen, net->unseen, r->windows, text);
    mk_runs_text(r, r->windows, mk_window_ill, text, sizeof text);
    if (net->ill)
        warn(r, "condition number above %.3g in %ld of %ld windows, which begin at steps %s", r->settings.condition, net->ill, r->windows, text);
    if (net->unseen == r->windows && !r->failure.text[0])
        (void)mk_fail(&r->failure, "in no window of %ld steps the sensors in range see all %d states (--allow-unobservable goes on)", r->length,
                      p->n);
}

int mk_tracking_design(mk_tracking_design_t *r, const mk_models_f64_t *models, const mk_tracking_design_settings_t *settings, mk_error_t *error) {
    const mk_scenario_t *s = models->scenario;
    const double begin = mk_seconds();
    memset(r, 0, sizeof *r);
    r->scenario = s;
    r->settings = *settings;
    if (!judge_consensus(r, error) || !mk_trajectory_make(&r->trajectory, models, settings->steps, settings->truth, error)) {
        mk_tracking_design_free(r);
        return 0;
    }
    r->length = settings->window < r->trajectory.instants ? settings->window : r->trajectory.instants;
    r->windows = r->trajectory.instants - r->length + 1;
    r->window = mk_allocate((size_t)r->windows, sizeof *r->window);
    r->node = mk_allocate((size_t)s->nodes, sizeof *r->node);
    mk_windows_network(&r->trajectory, models->P0, r->length, settings->condition, settings->threads, r->window, &r->network);
    mk_windows_nodes(&r->trajectory, models->P0, s->first, s->slot, r->length, settings->condition, settings->threads, r->node);
    if (settings->runs && !mk_coverage(models, settings->steps, settings->runs, &r->coverage, error)) {
        mk_tracking_design_free(r);
        return 0;
    }
    warn_graph(r);
    warn_sight(r);
    r->seconds = mk_seconds() - begin;
    return 1;
}

void mk_tracking_design_free(mk_tracking_design_t *r) {
    free(r->sensing);
    mk_convergence_free(&r->parts);
    free(r->pi);
    mk_trajectory_free(&r->trajectory);
    free(r->window);
    free(r->node);
    for (int i = 0; i < r->warnings; i++) free(r->warning[i]);
    free(r->warning);
    memset(r, 0, sizeof *r);
}
