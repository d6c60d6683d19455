/* SPDX-License-Identifier: MIT */
#include "navigation/nav_draw.h"

#include <stdio.h>

#include "commands.h"
#include "json_out.h"
#include "navigation/epochs.h"

enum { MEASUREMENTS, IMU, TRUTH, SUMMARY, FILES };

typedef struct {
    mk_output_t file[FILES];
    FILE *to[FILES]; /* null: not wanted */
    long readings, samples;
} drawing_t;

static void put_names(FILE *to, const char *const *names, int count) {
    for (int i = 0; i < count && to; i++) (void)fprintf(to, "%s%s", names[i], i + 1 < count ? "," : "\n");
}

static void put_numbers(FILE *to, double t, const double *values, int count) {
    (void)fprintf(to, "%.17g", t);
    for (int i = 0; i < count; i++) (void)fprintf(to, ",%.17g", values[i]);
    (void)fputc('\n', to);
}

static void put_truth(FILE *to, double t, const mk_nav_state_t *truth) {
    double x[MK_NAV_STATES];
    if (!to) return;
    mk_nav_state_put(truth, x);
    put_numbers(to, t, x, MK_NAV_STATES);
}

static void put_epoch(drawing_t *d, const mk_scenario_t *s, const mk_epoch_t *epoch) {
    const double begin = epoch->t - epoch->dt;
    for (long j = 0; j < epoch->samples && d->to[IMU]; j++) {
        const mk_inertial_t *const sample = &epoch->inertial[j];
        const double values[6] = {sample->w[0], sample->w[1], sample->w[2], sample->f[0], sample->f[1], sample->f[2]};
        put_numbers(d->to[IMU], j + 1 < epoch->samples ? begin + (double)(j + 1) * s->navigation->imu_s : epoch->t, values, 6);
    }
    for (int k = 0; k < s->nodes && d->to[MEASUREMENTS]; k++)
        if (epoch->have[k])
            (void)fprintf(d->to[MEASUREMENTS], "%.17g,%d,%.17g,%.17g,%.17g,%.17g\n", epoch->t, s->navigation->satellite[k].number, epoch->value[k],
                          epoch->satellite[k][0], epoch->satellite[k][1], epoch->satellite[k][2]);
    put_truth(d->to[TRUTH], epoch->t, epoch->truth);
    for (int k = 0; k < s->nodes; k++) d->readings += epoch->have[k];
    d->samples += epoch->samples;
}

static void put_run(drawing_t *d, const mk_scenario_t *s, const mk_nav_draw_options_t *options, const mk_epochs_t *epochs) {
    static const char *const range_names[] = MK_NAV_PSEUDORANGE_COLUMNS, *const sample_names[] = MK_NAV_INERTIAL_COLUMNS,
                            *const truth_names[] = MK_NAV_TRUTH_COLUMNS;
    mk_run_epochs_t stream;
    mk_epoch_t epoch;
    double estimate[MK_NAV_STATES];
    mk_run_epochs_open(&stream, epochs);
    mk_run_epochs_start(&stream, options->run);
    mk_nav_state_put(&stream.estimate, estimate);
    put_names(d->to[MEASUREMENTS], range_names, 6);
    put_names(d->to[IMU], sample_names, 7);
    put_names(d->to[TRUTH], truth_names, 1 + MK_NAV_STATES);
    put_truth(d->to[TRUTH], stream.t, &stream.truth);
    while (mk_run_epochs_next(&stream, &epoch)) put_epoch(d, s, &epoch);
    mk_run_epochs_close(&stream);
    if (!d->to[SUMMARY]) return;
    json_t *root = json_object();
    mk_json_set(root, "scenario", json_string(s->name));
    mk_json_set(root, "seed", json_integer((json_int_t)options->seed));
    mk_json_set(root, "run", json_integer(options->run));
    mk_json_set(root, "steps", json_integer(options->steps));
    mk_json_set(root, "estimate", mk_json_numbers(estimate, MK_NAV_STATES));
    mk_json_set(root, "P0", mk_json_symmetric(MK_NAV_STATES, s->P0));
    mk_json_set(root, "readings", json_integer(d->readings));
    mk_json_set(root, "samples", json_integer(d->samples));
    mk_json_put(d->to[SUMMARY], root);
}

/* Each file appears complete, or none. */
int mk_nav_draw(const mk_scenario_t *scenario, const mk_nav_draw_options_t *options) {
    const char *const path[FILES] = {options->measurements, options->imu, options->truth, options->json};
    mk_scenario_t clean = *scenario; /* its parts stay the scenario's */
    drawing_t d = {0};
    mk_error_t error, file_error;
    clean.faults = 0;
    mk_epochs_t *const epochs = mk_epochs_draw(&clean, options->seed, options->steps, &error);
    int status = epochs ? 0 : MK_EXIT_INPUT;
    for (int i = 0; i < FILES && !status; i++) {
        if (!path[i]) continue;
        if (mk_open_output(&d.file[i], path[i], &error)) d.to[i] = d.file[i].stream;
        else status = MK_EXIT_INPUT;
    }
    if (!status) put_run(&d, &clean, options, epochs);
    for (int i = 0; i < FILES; i++) {
        if (!d.to[i] || mk_close_output(&d.file[i], !status, &file_error)) continue;
        error = file_error;
        status = MK_EXIT_FAILED;
    }
    mk_epochs_free(epochs);
    if (status) return mk_complain(&error, status);
    (void)printf("run %d: %ld pseudoranges, %ld inertial samples; faults are not in the files: simulate adds them; \"estimate\" of --json goes into "
                 "model.navigation.estimate\n", options->run, d.readings, d.samples);
    return 0;
}
