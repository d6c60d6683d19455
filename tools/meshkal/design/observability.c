/* SPDX-License-Identifier: MIT */
/* What neighbourhoods do not see. Ranks are decided by singular values (dense.h), tens of microseconds a node; most nodes see everything
   by a wide margin, which a factorisation shows. */
#define MK_ROLLED
#include <math.h>
#include <meshkal/kernels.h>
#include <stdlib.h>

#include "dense.h"
#include "design/design.h"
#include "first_error.h"
#include "parallel.h"

typedef struct {
    const mk_scenario_t *scenario;
    int *result;
    int doublings;   /* the Gramian is over 2^doublings >= n steps */
    double *powers;  /* A, A^2, A^4, .. */
    double margin;   /* smallest eigenvalue of the Gramian, relative to the norm of G, above which nothing can be unobservable */
    double *work;
    mk_first_error_t first;
} watch_t;

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

/* O := O + A' O A. room: n x n. */
static void add_congruence(int n, const double *A, double *O, double *room) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += O[i > k ? MK_AT(i, k) : MK_AT(k, i)] * A[k * n + j];
            room[i * n + j] = sum;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            for (int k = 0; k < n; k++) O[MK_AT(i, j)] += A[k * n + i] * room[k * n + j];
}

/* The rank decision of mk_unobservable keeps a direction x if x' G x <= delta |G| and A maps it into the space again but for delta |A|,
   delta = 1e-8. Then |G^1/2 A^i x| <= sqrt(delta |G|) a^i (1 + small), a the spectral norm of A, and the Gramian O over L steps has
   x' O x <= delta |G| (1 + small) sum of a^2i. A Gramian above twice that in every direction leaves no such x. */
static double find_margin(int n, const double *A, int steps) {
    double *gram = mk_allocate((size_t)MK_PACKED(n) + (size_t)n, sizeof *gram), *values = gram + MK_PACKED(n), sum = 0.0, power = 1.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++)
            for (int k = 0; k < n; k++) gram[MK_AT(i, j)] += A[k * n + i] * A[k * n + j];
    const int good = mk_eigen_symmetric(n, gram, values, NULL);
    const double square = values[n - 1];
    free(gram);
    for (int i = 0; i < steps; i++, power *= square) sum += power;
    return good ? 2e-8 * sum : (double)INFINITY;
}

static size_t room(int n) { return 2 * (size_t)MK_PACKED(n) + (size_t)(n * n); }

static void watch_node(void *context, int worker, long k) {
    watch_t *w = context;
    const mk_scenario_t *s = w->scenario;
    const int n = s->n;
    double *gram = w->work + (size_t)worker * room(n), *O = gram + MK_PACKED(n), *product = O + MK_PACKED(n), square = 0.0;
    memset(gram, 0, (size_t)MK_PACKED(n) * sizeof *gram);
    for (int i = s->first[k]; i < s->first[k + 1]; i++) add_rows(n, &s->sensor[s->slot[i]], gram);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) square += (i == j ? 1.0 : 2.0) * gram[MK_AT(i, j)] * gram[MK_AT(i, j)];
    memcpy(O, gram, (size_t)MK_PACKED(n) * sizeof *O);
    for (int i = 0; i < w->doublings; i++) add_congruence(n, w->powers + i * n * n, O, product);
    for (int i = 0; i < n; i++) O[MK_AT(i, i)] -= w->margin * sqrt(square);
    w->result[k] = mk_ldl_f64(n, O) ? 0 : mk_unobservable(n, s->A, gram);
    if (w->result[k] >= 0) return;
    mk_error_t error;
    (void)mk_fail(&error, "the rank of the observability matrix of node %ld cannot be found", k);
    mk_first_error_put(&w->first, k, &error);
}

int mk_check_observability(const mk_scenario_t *s, int threads, mk_observability_t *result, mk_error_t *error) {
    const int n = s->n;
    double *gram = mk_allocate((size_t)MK_PACKED(n), sizeof *gram), *transposed = mk_allocate((size_t)(n * n), sizeof *transposed);
    for (int k = 0; k < s->nodes; k++) add_rows(n, &s->sensor[k], gram);
    for (int i = 0; i < n * n; i++) transposed[i] = s->A[i % n * n + i / n];
    result->global = mk_unobservable(n, s->A, gram);
    result->unreachable = mk_unobservable(n, transposed, s->Q);
    result->node = mk_allocate((size_t)s->nodes, sizeof *result->node);
    result->blind_nodes = 0;
    free(gram);
    free(transposed);
    if (result->global < 0 || result->unreachable < 0) return mk_fail(error, "the rank of an observability matrix cannot be found");
    watch_t w = {.scenario = s, .result = result->node};
    while (1 << w.doublings < n) w.doublings++;
    w.margin = find_margin(n, s->A, 1 << w.doublings);
    w.powers = mk_allocate((size_t)((w.doublings + 1) * n * n), sizeof *w.powers);
    memcpy(w.powers, s->A, (size_t)(n * n) * sizeof *w.powers);
    for (int p = 1; p < w.doublings; p++) {
        const double *from = w.powers + (p - 1) * n * n;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int k = 0; k < n; k++) w.powers[(p * n + i) * n + j] += from[i * n + k] * from[k * n + j];
    }
    w.work = mk_allocate((size_t)threads * room(n), sizeof *w.work);
    mk_first_error_open(&w.first);
    mk_parallel(threads, s->nodes, watch_node, &w);
    free(w.work);
    free(w.powers);
    for (int k = 0; k < s->nodes; k++) result->blind_nodes += result->node[k] > 0;
    return mk_first_error_close(&w.first, error);
}
