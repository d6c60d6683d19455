/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"
#include "design/steady.h"
#include "json_out.h"
#include "monitor_report.h"
#include "navigation/nav_simulate.h"
#include "parallel.h"
#include "signals.h"
#include "simulate_options.h"
#include "simulate_report.h"
#include "simulate_shared.h"
#include "tracking/track_simulate.h"

/* Steps after the last one that the adversary still looks ahead to, where the user does not say: the end of its horizon is not seen. */
#define HORIZON_MARGIN 100

typedef mk_simulate_options_t arguments_t;

static int read_arguments(int argc, char **argv, int alone, arguments_t *a, const char **path, mk_error_t *error) {
    const mk_option_t options[] = {{"filter", &a->filter, NULL}, {"steps", &a->steps, NULL},         {"seed", &a->seed, NULL},
                                   {"runs", &a->runs, NULL},     {"real", &a->real, NULL},           {"loss", &a->loss, NULL},
                                   {"tolerance", &a->tolerance, NULL}, {"measurements", &a->measurements, NULL}, {"truth", &a->truth, NULL},
                                   {"horizon", &a->horizon, NULL},     {"out", &a->out, NULL},                   {"json", &a->json, NULL},
                                   {"threads", &a->threads, NULL},     {"resume", &a->resume, NULL},           {"frozen", &a->frozen, NULL},
                                   {"arrivals", &a->arrivals, NULL},   {"record", &a->record, NULL},           {"imu", &a->imu, NULL},
                                   {"monitor", &a->monitor, NULL},     {"window", &a->window, NULL},           {"false-alarm", &a->false_alarm, NULL},
                                   {"models", &a->models, NULL}, {"from-step", &a->from_step, NULL}, {"lost-m", &a->lost_m, NULL},
                                   {"increments", &a->increments, NULL}, {"rule", &a->rule, NULL}, {"gate", &a->gate, NULL},
                                   {"iterations", &a->iterations, NULL}, {"protocol", &a->protocol, NULL},
                                   {alone ? NULL : "split", &a->split, NULL}, {NULL, NULL, NULL}};
    return mk_parse_options(argc, argv, options, "the scenario file", path, error);
}

static int refuse_tracking_options(const arguments_t *a, mk_error_t *error) {
    const char *const given[] = {a->models, a->from_step, a->lost_m, a->increments, a->rule, a->gate, a->iterations, a->protocol};
    static const char *const names[] = {"models", "from-step", "lost-m", "increments", "rule", "gate", "iterations", "protocol"};
    if (a->imu) return mk_fail(error, "--imu is for navigation scenarios, whose model has \"navigation\"");
    for (int i = 0; i < 8; i++)
        if (given[i]) return mk_fail(error, "--%s is for tracking scenarios, whose model has \"motion\"", names[i]);
    return 1;
}

/* How the work is shared out. */
static int set_shares(mk_campaign_t *c, const arguments_t *a, const mk_team_t *team, mk_error_t *error) {
    long long threads = team->ranks > 1 ? 1 : mk_cores();
    if (!mk_option_integer("threads", a->threads, 1, 4096, &threads, error)) return 0;
    c->threads = (int)threads;
    c->split_nodes = team->ranks > 1 && c->runs < team->ranks;
    if (!a->split) return 1;
    if (strcmp(a->split, "nodes") != 0 && strcmp(a->split, "runs") != 0) return mk_fail(error, "--split %s: must be nodes or runs", a->split);
    c->split_nodes = team->ranks > 1 && strcmp(a->split, "nodes") == 0;
    return 1;
}

