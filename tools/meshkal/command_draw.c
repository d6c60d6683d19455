/* SPDX-License-Identifier: MIT */
/* One run of a tracking or navigation scenario as CSV files, for other programs, and to be read again with simulate --measurements. */
#include <limits.h>
#include <stdio.h>

#include "commands.h"
#include "json_out.h"
#include "navigation/nav_draw.h"
#include "plugin_load.h"
#include "tracking/events.h"

enum { MEASUREMENTS, TRUTH, SUMMARY, FILES };

typedef struct {
    const char *path[FILES];
    mk_output_t file[FILES];
    FILE *to[FILES]; /* null: not wanted */
    long readings, lost, steps_lost, out_of_range;
    json_t *faults; /* [step, node] */
} drawing_t;

static void put_truth(FILE *to, double t, int n, const double *x) {
    for (int i = 0; i < n && to; i++) (void)fprintf(to, "%.17g,%d,%.17g\n", t, i, x[i]);
}

static int put_run(drawing_t *d, const mk_scenario_t *s, mk_run_events_t *stream, mk_error_t *error) {
    mk_instant_t instant;
    int more;
    if (d->to[MEASUREMENTS]) (void)fputs("t,node,row,value\n", d->to[MEASUREMENTS]);
    if (d->to[TRUTH]) (void)fputs("t,state,value\n", d->to[TRUTH]);
    put_truth(d->to[TRUTH], stream->t, s->n, stream->truth);
    for (long step = 1; (more = mk_run_events_next(stream, &instant, error)) > 0; step++) {
        for (int i = 0; i < instant.count; i++) {
            const mk_reading_t *reading = &instant.reading[i];
            for (int r = 0; d->to[MEASUREMENTS] && r < s->sensor[reading->node].rows; r++)
                (void)fprintf(d->to[MEASUREMENTS], "%.17g,%d,%d,%.17g\n", instant.t, reading->node, r, reading->z[r]);
            if (reading->faulty) (void)json_array_append_new(d->faults, json_pack("[I,i]", (json_int_t)step, reading->node));
        }
        put_truth(d->to[TRUTH], instant.t, s->n, instant.x);
        d->readings += instant.count;
        d->lost += instant.lost;
        d->steps_lost += instant.lost_together;
        d->out_of_range += instant.out_of_range;
    }
    return more == 0;
}

static void put_summary(const drawing_t *d, const mk_models_f64_t *models, const mk_run_events_t *stream, uint64_t seed, long steps) {
    const mk_scenario_t *s = models->scenario;
    json_t *root = json_object();
    mk_json_set(root, "scenario", json_string(s->name));
    mk_json_set(root, "seed", json_integer((json_int_t)seed));
    mk_json_set(root, "run", json_integer(stream->run));
    mk_json_set(root, "steps", json_integer(steps));
    mk_json_set(root, "estimate", mk_json_numbers(stream->estimate, (size_t)s->n));
    mk_json_set(root, "P0", mk_json_symmetric(s->n, s->P0));
    mk_json_set(root, "Q", mk_json_symmetric(s->n, models->transition.Q));
    mk_json_set(root, "readings", json_integer(d->readings));
    mk_json_set(root, "lost", json_integer(d->lost));
    mk_json_set(root, "steps_lost", json_integer(d->steps_lost));
    mk_json_set(root, "out_of_range", json_integer(d->out_of_range));
    mk_json_set(root, "faults", json_incref(d->faults));
    mk_json_put(d->to[SUMMARY], root);
}

static int draw(drawing_t *d, const mk_models_f64_t *models, uint64_t seed, int run, long steps, mk_error_t *error) {
    mk_run_events_t stream;
    mk_events_t *events = mk_events_draw(models, seed, steps);
    mk_run_events_open(&stream, events);
    mk_run_events_start(&stream, run);
    const int good = put_run(d, models->scenario, &stream, error);
    if (good && d->to[SUMMARY]) put_summary(d, models, &stream, seed, steps);
    mk_run_events_close(&stream);
    mk_events_free(events);
    return good;
}

