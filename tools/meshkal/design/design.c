/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include "design/design.h"

#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>

#include "dense.h"
#include "design/sized.h"
#include "first_error.h"
#include "parallel.h"

#define SETTLE_LIMIT 200000

static size_t packed(int n) { return (size_t)MK_PACKED(n); }
static double *doubles(size_t count) { return mk_allocate(count, sizeof(double)); }

/* --- local tolerances ------------------------------------------------------------------------------------------------------ */

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

       tr(Pc^-1 D) - log det(I + Pc^-1 D) = gamma(X, 1),   X = L^-1 D L^-T,   L L' = Pc + D,

   for an eigenvalue d of Pc^-1 D is one d / (1 + d) of X; gamma keeps its digits however small d is. work: LOCAL_WORK(n) numbers.
   Negative on failure. */
#define LOCAL_WORK(n) (3 * packed(n) + (size_t)((n) * (n)) + (size_t)MK_GAMMA_WORK(n))
static double local_tolerance(const mk_scenario_t *s, const double *W, const double *D, const double *S, double *work) {
    const int n = s->n;
    double *Y = work, *Pc = Y + packed(n), *X = Pc + packed(n), *full = X + packed(n), c;
    for (size_t i = 0; i < packed(n); i++) Y[i] = W[i] + S[i];
    if (mk_sized_predict(n, s->A, s->Q, Y, full, Pc) != MK_OK) return -1.0;
    for (size_t i = 0; i < packed(n); i++) Pc[i] += D[i];
    if (!mk_ldl_f64(n, Pc)) return -1.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) full[i * n + j] = D[i > j ? MK_AT(i, j) : MK_AT(j, i)];
    mk_ldl_forward_f64(n, n, Pc, full);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            const double swap = full[i * n + j];
            full[i * n + j] = full[j * n + i];
            full[j * n + i] = swap;
        }
    mk_ldl_forward_f64(n, n, Pc, full);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) X[MK_AT(i, j)] = full[i * n + j] * sqrt(Pc[MK_AT(i, i)] * Pc[MK_AT(j, j)]);
    return mk_gamma_f64(n, X, 1.0, &c, NULL, full + n * n) ? c : -1.0;
}

/* Tolerances of several nodes in one step of the centre. */
typedef struct {
    const mk_scenario_t *scenario;
    const double *W, *D, *information; /* information: of each node asked for, or null: made as it is needed */
    const int *id;
    double *c, *work;
    size_t room; /* of a worker */
    int step;    /* -1: steady */
    mk_first_error_t first;
} tolerances_t;

static void node_tolerance(void *context, int worker, long index) {
    tolerances_t *t = context;
    const int n = t->scenario->n;
    const long k = t->id ? t->id[index] : index;
    double *work = t->work + (size_t)worker * t->room, *made = work + LOCAL_WORK(n);
    const double *S = t->information ? t->information + (size_t)index * packed(n) : made;
    if (!t->information) mk_neighbourhood_information(t->scenario, k, made);
    t->c[index] = local_tolerance(t->scenario, t->W, t->D, S, work);
    if (t->c[index] >= 0.0) return;
    mk_error_t error;
    if (t->step < 0) (void)mk_fail(&error, "the local tolerance of node %ld cannot be computed", k);
    else (void)mk_fail(&error, "the local tolerance of node %ld cannot be computed in step %d", k, t->step);
    mk_first_error_put(&t->first, k, &error);
}

static int find_tolerances(tolerances_t *t, long count, int threads, mk_error_t *error) {
    t->room = LOCAL_WORK(t->scenario->n) + packed(t->scenario->n);
    t->work = doubles((size_t)threads * t->room);
    mk_first_error_open(&t->first);
    mk_parallel(threads, count, node_tolerance, t);
    free(t->work);
    return mk_first_error_close(&t->first, error);
}