static int set_campaign(mk_campaign_t *c, const arguments_t *a, const mk_scenario_t *s, const mk_team_t *team, mk_error_t *error) {
    long long steps = s->steps, runs = 1, seed = (long long)s->seed;
    int single;
    c->scenario = s;
    c->tolerance = s->tolerance;
    if (!mk_option_integer("steps", a->steps, 1, 1000000000, &steps, error) || !mk_option_integer("runs", a->runs, 1, 100000000, &runs, error) ||
        !mk_option_integer("seed", a->seed, 0, INT64_MAX, &seed, error) || !mk_option_real("loss", a->loss, 0.0, 1.0, &c->loss, error) ||
        !mk_option_real("tolerance", a->tolerance, 0.0, 1e6, &c->tolerance, error))
        return 0;
    c->steps = (int)steps;
    c->runs = (int)runs;
    c->seed = (uint64_t)seed;
    if (!mk_simulate_real(a, c->runs, &single, error)) return 0;
    c->network = single ? &mk_network_f32 : &mk_network_f64;
    if (a->resume && a->out) return mk_fail(error, "--resume keeps figures, not logs: leave --out away");
    if (a->resume && a->measurements) return mk_fail(error, "--resume: recorded measurements are one run");
    if (a->arrivals && a->loss) return mk_fail(error, "--loss: with --arrivals the file says what is lost");
    if (a->arrivals && c->runs != 1) return mk_fail(error, "--runs: recorded arrivals can be run once only");
    if (a->arrivals && a->resume) return mk_fail(error, "--resume: recorded arrivals are one run");
    if (!mk_filter_find(a->filter ? a->filter : "rkfdnu2", &c->filter, error)) return 0;
    if (a->arrivals && (!c->filter || c->filter->central))
        return mk_fail(error, "--arrivals is for one distributed filter; choose one with --filter");
    if (!mk_option_real("frozen", a->frozen, MK_LEAST_CLOSE, MK_MOST_CLOSE, &c->frozen, error)) return 0;
    if (a->frozen && c->filter && c->filter->mode == MK_TOLERANCE_SCHEDULE)
        return mk_fail(error, "--frozen: %s has another tolerance at every step, so its gain is not constant", c->filter->name);
    if (!c->filter && a->out) return mk_fail(error, "--out: a log holds one filter; choose one with --filter");
    if (a->record && (!c->filter || c->filter->central))
        return mk_fail(error, "--record: records are of nodes; choose one of kfd, rkfdu, rkfdnu, rkfdnu2 with --filter");
    if (a->record && team->ranks > 1) return mk_fail(error, "--record: one process writes records; leave mpirun away");
    if (a->record && a->resume) return mk_fail(error, "--resume keeps figures, not records: leave --record away");
    if (a->record && s->nodes > MK_MOST_FRAMED)
        return mk_fail(error, "--record: %d nodes, but frames have 16 bits for the number of a node", s->nodes);
    if (s->nodes > UINT16_MAX && (!c->filter || c->filter->central))
        return mk_fail(error, "a centralised filter takes at most %d nodes, not %d", UINT16_MAX, s->nodes);
    return mk_simulate_monitor(a, s, &c->monitor, error) && set_shares(c, a, team, error);
}

static int open_source(mk_source_t *source, mk_campaign_t *c, const arguments_t *a, mk_error_t *error) {
    const int worst = a->truth && strcmp(a->truth, "least-favourable") == 0, nominal = !a->truth || strcmp(a->truth, "nominal") == 0;
    long long horizon = (long long)c->steps + HORIZON_MARGIN;
    if (!mk_option_integer("horizon", a->horizon, 0, 100000000, &horizon, error)) return 0;
    if (a->horizon && !worst) return mk_fail(error, "--horizon goes with --truth least-favourable");
    if (a->measurements) {
        if (a->truth && (worst || nominal)) return mk_fail(error, "--truth %s is for drawn data, not with --measurements", a->truth);
        if (!mk_source_record(source, c->scenario, a->measurements, a->truth, a->steps ? c->steps : 0, error)) return 0;
        c->steps = source->steps;
        return 1;
    }
    if (nominal) {
        mk_source_draw(source, c->scenario, c->seed);
        return 1;
    }
    if (!worst) return mk_fail(error, "--truth %s: must be nominal or least-favourable; a file goes with --measurements", a->truth);
    if (horizon < c->steps - 1)
        return mk_fail(error, "--horizon %lld: the least favourable model must reach the last step, %d", horizon, c->steps - 1);
    return mk_source_draw_worst(source, c->scenario, c->seed, c->tolerance, (int)horizon, error);
}

static int read_arrivals(mk_arrivals_t *arrivals, mk_campaign_t *c, const arguments_t *a, mk_error_t *error) {
    if (!a->arrivals) return 1;
    if (!mk_arrivals_read(arrivals, c->scenario, c->steps, a->arrivals, error)) return 0;
    c->arrivals = arrivals;
    c->loss = arrivals->missing;
    return 1;
}

/* Everything that decides the numbers of a run, but the filter and the recorded files. */
static void identify(char *text, size_t room, const mk_campaign_t *c, const mk_source_t *source) {
    const mk_monitor_settings_t *m = &c->monitor;
    char frozen[40] = "", monitor[200] = "";
    if (c->frozen > 0.0) (void)snprintf(frozen, sizeof frozen, " frozen %.17g", c->frozen);
    if (m->scheme != MK_MONITOR_NONE)
        (void)snprintf(monitor, sizeof monitor, " monitor %s window %d false-alarm %.17g", mk_monitor_name(m->scheme), m->window, m->false_alarm);
    (void)snprintf(text, room, "meshkal " MK_VERSION " scenario %s seed %llu steps %d loss %.17g tolerance %.17g real %s truth %s horizon %d%s%s",
                   c->scenario->sha256, (unsigned long long)c->seed, c->steps, c->loss, c->tolerance, c->network->name, mk_truth_name(source->truth),
                   source->worst.horizon, frozen, monitor);
}

