/* SPDX-License-Identifier: MIT */
#include "navigation/epochs.h"

#include <math.h>
#include <meshkal/angle.h>
#include <stdlib.h>
#include <string.h>

#include "navigation/epochs_parts.h"
#include "random.h"
#include "scenario_faults.h"

/* Samples of a drawn flight, which are kept: 17 numbers each. */
#define MOST_KEPT 50000000L

mk_epochs_facts_t mk_epochs_facts(const mk_epochs_t *epochs) { return epochs->facts; }

mk_epochs_t *mk_epochs_draw(const mk_scenario_t *s, uint64_t seed, long steps, mk_error_t *error) {
    const mk_navigation_t *const nav = s->navigation;
    if (steps > MOST_KEPT / nav->samples) {
        (void)mk_fail(error, "%ld epochs of %d samples each: at most %ld samples can be drawn", steps, nav->samples, MOST_KEPT);
        return NULL;
    }
    mk_epochs_t *const epochs = mk_allocate(1, sizeof *epochs);
    epochs->scenario = s;
    epochs->seed = seed;
    epochs->facts.drawn = epochs->facts.has_truth = 1;
    epochs->facts.steps = steps;
    epochs->facts.start_s = nav->start_s;
    epochs->facts.last_s = nav->start_s + (double)steps * s->dt_s;
    epochs->facts.fewest = s->nodes;
    epochs->facts.sha256 = epochs->sha256;
    epochs->most_samples = nav->samples;
    epochs->flown = mk_fly(nav, steps * nav->samples);
    epochs->place = mk_allocate((size_t)s->nodes, sizeof *epochs->place);
    for (int k = 0; k < s->nodes; k++) {
        double up, level, east, north;
        mk_sincos_f64(nav->satellite[k].elevation, &up, &level);
        mk_sincos_f64(nav->satellite[k].azimuth, &east, &north);
        epochs->place[k][0] = nav->satellite_range * level * east;
        epochs->place[k][1] = nav->satellite_range * level * north;
        epochs->place[k][2] = nav->satellite_range * up;
    }
    return epochs;
}

void mk_epochs_free(mk_epochs_t *epochs) {
    if (!epochs) return;
    free(epochs->flown);
    free(epochs->place);
    free(epochs->sample);
    free(epochs->time);
    free(epochs->first);
    free(epochs->node);
    free(epochs->value);
    free(epochs->from);
    free(epochs->truth);
    free(epochs);
}

/* --- a run ------------------------------------------------------------------------------------------------------------------ */

void mk_run_epochs_open(mk_run_epochs_t *stream, const mk_epochs_t *epochs) {
    const size_t nodes = (size_t)epochs->scenario->nodes;
    memset(stream, 0, sizeof *stream);
    stream->epochs = epochs;
    stream->inertial = mk_allocate((size_t)epochs->most_samples, sizeof *stream->inertial);
    stream->have = mk_allocate(nodes, 1);
    stream->value = mk_allocate(2 * nodes, sizeof *stream->value);
    stream->fault = stream->value + nodes;
    stream->satellite = mk_allocate(nodes, sizeof *stream->satellite);
}

void mk_run_epochs_close(mk_run_epochs_t *stream) {
    free(stream->inertial);
    free(stream->have);
    free(stream->value);
    free(stream->satellite);
    memset(stream, 0, sizeof *stream);
}

/* Truth at the start, with biases; then the error of the estimate. */
static void draw_start(mk_run_epochs_t *stream) {
    const mk_epochs_t *const epochs = stream->epochs;
    const mk_navigation_t *const nav = epochs->scenario->navigation;
    mk_nav_state_t *const truth = &stream->truth;
    mk_random_t random;
    double error[MK_NAV_STATES];
    mk_random_start(&random, epochs->seed, (uint32_t)stream->run, 0, 0, MK_DRAW_INITIAL);
    for (int i = 0; i < MK_NAV_STATES; i++) error[i] = nav->sd[i] * mk_random_normal(&random);
    memset(truth, 0, sizeof *truth);
    memcpy(truth->q, epochs->flown->q, sizeof truth->q);
    memcpy(truth->v, epochs->flown->v, sizeof truth->v);
    memcpy(truth->p, epochs->flown->p, sizeof truth->p);
    memcpy(truth->gyro_bias, nav->biases_are_drawn ? error + MK_NAV_GYRO : nav->gyro_bias, sizeof truth->gyro_bias);
    memcpy(truth->accelerometer_bias, nav->biases_are_drawn ? error + MK_NAV_ACCELEROMETER : nav->accelerometer_bias, sizeof truth->accelerometer_bias);
    /* The estimate knows nothing of biases and clock; its error in the clock is the clock's. */
    truth->clock_bias = error[MK_NAV_CLOCK];
    truth->clock_drift = error[MK_NAV_DRIFT];
    stream->estimate = *truth;
    for (int i = 0; i < MK_NAV_STATES; i++) error[i] = i < MK_NAV_GYRO ? -error[i] : 0.0;
    mk_nav_correct(&stream->estimate, error);
    memset(stream->estimate.gyro_bias, 0, sizeof truth->gyro_bias);
    memset(stream->estimate.accelerometer_bias, 0, sizeof truth->accelerometer_bias);
    stream->estimate.clock_bias = stream->estimate.clock_drift = 0.0;
}

