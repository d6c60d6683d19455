/* SPDX-License-Identifier: MIT */
#include "tracking/track_simulate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"
#include "plugin_load.h"
#include "signals.h"
#include "simulate_shared.h"
#include "tracking/track_report.h"

/* A gap of so many mean intervals is worth a note. */
#define LONG_GAP 1000.0

static int refuse_options(const mk_simulate_options_t *a, mk_error_t *error) {
    if (a->truth && strcmp(a->truth, "least-favourable") == 0)
        return mk_fail(error, "--truth least-favourable is for linear scenarios: the worst model of a nonlinear one is not known");
    if (a->monitor || a->window || a->false_alarm) return mk_fail(error, "--monitor, --window and --false-alarm are not for tracking scenarios");
    if (a->horizon) return mk_fail(error, "--horizon is for linear scenarios");
    if (a->frozen) return mk_fail(error, "--frozen is for linear scenarios: the gain of a nonlinear filter has no limit");
    if (a->resume) return mk_fail(error, "--resume is for linear scenarios");
    if (a->arrivals) return mk_fail(error, "--arrivals is for linear scenarios; --loss draws what is lost");
    if (a->record) return mk_fail(error, "--record is for linear scenarios");
    if (a->measurements && a->truth && strcmp(a->truth, "nominal") == 0)
        return mk_fail(error, "--truth nominal is for drawn data, not with --measurements");
    if (!a->measurements && a->truth && strcmp(a->truth, "nominal") != 0)
        return mk_fail(error, "--truth %s: for drawn data it is nominal; a file goes with --measurements", a->truth);
    return 1;
}

static int one_of(const char *option, const char *text, const char *const *names, int count, int *value, mk_error_t *error) {
    char list[200] = "";
    for (int i = 0; text && i < count; i++) {
        if (strcmp(text, names[i]) == 0) {
            *value = i;
            return 1;
        }
        (void)snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", i ? ", " : "", names[i]);
    }
    return text ? mk_fail(error, "--%s %s: must be one of %s", option, text, list) : 1;
}

/* Options in place of what the scenario says. */
static int change_settings(const mk_simulate_options_t *a, mk_scenario_t *s, mk_error_t *error) {
    static const char *const rules[] = {"none", "innovation", "mahalanobis"};
    static const char *const protocols[] = {"paper", "perron", "metropolis", "ratio"};
    mk_tracking_t *const tracking = s->tracking;
    long long increments = tracking->increments, iterations = tracking->iterations;
    int protocol = (int)tracking->protocol;
    if (!mk_option_integer("increments", a->increments, 1, 65535, &increments, error) ||
        !mk_option_integer("iterations", a->iterations, 0, 65535, &iterations, error) || !one_of("rule", a->rule, rules, 3, &tracking->rule, error) ||
        !one_of("protocol", a->protocol, protocols, 4, &protocol, error) ||
        !mk_option_real("tolerance", a->tolerance, 0.0, 1e6, &s->tolerance, error))
        return 0;
    tracking->increments = (int)increments;
    tracking->iterations = (int)iterations;
    tracking->protocol = (mk_protocol_t)protocol;
    if (!a->gate) return 1;
    if (strcmp(a->gate, "none") == 0) {
        tracking->gate.exists = 0;
        return 1;
    }
    if (!tracking->gate.exists) {
        tracking->gate.sensor = tracking->gate.stacked = 1;
        tracking->gate.filters = (1u << MK_TRACKING_FILTER_COUNT) - 1u;
        tracking->gate.patience = MK_TRACKING_PATIENCE;
        tracking->gate.exists = 1;
    }
    if (!mk_option_real("gate", a->gate, 0.0, 1.0, &tracking->gate.significance, error)) return 0;
    if (tracking->gate.significance > 0.0 && tracking->gate.significance < 1.0) return 1;
    return mk_fail(error, "--gate %s: must be between 0 and 1, or none", a->gate);
}

