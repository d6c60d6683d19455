/* SPDX-License-Identifier: MIT */
#include "design_tracking.h"

#include <string.h>

#include "commands.h"
#include "file.h"
#include "parallel.h"
#include "plugin_load.h"
#include "tracking/tracking_design.h"

/* Runs by default, and readings of all of them together. */
enum { RUNS = 100, READINGS = 20000000 };

static int settle(const mk_scenario_t *s, const mk_design_tracking_arguments_t *a, mk_tracking_design_settings_t *settings, mk_error_t *error) {
    long long window = 10, threads = mk_cores(), runs = RUNS;
    /* Along noisy paths one range sensor looks as if it saw everything, with some 1e7; a thousand deviations of the prior are no more use. */
    settings->condition = 1e6;
    if (!mk_option_integer("window", a->window, 1, 1000000000, &window, error) ||
        !mk_option_real("condition", a->condition, 1.0, 1e300, &settings->condition, error) ||
        !mk_option_integer("runs", a->runs, 0, 1000000, &runs, error) || !mk_option_integer("threads", a->threads, 1, 1024, &threads, error))
        return 0;
    if (a->truth && a->runs) return mk_fail(error, "--runs draws trajectories; --truth FILE.csv gives one");
    settings->window = (long)window;
    settings->threads = (int)threads;
    settings->truth = a->truth;
    settings->steps = s->steps;
    /* By default a second or so. */
    const double most = READINGS / ((double)s->nodes * (double)s->steps);
    if (!a->runs && (double)runs > most) runs = (long long)most;
    settings->runs = a->truth ? 0 : (long)runs;
    return 1;
}

int mk_design_tracking(const mk_scenario_t *s, const mk_design_tracking_arguments_t *a) {
    mk_error_t error;
    mk_tracking_design_settings_t settings;
    mk_tracking_design_t results;
    const mk_plugin_t *plugin;
    mk_output_t file;
    if (!settle(s, a, &settings, &error) || !mk_plugin_load(a->models, &plugin, &error)) return mk_complain(&error, MK_EXIT_INPUT);
    mk_models_f64_t *models = mk_models_open_f64(s, plugin, &error);
    if (!models) return mk_complain(&error, MK_EXIT_INPUT);
    int status = a->json && !mk_open_output(&file, a->json, &error) ? MK_EXIT_INPUT : 0;
    const int opened = a->json && !status;
    const int made = !status && mk_tracking_design(&results, models, &settings, &error);
    if (!made) status = MK_EXIT_INPUT;
    if (opened) {
        mk_error_t file_error;
        if (made) mk_write_tracking_design(file.stream, &results);
        if (!mk_close_output(&file, made, &file_error)) {
            error = file_error;
            status = MK_EXIT_FAILED;
        }
    }
    if (!status) {
        mk_print_tracking_design(&results);
        if (results.failure.text[0] && !a->allow) {
            error = results.failure;
            status = MK_EXIT_FAILED;
        }
    }
    if (status) (void)mk_complain(&error, status);
    if (made) mk_tracking_design_free(&results);
    mk_models_close_f64(models);
    return status;
}
