/* SPDX-License-Identifier: MIT */
#include "tracking/events.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_faults.h"
#include "simulation/gaussian.h"
#include "tracking/events_parts.h"

mk_events_t *mk_events_open(const mk_models_f64_t *models) {
    const mk_scenario_t *s = models->scenario;
    mk_events_t *events = mk_allocate(1, sizeof *events);
    events->models = models;
    events->facts.sha256 = events->sha256;
    events->row_first = mk_allocate((size_t)s->nodes + 1, sizeof *events->row_first);
    for (int k = 0; k < s->nodes; k++) events->row_first[k + 1] = events->row_first[k] + s->sensor[k].rows;
    return events;
}

mk_events_t *mk_events_draw(const mk_models_f64_t *models, uint64_t seed, long steps) {
    const mk_scenario_t *s = models->scenario;
    const size_t np = (size_t)MK_PACKED(s->n);
    mk_events_t *events = mk_events_open(models);
    events->seed = seed;
    events->facts.drawn = events->facts.has_truth = 1;
    events->facts.steps = steps;
    events->facts.half = steps / 2 + 1;
    events->facts.known = s->n < 64 ? ((uint64_t)1 << s->n) - 1 : UINT64_MAX;
    events->facts.start_s = s->tracking->start_s;
    events->root_P0 = mk_allocate(2 * np, sizeof *events->root_P0);
    events->root_Q = events->root_P0 + np;
    mk_gaussian_root(s->n, s->P0, events->root_P0);
    mk_gaussian_root(s->n, models->transition.Q, events->root_Q);
    events->root_first = mk_allocate((size_t)s->nodes + 1, sizeof *events->root_first);
    for (int k = 0; k < s->nodes; k++) events->root_first[k + 1] = events->root_first[k] + (size_t)MK_PACKED(s->sensor[k].rows);
    events->root_R = mk_allocate(events->root_first[s->nodes], sizeof *events->root_R);
    for (int k = 0; k < s->nodes; k++) mk_gaussian_root(s->sensor[k].rows, s->sensor[k].R, events->root_R + events->root_first[k]);
    return events;
}

void mk_events_free(mk_events_t *events) {
    if (!events) return;
    free(events->row_first);
    free(events->root_P0);
    free(events->root_first);
    free(events->root_R);
    free(events->time);
    free(events->z);
    free(events->x);
    free(events->first);
    free(events->reading);
    free(events);
}

mk_events_facts_t mk_events_facts(const mk_events_t *events) { return events->facts; }

void mk_run_events_open(mk_run_events_t *stream, const mk_events_t *events) {
    const mk_scenario_t *s = events->models->scenario;
    const size_t n = (size_t)s->n;
    memset(stream, 0, sizeof *stream);
    stream->events = events;
    stream->x = mk_allocate(3 * n + 2 * (size_t)events->row_first[s->nodes], sizeof *stream->x);
    stream->next = stream->x + n;
    stream->estimate = stream->next + n;
    stream->z = stream->estimate + n;
    stream->reading = mk_allocate((size_t)s->nodes, sizeof *stream->reading);
    mk_run_events_start(stream, 0);
}

void mk_run_events_close(mk_run_events_t *stream) {
    free(stream->x);
    free(stream->reading);
    memset(stream, 0, sizeof *stream);
}

void mk_run_events_start(mk_run_events_t *stream, int run) {
    const mk_events_t *events = stream->events;
    const mk_scenario_t *s = events->models->scenario;
    stream->run = run;
    stream->step = 1;
    stream->t = events->facts.start_s;
    memcpy(stream->x, s->x0, (size_t)s->n * sizeof *stream->x);
    memcpy(stream->estimate, s->x0, (size_t)s->n * sizeof *stream->x);
    stream->truth = events->facts.drawn ? stream->x : NULL;
    if (!events->facts.drawn) return;
    mk_random_t random;
    mk_random_start(&random, events->seed, (uint32_t)run, 0, 0, MK_DRAW_INITIAL);
    mk_gaussian_add(&random, s->n, events->root_P0, s->tracking->estimate_is_drawn ? stream->estimate : stream->x);
}

/* --- drawn ----------------------------------------------------------------------------------------------------------------- */

static int all_finite(int count, const double *values) {
    for (int i = 0; i < count; i++)
        if (!isfinite(values[i])) return 0;
    return 1;
}

static int draw_truth(mk_run_events_t *stream, mk_error_t *error) {
    const mk_events_t *events = stream->events;
    const mk_scenario_t *s = events->models->scenario;
    const mk_model_f64_t *model = &events->models->transition.model;
    const size_t bytes = (size_t)s->n * sizeof *stream->x;
    mk_random_t random;
    mk_status_t status = model->function(model->context, s->dt_s, 1, stream->x, stream->next);
    mk_random_start(&random, events->seed, (uint32_t)stream->run, 0, (uint32_t)(stream->step - 1), MK_DRAW_PROCESS);
    mk_gaussian_add(&random, s->n, events->root_Q, stream->next);
    if (status == MK_OK && !all_finite(s->n, stream->next)) status = MK_ERROR_NOT_FINITE;
    if (status != MK_OK)
        return mk_fail(error, "run %d, step %ld: motion of the drawn truth: %s: the model does not hold where the target went: fewer steps or another seed",
                       stream->run, stream->step, mk_status_name(status));
    memcpy(stream->x, stream->next, bytes);
    return 1;
}

