/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include "tracking/track_record.h"

#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>
#include <string.h>

#include "simulation/statistics.h"

void mk_track_record_open(mk_track_record_t *r, long steps, int estimators) {
    const size_t T = (size_t)steps, E = (size_t)estimators;
    r->steps = steps;
    r->estimators = estimators;
    r->count = MK_TRACK_SINGLE + 5 * T + 3 * E;
    r->value = r->single = mk_allocate(r->count, sizeof *r->value);
    r->position = r->single + MK_TRACK_SINGLE;
    r->velocity = r->position + T;
    r->apart = r->velocity + T;
    r->nees = r->apart + T;
    r->time = r->nees + T;
    r->node_position = r->time + T;
    r->node_velocity = r->node_position + E;
    r->node_nees = r->node_velocity + E;
}

void mk_track_record_close(mk_track_record_t *r) {
    free(r->value);
    memset(r, 0, sizeof *r);
}

void mk_track_statistics_open(mk_track_statistics_t *s, long steps, int estimators) {
    s->runs = 0;
    mk_track_record_open(&s->mean, steps, estimators);
    mk_track_record_open(&s->squares, steps, estimators);
    mk_track_record_open(&s->largest, steps, estimators);
}

void mk_track_statistics_close(mk_track_statistics_t *s) {
    mk_track_record_close(&s->mean);
    mk_track_record_close(&s->squares);
    mk_track_record_close(&s->largest);
}

void mk_track_statistics_add(mk_track_statistics_t *s, const double *value) {
    mk_welford(++s->runs, s->mean.count, value, s->mean.value, s->squares.value);
    for (size_t i = 0; i < s->mean.count; i++)
        if (s->runs == 1 || value[i] > s->largest.value[i]) s->largest.value[i] = value[i];
}

/* d' P^-1 d of the states in the set; NaN if there are none, P is not positive definite, or d not known. work: 2 packed n. d is overwritten. */
static double normalised(int all, uint64_t set, const double *P, double *d, double *work) {
    double *const part = work + MK_PACKED(all), sum = 0.0;
    int n = 0;
    for (int i = 0, place = 0; i < all; i++) {
        if (!(set >> i & 1)) continue;
        for (int j = 0; j <= i; j++)
            if (set >> j & 1) part[place++] = P[MK_PACKED(i) + j];
        d[n++] = d[i];
    }
    if (n == 0 || !mk_positive_definite_f64(n, part, work)) return (double)NAN;
    for (int i = 0; i < n; i++) { /* work holds L and 1 / D of L D L' */
        for (int j = 0; j < i; j++) d[i] -= work[MK_PACKED(i) + j] * d[j];
        sum += d[i] * d[i] * work[MK_PACKED(i) + i];
    }
    return sum;
}

static double square_of(const uint8_t *state, int count, const double *x, const double *estimate) {
    double sum = count > 0 ? 0.0 : (double)NAN;
    for (int i = 0; i < count; i++) {
        const double d = x[state[i]] - estimate[state[i]];
        sum += d * d;
    }
    return sum;
}

static double largest_distance(const mk_track_setting_t *setting, const double *estimate) {
    const mk_motion_t *const motion = &setting->scenario->tracking->motion;
    const int E = setting->topology.estimators, n = setting->scenario->n;
    double largest = motion->dimensions > 0 ? 0.0 : (double)NAN;
    for (int a = 0; a < E; a++)
        for (int b = 0; b < a; b++) {
            const double square = square_of(motion->position, motion->dimensions, estimate + a * n, estimate + b * n);
            if (square > largest) largest = square;
        }
    return sqrt(largest);
}

void mk_track_judge(const mk_track_setting_t *setting, const mk_track_look_t *look, const double *x, mk_track_errors_t *errors, double *work) {
    const mk_tracking_t *const tracking = setting->scenario->tracking;
    const mk_motion_t *const motion = &tracking->motion;
    const int E = setting->topology.estimators, n = setting->scenario->n, dimensions = motion->dimensions;
    double *const d = work + 2 * MK_PACKED(n);
    errors->position = errors->velocity = errors->nees = 0.0;
    for (int e = 0; e < E; e++) {
        const double *const estimate = look->estimate + e * n;
        double sum = 0.0;
        for (int i = 0; i < n; i++) d[i] = x ? x[i] - estimate[i] : (double)NAN;
        if (x && setting->space && setting->space->difference) setting->space->difference(setting->space->context, x, estimate, d);
        for (int i = 0; i < n; i++)
            if (!isnan(d[i])) sum += d[i] * d[i];
        errors->error[e] = sqrt(sum);
        errors->node_position[e] = x ? square_of(motion->position, dimensions, x, estimate) : (double)NAN;
        errors->node_velocity[e] = x ? square_of(motion->velocity, tracking->has_velocity ? dimensions : 0, x, estimate) : (double)NAN;
        errors->node_nees[e] = normalised(n, setting->known, look->covariance + e * MK_PACKED(n), d, work);
        errors->position += errors->node_position[e] / E;
        errors->velocity += errors->node_velocity[e] / E;
        errors->nees += errors->node_nees[e] / E;
    }
    errors->apart = largest_distance(setting, look->estimate);
}