/* Runs the campaign's filter, or all of them if it has none, into the table and the JSON list. An exit status. */
static int run_filters(mk_campaign_t *c, const mk_source_t *source, mk_team_t *team, json_t *filters, int *interrupted, mk_error_t *error) {
    const mk_filter_t *only = c->filter;
    FILE *table = c->log_path && strcmp(c->log_path, "-") == 0 ? stderr : stdout;
    mk_result_t result;
    int ran = 0;
    *interrupted = 0;
    memset(&result, 0, sizeof result);
    for (int i = 0; i < MK_FILTERS && !*interrupted; i++) {
        if (only && only != &mk_filters[i]) continue;
        c->filter = &mk_filters[i];
        if (ran) mk_result_free(&result);
        const int status = mk_campaign_run(c, source, team, &result, error);
        if (status) return ran ? MK_EXIT_FAILED : status; /* filters before this one did their work */
        *interrupted = result.interrupted;
        if (team->rank > 0) {
            ran = 1;
            continue;
        }
        if (!ran) mk_report_head(table, c, source, team);
        mk_report_row(table, c, &result);
        (void)json_array_append_new(filters, mk_report_filter(c, &result));
        ran = 1;
    }
    if (team->rank == 0) mk_report_alert_tables(table, c, filters);
    if (team->rank == 0) mk_report_foot(table, c, source, team, &result);
    mk_result_free(&result);
    return 0;
}

static int simulate(mk_campaign_t *c, const mk_source_t *source, mk_team_t *team, const char *json, int *interrupted, mk_error_t *error) {
    json_t *filters = json_array();
    mk_output_t file;
    const int writes = json && team->rank == 0;
    /* The summary's place is tried before hours are spent on what goes there. */
    const int opened = !writes || mk_open_output(&file, json, error);
    int status = team->agree(team, opened, error) ? 0 : MK_EXIT_INPUT;
    if (!status) status = run_filters(c, source, team, filters, interrupted, error);
    if (writes && opened) {
        mk_error_t file_error;
        json_t *summary = mk_report_summary(c, source, team, json_incref(filters));
        if (!status) (void)json_dumpf(summary, file.stream, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
        json_decref(summary);
        if (!mk_close_output(&file, !status, &file_error)) {
            *error = file_error;
            status = MK_EXIT_FAILED;
        }
    }
    json_decref(filters);
    return status;
}

int mk_command_simulate(int argc, char **argv, struct mk_team *given) {
    mk_team_t *team = given ? given : &mk_team_alone;
    mk_error_t error;
    arguments_t a;
    mk_scenario_t scenario;
    mk_campaign_t c;
    mk_source_t source;
    mk_arrivals_t arrivals;
    char identity[512] = "", shares[896];
    const char *path;
    int interrupted = 0, status = MK_EXIT_INPUT;
    memset(&a, 0, sizeof a);
    memset(&c, 0, sizeof c);
    memset(&scenario, 0, sizeof scenario);
    memset(&source, 0, sizeof source);
    memset(&arrivals, 0, sizeof arrivals);
    int good = read_arguments(argc, argv, !given, &a, &path, &error) && mk_scenario_load_any(&scenario, path, &error);
    if (good && scenario.tracking && !given) {
        status = mk_track_simulate(&a, &scenario);
        mk_scenario_free(&scenario);
        return status;
    }
    if (good && scenario.navigation && !given) {
        status = mk_nav_simulate(&a, &scenario);
        mk_scenario_free(&scenario);
        return status;
    }
    if (good && scenario.navigation) good = mk_fail(&error, "%s: a navigation scenario runs in one process, on all its cores: leave mpirun away", path);
    if (good && scenario.tracking) good = mk_fail(&error, "%s: a tracking scenario runs in one process, on all its cores: leave mpirun away", path);
    good = good && refuse_tracking_options(&a, &error) && set_campaign(&c, &a, &scenario, team, &error) && open_source(&source, &c, &a, &error) &&
           read_arrivals(&arrivals, &c, &a, &error);
    if (good) identify(identity, sizeof identity, &c, &source);
    (void)snprintf(shares, sizeof shares, "%s data %s arrivals %s filter %s runs %d threads %d split %s out %d json %d resume %d", identity,
                   source.sha256[0] ? source.sha256 : "drawn", arrivals.sha256[0] ? arrivals.sha256 : "drawn", c.filter ? c.filter->name : "all", c.runs,
                   c.threads, c.split_nodes ? "nodes" : "runs", a.out != NULL, a.json != NULL, a.resume != NULL);
    good = team->agree(team, good, &error) && team->same(team, shares, &error);
    if (good) {
        if (!a.out) mk_scenario_drop_text(&scenario);
        mk_catch_signals();
        c.log_path = a.out;
        c.record_path = a.record;
        c.keep_path = a.resume;
        c.identity = identity;
        c.progress = team->rank == 0 && isatty(STDERR_FILENO) == 1;
        status = simulate(&c, &source, team, a.json, &interrupted, &error);
        good = status == 0;
    }
    if (!good && team->rank == 0) (void)mk_complain(&error, status);
    mk_arrivals_free(&arrivals);
    mk_source_free(&source);
    mk_scenario_free(&scenario);
    return good && interrupted ? MK_EXIT_FAILED : status;
}