static int set_campaign(mk_track_campaign_t *c, const mk_simulate_options_t *a, const mk_scenario_t *s, mk_error_t *error) {
    mk_simulate_numbers_t given;
    int single;
    c->scenario = s;
    c->lost_m = (double)INFINITY;
    if (!mk_simulate_numbers(a, s, &given, error) ||
        !mk_option_real("loss", a->loss, 0.0, 1.0, &c->loss, error) || !mk_option_real("lost-m", a->lost_m, 0.0, 1e300, &c->lost_m, error))
        return 0;
    c->facts.steps = given.steps;
    c->runs = given.runs;
    c->seed = given.seed;
    c->threads = given.threads;
    if (!mk_simulate_real(a, given.runs, &single, error)) return 0;
    c->tracker = single ? &mk_tracker_f32 : &mk_tracker_f64;
    if (!mk_tracking_filter_find(a->filter ? a->filter : "ukf", &c->filter, error)) return 0;
    if (!c->filter && a->out) return mk_fail(error, "--out: a log holds one filter; choose one with --filter");
    if (s->nodes > UINT16_MAX) return mk_fail(error, "tracking takes at most %d nodes, not %d", UINT16_MAX, s->nodes);
    return 1;
}

static int open_events(mk_track_campaign_t *c, const mk_simulate_options_t *a, const mk_models_f64_t *models, mk_events_t **events,
                       mk_error_t *error) {
    long long from = -1;
    *events = a->measurements ? mk_events_record(models, a->measurements, a->truth, a->steps ? c->facts.steps : 0, error)
                              : mk_events_draw(models, c->seed, c->facts.steps);
    if (!*events) return 0;
    c->events = *events;
    c->facts = mk_events_facts(*events);
    if (!mk_option_integer("from-step", a->from_step, 1, c->facts.steps, &from, error)) return 0;
    c->from = from > 0 ? (long)from : c->facts.half;
    return 1;
}

/* --- what the network cannot do --------------------------------------------------------------------------------------------- */

/* Parts of the graph: part[k] of node k. Also whether every edge joins two sides (the graph is bipartite). */
static int count_parts(const mk_scenario_t *s, int *part, int *bipartite) {
    int *const queue = mk_allocate(2 * (size_t)s->nodes, sizeof *queue), *const side = queue + s->nodes, parts = 0;
    for (int k = 0; k < s->nodes; k++) part[k] = -1;
    *bipartite = 1;
    for (int k = 0; k < s->nodes; k++) {
        int length = 0;
        if (part[k] >= 0) continue;
        part[k] = parts;
        side[k] = 0;
        queue[length++] = k;
        for (int next = 0; next < length; next++)
            for (int i = s->first[queue[next]] + 1; i < s->first[queue[next] + 1]; i++) {
                const int l = s->slot[i];
                if (part[l] < 0) {
                    part[l] = parts;
                    side[l] = !side[queue[next]];
                    queue[length++] = l;
                } else if (side[l] == side[queue[next]]) {
                    *bipartite = 0;
                }
            }
        parts++;
    }
    free(queue);
    return parts;
}

static void note_network(const mk_scenario_t *s, const mk_tracking_filter_t *only, json_t *notes) {
    if (only && only->kind == MK_TRACK_CENTRAL) return;
    int *const part = mk_allocate((size_t)s->nodes, sizeof *part), bipartite;
    const int parts = count_parts(s, part, &bipartite);
    for (int k = 0; k < s->nodes; k++)
        if (s->first[k + 1] - s->first[k] == 1) mk_add_note(notes, "node %d has no links: in a distributed filter it has its own readings only", k);
    if (parts > 1) {
        int other = 0;
        while (part[other] == 0) other++;
        mk_add_note(notes, "the network is in %d parts, nodes 0 and %d in different ones: consensus cannot converge to one estimate, and each part of duif takes "
                        "its average for that of all %d nodes",
                 parts, other, s->nodes);
    }
    if (bipartite && s->nodes > 1 && s->tracking->protocol == MK_PROTOCOL_PAPER && (!only || only->kind == MK_TRACK_INFORMATION))
        mk_add_note(notes, "the graph has no cycle of odd length: the paper's protocol converges in steps only in which some node measures");
    free(part);
}

