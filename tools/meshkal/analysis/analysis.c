/* SPDX-License-Identifier: MIT */
#include "analysis/analysis.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analysis/error_covariance.h"
#include "design/design.h"
#include "parallel.h"
#include "process.h"

/* Below this many estimators a step is shorter than the start of a thread. */
#define WORTH_THREADS 48

static double *doubles(size_t count) { return mk_allocate(count, sizeof(double)); }

/* The filters of all estimators, by their covariance recursions. */
typedef struct {
    const mk_analysis_t *a;
    mk_topology_t topology;
    mk_recursion_t *recursion;
    double *fixed, *schedule, *theta, *Phi, *MA, *scratch;
    size_t worker_room;
    int *failed, t;
} filters_t;

static int open_filters(filters_t *f, const mk_analysis_t *a, mk_error_t *error) {
    const mk_scenario_t *s = a->scenario;
    const size_t square = (size_t)(s->n * s->n);
    memset(f, 0, sizeof *f);
    f->a = a;
    f->topology = a->filter->central ? mk_central_topology(s) : mk_distributed_topology(s);
    const size_t E = (size_t)f->topology.estimators;
    f->worker_room = (size_t)(3 * MK_PACKED(s->n)) + 2 * square;
    f->fixed = doubles(2 * E + 2 * E * square + (size_t)a->threads * f->worker_room);
    f->theta = f->fixed + E;
    f->Phi = f->theta + E;
    f->MA = f->Phi + E * square;
    f->scratch = f->MA + E * square;
    f->failed = mk_allocate(E, sizeof *f->failed);
    f->recursion = mk_allocate(E, sizeof *f->recursion);
    if (!mk_filter_tolerances(a->filter, s, a->tolerance, a->horizon + 1, &f->topology, a->threads, f->fixed, &f->schedule, error)) return 0;
    for (size_t e = 0; e < E; e++) {
        mk_recursion_open(&f->recursion[e], s, f->fixed[e]);
        for (int i = f->topology.first[e]; i < f->topology.first[e + 1]; i++) mk_recursion_add(&f->recursion[e], &s->sensor[f->topology.slot[i]]);
    }
    return 1;
}

static void close_filters(filters_t *f) {
    for (int e = 0; e < f->topology.estimators; e++) mk_recursion_close(&f->recursion[e]);
    if (f->a->filter->central) mk_central_free(&f->topology);
    free(f->recursion);
    free(f->fixed);
    free(f->schedule);
    free(f->failed);
}

static void step_one(void *context, int worker, long e) {
    const filters_t *f = context;
    mk_recursion_t *r = &f->recursion[e];
    const size_t at = (size_t)e * (size_t)(r->n * r->n);
    if (f->schedule) r->tolerance = f->schedule[(size_t)f->t * (size_t)f->topology.estimators + (size_t)e];
    mk_recursion_gain(r, f->MA + at, f->Phi + at, f->scratch + (size_t)worker * f->worker_room);
    f->failed[e] = !mk_recursion_step(r);
    f->theta[e] = r->theta;
}

/* Gains and thetas of step t. */
static int step_filters(filters_t *f, int t, int threads, mk_error_t *error) {
    f->t = t;
    mk_parallel(threads, f->topology.estimators, step_one, f);
    for (int e = 0; e < f->topology.estimators; e++) {
        if (!f->failed[e]) continue;
        if (f->a->filter->central) return mk_fail(error, "filter %s: its covariance is not positive definite in step %d", f->a->filter->name, t);
        return mk_fail(error, "filter %s: the covariance of node %d is not positive definite in step %d: does it observe all states?", f->a->filter->name, e, t);
    }
    return 1;
}

static double trace(int n, const double *S, int stride) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += S[i * stride + i];
    return sum;
}

static double position_trace(const mk_scenario_t *s, const double *S, int stride) {
    double sum = 0.0;
    for (int i = 0; i < s->position_count; i++) sum += S[s->position_states[i] * stride + s->position_states[i]];
    return sum;
}

static void take_errors(mk_performance_t *r, const mk_scenario_t *s, const mk_error_covariance_t *x, int t) {
    double sum = 0.0, position = 0.0;
    for (int e = 0; e < r->estimators; e++) {
        int stride;
        const double *block = mk_error_covariance_block(x, e, e, &stride);
        const double own = trace(s->n, block, stride), own_position = position_trace(s, block, stride);
        sum += own;
        position += own_position;
        if (t != r->steady_step) continue;
        r->node_msd[e] = own;
        r->node_position_msd[e] = own_position;
    }
    r->msd[t] = sum / r->estimators;
    r->position_msd[t] = position / r->estimators;
    r->central_msd[t] = trace(s->n, x->central, s->n);
    r->central_position_msd[t] = position_trace(s, x->central, s->n);
}

static void take_tolerances(mk_performance_t *r, const filters_t *f, int t) {
    const size_t E = (size_t)r->estimators;
    const double *tolerance = f->schedule ? f->schedule + (size_t)t * E : f->fixed;
    if (r->tolerance) {
        memcpy(r->tolerance + (size_t)t * E, tolerance, E * sizeof *tolerance);
        memcpy(r->theta + (size_t)t * E, f->theta, E * sizeof *tolerance);
    }
    if (t != r->steady_step) return;
    memcpy(r->node_tolerance, tolerance, E * sizeof *tolerance);
    memcpy(r->node_theta, f->theta, E * sizeof *tolerance);
    for (size_t e = 0; e < E; e++) {
        r->mean_tolerance += tolerance[e] / (double)E;
        r->mean_theta += f->theta[e] / (double)E;
    }
}

