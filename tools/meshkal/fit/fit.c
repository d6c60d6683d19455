/* SPDX-License-Identifier: MIT */
#include "fit/fit.h"

#include <math.h>
#include <meshkal/base.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"

/* A part of a residual outside the range of Q, relative to the numbers it is the difference of: files with six digits pass. */
#define OUTSIDE 1e-5

static double *doubles(size_t count) { return mk_allocate(count, sizeof(double)); }

char *mk_fit_name(int node, char *text) {
    if (node >= 0) (void)snprintf(text, 24, "node %d", node);
    else (void)snprintf(text, 24, "%s", node == MK_FIT_PROCESS ? "process noise" : node == MK_FIT_ACROSS ? "between blocks" : "all");
    return text;
}

/* What one block's residuals are made with, and they themselves: steps x rows, NaN where a reading is missing. */
typedef struct {
    int node, rows, steps, present, dimension;
    double *root; /* eigenvectors over square roots of eigenvalues, rows x dimension; then those of eigenvalue 0 */
    double *u;
} block_t;

/* Whitens by K = sum lambda e e'. An eigenvalue below rounding of the largest is 0. 1, or 0. */
static int open_block(block_t *b, int node, int dimension, const double *K, int steps) {
    double *values = doubles((size_t)dimension), *vectors = doubles((size_t)(dimension * dimension));
    b->node = node;
    b->dimension = dimension;
    b->steps = steps;
    b->rows = 0;
    b->root = doubles((size_t)(dimension * dimension));
    const int good = mk_eigen_symmetric(dimension, K, values, vectors);
    const double least = node == MK_FIT_PROCESS ? 1e-13 * dimension * values[dimension - 1] : 0.0;
    int null = dimension;
    for (int i = 0; i < dimension && good; i++) {
        const int real = values[i] > least, row = real ? b->rows++ : --null;
        for (int j = 0; j < dimension; j++)
            b->root[row * dimension + j] = vectors[i * dimension + j] / (real ? sqrt(values[i]) : 1.0);
    }
    b->u = doubles((size_t)steps * (size_t)b->rows + 1);
    free(values);
    free(vectors);
    return good;
}

/* u(t) = root residual. size: of the numbers whose difference the residual is. Returns the largest part outside the range, relative to it. */
static double whiten(block_t *b, int t, const double *residual, double size) {
    double outside = 0.0;
    for (int i = 0; i < b->dimension; i++) {
        double sum = 0.0;
        for (int j = 0; j < b->dimension; j++) sum += b->root[i * b->dimension + j] * residual[j];
        if (i < b->rows) b->u[(size_t)t * (size_t)b->rows + (size_t)i] = sum;
        else if (fabs(sum) > outside * size) outside = fabs(sum) / size;
    }
    b->present++;
    return outside;
}

static int check_states(const mk_source_t *source, const char *states, mk_error_t *error) {
    const int n = source->scenario->n, T = source->steps;
    int last = -1, t = -1, state = -1;
    for (int step = 0; step < T; step++)
        for (int i = 0; i < n; i++) {
            if (!isnan(source->all_x[(size_t)step * (size_t)n + (size_t)i])) last = step;
            else if (t < 0) {
                t = step;
                state = i;
            }
        }
    if (t < 0) return 1;
    if (last < t)
        return mk_fail(error,
                       "%s: no state %d at t = %d: the states end there, the measurements go on to t = %d (--steps %d uses what both have)",
                       states, state, t, T - 1, t);
    return mk_fail(error, "%s: state %d at t = %d is missing: every state of every step is needed up to the last measurement, t = %d", states,
                   state, t, T - 1);
}

static int process_residuals(block_t *b, const mk_source_t *source, const char *states, mk_error_t *error) {
    const mk_scenario_t *s = source->scenario;
    const int n = s->n;
    double *w = doubles((size_t)n);
    int good = 1;
    for (int t = 0; t < b->steps && good; t++) {
        const double *x = source->all_x + (size_t)t * (size_t)n, *next = x + n;
        double size = 0.0;
        for (int i = 0; i < n; i++) {
            w[i] = next[i] - s->input[i];
            size = fmax(size, fmax(fabs(next[i]), fabs(s->input[i])));
            for (int j = 0; j < n; j++) {
                w[i] -= s->A[i * n + j] * x[j];
                size = fmax(size, fabs(s->A[i * n + j] * x[j]));
            }
        }
        const double outside = whiten(b, t, w, size);
        if (outside > OUTSIDE)
            good = mk_fail(error,
                           "%s: from t = %d to %d the state moves where the process noise Q has rank %d of %d and allows nothing: by %.2g of "
                           "its size (is the model's A, input or Q another one, or have the states fewer than six digits?)",
                           states, t, t + 1, b->rows, n, outside);
    }
    free(w);
    return good;
}

