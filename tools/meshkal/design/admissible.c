/* SPDX-License-Identifier: MIT */
#include "design/admissible.h"

#include <lapacke.h>
#include <math.h>
#include <meshkal/gamma.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"

/* The bound of spec 1.6 without its block Toeplitz matrices. Om + theta J' (theta M - I)^-1 J is the information that L steps give about
   the first state when every step costs x' (S - theta I) x beside the noise: the value of a linear quadratic game, and theta < 1 /
   lam_max(M) says that the game has one. A block of steps is the map

       value -> H + E' value (I + G value)^-1 E,        one step: E = A, G = Q, H = S - theta I,

   and blocks compose, so that L steps take log L compositions of n x n matrices. */
typedef struct {
    double *E, *G, *H;
} block_t;

typedef struct {
    int n;
    double *room;
    block_t one, power, total;
    double *system, *right, *scratch;
    lapack_int *pivot;
} game_t;

/* C := A' B or A B', made symmetric, plus C. */
static void add_congruence(int n, const double *A, const double *B, int left, double *C) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++)
                sum += left ? A[k * n + i] * B[k * n + j] + A[k * n + j] * B[k * n + i]
                            : A[i * n + k] * B[j * n + k] + A[j * n + k] * B[i * n + k];
            C[i * n + j] += 0.5 * sum;
            C[j * n + i] = C[i * n + j];
        }
}

/* 1 if I + F' H F is positive definite for G = F F': the inner minimum exists. */
static int has_minimum(const game_t *g, const double *G, const double *H) {
    const int n = g->n;
    double *values = g->scratch, *F = values + n, *T = F + n * n, *packed = T + n * n;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) packed[i * (i + 1) / 2 + j] = G[i * n + j];
    if (!mk_eigen_symmetric(n, packed, values, F)) return 0;
    for (int k = 0; k < n; k++)
        for (int i = 0; i < n; i++) F[k * n + i] *= values[k] > 0.0 ? sqrt(values[k]) : 0.0; /* row k: column k of F */
    mk_multiply(n, F, H, T);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = i == j;
            for (int k = 0; k < n; k++) sum += T[i * n + k] * F[j * n + k];
            packed[i * (i + 1) / 2 + j] = sum;
        }
    return mk_eigen_symmetric(n, packed, values, NULL) && values[0] > 0.0;
}

/* first := first, then second. 0 if the game has no value. */
static int compose(const game_t *g, block_t *first, const block_t *second) {
    const int n = g->n;
    if (!has_minimum(g, first->G, second->H)) return 0;
    double *E = g->scratch, *G = E + n * n, *T = G + n * n;
    mk_multiply(n, first->G, second->H, g->system);
    for (int i = 0; i < n; i++) {
        g->system[i * n + i] += 1.0;
        memcpy(g->right + i * 2 * n, first->E + i * n, (size_t)n * sizeof *E);
        memcpy(g->right + i * 2 * n + n, first->G + i * n, (size_t)n * sizeof *E);
    }
    if (LAPACKE_dgesv(LAPACK_ROW_MAJOR, n, 2 * n, g->system, n, g->pivot, g->right, 2 * n) != 0) return 0;
    for (int i = 0; i < n; i++) {
        memcpy(E + i * n, g->right + i * 2 * n, (size_t)n * sizeof *E);
        memcpy(G + i * n, g->right + i * 2 * n + n, (size_t)n * sizeof *E);
    }
    mk_multiply(n, second->H, E, T);
    add_congruence(n, first->E, T, 1, first->H);
    mk_multiply(n, second->E, G, T);
    memcpy(first->G, second->G, (size_t)(n * n) * sizeof *T);
    add_congruence(n, T, second->E, 0, first->G);
    mk_multiply(n, second->E, E, T);
    memcpy(first->E, T, (size_t)(n * n) * sizeof *T);
    return 1;
}

static void copy_block(int n, block_t *to, const block_t *from) { memcpy(to->E, from->E, (size_t)(3 * n * n) * sizeof *to->E); }

