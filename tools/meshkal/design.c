/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include "design.h"

#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>

#include "dense.h"

#define SETTLE_LIMIT 200000

static size_t packed(int n) { return (size_t)MK_PACKED(n); }
static double *doubles(size_t count) { return mk_allocate(count, sizeof(double)); }

/* D = V - P = sum of lambda (theta lambda / (1 - theta lambda)) v v' over the eigenpairs of P: the difference of two nearly equal
   matrices without cancellation when c is small. */
static int make_increase(int n, const double *P, double theta, double *D) {
    double *values = doubles((size_t)n), *vectors = doubles((size_t)(n * n));
    const int good = mk_eigen_symmetric(n, P, values, vectors);
    for (int i = 0; i < n && good; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) {
                const double u = theta * values[k];
                sum += values[k] * (u / (1.0 - u)) * vectors[k * n + i] * vectors[k * n + j];
            }
            D[MK_AT(i, j)] = sum;
        }
    free(values);
    free(vectors);
    return good;
}

/* c_k of spec 1.5: V(t) by its inverse W, D = V(t+1) - P(t+1), S the information of the node's neighbourhood.
   tr(Pc^-1 D) - log det(I + Pc^-1 D) = sum of d - log(1 + d) over the eigenvalues d of Pc^-1 D. Negative on failure. */
static double local_tolerance(const mk_scenario_t *s, const double *W, const double *D, const double *S) {
    const int n = s->n;
    double *Y = doubles(2 * packed(n) + (size_t)(n * n + n)), *Pc = Y + packed(n), *X = Pc + packed(n), *values = X + n * n;
    double c = 0.0;
    for (size_t i = 0; i < packed(n); i++) Y[i] = W[i] + S[i];
    if (mk_robust_predict_f64(n, s->A, s->Q, Y, X, Pc) == MK_OK && mk_eigen_generalised(n, D, Pc, values))
        for (int i = 0; i < n; i++) c += mk_log_gap_f64(fmax(values[i], 0.0));
    else c = -1.0;
    free(Y);
    return c;
}

/* Information S_Nk of every neighbourhood (nodes x packed). */
static double *neighbourhood_information(const mk_scenario_t *s) {
    const size_t count = packed(s->n);
    double *own = doubles((size_t)s->nodes * count), *sum = doubles((size_t)s->nodes * count);
    for (int k = 0; k < s->nodes; k++) mk_sensor_matrices(s->n, &s->sensor[k], NULL, own + (size_t)k * count, NULL);
    for (int k = 0; k < s->nodes; k++)
        for (int i = s->first[k]; i < s->first[k + 1]; i++)
            for (size_t j = 0; j < count; j++) sum[(size_t)k * count + j] += own[(size_t)s->slot[i] * count + j];
    free(own);
    return sum;
}

static void open_central(mk_recursion_t *r, const mk_scenario_t *s, double tolerance) {
    mk_recursion_open(r, s, tolerance);
    for (int k = 0; k < s->nodes; k++) mk_recursion_add(r, &s->sensor[k]);
}

static void take_steady(mk_steady_t *steady, const mk_recursion_t *r) {
    const size_t count = packed(r->n);
    double *room = doubles(2 * count);
    steady->P = doubles(count);
    steady->V = doubles(count);
    steady->theta = r->theta;
    memcpy(steady->P, r->P, count * sizeof *r->P);
    memcpy(room, r->W, count * sizeof *room);
    (void)mk_inverse_f64(r->n, room, room + count, steady->V);
    free(room);
}

static void steady_free(mk_steady_t *steady) {
    free(steady->P);
    free(steady->V);
}

void mk_design_free(mk_design_t *design) {
    steady_free(&design->central);
    for (int k = 0; design->node && k < design->nodes; k++) steady_free(&design->node[k]);
    free(design->node);
    free(design->local);
    memset(design, 0, sizeof *design);
}

int mk_design_nodes(mk_design_t *design, const mk_scenario_t *s, const int *may_grow, mk_error_t *error) {
    const size_t count = packed(s->n);
    double *information = neighbourhood_information(s);
    int good = 1;
    design->node = mk_allocate((size_t)s->nodes, sizeof *design->node);
    for (int k = 0; k < s->nodes && good; k++) {
        mk_recursion_t r;
        mk_recursion_open(&r, s, design->local[k]);
        memcpy(r.S, information + (size_t)k * count, count * sizeof *r.S);
        /* Without observability P may grow without end; there is no point in waiting long for it not to. */
        if (mk_recursion_settle(&r, may_grow[k] ? SETTLE_LIMIT / 20 : SETTLE_LIMIT)) take_steady(&design->node[k], &r);
        else if (!may_grow[k])
            good = mk_fail(error, "tolerance %g: the filter of node %d, with its local tolerance %g, does not converge", design->tolerance, k,
                           design->local[k]);
        mk_recursion_close(&r);
    }
    free(information);
    return good;
}

