/* SPDX-License-Identifier: MIT */
#include "tracking/windows.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "parallel.h"

typedef struct {
    const mk_trajectory_t *trajectory;
    double *L;              /* P0 = L L', rows */
    const int *first, *slot;
    double *sum;            /* network: information of each instant, packed */
    long length;
    double limit;
    mk_window_t *window;    /* network */
    mk_windows_t *all;
} work_t;

static double *numbers(size_t count) { return mk_allocate(count + 1, sizeof(double)); }

/* S := B' S B, S packed, B n x n. room: n x n. */
static void congruence(int n, const double *B, double *S, double *room) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += S[i > k ? i * (i + 1) / 2 + k : k * (k + 1) / 2 + i] * B[k * n + j];
            room[i * n + j] = sum;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += B[k * n + i] * room[k * n + j];
            S[i * (i + 1) / 2 + j] = sum;
        }
}

/* information: of each instant, packed. */
static mk_window_t judge(const work_t *w, const double *information, long begin) {
    const mk_trajectory_t *r = w->trajectory;
    const int n = r->n, packed = MK_PACKED(n);
    double *S = numbers((size_t)(packed + n * n + n)), *room = S + packed, *values = room + n * n;
    for (long t = begin + w->length - 1; t >= begin; t--) {
        if (t < begin + w->length - 1) congruence(n, r->Phi + (size_t)t * (size_t)(n * n), S, room);
        for (int i = 0; i < packed; i++) S[i] += information[(size_t)t * (size_t)packed + (size_t)i];
    }
    congruence(n, w->L, S, room);
    mk_window_t window = {0.0, (double)INFINITY, 0};
    if (mk_eigen_symmetric(n, S, values, NULL)) {
        for (int i = 0; i < n; i++) window.seen += values[i] > MK_UNSEEN * values[n - 1];
        window.smallest = window.seen == n ? values[0] : 0.0;
        if (window.seen == n) window.condition = values[n - 1] / values[0];
    }
    free(S);
    return window;
}

static void start(mk_windows_t *all, int n) {
    memset(all, 0, sizeof *all);
    all->worst = -1;
    all->least_seen = n;
}

static void count(mk_windows_t *all, const mk_window_t *window, int n, double limit, long begin) {
    if (all->worst < 0 || window->smallest < all->smallest) {
        all->smallest = window->smallest;
        all->worst = begin;
    }
    if (window->seen < all->least_seen) all->least_seen = window->seen;
    if (window->seen < n) all->unseen++;
    else {
        all->ill += window->condition > limit;
        all->condition = fmax(all->condition, window->condition);
    }
}

static void open_work(work_t *w, const mk_trajectory_t *r, const double *P0, long length, double limit) {
    const int n = r->n;
    memset(w, 0, sizeof *w);
    w->trajectory = r;
    w->length = length;
    w->limit = limit;
    w->L = numbers((size_t)(n * n));
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) w->L[i * n + j] = P0[i * (i + 1) / 2 + j];
    /* The scenario's P0 was found positive definite when it was read. */
    (void)LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, w->L, n);
}

static void network_window(void *context, int worker, long begin) {
    const work_t *w = context;
    (void)worker;
    w->window[begin] = judge(w, w->sum, begin);
}

/* Adds node k's information of each instant and marks those that have some. */
static void add_node(const mk_trajectory_t *r, int k, double *sum, unsigned char *there) {
    const size_t packed = MK_PACKED((size_t)r->n);
    for (long t = 0; t < r->instants; t++) {
        const int entry = r->entry[(size_t)t * (size_t)r->nodes + (size_t)k];
        if (entry < 0) continue;
        there[t] = 1;
        for (size_t i = 0; i < packed; i++) sum[(size_t)t * packed + i] += r->information[(size_t)entry * packed + i];
    }
}

void mk_windows_network(const mk_trajectory_t *r, const double *P0, long length, double limit, int threads, mk_window_t *window, mk_windows_t *all) {
    const long windows = r->instants - length + 1;
    unsigned char *there = mk_allocate((size_t)r->instants, 1);
    work_t w;
    open_work(&w, r, P0, length, limit);
    w.sum = numbers((size_t)r->instants * MK_PACKED((size_t)r->n));
    w.window = window;
    for (int k = 0; k < r->nodes; k++) add_node(r, k, w.sum, there);
    mk_parallel(threads, windows, network_window, &w);
    start(all, r->n);
    for (long begin = 0; begin < windows; begin++) count(all, &window[begin], r->n, limit, begin);
    for (long t = 0; t < r->instants; t++) all->heard += there[t];
    all->readings = all->heard;
    free(w.sum);
    free(w.L);
    free(there);
}

static void node_windows(void *context, int worker, long k) {
    const work_t *w = context;
    const mk_trajectory_t *r = w->trajectory;
    mk_windows_t *const all = &w->all[k];
    double *sum = numbers((size_t)r->instants * MK_PACKED((size_t)r->n));
    unsigned char *there = mk_allocate((size_t)r->instants, 1);
    (void)worker;
    start(all, r->n);
    for (int i = w->first[k]; i < w->first[k + 1]; i++) add_node(r, w->slot[i], sum, there);
    for (long t = 0; t < r->instants; t++) {
        all->heard += there[t];
        all->readings += r->entry[(size_t)t * (size_t)r->nodes + (size_t)k] >= 0;
    }
    for (long begin = 0; begin + w->length <= r->instants; begin++) {
        const mk_window_t window = judge(w, sum, begin);
        count(all, &window, r->n, w->limit, begin);
    }
    free(sum);
    free(there);
}

void mk_windows_nodes(const mk_trajectory_t *r, const double *P0, const int *first, const int *slot, long length, double limit, int threads,
                      mk_windows_t *all) {
    work_t w;
    open_work(&w, r, P0, length, limit);
    w.first = first;
    w.slot = slot;
    w.all = all;
    mk_parallel(threads, r->nodes, node_windows, &w);
    free(w.L);
}
