/* SPDX-License-Identifier: MIT */
#include "navigation/nav_simulate.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"
#include "navigation/nav_report.h"
#include "scenario_monitor.h"
#include "signals.h"
#include "simulate_shared.h"

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
    mk_simulate_numbers_t given;
    long long from = -1;
    int single;
    if (!mk_simulate_numbers(a, s, &given, error) ||
        !mk_simulate_monitor(a, s, &c->monitor, error) ||
        !mk_nav_filter_find(a->filter ? a->filter : "ekf", &c->filter, error))
        return 0;
    if (!mk_simulate_real(a, given.runs, &single, error)) return 0;
    c->precision = single ? &mk_nav_f32 : &mk_nav_f64;
    if (c->filter == MK_NAV_FILTER_COUNT && a->out) return mk_fail(error, "--out: a log holds one filter; choose one with --filter");
    c->scenario = s;
    c->runs = given.runs;
    c->seed = given.seed;
    c->threads = given.threads;
    c->span = mk_nav_fault_span(s);
    c->epochs = a->measurements ? mk_epochs_record(s, a->measurements, a->imu, a->truth, a->steps ? given.steps : 0, error)
                                : mk_epochs_draw(s, c->seed, given.steps, error);
    if (!c->epochs) return 0;
    c->facts = mk_epochs_facts(c->epochs);
    if (!mk_option_integer("from-step", a->from_step, 1, c->facts.steps, &from, error)) return 0;
    c->from = from > 0 ? (long)from : c->facts.steps / 2 + 1;
    return 1;
}

static void add_notes(const mk_nav_campaign_t *c, json_t *notes) {
    const mk_scenario_t *const s = c->scenario;
    if (c->facts.fewest < 4)
        mk_add_note(notes, "%s %d satellite%s: position and clock take four; with fewer the inertial unit carries them on, and rekf-t is the plain filter",
                 c->facts.drawn ? c->facts.fewest == 1 ? "there is" : "there are" : "the poorest epoch has", c->facts.fewest,
                 c->facts.fewest == 1 ? "" : "s");
    if (c->facts.gap_s > LONG_GAP * c->facts.interval_s)
        mk_add_note(notes, "no inertial sample for %.6g s from t = %.15g on, %.3g times the mean interval: rates are taken as constant over it", c->facts.gap_s,
                 c->facts.gap_from_s, c->facts.gap_s / c->facts.interval_s);
    if (!c->facts.drawn && !s->navigation->has_estimate)
        mk_add_note(notes, "model.navigation.estimate is not given: the run starts from the scenario's own start, with clock and biases 0");
    for (int i = 0; i < s->faults; i++)
        if (!(s->fault[i].from_s < c->facts.last_s))
            mk_add_note(notes, "faults[%d] begins at %g s: after the last epoch, %.15g s", i, s->fault[i].from_s, c->facts.last_s);
    if (c->monitor.scheme != MK_MONITOR_NONE && s->nodes < 5)
        mk_add_note(notes, "%d satellite%s: with fewer than five no statistic can say which of them is faulty", s->nodes, s->nodes == 1 ? "" : "s");
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

typedef struct {
    mk_nav_campaign_t *c;
    int interrupted;
} work_t;

static int do_work(void *context, json_t *filters, json_t *notes, mk_error_t *error) {
    work_t *const w = context;
    add_notes(w->c, notes);
    return run_filters(w->c, filters, notes, &w->interrupted, error);
}

static json_t *summarise(void *context, json_t *filters, json_t *notes) {
    const work_t *const w = context;
    return mk_nav_report_summary(w->c, filters, notes);
}

int mk_nav_simulate(const mk_simulate_options_t *a, const mk_scenario_t *s) {
    mk_nav_campaign_t c;
    mk_error_t error;
    work_t work = {&c, 0};
    int status = MK_EXIT_INPUT;
    memset(&c, 0, sizeof c);
    if (refuse_options(a, &error) && set_campaign(&c, a, s, &error)) {
        c.log_path = a->out;
        c.progress = isatty(STDERR_FILENO) == 1;
        mk_catch_signals();
        status = mk_simulate_written(&(mk_simulate_work_t){&work, do_work, summarise}, a->json, &error);
    }
    if (status) (void)mk_complain(&error, status);
    mk_epochs_free((mk_epochs_t *)c.epochs);
    return !status && work.interrupted ? MK_EXIT_FAILED : status;
}