/* 1 if theta is below phi of `horizon` steps. */
static int below_phi(game_t *g, const mk_recursion_t *r, double theta, int horizon) {
    const int n = g->n;
    memcpy(g->one.E, r->A, (size_t)(n * n) * sizeof *r->A);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const int at = i > j ? i * (i + 1) / 2 + j : j * (j + 1) / 2 + i;
            g->one.G[i * n + j] = r->Q[at];
            g->one.H[i * n + j] = r->S[at] - (i == j ? theta : 0.0);
        }
    copy_block(n, &g->power, &g->one);
    int started = 0;
    for (int rest = horizon; rest > 0; rest >>= 1) {
        if (rest & 1) {
            if (!started) copy_block(n, &g->total, &g->power);
            else if (!compose(g, &g->total, &g->power)) return 0;
            started = 1;
        }
        if (rest > 1) {
            copy_block(n, &g->one, &g->power);
            if (!compose(g, &g->power, &g->one)) return 0;
        }
    }
    double *values = g->scratch, *packed = values + n;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) packed[i * (i + 1) / 2 + j] = g->total.H[i * n + j];
    return mk_eigen_symmetric(n, packed, values, NULL) && values[0] > 0.0;
}

static void open_game(game_t *g, int n) {
    const size_t square = (size_t)(n * n);
    g->n = n;
    g->room = mk_allocate(9 * square + 3 * square + 4 * square + (size_t)n, sizeof *g->room);
    block_t *block[3] = {&g->one, &g->power, &g->total};
    for (size_t i = 0; i < 3; i++) {
        block[i]->E = g->room + 3 * i * square;
        block[i]->G = block[i]->E + square;
        block[i]->H = block[i]->G + square;
    }
    g->system = g->room + 9 * square;
    g->right = g->system + square;
    g->scratch = g->right + 2 * square;
    g->pivot = mk_allocate((size_t)n, sizeof *g->pivot);
}

int mk_admissible(mk_recursion_t *r, mk_admissible_t *result) {
    const int n = r->n;
    r->tolerance = 0.0;
    if (!mk_recursion_settle(r, 200000)) return 0;
    double *values = mk_allocate((size_t)n, sizeof *values), *work = mk_allocate((size_t)MK_GAMMA_WORK(n), sizeof *work);
    game_t game;
    open_game(&game, n);
    int good = mk_eigen_symmetric(n, r->P, values, NULL), close_ones = 0;
    const double pole = good ? 1.0 / values[n - 1] : 0.0;
    result->count = 0;
    while (good && result->count < MK_HORIZONS && close_ones < 2) {
        const int at = result->count++, horizon = 2 * n << at;
        result->horizon[at] = horizon;
        if (below_phi(&game, r, pole, horizon)) {
            result->c[at] = (double)INFINITY;
            break;
        }
        double low = 0.0, high = pole, c = 0.0;
        for (int i = 0; i < 60; i++) {
            const double middle = 0.5 * (low + high);
            if (below_phi(&game, r, middle, horizon)) low = middle;
            else high = middle;
        }
        if (low > 0.0) (void)mk_gamma_f64(n, r->P, low, &c, NULL, work);
        result->c[at] = c;
        /* One small gain may be luck: the first horizons can lie on a plateau. */
        close_ones = at > 0 && c <= 1.01 * result->c[at - 1] && c > 0.0 ? close_ones + 1 : 0;
    }
    free(values);
    free(work);
    free(game.room);
    free(game.pivot);
    return good;
}

static int settles(mk_recursion_t *r, const mk_scenario_t *s, double c) {
    mk_recursion_t trial;
    mk_recursion_open(&trial, s, c);
    memcpy(trial.S, r->S, (size_t)(r->n * (r->n + 1) / 2) * sizeof *r->S);
    const int good = mk_recursion_settle(&trial, 20000);
    mk_recursion_close(&trial);
    return good;
}

double mk_largest_settling(mk_recursion_t *r, const mk_scenario_t *s, double limit) {
    if (settles(r, s, limit)) return limit;
    double low = 0.0, high = limit;
    while (high > 1.01 * low && high > 1e-9) {
        const double middle = low > 0.0 ? sqrt(low * high) : 0.1 * high;
        if (settles(r, s, middle)) low = middle;
        else high = middle;
    }
    return low;
}
