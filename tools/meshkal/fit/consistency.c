/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include "fit/consistency.h"

#include <math.h>
#include <meshkal/kernels.h>
#include <meshkal/quantile.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "design/design.h"
#include "fit/mismatch.h"
#include "parallel.h"

const char *mk_consistency_verdict(const mk_mean_t *mean) {
    if (isnan(mean->mean)) return "-";
    return mean->mean > mean->high ? "optimistic" : mean->mean < mean->low ? "cautious" : "consistent";
}

/* The interval of a mean over `degrees` squares of standard normal numbers, of which `effective` count. */
static mk_mean_t make_mean(double sum, double degrees, double effective, double error) {
    const double nan = (double)NAN;
    mk_mean_t mean = {nan, nan, nan};
    if (!(degrees > 0.0)) return mean;
    mean.mean = sum / degrees;
    mean.low = mk_chi2_quantile(1.0 - 0.5 * error, effective) / effective;
    mean.high = mk_chi2_quantile(0.5 * error, effective) / effective;
    return mean;
}

static double element(const double *S, int i, int j) { return S[i > j ? MK_AT(i, j) : MK_AT(j, i)]; }

/* 1 + 2 sum over k of (1 - k / steps) tr(W F^k V F^k') / n, W = V^-1. X: F, overwritten; next: room for n x n. */
static double sum_correlations(int n, int steps, const double *F, const double *W, const double *V, double *X, double *next) {
    double ratio = 1.0;
    for (int k = 1; k < steps; k++) {
        double trace = 0.0; /* sum of products of W F^k and F^k V */
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                double WX = 0.0, XV = 0.0;
                for (int l = 0; l < n; l++) {
                    WX += element(W, i, l) * X[l * n + j];
                    XV += X[i * n + l] * element(V, l, j);
                }
                trace += WX * XV;
            }
        ratio += 2.0 * (1.0 - (double)k / steps) * trace / n;
        if (!(trace > 1e-6 * n)) break;
        mk_multiply(n, F, X, next);
        memcpy(X, next, (size_t)(n * n) * sizeof *X);
    }
    return ratio;
}

/* Variance of the mean of kfc's NEES over `steps` steps, relative to independent ones, by the model alone: steady errors are normal with
   covariance V and e(t+1) = F e(t) + noise, F = A M V^-1, so that the NEES of t and t + k correlate by tr(W F^k V F^k') / n. 0 if the filter
   does not settle. */
static double central_ratio(const mk_scenario_t *s, int steps) {
    const int n = s->n, packed = MK_PACKED(n);
    double *Y = mk_allocate((size_t)(3 * packed + 4 * n * n), sizeof *Y), *M = Y + 2 * packed, *F = M + packed, *G = F + n * n, *X = G + n * n;
    double *next = X + n * n, ratio = 0.0;
    mk_recursion_t r;
    mk_recursion_open(&r, s, 0.0);
    for (int k = 0; k < s->nodes; k++) mk_recursion_add(&r, &s->sensor[k]);
    const int settled = mk_recursion_settle(&r, 100000);
    for (int i = 0; i < packed; i++) Y[i] = r.W[i] + r.S[i];
    if (settled && mk_inverse_f64(n, Y, Y + packed, M)) {
        for (int i = 0; i < n * n; i++) {
            X[i] = element(M, i / n, i % n);
            next[i] = element(r.W, i / n, i % n);
        }
        mk_multiply(n, X, next, G);
        mk_multiply(n, s->A, G, F);
        memcpy(X, F, (size_t)(n * n) * sizeof *X);
        ratio = sum_correlations(n, steps, F, r.W, r.P, X, next);
    }
    free(Y);
    mk_recursion_close(&r);
    return ratio;
}

