/* SPDX-License-Identifier: MIT */
#include "tracking/trajectory.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "csv.h"
#include "tracking/events.h"

static double *numbers(size_t count) { return mk_allocate(count + 1, sizeof(double)); }

/* --- states ---------------------------------------------------------------------------------------------------------------- */

static int finite(int n, const double *x) {
    for (int i = 0; i < n; i++)
        if (!isfinite(x[i])) return 0;
    return 1;
}

static int mean_states(mk_trajectory_t *r, const mk_models_f64_t *models, long steps, mk_error_t *error) {
    const mk_scenario_t *s = models->scenario;
    const size_t n = (size_t)r->n;
    const mk_model_f64_t *g = &models->transition.model;
    const double *x = s->x0;
    r->instants = steps;
    r->x = numbers((size_t)steps * n);
    r->t = numbers((size_t)steps);
    for (long t = 0; t < steps; t++, x = r->x + (size_t)(t - 1) * n) {
        double *const next = r->x + (size_t)t * n;
        const mk_status_t status = g->function(g->context, s->dt_s, 1, x, next);
        r->t[t] = s->tracking->start_s + (double)(t + 1) * s->dt_s;
        if (status != MK_OK || !finite(r->n, next))
            return mk_fail(error, "step %ld: the mean trajectory from x0 leaves the domain of the motion (%s): change x0 or give --truth FILE.csv",
                           t + 1, mk_status_name(status == MK_OK ? MK_ERROR_NOT_FINITE : status));
    }
    return 1;
}

typedef struct {
    double t, value;
    long line;
    int state;
} value_t;

static int compare_value(const void *a, const void *b) {
    const value_t *x = a, *y = b;
    if (x->t != y->t) return x->t < y->t ? -1 : 1;
    return (x->state > y->state) - (x->state < y->state);
}

/* Velocities by differences of the positions beside, of the two at an end. */
static void fill_velocity(mk_trajectory_t *r, int position, int velocity) {
    const size_t n = (size_t)r->n;
    for (long t = 0; t < r->instants && r->instants > 1; t++) {
        const long before = t ? t - 1 : 0, after = t < r->instants - 1 ? t + 1 : t;
        r->x[(size_t)t * n + (size_t)velocity] =
            (r->x[(size_t)after * n + (size_t)position] - r->x[(size_t)before * n + (size_t)position]) / (r->t[after] - r->t[before]);
    }
}

static int complete_states(mk_trajectory_t *r, const mk_scenario_t *s, const long *there, const char *path, mk_error_t *error) {
    const mk_tracking_t *tracking = s->tracking;
    for (int i = 0; i < r->n; i++) {
        int position = 0, axis = -1;
        for (int a = 0; a < tracking->motion.dimensions; a++) {
            position |= tracking->motion.position[a] == i;
            if (tracking->has_velocity && tracking->motion.velocity[a] == i) axis = a;
        }
        if (there[i] == r->instants) continue;
        if (there[i] > 0)
            return mk_fail(error, "%s: state %d (%s) has a value at %ld of %ld times: it must have one at each, or at none", path, i,
                           tracking->state[i], there[i], r->instants);
        if (position) return mk_fail(error, "%s: no values of state %d (%s), which is a position", path, i, tracking->state[i]);
        if (axis >= 0) {
            fill_velocity(r, tracking->motion.position[axis], i);
            r->filled_velocity = 1;
        } else r->kept_states++;
    }
    return 1;
}

static int place_values(mk_trajectory_t *r, const mk_csv_t *csv, const mk_scenario_t *s, value_t *value, long *there, mk_error_t *error) {
    const size_t n = (size_t)r->n;
    for (size_t i = 0; i < csv->rows; i++) {
        if (!mk_csv_index(csv, i, 1, "state", r->n, &value[i].state, error)) return 0;
        value[i].t = csv->value[3 * i];
        value[i].value = csv->value[3 * i + 2];
        value[i].line = csv->line[i];
    }
    qsort(value, csv->rows, sizeof *value, compare_value);
    for (size_t i = 0; i < csv->rows; i++) {
        if (i && value[i].t == value[i - 1].t && value[i].state == value[i - 1].state)
            return mk_fail(error, "%s:%ld: t = %.15g, state %d has a value already", csv->path,
                           value[i].line > value[i - 1].line ? value[i].line : value[i - 1].line, value[i].t, value[i].state);
        if (i == 0 || value[i].t != value[i - 1].t) {
            memcpy(r->x + (size_t)r->instants * n, s->x0, n * sizeof *s->x0);
            r->t[r->instants++] = value[i].t;
        }
        r->x[(size_t)(r->instants - 1) * n + (size_t)value[i].state] = value[i].value;
        there[value[i].state]++;
    }
    return complete_states(r, s, there, csv->path, error);
}

static int recorded_states(mk_trajectory_t *r, const mk_scenario_t *s, const char *path, mk_error_t *error) {
    static const char *const names[] = {"t", "state", "value"};
    mk_csv_t csv;
    if (!mk_csv_read(&csv, path, 3, names, error)) return 0;
    if (csv.rows == 0) {
        mk_csv_free(&csv);
        return mk_fail(error, "%s: no values", path);
    }
    /* As many times as values, at most. */
    value_t *value = mk_allocate(csv.rows, sizeof *value);
    long *there = mk_allocate((size_t)r->n, sizeof *there);
    r->x = numbers(csv.rows * (size_t)r->n);
    r->t = numbers(csv.rows);
    const int good = place_values(r, &csv, s, value, there, error);
    free(value);
    free(there);
    mk_csv_free(&csv);
    return good;
}