static void sensor_residuals(block_t *b, const mk_source_t *source) {
    const mk_scenario_t *s = source->scenario;
    const mk_sensor_t *sensor = &s->sensor[b->node];
    const size_t rows = (size_t)source->row_first[s->nodes];
    double *v = doubles((size_t)sensor->rows);
    for (int t = 0; t < b->steps; t++) {
        const double *x = source->all_x + (size_t)t * (size_t)s->n, *y = source->all_y + (size_t)t * rows + source->row_first[b->node];
        for (int r = 0; r < sensor->rows; r++) {
            v[r] = y[r];
            for (int j = 0; j < s->n; j++) v[r] -= sensor->C[r * s->n + j] * x[j];
        }
        if (!isnan(y[0])) (void)whiten(b, t, v, 1.0);
        else b->u[(size_t)t * (size_t)b->rows] = (double)NAN;
    }
    free(v);
}

static int is_present(const block_t *b, int t) { return b->rows == 0 || (t < b->steps && !isnan(b->u[(size_t)t * (size_t)b->rows])); }

static void judge(mk_fit_block_t *result, int node, const mk_mismatch_t *m, double level) {
    result->node = node;
    result->enough = 1;
    result->rows = m->rows;
    result->steps = m->steps;
    result->mismatch = *m;
    result->c = m->raw - m->bias;
    result->p = mk_mismatch_test(m, &result->statistic, &result->degrees);
    result->low = result->high = (double)NAN;
    if (node != MK_FIT_ACROSS) mk_mismatch_interval(m, level, &result->low, &result->high);
}

static int fit_block(mk_fit_block_t *result, const block_t *b, double level, const char *file, mk_error_t *error) {
    const size_t rows = (size_t)b->rows;
    result->node = b->node;
    result->rows = b->rows;
    result->steps = b->present;
    result->enough = b->present >= b->rows + 3;
    char name[24];
    if (!result->enough && b->node >= 0) return 1;
    if (!result->enough)
        return mk_fail(error, "%s: %d steps are too few: the %d dimensions of the process noise need at least %d states in a row", file, b->present,
                       b->rows, b->rows + 4);
    double *u = doubles((size_t)b->present * rows);
    int used = 0, bad;
    for (int t = 0; t < b->steps; t++)
        if (is_present(b, t)) memcpy(u + (size_t)used++ * rows, b->u + (size_t)t * rows, rows * sizeof *u);
    mk_mismatch_t m;
    int good = mk_mismatch_make(&m, used, b->rows, u, NULL, &bad);
    if (!good)
        (void)mk_fail(error,
                      "%s: the residuals of %s do not vary in all of their %d dimensions: c is infinite (was a value logged that does not move?)",
                      file, mk_fit_name(b->node, name), b->rows);
    else if (!isfinite(m.raw)) good = mk_fail(error, "%s: the residuals of %s overflow", file, mk_fit_name(b->node, name));
    if (good) judge(result, b->node, &m, level);
    free(u);
    return good;
}

/* All blocks that are not left out, on the steps where all of them are present. 1; 0: no joint fit; -1 and an error. */
static int fit_joint(mk_fit_t *fit, const block_t *block, const char *file, mk_error_t *error) {
    int *first = mk_allocate((size_t)fit->blocks + 1, sizeof *first), *at = mk_allocate((size_t)fit->blocks, sizeof *at), used = 0;
    for (int b = 0; b < fit->blocks; b++) {
        if (!fit->block[b].enough) continue;
        at[used] = b;
        first[used + 1] = first[used] + block[b].rows;
        used++;
    }
    const int rows = first[used];
    char *complete = mk_allocate((size_t)fit->steps, 1);
    for (int t = 0; t < fit->steps; t++) {
        complete[t] = 1;
        for (int b = 0; b < used && complete[t]; b++) complete[t] = (char)is_present(&block[at[b]], t);
        fit->complete_steps += complete[t];
    }
    int result = fit->complete_steps >= rows + MK_FIT_SPARE;
    if (result) {
        double *u = doubles((size_t)fit->complete_steps * (size_t)rows), *S = doubles((size_t)rows * ((size_t)rows + 1) / 2), *next = u;
        for (int t = 0; t < fit->steps; t++)
            for (int b = 0; b < used && complete[t]; b++) {
                const size_t count = (size_t)block[at[b]].rows;
                memcpy(next, block[at[b]].u + (size_t)t * count, count * sizeof *next);
                next += count;
            }
        mk_mismatch_t m, across;
        int bad;
        char name[24];
        if (!mk_mismatch_make(&m, fit->complete_steps, rows, u, S, &bad)) {
            int b = 0;
            while (first[b + 1] <= bad) b++;
            result = -1;
            (void)mk_fail(error,
                          "%s: the residuals of %s follow from those of the blocks before it: c is infinite (are the readings of one sensor "
                          "logged under two nodes?)",
                          file, mk_fit_name(block[at[b]].node, name));
        } else if (m.lags > 0 && 1.0 / m.spread < MK_FIT_EFFECTIVE * rows) {
            result = 0;
        } else {
            judge(&fit->all, MK_FIT_ALL, &m, fit->level);
            if (used > 1) {
                mk_mismatch_across(&across, &m, S, used, first);
                judge(&fit->block[fit->blocks++], MK_FIT_ACROSS, &across, fit->level);
            }
        }
        free(u);
        free(S);
    }
    free(first);
    free(at);
    free(complete);
    return result;
}