/* Each file appears complete, or none. */
static int draw_files(drawing_t *d, const mk_models_f64_t *models, uint64_t seed, int run, long steps, mk_error_t *error) {
    mk_error_t file_error;
    int status = 0;
    for (int i = 0; i < FILES && !status; i++) {
        if (!d->path[i]) continue;
        if (mk_open_output(&d->file[i], d->path[i], error)) d->to[i] = d->file[i].stream;
        else status = MK_EXIT_INPUT;
    }
    if (!status && !draw(d, models, seed, run, steps, error)) status = MK_EXIT_FAILED;
    for (int i = 0; i < FILES; i++) {
        if (!d->to[i] || mk_close_output(&d->file[i], !status, &file_error)) continue;
        *error = file_error;
        status = MK_EXIT_FAILED;
    }
    return status;
}

int mk_command_draw(int argc, char **argv) {
    mk_error_t error;
    mk_scenario_t s;
    drawing_t d = {0};
    const char *path, *steps_text = NULL, *seed_text = NULL, *run_text = NULL, *models_path = NULL, *imu_path = NULL;
    const mk_option_t options[] = {{"measurements", &d.path[MEASUREMENTS], NULL}, {"truth", &d.path[TRUTH], NULL}, {"json", &d.path[SUMMARY], NULL},
                                   {"steps", &steps_text, NULL}, {"seed", &seed_text, NULL}, {"run", &run_text, NULL},
                                   {"models", &models_path, NULL}, {"imu", &imu_path, NULL}, {NULL, NULL, NULL}};
    long long steps = 0, seed = -1, run = 0;
    const mk_plugin_t *plugin;
    if (!mk_parse_options(argc, argv, options, "the scenario file", &path, &error) ||
        !mk_option_integer("steps", steps_text, 1, 1000000000, &steps, &error) || !mk_option_integer("seed", seed_text, 0, INT64_MAX, &seed, &error) ||
        !mk_option_integer("run", run_text, 0, 99999999, &run, &error) || !mk_scenario_load_any(&s, path, &error))
        return mk_complain(&error, MK_EXIT_INPUT);
    int status = MK_EXIT_INPUT;
    mk_models_f64_t *models = NULL;
    if (s.navigation && !models_path) {
        const mk_nav_draw_options_t options = {d.path[MEASUREMENTS], imu_path, d.path[TRUTH], d.path[SUMMARY], seed < 0 ? s.seed : (uint64_t)seed, (int)run,
                                               steps > 0 ? (long)steps : s.steps};
        status = mk_nav_draw(&s, &options);
        mk_scenario_free(&s);
        return status;
    }
    if (s.navigation) (void)mk_fail(&error, "--models is for tracking scenarios");
    else if (!s.tracking) (void)mk_fail(&error, "%s: the model is linear (no \"motion\", no \"navigation\"): draw is for tracking and navigation", path);
    else if (imu_path) (void)mk_fail(&error, "--imu is for navigation scenarios, whose model has \"navigation\"");
    else if (mk_plugin_load(models_path, &plugin, &error)) models = mk_models_open_f64(&s, plugin, &error);
    d.faults = json_array();
    if (models) status = draw_files(&d, models, seed < 0 ? s.seed : (uint64_t)seed, (int)run, steps > 0 ? (long)steps : s.steps, &error);
    if (status) (void)mk_complain(&error, status);
    else
        (void)printf("run %lld: %ld readings, of which faulty: %zu; lost: %ld, in %ld steps all; out of range: %ld\n", run, d.readings,
                     json_array_size(d.faults), d.lost, d.steps_lost, d.out_of_range);
    json_decref(d.faults);
    mk_models_close_f64(models);
    mk_scenario_free(&s);
    return status;
}