/* --- derivatives ----------------------------------------------------------------------------------------------------------- */

/* J, rows x n, at x. */
static mk_status_t derive(const mk_models_f64_t *models, const mk_model_f64_t *model, double dt, int rows, const double *x, double *J) {
    const int n = models->n;
    if (model->jacobian) return model->jacobian(model->context, dt, x, J);
    double *point = numbers((size_t)(n + 3 * rows)), *plus = point + n, *minus = plus + rows, *difference = minus + rows;
    mk_status_t status = MK_OK;
    for (int i = 0; i < n && status == MK_OK; i++) {
        const double step = 6e-6 * (fabs(x[i]) + sqrt(models->P0[i * (i + 1) / 2 + i]));
        memcpy(point, x, (size_t)n * sizeof *x);
        point[i] = x[i] + step;
        const double high = point[i];
        status = model->function(model->context, dt, 1, point, plus);
        point[i] = x[i] - step;
        const double low = point[i];
        if (status == MK_OK) status = model->function(model->context, dt, 1, point, minus);
        if (model->space && model->space->difference) model->space->difference(model->space->context, plus, minus, difference);
        else
            for (int row = 0; row < rows; row++) difference[row] = plus[row] - minus[row];
        for (int row = 0; row < rows; row++) J[row * n + i] = difference[row] / (high - low);
    }
    free(point);
    return status;
}

/* information := H' R^-1 H by the rows of L^-1 H, R = L L'. H is overwritten. */
static int weigh(int n, int rows, const double *R, double *H, double *L, double *information) {
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < rows; j++) L[i * rows + j] = j <= i ? R[i * (i + 1) / 2 + j] : 0.0;
    if (LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', rows, L, rows) || LAPACKE_dtrtrs(LAPACK_ROW_MAJOR, 'L', 'N', 'N', rows, n, L, rows, H, n)) return 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int row = 0; row < rows; row++) sum += H[row * n + i] * H[row * n + j];
            information[i * (i + 1) / 2 + j] = sum;
        }
    return finite(MK_PACKED(n), information);
}

static void make_information(mk_trajectory_t *r, const mk_models_f64_t *models) {
    const mk_scenario_t *s = models->scenario;
    const size_t packed = MK_PACKED((size_t)r->n), n = (size_t)r->n;
    const int m = models->m;
    double *H = numbers((size_t)m * n), *L = numbers((size_t)(m * m));
    size_t used = 0, room = 1024;
    r->information = numbers(room * packed);
    r->entry = mk_allocate((size_t)r->instants * (size_t)r->nodes, sizeof *r->entry);
    r->measuring = mk_allocate((size_t)r->instants, sizeof *r->measuring);
    for (long t = 0; t < r->instants; t++)
        for (int k = 0; k < r->nodes; k++) {
            const double *x = r->x + (size_t)t * n;
            const mk_sensor_f64_t *sensor = &models->sensor[k];
            int *const entry = &r->entry[(size_t)t * (size_t)r->nodes + (size_t)k];
            *entry = -1;
            if (s->tracking->node[k].kind == MK_SENSOR_NONE || !mk_in_range(s, k, x)) continue;
            if (used == room) {
                double *more = numbers(2 * room * packed);
                memcpy(more, r->information, used * packed * sizeof *more);
                free(r->information);
                r->information = more;
                room *= 2;
            }
            if (derive(models, &sensor->model, 0.0, sensor->rows, x, H) != MK_OK ||
                !weigh(r->n, sensor->rows, sensor->R, H, L, r->information + used * packed)) {
                if (r->undefined++ == 0) {
                    r->undefined_instant = t;
                    r->undefined_node = k;
                }
                continue;
            }
            *entry = (int)used++;
            r->measuring[t]++;
        }
    free(H);
    free(L);
}

int mk_trajectory_make(mk_trajectory_t *r, const mk_models_f64_t *models, long steps, const char *truth, mk_error_t *error) {
    const mk_scenario_t *s = models->scenario;
    const size_t n = (size_t)models->n;
    memset(r, 0, sizeof *r);
    r->n = models->n;
    r->nodes = s->nodes;
    int good = truth ? recorded_states(r, s, truth, error) : mean_states(r, models, steps, error);
    if (good) r->Phi = numbers((size_t)r->instants * n * n);
    for (long t = 0; t + 1 < r->instants && good; t++) {
        double *const Phi = r->Phi + (size_t)t * n * n;
        if (derive(models, &models->transition.model, r->t[t + 1] - r->t[t], r->n, r->x + (size_t)t * n, Phi) != MK_OK || !finite(r->n * r->n, Phi))
            good = mk_fail(error, "instant %ld: the motion has no derivative there", t + 1);
    }
    if (good) make_information(r, models);
    if (!good) mk_trajectory_free(r);
    return good;
}

void mk_trajectory_free(mk_trajectory_t *r) {
    free(r->t);
    free(r->x);
    free(r->Phi);
    free(r->entry);
    free(r->information);
    free(r->measuring);
    memset(r, 0, sizeof *r);
}