static void take_blocks(mk_performance_t *r, const mk_analysis_t *a, const mk_error_covariance_t *x) {
    const mk_scenario_t *s = a->scenario;
    const int n = s->n, square = n * n;
    double *to = r->covariance;
    for (int i = s->first[a->node]; i < s->first[a->node + 1]; i++, to += square) {
        int stride;
        const double *block = mk_error_covariance_block(x, a->node, s->slot[i], &stride);
        for (int j = 0; j < n; j++) memcpy(to + j * n, block + j * stride, (size_t)n * sizeof *to);
    }
    memcpy(to, x->cross + (size_t)a->node * (size_t)square, (size_t)square * sizeof *to);
}

static void open_performance(mk_performance_t *r, const mk_analysis_t *a, int estimators) {
    const size_t steps = (size_t)a->horizon + 1, E = (size_t)estimators;
    memset(r, 0, sizeof *r);
    r->estimators = estimators;
    r->horizon = a->horizon;
    r->steady_step = a->horizon / 2;
    r->msd = doubles(4 * steps + 4 * E);
    r->position_msd = r->msd + steps;
    r->central_msd = r->position_msd + steps;
    r->central_position_msd = r->central_msd + steps;
    r->node_msd = r->central_position_msd + steps;
    r->node_position_msd = r->node_msd + E;
    r->node_tolerance = r->node_position_msd + E;
    r->node_theta = r->node_tolerance + E;
    if (a->per_step) {
        r->tolerance = doubles(2 * steps * E);
        r->theta = r->tolerance + steps * E;
    }
    if (a->node >= 0) {
        const size_t slots = (size_t)(a->scenario->first[a->node + 1] - a->scenario->first[a->node]);
        r->covariance = doubles((slots + 1) * (size_t)(a->scenario->n * a->scenario->n));
    }
}

void mk_performance_free(mk_performance_t *r) {
    free(r->msd);
    free(r->tolerance);
    free(r->covariance);
    memset(r, 0, sizeof *r);
}

static int run(const mk_analysis_t *a, filters_t *f, mk_performance_t *r, mk_error_t *error) {
    const mk_least_favourable_t *model = a->model;
    const size_t square = (size_t)(model->n * model->n);
    const int threads = r->estimators < WORTH_THREADS ? 1 : a->threads;
    mk_error_covariance_t x;
    int good = 1;
    mk_error_covariance_open(&x, a->scenario, &f->topology, !a->filter->central, threads);
    for (int t = 0; t <= a->horizon && good; t++) {
        const size_t at = (size_t)t * square;
        const mk_error_maps_t maps = {f->Phi, f->MA, model->Ag + at, model->MA + at, a->nominal || !(a->tolerance > 0.0) ? NULL : model->N + at};
        take_errors(r, a->scenario, &x, t);
        if (r->covariance && t == r->steady_step) take_blocks(r, a, &x);
        good = step_filters(f, t, threads, error);
        if (good) take_tolerances(r, f, t);
        if (good && t < a->horizon) mk_error_covariance_step(&x, &maps);
    }
    mk_error_covariance_close(&x);
    return good;
}

int mk_analyse(const mk_analysis_t *a, mk_performance_t *r, mk_error_t *error) {
    const double from = mk_seconds();
    filters_t f;
    int good = open_filters(&f, a, error);
    open_performance(r, a, f.topology.estimators);
    good = good && run(a, &f, r, error);
    close_filters(&f);
    r->steady = good && mk_stands_still(r->msd, r->horizon) && mk_stands_still(r->central_msd, r->horizon);
    r->central_theta = a->model->theta[r->steady_step];
    for (int i = 0; i < a->model->n; i++) r->central_trace_V += a->model->V[r->steady_step * MK_PACKED(a->model->n) + MK_PACKED(i + 1) - 1];
    r->seconds = mk_seconds() - from;
    if (!good) mk_performance_free(r);
    return good;
}

/* Range of the values from a to b, either way round. */
static double range(const double *values, int a, int b) {
    double least = values[a], most = least;
    for (int i = a < b ? a : b; i <= (a < b ? b : a); i++) {
        least = fmin(least, values[i]);
        most = fmax(most, values[i]);
    }
    return most - least;
}

int mk_stands_still(const double *values, int horizon) {
    const int middle = horizon / 2, h = horizon * 12 / 100;
    const double value = fabs(values[middle]), limit = (pow(10.0, 0.01) - 1.0) * value;
    double near[2], rest[2];
    if (h < 1) return 0;
    for (int side = 0; side < 2; side++) {
        const int way = side ? h : -h;
        const double far = range(values, middle + 3 * way, middle + 4 * way);
        near[side] = range(values, middle, middle + way);
        /* far q^3 = near; what is to come: near (q + q^2 + ..) */
        const double q = near[side] > 1e-3 * limit ? cbrt(near[side] / far) : 0.0;
        rest[side] = q < 1.0 ? near[side] * q / (1.0 - q) : (double)INFINITY;
    }
    for (int side = 0; side < 2; side++) {
        /* Change that does not shrink towards the middle may be the last of what shrinks on the other side. */
        const int passing = isinf(rest[side]) && near[side] < near[!side] && rest[!side] < limit;
        if (!(near[side] < 2.0 * limit && (passing || rest[side] < limit))) return 0;
    }
    return 1;
}
