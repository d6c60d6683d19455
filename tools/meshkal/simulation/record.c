/* SPDX-License-Identifier: MIT */
#include "simulation/record.h"

#include <math.h>
#include <meshkal/quantile.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "simulation/statistics.h"

void mk_record_open(mk_record_t *r, int n, int steps, int estimators, size_t phases, size_t alerts) {
    r->n = n;
    r->steps = steps;
    r->estimators = estimators;
    r->count = 5 + (size_t)n + 2 * (size_t)steps + (size_t)estimators + phases + alerts;
    r->phases = phases;
    r->alerts = alerts;
    r->value = mk_allocate(r->count, sizeof *r->value);
    r->steady = r->value;
    r->position_steady = r->steady + 1;
    r->theta = r->steady + 2;
    r->tolerance = r->steady + 3;
    r->nis_ratio = r->steady + 4;
    r->state_square = r->steady + 5;
    r->msd = r->state_square + n;
    r->position_msd = r->msd + steps;
    r->node_msd = r->position_msd + steps;
    r->phase_msd = r->node_msd + estimators;
    r->alert = r->phase_msd + phases;
}

void mk_record_close(mk_record_t *r) {
    free(r->value);
    memset(r, 0, sizeof *r);
}

void mk_statistics_open(mk_statistics_t *s, const mk_record_t *like) {
    memset(s, 0, sizeof *s);
    mk_record_open(&s->mean, like->n, like->steps, like->estimators, like->phases, like->alerts);
    mk_record_open(&s->squares, like->n, like->steps, like->estimators, like->phases, like->alerts);
}

void mk_statistics_close(mk_statistics_t *s) {
    mk_record_close(&s->mean);
    mk_record_close(&s->squares);
    free(s->alert);
}

void mk_statistics_add(mk_statistics_t *s, const double *value) {
    const size_t alerts = s->mean.alerts, before = s->mean.count - alerts;
    if (alerts && s->runs == s->room) {
        double *const more = mk_allocate((size_t)(s->room = 2 * s->room + 16) * alerts, sizeof *more);
        if (s->runs) memcpy(more, s->alert, (size_t)s->runs * alerts * sizeof *more);
        free(s->alert);
        s->alert = more;
    }
    if (alerts) memcpy(s->alert + (size_t)s->runs * alerts, value + before, alerts * sizeof *value);
    mk_welford(++s->runs, before, value, s->mean.value, s->squares.value);
}

void mk_statistics_finish(mk_statistics_t *s) {
    const double runs = s->runs, quantile = s->runs < 2 ? (double)NAN : mk_student_quantile(0.025, runs - 1.0);
    for (size_t i = 0; i < s->mean.count; i++) {
        if (s->runs == 0) s->mean.value[i] = (double)NAN;
        s->squares.value[i] = s->runs < 2 ? (double)NAN : quantile * sqrt(s->squares.value[i] / (runs * (runs - 1.0)));
    }
}