/* What a recorded run starts from without an estimate: the flight's start. */
static void state_start(mk_run_epochs_t *stream) {
    mk_flown_t *const flown = mk_fly(stream->epochs->scenario->navigation, 0);
    memset(&stream->estimate, 0, sizeof stream->estimate);
    memcpy(stream->estimate.q, flown->q, sizeof flown->q);
    memcpy(stream->estimate.v, flown->v, sizeof flown->v);
    memcpy(stream->estimate.p, flown->p, sizeof flown->p);
    free(flown);
}

void mk_run_epochs_start(mk_run_epochs_t *stream, int run) {
    const mk_navigation_t *const nav = stream->epochs->scenario->navigation;
    stream->run = run;
    stream->step = 1;
    stream->t = stream->epochs->facts.start_s;
    stream->row = 0;
    if (stream->epochs->facts.drawn) draw_start(stream);
    else state_start(stream);
    if (nav->has_estimate) mk_nav_state_take(nav->estimate, &stream->estimate);
}

static void draw_samples(mk_run_epochs_t *stream) {
    const mk_epochs_t *const epochs = stream->epochs;
    const mk_navigation_t *const nav = epochs->scenario->navigation;
    const mk_flown_t *const flown = epochs->flown + (stream->step - 1) * nav->samples + 1;
    const double gyro = nav->angle_walk / sqrt(nav->imu_s), accelerometer = nav->velocity_walk / sqrt(nav->imu_s);
    mk_random_t random;
    mk_random_start(&random, epochs->seed, (uint32_t)stream->run, 0, (uint32_t)stream->step, MK_DRAW_INERTIAL);
    for (int j = 0; j < nav->samples; j++) {
        mk_inertial_t *const sample = &stream->inertial[j];
        *sample = flown[j].sample;
        for (int i = 0; i < 3; i++) {
            sample->w[i] += stream->truth.gyro_bias[i] + gyro * mk_random_normal(&random);
            sample->f[i] += stream->truth.accelerometer_bias[i] + accelerometer * mk_random_normal(&random);
        }
    }
    memcpy(stream->truth.q, flown[nav->samples - 1].q, sizeof stream->truth.q);
    memcpy(stream->truth.v, flown[nav->samples - 1].v, sizeof stream->truth.v);
    memcpy(stream->truth.p, flown[nav->samples - 1].p, sizeof stream->truth.p);
}

static void draw_clock(mk_run_epochs_t *stream) {
    const mk_navigation_t *const nav = stream->epochs->scenario->navigation;
    const double T = stream->epochs->scenario->dt_s, drift = nav->clock_sg * T, both = 0.5 * drift * T;
    mk_random_t random;
    mk_random_start(&random, stream->epochs->seed, (uint32_t)stream->run, 0, (uint32_t)stream->step, MK_DRAW_PROCESS);
    const double g = mk_random_normal(&random), other = mk_random_normal(&random);
    /* Root of [drift both; both bias]: bias less both^2 / drift is sf T + sg T^3 / 12. */
    stream->truth.clock_bias += T * stream->truth.clock_drift + (drift > 0.0 ? both / sqrt(drift) : 0.0) * g +
                                sqrt(T * (nav->clock_sf + nav->clock_sg * T * T / 12.0)) * other;
    stream->truth.clock_drift += sqrt(drift) * g;
}

static void draw_epoch(mk_run_epochs_t *stream, mk_epoch_t *epoch) {
    const mk_epochs_t *const epochs = stream->epochs;
    const mk_scenario_t *const s = epochs->scenario;
    epoch->t = epochs->facts.start_s + (double)stream->step * s->dt_s;
    epoch->dt = s->dt_s;
    epoch->samples = s->navigation->samples;
    draw_samples(stream);
    draw_clock(stream);
    for (int k = 0; k < s->nodes; k++) {
        mk_random_t random;
        double square = 0.0;
        mk_random_start(&random, epochs->seed, (uint32_t)stream->run, (uint32_t)k, (uint32_t)stream->step, MK_DRAW_MEASUREMENT);
        for (int i = 0; i < 3; i++) {
            const double d = epochs->place[k][i] - stream->truth.p[i];
            stream->satellite[k][i] = epochs->place[k][i];
            square += d * d;
        }
        stream->have[k] = 1;
        stream->value[k] = sqrt(square) + stream->truth.clock_bias + sqrt(s->sensor[k].R[0]) * mk_random_normal(&random);
    }
    epoch->truth = &stream->truth;
}

int mk_run_epochs_next(mk_run_epochs_t *stream, mk_epoch_t *epoch) {
    const mk_epochs_t *const epochs = stream->epochs;
    if (stream->step > epochs->facts.steps) return 0;
    memset(epoch, 0, sizeof *epoch);
    epoch->inertial = stream->inertial;
    epoch->have = stream->have;
    epoch->value = stream->value;
    epoch->satellite = (const double(*)[3])stream->satellite;
    epoch->fault = stream->fault;
    if (epochs->facts.drawn) draw_epoch(stream, epoch);
    else mk_recorded_epoch(stream, epoch);
    for (int k = 0; k < epochs->scenario->nodes; k++) {
        stream->fault[k] = 0.0;
        (void)mk_faults_add(epochs->scenario, k, epoch->t, &stream->fault[k]);
        stream->value[k] += stream->fault[k];
    }
    stream->t = epoch->t;
    stream->step++;
    return 1;
}