int mk_in_range(const mk_scenario_t *s, int k, const double *x) {
    double square = 0.0;
    if (!(s->tracking->node[k].range_limit_m < (double)INFINITY)) return 1;
    for (int i = 0; i < s->position_count; i++) {
        const double d = x[s->position_states[i]] - s->sensor[k].position_m[i];
        square += d * d;
    }
    return sqrt(square) <= s->tracking->node[k].range_limit_m;
}

/* h(x) + v + fault into z, zero of whose length stand behind all rows: the short way round from there is what a sensor reports. */
static int draw_reading(mk_run_events_t *stream, int k, double *z, int *faulty, mk_error_t *error) {
    const mk_events_t *events = stream->events;
    const mk_scenario_t *s = events->models->scenario;
    const mk_model_f64_t *model = &events->models->sensor[k].model;
    const mk_tracking_node_t *node = &s->tracking->node[k];
    const int rows = s->sensor[k].rows;
    const uint32_t run = (uint32_t)stream->run, step = (uint32_t)stream->step;
    const double *zero = stream->z + events->row_first[s->nodes];
    mk_random_t random;
    mk_status_t status = model->function(model->context, 0.0, 1, stream->x, z);
    mk_random_start(&random, events->seed, run, (uint32_t)k, step, MK_DRAW_MEASUREMENT);
    mk_gaussian_add(&random, rows, events->root_R + events->root_first[k], z);
    *faulty = 0;
    if (node->fault_sigma) {
        mk_random_start(&random, events->seed, run, (uint32_t)k, step, MK_DRAW_FAULT);
        *faulty = mk_random_uniform(&random) < node->fault_probability;
        for (int r = 0; r < rows && *faulty; r++) z[r] += node->fault_sigma[r] * mk_random_normal(&random);
    }
    *faulty |= mk_faults_add(s, k, events->facts.start_s + (double)stream->step * s->dt_s, z);
    if (status == MK_OK && !all_finite(rows, z)) status = MK_ERROR_NOT_FINITE;
    if (status != MK_OK)
        return mk_fail(error, "run %d, step %ld, node %d: reading of the drawn truth: %s: no reading where the target is (on the sensor?): move the sensor",
                       stream->run, stream->step, k, mk_status_name(status));
    if (model->space && model->space->difference) model->space->difference(model->space->context, z, zero, z);
    return 1;
}

static int lost(const mk_events_t *events, int run, int k, long step, int purpose, double probability) {
    mk_random_t random;
    if (!(probability > 0.0)) return 0;
    mk_random_start(&random, events->seed, (uint32_t)run, (uint32_t)k, (uint32_t)step, purpose);
    return mk_random_uniform(&random) < probability;
}

static int draw_next(mk_run_events_t *stream, mk_instant_t *instant, mk_error_t *error) {
    const mk_events_t *events = stream->events;
    const mk_scenario_t *s = events->models->scenario;
    const mk_tracking_t *tracking = s->tracking;
    if (!draw_truth(stream, error)) return -1;
    instant->t = events->facts.start_s + (double)stream->step * s->dt_s;
    instant->dt = s->dt_s;
    instant->reading = stream->reading;
    instant->x = stream->x;
    instant->lost_together = lost(events, stream->run, 0, stream->step, MK_DRAW_STEP, tracking->reading_loss);
    for (int k = 0; k < s->nodes; k++) {
        mk_reading_t *reading = &stream->reading[instant->count];
        double *z = stream->z + events->row_first[k];
        if (tracking->node[k].kind == MK_SENSOR_NONE) continue;
        if (!mk_in_range(s, k, stream->x)) {
            instant->out_of_range++;
            continue;
        }
        if (instant->lost_together || lost(events, stream->run, k, stream->step, MK_DRAW_READING, tracking->node[k].loss)) {
            instant->lost++;
            continue;
        }
        if (!draw_reading(stream, k, z, &reading->faulty, error)) return -1;
        reading->node = k;
        reading->z = z;
        instant->count++;
    }
    return 1;
}

/* --- next ------------------------------------------------------------------------------------------------------------------ */

int mk_run_events_next(mk_run_events_t *stream, mk_instant_t *instant, mk_error_t *error) {
    const mk_events_t *events = stream->events;
    memset(instant, 0, sizeof *instant);
    if (stream->step > events->facts.steps) return 0;
    if (events->facts.drawn) {
        if (draw_next(stream, instant, error) < 0) return -1;
    } else {
        const size_t i = (size_t)stream->step - 1, n = (size_t)events->models->n;
        instant->t = events->time[i];
        instant->dt = instant->t - stream->t;
        instant->count = (int)(events->first[i + 1] - events->first[i]);
        instant->reading = events->reading + events->first[i];
        instant->x = events->x + (events->facts.has_truth ? i : 0) * n;
    }
    stream->t = instant->t;
    stream->step++;
    return 1;
}