/* The run: NEES of every step of the second half (estimator by estimator) and sums of NIS and its rows. */
static int run(const mk_network_t *network, void *net, const mk_topology_t *topology, const mk_source_t *source, int central, double *nees,
               double *nis, double *rows, mk_error_t *error) {
    const int T = source->steps, from = T / 2, E = topology->estimators;
    uint8_t *arrived = mk_allocate((size_t)topology->first[E], 1), *heard = mk_allocate((size_t)topology->first[E], 1);
    double *now = mk_allocate((size_t)E, sizeof *now);
    mk_snapshot_t snapshot = mk_snapshot_make(network, E, source->scenario, NULL);
    const double *step_nis = snapshot.nis;
    mk_stream_t stream;
    int bad = 0;
    mk_stream_open(&stream, source, NULL, &mk_team_alone, 1);
    mk_status_t status = network->start(net, &bad);
    memset(heard, 1, (size_t)topology->first[E]);
    for (int t = 0; t < T && status == MK_OK; t++) {
        mk_stream_step(&stream, 0, t);
        memset(arrived, 1, (size_t)topology->first[E]);
        network->nees(net, stream.x, now);
        status = network->incremental(net, 0, E, stream.y, source->row_first, arrived, NULL, &bad);
        if (status == MK_OK) status = network->diffuse(net, 0, E, central ? NULL : heard, NULL, &bad);
        if (status != MK_OK) (void)mk_fail(error, "step %d, %s %d: %s", t, central ? "central filter" : "node", bad, mk_status_name(status));
        network->look_after(net, &snapshot);
        for (int e = 0; e < E && t >= from; e++) {
            nees[(size_t)e * (size_t)(T - from) + (size_t)(t - from)] = now[e];
            nis[e] += step_nis[e];
            rows[e] += snapshot.nis_rows[e];
        }
    }
    mk_stream_close(&stream);
    mk_snapshot_free(&snapshot);
    free(arrived);
    free(heard);
    free(now);
    return status == MK_OK;
}

int mk_consistency_make(mk_consistency_t *result, const mk_source_t *source, const mk_filter_t *filter, double tolerance, double level,
                        mk_error_t *error) {
    const mk_scenario_t *s = source->scenario;
    const int steps = source->steps - source->steps / 2;
    memset(result, 0, sizeof *result);
    if (filter->central && s->nodes > UINT16_MAX) return mk_fail(error, "a centralised filter takes at most %d nodes, not %d", UINT16_MAX, s->nodes);
    mk_topology_t topology = filter->central ? mk_central_topology(s) : mk_distributed_topology(s);
    const size_t E = (size_t)topology.estimators;
    double *local = mk_allocate(3 * E, sizeof *local), *nis = local + E, *rows = nis + E, *nees = mk_allocate(E * (size_t)steps, sizeof *nees);
    double *schedule;
    int good = mk_filter_tolerances(filter, s, tolerance, source->steps, &topology, mk_cores(), local, &schedule, error);
    if (good) {
        void *net = mk_network_f64.open(s, &topology, local, 0, NULL, mk_cores());
        good = run(&mk_network_f64, net, &topology, source, filter->central, nees, nis, rows, error);
        mk_network_f64.close(net);
    }
    if (good) {
        const double part = (1.0 - level) / (double)E, exact = filter->central ? central_ratio(s, steps) : 0.0;
        result->filter = filter;
        result->tolerance = tolerance;
        result->estimators = (int)E;
        result->steps = steps;
        result->nis = mk_allocate(2 * E, sizeof *result->nis);
        result->nees = result->nis + E;
        for (size_t e = 0; e < E; e++) {
            const double *series = nees + e * (size_t)steps, degrees = (double)s->n * steps;
            double sum = 0.0;
            for (int t = 0; t < steps; t++) sum += series[t];
            result->nis[e] = make_mean(nis[e], rows[e], rows[e], part);
            result->nees[e] = make_mean(sum, degrees, degrees / (exact > 0.0 ? exact : mk_long_run(steps, series, 0)), part);
        }
    }
    if (filter->central) mk_central_free(&topology);
    free(schedule);
    free(local);
    free(nees);
    return good;
}

void mk_consistency_free(mk_consistency_t *result) {
    free(result->nis);
    memset(result, 0, sizeof *result);
}