int mk_design_local(const mk_design_t *design, const mk_scenario_t *s, const int *id, long count, int threads, double *c, mk_error_t *error) {
    memset(c, 0, (size_t)count * sizeof *c);
    if (!(design->tolerance > 0.0)) return 1;
    const int n = s->n;
    double *D = doubles(packed(n)), *W = doubles(packed(n)), *work = doubles(MK_ROBUST_WORK((size_t)n)), theta;
    tolerances_t t = {.scenario = s, .W = W, .D = D, .id = id, .c = c, .step = -1};
    int good = make_increase(n, design->central.P, design->central.theta, D) &&
               mk_sized_information(n, design->central.P, design->tolerance, W, &theta, work) == MK_OK;
    good = good ? find_tolerances(&t, count, threads, error) : mk_fail(error, "the increase of the central covariance cannot be found");
    free(D);
    free(W);
    free(work);
    return good;
}

/* --- fixed points ---------------------------------------------------------------------------------------------------------- */

static double trace(int n, const double *S) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += S[MK_AT(i, i)];
    return sum;
}

/* P and V into the two places given, which the steady state keeps if `keep`. */
static void take_steady(mk_steady_t *steady, const mk_recursion_t *r, double *P, double *V, int keep) {
    const size_t count = packed(r->n);
    double *room = r->work;
    memcpy(P, r->P, count * sizeof *P);
    memcpy(room, r->W, count * sizeof *room);
    (void)mk_inverse_f64(r->n, room, room + count, V);
    steady->exists = 1;
    steady->theta = r->theta;
    steady->trace_P = trace(r->n, P);
    steady->trace_V = trace(r->n, V);
    steady->P = keep ? P : NULL;
    steady->V = keep ? V : NULL;
}

void mk_design_free(mk_design_t *design) {
    free(design->central.P);
    free(design->central.V);
    free(design->node);
    free(design->block);
    free(design->local);
    memset(design, 0, sizeof *design);
}

typedef struct {
    mk_design_t *design;
    const mk_scenario_t *scenario;
    const int *may_grow;
    int keep;
    double *spare; /* of each worker, for P and V that are not kept */
    mk_first_error_t first;
} fixed_points_t;

static void node_fixed_point(void *context, int worker, long k) {
    fixed_points_t *f = context;
    mk_design_t *design = f->design;
    const size_t count = packed(design->n);
    if (mk_first_error_before(&f->first, k)) return;
    double *P = f->keep ? design->block + 2 * (size_t)k * count : f->spare + 2 * (size_t)worker * count;
    mk_recursion_t r;
    mk_recursion_open(&r, f->scenario, design->local[k]);
    mk_neighbourhood_information(f->scenario, k, r.S);
    /* Without observability P may grow without end; there is no point in waiting long for it not to. */
    if (mk_recursion_settle(&r, f->may_grow[k] ? SETTLE_LIMIT / 20 : SETTLE_LIMIT)) {
        take_steady(&design->node[k], &r, P, P + count, f->keep);
    } else if (!f->may_grow[k]) {
        mk_error_t error;
        (void)mk_fail(&error, "tolerance %g: the filter of node %ld, with its local tolerance %g, does not converge", design->tolerance, k,
                      design->local[k]);
        mk_first_error_put(&f->first, k, &error);
    }
    mk_recursion_close(&r);
}

int mk_design_nodes(mk_design_t *design, const mk_scenario_t *s, const int *may_grow, int keep, int threads, mk_error_t *error) {
    fixed_points_t f = {.design = design, .scenario = s, .may_grow = may_grow, .keep = keep};
    design->node = mk_allocate((size_t)s->nodes, sizeof *design->node);
    if (keep) design->block = doubles(2 * (size_t)s->nodes * packed(s->n));
    else f.spare = doubles(2 * (size_t)threads * packed(s->n));
    mk_first_error_open(&f.first);
    mk_parallel(threads, s->nodes, node_fixed_point, &f);
    free(f.spare);
    return mk_first_error_close(&f.first, error);
}

