/* SPDX-License-Identifier: MIT */
#include "simulate_shared.h"

#include <float.h>
#include <stdarg.h>
#include <string.h>

#include "commands.h"
#include "file.h"
#include "parallel.h"
#include "scenario_monitor.h"

int mk_simulate_numbers(const mk_simulate_options_t *a, const mk_scenario_t *s, mk_simulate_numbers_t *numbers, mk_error_t *error) {
    long long steps = s->steps, runs = 1, seed = (long long)s->seed, threads = mk_cores();
    if (!mk_option_integer("steps", a->steps, 1, 1000000000, &steps, error) || !mk_option_integer("runs", a->runs, 1, 1000000, &runs, error) ||
        !mk_option_integer("seed", a->seed, 0, INT64_MAX, &seed, error) || !mk_option_integer("threads", a->threads, 1, 4096, &threads, error))
        return 0;
    numbers->steps = (long)steps;
    numbers->runs = (int)runs;
    numbers->threads = (int)threads;
    numbers->seed = (uint64_t)seed;
    return 1;
}

int mk_simulate_real(const mk_simulate_options_t *a, int runs, int *single, mk_error_t *error) {
    *single = a->real && strcmp(a->real, "float32") == 0;
    if (a->real && !*single && strcmp(a->real, "float64") != 0) return mk_fail(error, "--real %s: must be float32 or float64", a->real);
    if (a->measurements && runs != 1) return mk_fail(error, "--runs: recorded measurements can be run once only");
    return 1;
}

int mk_simulate_monitor(const mk_simulate_options_t *a, const mk_scenario_t *s, mk_monitor_settings_t *settings, mk_error_t *error) {
    long long window = s->monitor.window;
    *settings = s->monitor;
    if (a->monitor && !mk_monitor_find(a->monitor, &settings->scheme, error)) return 0;
    if (settings->scheme == MK_MONITOR_NONE && (a->window || a->false_alarm))
        return mk_fail(error, "--%s goes with --monitor", a->window ? "window" : "false-alarm");
    if (!mk_option_integer("window", a->window, 1, MK_MONITOR_LONGEST, &window, error)) return 0;
    if (!mk_option_real("false-alarm", a->false_alarm, DBL_MIN, 1.0 - DBL_EPSILON, &settings->false_alarm, error))
        return mk_fail(error, "--false-alarm %s: must be a probability, above 0 and below 1", a->false_alarm);
    settings->window = (int)window;
    /* Not published; the best single value found (spec 3.3). */
    if (!(settings->jump > 0.0)) settings->jump = 2.0 * settings->window;
    return 1;
}

void mk_add_note(json_t *notes, const char *format, ...) {
    mk_error_t text;
    va_list arguments;
    va_start(arguments, format);
    (void)mk_vfail(&text, format, arguments);
    va_end(arguments);
    (void)json_array_append_new(notes, json_string(text.text));
}

int mk_simulate_written(const mk_simulate_work_t *work, const char *json, mk_error_t *error) {
    json_t *filters = json_array(), *notes = json_array();
    mk_output_t file;
    int status = json && !mk_open_output(&file, json, error) ? MK_EXIT_INPUT : 0;
    if (!status) {
        status = work->work(work->context, filters, notes, error);
        if (json) {
            mk_error_t file_error;
            json_t *const summary = work->summary(work->context, json_incref(filters), json_incref(notes));
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