static void fit_sum(mk_fit_t *fit) {
    mk_mismatch_t sum;
    const int parts = fit->blocks - fit->left_out;
    memset(&sum, 0, sizeof sum);
    for (int b = 0; b < fit->blocks; b++)
        if (fit->block[b].enough) mk_mismatch_add(&sum, &fit->block[b].mismatch);
    /* The least of many probabilities is small by chance. */
    sum.white_p = fmin(1.0, sum.white_p * parts);
    sum.tails_p = fmin(1.0, sum.tails_p * parts);
    judge(&fit->all, MK_FIT_ALL, &sum, fit->level);
}

static int by_p(const void *left, const void *right) {
    const double a = (*(mk_fit_block_t *const *)left)->p, b = (*(mk_fit_block_t *const *)right)->p;
    return (a > b) - (a < b);
}

/* Holm: the i-th smallest of m probabilities times m - i, none below the one before it. */
static void correct(mk_fit_t *fit) {
    mk_fit_block_t **order = mk_allocate((size_t)fit->blocks + 1, sizeof *order);
    int count = 0;
    double most = 0.0;
    for (int b = 0; b < fit->blocks; b++)
        if (fit->block[b].enough) order[count++] = &fit->block[b];
    qsort(order, (size_t)count, sizeof *order, by_p);
    for (int i = 0; i < count; i++) {
        most = fmin(fmax(most, order[i]->p * (count - i)), 1.0);
        order[i]->p_holm = most;
        fit->rejected += most < 1.0 - fit->level;
    }
    free(order);
}

/* Residuals and laws of all blocks. */
static int fit_blocks(mk_fit_t *fit, block_t *block, const mk_source_t *source, const char *states, const char *measurements, mk_error_t *error) {
    const mk_scenario_t *s = source->scenario;
    if (!open_block(&block[0], MK_FIT_PROCESS, s->n, s->Q, fit->steps)) return mk_fail(error, "the eigenvalues of Q cannot be found");
    if (!process_residuals(&block[0], source, states, error)) return 0;
    /* Without process noise there is nothing to fit there; the residuals have been seen to be 0. */
    const int process = block[0].rows > 0;
    if (process && !fit_block(&fit->block[0], &block[0], fit->level, states, error)) return 0;
    fit->blocks = process;
    for (int k = 0; k < s->nodes; k++) {
        block_t *b = &block[k + 1];
        if (!open_block(b, k, s->sensor[k].rows, s->sensor[k].R, source->steps))
            return mk_fail(error, "the eigenvalues of R of node %d cannot be found", k);
        sensor_residuals(b, source);
        if (!fit_block(&fit->block[fit->blocks], b, fit->level, measurements, error)) return 0;
        fit->left_out += !fit->block[fit->blocks].enough;
        fit->blocks++;
    }
    if (fit->left_out == s->nodes)
        return mk_fail(error, "%s: no node has enough readings: one of %d rows needs at least %d", measurements, block[1].rows, block[1].rows + 3);
    const int joint = fit_joint(fit, block + !process, measurements, error);
    fit->joint = joint > 0;
    if (joint == 0) fit_sum(fit);
    return joint >= 0;
}

int mk_fit_make(mk_fit_t *fit, const mk_source_t *source, const char *states, const char *measurements, double level, mk_error_t *error) {
    const int nodes = source->scenario->nodes;
    memset(fit, 0, sizeof *fit);
    fit->level = level;
    fit->steps = source->steps - 1;
    if (!check_states(source, states, error)) return 0;
    if (fit->steps < 1) return mk_fail(error, "%s: one step only: nothing to fit", measurements);
    block_t *block = mk_allocate((size_t)nodes + 1, sizeof *block);
    fit->block = mk_allocate((size_t)nodes + 2, sizeof *fit->block);
    const int good = fit_blocks(fit, block, source, states, measurements, error);
    for (int b = 0; b <= nodes; b++) {
        free(block[b].root);
        free(block[b].u);
    }
    free(block);
    if (!good) {
        mk_fit_free(fit);
        return 0;
    }
    correct(fit);
    fit->consistent = fit->all.p >= 1.0 - level;
    fit->tolerance = fit->consistent ? 0.0 : fmax(fit->all.c, 0.0);
    return 1;
}

void mk_fit_free(mk_fit_t *fit) {
    free(fit->block);
    memset(fit, 0, sizeof *fit);
}