/* Dimensions of the smallest line, plane, ... through all places that distances are measured from; -1: some sensor sees more than distances. */
static int spanned_by_ranges(const mk_scenario_t *s) {
    const int d = s->position_count;
    double axis[3][3], origin[3] = {0.0, 0.0, 0.0};
    int axes = 0, places = 0;
    for (int k = 0; k < s->nodes; k++) {
        const mk_sensor_kind_t kind = s->tracking->node[k].kind;
        if (kind == MK_SENSOR_NONE) continue;
        if (kind != MK_SENSOR_RANGE && kind != MK_SENSOR_RANGE_RATE && kind != MK_SENSOR_TDOA) return -1;
        for (int which = 0; which < (kind == MK_SENSOR_TDOA ? 2 : 1); which++) {
            const double *const place = which ? s->tracking->node[k].reference_m : s->sensor[k].position_m;
            double v[3] = {0.0, 0.0, 0.0}, size = 0.0, left = 0.0;
            if (places++ == 0) memcpy(origin, place, (size_t)d * sizeof *origin);
            for (int i = 0; i < d; i++) {
                v[i] = place[i] - origin[i];
                size += v[i] * v[i];
            }
            for (int a = 0; a < axes; a++) {
                double along = 0.0;
                for (int i = 0; i < d; i++) along += axis[a][i] * v[i];
                for (int i = 0; i < d; i++) v[i] -= along * axis[a][i];
            }
            for (int i = 0; i < d; i++) left += v[i] * v[i];
            if (axes == d || !(left > 1e-12 * size)) continue;
            for (int i = 0; i < d; i++) axis[axes][i] = v[i] / sqrt(left);
            axes++;
        }
    }
    return places ? axes : -1;
}

/* With ranges to places on a line (in a plane, in three dimensions) the mirror image fits as well. */
static void note_mirror(const mk_scenario_t *s, json_t *notes) {
    const int d = s->position_count, axes = d >= 2 ? spanned_by_ranges(s) : -1;
    if (axes < 0 || axes >= d) return;
    mk_add_note(notes, "all distances are measured from places %s: the target's mirror image fits them as well, and after a gap or near them "
                    "filters can go over to it: move a sensor out of there",
             axes == 0 ? "that are one point" : axes == 1 ? "on one line" : "in one plane");
}

/* A time stamp that is far from all others makes a prediction over years. */
static void note_gap(const mk_events_facts_t *facts, json_t *notes) {
    const double others = facts->last_s - facts->start_s - facts->longest_gap_s;
    if (facts->drawn || facts->steps < 3 || !(facts->longest_gap_s > LONG_GAP * others / (double)(facts->steps - 2))) return;
    mk_add_note(notes, "%.6g s without a reading, from t = %.15g on, %.3g times the mean interval of the others: a wrong time stamp?",
             facts->longest_gap_s, facts->longest_gap_from_s, facts->longest_gap_s / others * (double)(facts->steps - 2));
}

/* Recordings hold more than the gate's model of them. */
static void note_patience(const mk_track_campaign_t *c, json_t *notes) {
    if (c->facts.drawn || !c->scenario->tracking->gate.exists || c->scenario->tracking->gate.patience > 0) return;
    mk_add_note(notes, "the gate has no way back: a filter that loses its target, as in a gap, may refuse all readings from then on: set tracking.gate.patience, 10 "
                    "where readings come one at a time");
}

/* --- the work --------------------------------------------------------------------------------------------------------------- */

