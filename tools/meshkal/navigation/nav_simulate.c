/* SPDX-License-Identifier: MIT */
#include "navigation/nav_simulate.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"
#include "json_out.h"
#include "navigation/nav_report.h"
#include "parallel.h"
#include "scenario_monitor.h"
#include "signals.h"

/* An interval of samples that is so many times the mean is worth a note. */
#define LONG_GAP 10.0

static int refuse_options(const mk_simulate_options_t *a, mk_error_t *error) {
    const struct {
        const char *name, *value;
    } other[] = {{"loss", a->loss},     {"tolerance", a->tolerance}, {"horizon", a->horizon},       {"resume", a->resume}, {"frozen", a->frozen},
                 {"record", a->record}, {"arrivals", a->arrivals},   {"models", a->models},         {"lost-m", a->lost_m}, {"rule", a->rule},
                 {"gate", a->gate},     {"split", a->split},         {"increments", a->increments}, {"protocol", a->protocol},
                 {"iterations", a->iterations}};
    for (size_t i = 0; i < sizeof other / sizeof other[0]; i++)
        if (other[i].value) return mk_fail(error, "--%s is not for navigation scenarios", other[i].name);
    if ((a->measurements != NULL) != (a->imu != NULL))
        return mk_fail(error, "--%s goes with --%s: a recorded run needs both", a->imu ? "imu" : "measurements", a->imu ? "measurements" : "imu");
    if (a->truth && !a->measurements) return mk_fail(error, "--truth FILE.csv goes with --measurements and --imu");
    return 1;
}

static int set_campaign(mk_nav_campaign_t *c, const mk_simulate_options_t *a, const mk_scenario_t *s, mk_error_t *error) {
    long long steps = s->steps, runs = 1, seed = (long long)s->seed, threads = mk_cores(), from = -1;
    if (!mk_option_integer("steps", a->steps, 1, 1000000000, &steps, error) || !mk_option_integer("runs", a->runs, 1, 1000000, &runs, error) ||
        !mk_option_integer("seed", a->seed, 0, INT64_MAX, &seed, error) || !mk_option_integer("threads", a->threads, 1, 4096, &threads, error) ||
        !mk_monitor_options(a->monitor, a->window, a->false_alarm, s, &c->monitor, error) ||
        !mk_nav_filter_find(a->filter ? a->filter : "ekf", &c->filter, error))
        return 0;
    c->precision = &mk_nav_f64;
    if (a->real && strcmp(a->real, "float32") == 0) c->precision = &mk_nav_f32;
    else if (a->real && strcmp(a->real, "float64") != 0) return mk_fail(error, "--real %s: must be float32 or float64", a->real);
    if (a->measurements && runs != 1) return mk_fail(error, "--runs: recorded measurements can be run once only");
    if (c->filter == MK_NAV_FILTER_COUNT && a->out) return mk_fail(error, "--out: a log holds one filter; choose one with --filter");
    c->scenario = s;
    c->runs = (int)runs;
    c->seed = (uint64_t)seed;
    c->threads = (int)threads;
    c->span = mk_nav_fault_span(s);
    c->epochs = a->measurements ? mk_epochs_record(s, a->measurements, a->imu, a->truth, a->steps ? (long)steps : 0, error)
                                : mk_epochs_draw(s, c->seed, (long)steps, error);
    if (!c->epochs) return 0;
    c->facts = mk_epochs_facts(c->epochs);
    if (!mk_option_integer("from-step", a->from_step, 1, c->facts.steps, &from, error)) return 0;
    c->from = from > 0 ? (long)from : c->facts.steps / 2 + 1;
    return 1;
}

static void add_note(json_t *notes, const char *format, ...) MK_PRINTF(2, 3);
static void add_note(json_t *notes, const char *format, ...) {
    mk_error_t text;
    va_list arguments;
    va_start(arguments, format);
    (void)mk_vfail(&text, format, arguments);
    va_end(arguments);
    (void)json_array_append_new(notes, json_string(text.text));
}