static void open_central(mk_recursion_t *r, const mk_scenario_t *s, double tolerance) {
    mk_recursion_open(r, s, tolerance);
    for (int k = 0; k < s->nodes; k++) mk_recursion_add(r, &s->sensor[k]);
}

int mk_design_central(mk_design_t *design, const mk_scenario_t *s, double tolerance, mk_error_t *error) {
    memset(design, 0, sizeof *design);
    mk_recursion_t r;
    open_central(&r, s, tolerance);
    const int settled = mk_recursion_settle(&r, SETTLE_LIMIT);
    if (settled) {
        design->n = s->n;
        design->nodes = s->nodes;
        design->tolerance = tolerance;
        take_steady(&design->central, &r, doubles(packed(s->n)), doubles(packed(s->n)), 1);
    }
    mk_recursion_close(&r);
    return settled || mk_fail(error, "tolerance %g: the centralised filter does not converge", tolerance);
}

int mk_design_make(mk_design_t *design, const mk_scenario_t *s, double tolerance, mk_error_t *error) {
    if (!mk_design_central(design, s, tolerance, error)) return 0;
    design->local = doubles((size_t)s->nodes);
    if (mk_design_local(design, s, NULL, s->nodes, mk_cores(), design->local, error)) return 1;
    mk_design_free(design);
    return 0;
}

/* --- tolerances over time -------------------------------------------------------------------------------------------------- */

struct mk_schedule {
    mk_recursion_t r;
    tolerances_t t;
    double *before, *D, *information;
    long count;
    int threads;
};

static void take_information(void *context, int worker, long index) {
    const mk_schedule_t *m = context;
    (void)worker;
    mk_neighbourhood_information(m->t.scenario, m->t.id ? m->t.id[index] : index, m->information + (size_t)index * packed(m->r.n));
}

mk_schedule_t *mk_schedule_open(const mk_scenario_t *s, double tolerance, const int *id, long count, int threads) {
    mk_schedule_t *m = mk_allocate(1, sizeof *m);
    open_central(&m->r, s, tolerance);
    m->before = doubles(packed(s->n));
    m->D = doubles(packed(s->n));
    m->count = count;
    m->threads = threads;
    if (tolerance > 0.0) m->information = doubles((size_t)count * packed(s->n));
    m->t = (tolerances_t){.scenario = s, .W = m->before, .D = m->D, .information = m->information, .id = id};
    if (m->information) mk_parallel(threads, count, take_information, m);
    return m;
}

int mk_schedule_step(mk_schedule_t *m, double *c, mk_error_t *error) {
    memset(c, 0, (size_t)m->count * sizeof *c);
    if (!(m->r.tolerance > 0.0)) return 1;
    memcpy(m->before, m->r.W, packed(m->r.n) * sizeof *m->before);
    m->t.c = c;
    if (!mk_recursion_step(&m->r) || !make_increase(m->r.n, m->r.P, m->r.theta, m->D))
        return mk_fail(error, "tolerance %g: the centralised filter fails in step %d", m->r.tolerance, m->t.step);
    const int good = find_tolerances(&m->t, m->count, m->threads, error);
    m->t.step++;
    return good;
}

void mk_schedule_close(mk_schedule_t *m) {
    mk_recursion_close(&m->r);
    free(m->before);
    free(m->D);
    free(m->information);
    free(m);
}

double *mk_design_schedule(const mk_scenario_t *s, double tolerance, int steps, const int *id, long count, int threads, mk_error_t *error) {
    double *c = doubles((size_t)steps * (size_t)count);
    mk_schedule_t *schedule = mk_schedule_open(s, tolerance, id, count, threads);
    int good = 1;
    for (int t = 0; t < steps && good; t++) good = mk_schedule_step(schedule, c + (size_t)t * (size_t)count, error);
    mk_schedule_close(schedule);
    if (good) return c;
    free(c);
    return NULL;
}