/* Runs the campaign's filter, or all of them if it has none. An exit status. */
static int run_filters(mk_track_campaign_t *c, json_t *filters, json_t *notes, int *interrupted, mk_error_t *error) {
    const mk_tracking_filter_t *const only = c->filter;
    FILE *const table = c->log_path && strcmp(c->log_path, "-") == 0 ? stderr : stdout;
    mk_track_result_t result[MK_TRACKING_FILTER_COUNT];
    int order[MK_TRACKING_FILTER_COUNT], ran = 0, status = 0;
    double ukf = (double)NAN;
    *interrupted = 0;
    for (int i = 0; i < MK_TRACKING_FILTER_COUNT && !*interrupted && !status; i++) {
        if (only && only != &mk_tracking_filters[i]) continue;
        c->filter = &mk_tracking_filters[i];
        status = mk_track_campaign_run(c, &result[ran], error);
        *interrupted = result[ran].interrupted;
        if (status == MK_EXIT_INPUT && !only) {
            mk_add_note(notes, "left out: %s", error->text);
            mk_track_result_free(&result[ran]);
            status = 0;
            continue;
        }
        if (strcmp(c->filter->name, "ukf") == 0) ukf = result[ran].step_seconds;
        order[ran++] = i;
    }
    if (ran == 0 && !status) status = mk_fail(error, "no filter can run on this scenario") + MK_EXIT_INPUT;
    if (!status) mk_track_report_head(table, c);
    for (int i = 0; i < ran; i++) {
        c->filter = &mk_tracking_filters[order[i]];
        if (!status) {
            mk_track_report_row(table, c, &result[i], ukf);
            (void)json_array_append_new(filters, mk_track_report_filter(c, &result[i], ukf));
        }
    }
    if (!status) mk_track_report_foot(table, c, &result[ran - 1], notes);
    for (int i = 0; i < ran; i++) mk_track_result_free(&result[i]);
    return status;
}

typedef struct {
    mk_track_campaign_t *c;
    int interrupted;
} work_t;

static int do_work(void *context, json_t *filters, json_t *notes, mk_error_t *error) {
    work_t *const w = context;
    note_network(w->c->scenario, w->c->filter, notes);
    note_mirror(w->c->scenario, notes);
    note_gap(&w->c->facts, notes);
    note_patience(w->c, notes);
    return run_filters(w->c, filters, notes, &w->interrupted, error);
}

static json_t *summarise(void *context, json_t *filters, json_t *notes) {
    const work_t *const w = context;
    return mk_track_report_summary(w->c, filters, notes);
}

int mk_track_simulate(const mk_simulate_options_t *a, mk_scenario_t *s) {
    mk_track_campaign_t c;
    mk_error_t error;
    const mk_plugin_t *plugin = NULL;
    mk_events_t *events = NULL;
    mk_models_f64_t *models = NULL;
    void *own = NULL;
    work_t work = {&c, 0};
    int status = MK_EXIT_INPUT;
    memset(&c, 0, sizeof c);
    if (refuse_options(a, &error) && change_settings(a, s, &error) && set_campaign(&c, a, s, &error) && mk_plugin_load(a->models, &plugin, &error) &&
        (models = mk_models_open_f64(s, plugin, &error)) != NULL && open_events(&c, a, models, &events, &error) &&
        (own = c.tracker->open_models(s, plugin, &error)) != NULL) {
        c.models = own;
        c.space = models->transition.model.space;
        c.log_path = a->out;
        c.progress = isatty(STDERR_FILENO) == 1;
        mk_catch_signals();
        status = mk_simulate_written(&(mk_simulate_work_t){&work, do_work, summarise}, a->json, &error);
    }
    if (status) (void)mk_complain(&error, status);
    if (own) c.tracker->close_models(own);
    if (events) mk_events_free(events);
    if (models) mk_models_close_f64(models);
    return !status && work.interrupted ? MK_EXIT_FAILED : status;
}