static void add_notes(const mk_nav_campaign_t *c, json_t *notes) {
    const mk_scenario_t *const s = c->scenario;
    if (c->facts.fewest < 4)
        add_note(notes, "%s %d satellite%s: position and clock take four; with fewer the inertial unit carries them on, and rekf-t is the plain filter",
                 c->facts.drawn ? c->facts.fewest == 1 ? "there is" : "there are" : "the poorest epoch has", c->facts.fewest,
                 c->facts.fewest == 1 ? "" : "s");
    if (c->facts.gap_s > LONG_GAP * c->facts.interval_s)
        add_note(notes, "no inertial sample for %.6g s from t = %.15g on, %.3g times the mean interval: rates are taken as constant over it", c->facts.gap_s,
                 c->facts.gap_from_s, c->facts.gap_s / c->facts.interval_s);
    if (!c->facts.drawn && !s->navigation->has_estimate)
        add_note(notes, "model.navigation.estimate is not given: the run starts from the scenario's own start, with clock and biases 0");
    for (int i = 0; i < s->faults; i++)
        if (!(s->fault[i].from_s < c->facts.last_s))
            add_note(notes, "faults[%d] begins at %g s: after the last epoch, %.15g s", i, s->fault[i].from_s, c->facts.last_s);
    if (c->monitor.scheme != MK_MONITOR_NONE && s->nodes < 5)
        add_note(notes, "%d satellite%s: with fewer than five no statistic can say which of them is faulty", s->nodes, s->nodes == 1 ? "" : "s");
}

/* The campaign's filter, or all of them, one after another. An exit status. */
static int run_filters(mk_nav_campaign_t *c, json_t *filters, json_t *notes, int *interrupted, mk_error_t *error) {
    const int only = c->filter, all = only == MK_NAV_FILTER_COUNT;
    FILE *const table = c->log_path && strcmp(c->log_path, "-") == 0 ? stderr : stdout;
    mk_nav_result_t result;
    *interrupted = 0;
    memset(&result, 0, sizeof result);
    for (int i = all ? 0 : only; i <= (all ? MK_NAV_FILTER_COUNT - 1 : only) && !*interrupted; i++) {
        mk_nav_result_free(&result);
        c->filter = i;
        const int status = mk_nav_campaign_run(c, &result, error);
        if (status) {
            mk_nav_result_free(&result);
            return status;
        }
        *interrupted = result.interrupted;
        if (json_array_size(filters) == 0) mk_nav_report_head(table, c);
        mk_nav_report_row(table, c, &result);
        (void)json_array_append_new(filters, mk_nav_report_filter(c, &result));
    }
    mk_nav_report_foot(table, c, &result, notes);
    mk_nav_result_free(&result);
    return 0;
}

static int run_written(mk_nav_campaign_t *c, const char *json, int *interrupted, mk_error_t *error) {
    json_t *filters = json_array(), *notes = json_array();
    mk_output_t file;
    int status = json && !mk_open_output(&file, json, error) ? MK_EXIT_INPUT : 0;
    if (!status) {
        add_notes(c, notes);
        status = run_filters(c, filters, notes, interrupted, error);
        if (json) {
            mk_error_t file_error;
            json_t *const summary = mk_nav_report_summary(c, json_incref(filters), json_incref(notes));
            if (!status) (void)json_dumpf(summary, file.stream, JSON_INDENT(1) | JSON_REAL_PRECISION(17));
            json_decref(summary);
            if (!mk_close_output(&file, !status, &file_error) && !status) {
                *error = file_error;
                status = MK_EXIT_FAILED;
            }
        }
    }
    json_decref(filters);
    json_decref(notes);
    return status;
}

int mk_nav_simulate(const mk_simulate_options_t *a, const mk_scenario_t *s) {
    mk_nav_campaign_t c;
    mk_error_t error;
    int interrupted = 0, status = MK_EXIT_INPUT;
    memset(&c, 0, sizeof c);
    if (refuse_options(a, &error) && set_campaign(&c, a, s, &error)) {
        c.log_path = a->out;
        c.progress = isatty(STDERR_FILENO) == 1;
        mk_catch_signals();
        status = run_written(&c, a->json, &interrupted, &error);
    }
    if (status) (void)mk_complain(&error, status);
    mk_epochs_free((mk_epochs_t *)c.epochs);
    return !status && interrupted ? MK_EXIT_FAILED : status;
}