int mk_design_make(mk_design_t *design, const mk_scenario_t *s, double tolerance, mk_error_t *error) {
    memset(design, 0, sizeof *design);
    design->n = s->n;
    design->nodes = s->nodes;
    design->tolerance = tolerance;
    mk_recursion_t r;
    open_central(&r, s, tolerance);
    if (!mk_recursion_settle(&r, SETTLE_LIMIT)) {
        mk_recursion_close(&r);
        return mk_fail(error, "tolerance %g: the centralised filter does not converge", tolerance);
    }
    take_steady(&design->central, &r);
    design->local = doubles((size_t)s->nodes);
    double *D = doubles(packed(s->n)), *information = neighbourhood_information(s);
    int good = make_increase(s->n, r.P, r.theta, D) || mk_fail(error, "the eigenvalues of P cannot be found");
    for (int k = 0; k < s->nodes && good; k++) {
        design->local[k] = tolerance > 0.0 ? local_tolerance(s, r.W, D, information + (size_t)k * packed(s->n)) : 0.0;
        if (design->local[k] < 0.0) good = mk_fail(error, "the local tolerance of node %d cannot be computed", k);
    }
    mk_recursion_close(&r);
    free(D);
    free(information);
    if (!good) mk_design_free(design);
    return good;
}

double *mk_design_schedule(const mk_scenario_t *s, double tolerance, int steps, mk_error_t *error) {
    const size_t count = packed(s->n);
    double *schedule = doubles((size_t)steps * (size_t)s->nodes), *before = doubles(count), *D = doubles(count);
    double *information = neighbourhood_information(s);
    mk_recursion_t r;
    open_central(&r, s, tolerance);
    int good = 1;
    for (int t = 0; t < steps && good && tolerance > 0.0; t++) {
        memcpy(before, r.W, count * sizeof *before);
        good = mk_recursion_step(&r) && make_increase(s->n, r.P, r.theta, D);
        if (!good) (void)mk_fail(error, "tolerance %g: the centralised filter fails in step %d", tolerance, t);
        for (int k = 0; k < s->nodes && good; k++) {
            const double c = local_tolerance(s, before, D, information + (size_t)k * count);
            schedule[(size_t)t * (size_t)s->nodes + (size_t)k] = c;
            if (c < 0.0) good = mk_fail(error, "the local tolerance of node %d cannot be computed in step %d", k, t);
        }
    }
    mk_recursion_close(&r);
    free(before);
    free(D);
    free(information);
    if (good) return schedule;
    free(schedule);
    return NULL;
}

/* Gram matrix of sensor rows scaled to length one: observability does not depend on how good a sensor is, its numbers do. */
static void add_rows(int n, const mk_sensor_t *sensor, double *gram) {
    for (int r = 0; r < sensor->rows; r++) {
        const double *row = sensor->C + r * n;
        double square = 0.0;
        for (int i = 0; i < n; i++) square += row[i] * row[i];
        if (!(square > 0.0)) continue;
        for (int i = 0; i < n; i++)
            for (int j = 0; j <= i; j++) gram[MK_AT(i, j)] += row[i] * row[j] / square;
    }
}

int mk_check_observability(const mk_scenario_t *s, mk_observability_t *result, mk_error_t *error) {
    const int n = s->n;
    const size_t count = packed(n);
    double *own = doubles((size_t)s->nodes * count), *gram = doubles(count), *transposed = doubles((size_t)(n * n));
    result->node = mk_allocate((size_t)s->nodes, sizeof *result->node);
    result->blind_nodes = 0;
    for (int k = 0; k < s->nodes; k++) {
        add_rows(n, &s->sensor[k], own + (size_t)k * count);
        for (size_t j = 0; j < count; j++) gram[j] += own[(size_t)k * count + j];
    }
    result->global = mk_unobservable(n, s->A, gram);
    for (int i = 0; i < n * n; i++) transposed[i] = s->A[i % n * n + i / n];
    result->unreachable = mk_unobservable(n, transposed, s->Q);
    int good = result->global >= 0 && result->unreachable >= 0;
    for (int k = 0; k < s->nodes && good; k++) {
        memset(gram, 0, count * sizeof *gram);
        for (int i = s->first[k]; i < s->first[k + 1]; i++)
            for (size_t j = 0; j < count; j++) gram[j] += own[(size_t)s->slot[i] * count + j];
        result->node[k] = mk_unobservable(n, s->A, gram);
        good = result->node[k] >= 0;
        result->blind_nodes += result->node[k] > 0;
    }
    free(own);
    free(gram);
    free(transposed);
    return good || mk_fail(error, "the rank of an observability matrix cannot be found");
}
