/* SPDX-License-Identifier: MIT */
#include "tracking/consensus_rate.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "error.h"
#include "random.h"

static double *numbers(int count) { return mk_allocate((size_t)count + 1, sizeof(double)); }

static int degree(const mk_links_t *links, int k) {
    int count = 0;
    for (int i = links->first[k]; i < links->first[k + 1]; i++) count += links->slot[i] != k;
    return count;
}

/* Symmetric form of P: entries right_i right_j off the diagonal (paper), or those of Metropolis; own_i on it. */
typedef struct {
    const mk_links_t *links;
    int metropolis;
    double *scale; /* paper: 1 / sqrt(d + g); Metropolis: 1 + d */
    double *own;
    double *top;   /* eigenvector of eigenvalue 1, length 1 */
} symmetric_t;

static double entry(const symmetric_t *s, int i, int j) {
    return s->metropolis ? 1.0 / fmax(s->scale[i], s->scale[j]) : s->scale[i] * s->scale[j];
}

static void open_symmetric(symmetric_t *s, const mk_averaging_t *p) {
    const int nodes = p->links->nodes;
    double total = 0.0;
    s->links = p->links;
    s->metropolis = p->metropolis;
    s->scale = numbers(nodes);
    s->own = numbers(nodes);
    s->top = numbers(nodes);
    for (int k = 0; k < nodes; k++) {
        const int d = degree(p->links, k), g = !p->measures || p->measures[k];
        /* A node without weights keeps its value. */
        const double weight = p->metropolis ? 1.0 : d + g ? d + g : 1.0;
        s->scale[k] = p->metropolis ? 1.0 + d : 1.0 / sqrt(weight);
        s->own[k] = d + g ? g / weight : 1.0;
        s->top[k] = sqrt(weight);
        total += weight;
    }
    for (int k = 0; k < nodes; k++) {
        s->top[k] /= sqrt(total);
        if (!p->metropolis) continue;
        s->own[k] = 1.0;
        for (int i = p->links->first[k]; i < p->links->first[k + 1]; i++)
            if (p->links->slot[i] != k) s->own[k] -= entry(s, k, p->links->slot[i]);
    }
}

static void close_symmetric(symmetric_t *s) {
    free(s->scale);
    free(s->own);
    free(s->top);
}

static double *make_packed(const symmetric_t *s) {
    const int nodes = s->links->nodes;
    double *S = numbers(nodes * (nodes + 1) / 2);
    for (int k = 0; k < nodes; k++) {
        S[k * (k + 1) / 2 + k] = s->own[k];
        for (int i = s->links->first[k]; i < s->links->first[k + 1]; i++)
            if (s->links->slot[i] < k) S[k * (k + 1) / 2 + s->links->slot[i]] = entry(s, k, s->links->slot[i]);
    }
    return S;
}

static int dense_rate(const symmetric_t *s, mk_rate_t *rate) {
    const int nodes = s->links->nodes;
    double *S = make_packed(s), *values = numbers(nodes);
    const int good = mk_eigen_symmetric(nodes, S, values, NULL);
    /* Connected: eigenvalue 1 is single, and the last. */
    rate->modulus = nodes > 1 ? fmin(fmax(fabs(values[0]), fabs(values[nodes - 2])), 1.0) : 0.0;
    rate->error = 1e-14;
    rate->steps = 0;
    free(S);
    free(values);
    return good;
}

/* --- Lanczos --------------------------------------------------------------------------------------------------------------- */

enum { MOST_STEPS = 20000 };

static void apply(const symmetric_t *s, const double *x, double *y) {
    const mk_links_t *links = s->links;
    for (int k = 0; k < links->nodes; k++) {
        double sum = s->own[k] * x[k];
        for (int i = links->first[k]; i < links->first[k + 1]; i++)
            if (links->slot[i] != k) sum += entry(s, k, links->slot[i]) * x[links->slot[i]];
        y[k] = sum;
    }
}

/* Takes the known eigenvector out and scales to length 1; returns the length. */
static double clean(const symmetric_t *s, double *x) {
    const int nodes = s->links->nodes;
    double along = 0.0, square = 0.0;
    for (int k = 0; k < nodes; k++) along += s->top[k] * x[k];
    for (int k = 0; k < nodes; k++) {
        x[k] -= along * s->top[k];
        square += x[k] * x[k];
    }
    const double length = sqrt(square);
    for (int k = 0; k < nodes && length > 0.0; k++) x[k] /= length;
    return length;
}

/* Eigenvalue `which` (from 1) of the tridiagonal matrix of m rows, and the last element of its eigenvector. */
static int tridiagonal(int m, const double *alpha, const double *beta, int which, double *value, double *last) {
    double *diagonal = numbers(m), *beside = numbers(m), *values = numbers(m), *vector = numbers(m);
    lapack_int found, support[2], info;
    memcpy(diagonal, alpha, (size_t)m * sizeof *alpha);
    memcpy(beside, beta, (size_t)m * sizeof *beta);
    info = LAPACKE_dstevr(LAPACK_COL_MAJOR, 'V', 'I', m, diagonal, beside, 0.0, 0.0, which, which, 0.0, &found, values, vector, m, support);
    *value = values[0];
    *last = vector[m - 1];
    free(diagonal);
    free(beside);
    free(values);
    free(vector);
    return info == 0;
}

/* Both ends of the spectrum without 1. Without orthogonalisation against earlier vectors inner eigenvalues come more than once; the outer
   ones and their residuals stay right (Paige). */
static int lanczos(const symmetric_t *s, mk_rate_t *rate) {
    const int nodes = s->links->nodes;
    double *v = numbers(nodes), *before = numbers(nodes), *w = numbers(nodes), *alpha = numbers(MOST_STEPS), *beta = numbers(MOST_STEPS);
    mk_random_t random;
    int good = 1, m = 0, check = 64, settled = 0;
    mk_random_start(&random, 1, 0, 0, 0, MK_DRAW_NETWORK);
    for (int k = 0; k < nodes; k++) v[k] = mk_random_normal(&random) + s->top[k];
    (void)clean(s, v);
    while (good && !settled) {
        double along = 0.0;
        apply(s, v, w);
        for (int k = 0; k < nodes; k++) along += w[k] * v[k];
        for (int k = 0; k < nodes; k++) w[k] -= along * v[k] + (m ? beta[m - 1] * before[k] : 0.0);
        alpha[m] = along;
        beta[m] = clean(s, w);
        double *const old = before;
        before = v;
        v = w;
        w = old;
        m++;
        const int over = m == MOST_STEPS || beta[m - 1] < 1e-14;
        if (m < check && !over) continue;
        double low = 0.0, high = 0.0, low_last = 0.0, high_last = 0.0;
        good = tridiagonal(m, alpha, beta, 1, &low, &low_last) && tridiagonal(m, alpha, beta, m, &high, &high_last);
        const int upper = fabs(high) >= fabs(low);
        rate->modulus = fmin(fmax(fabs(low), fabs(high)), 1.0);
        rate->error = beta[m - 1] * fabs(upper ? high_last : low_last);
        rate->steps = m;
        /* The other end may still grow past this one. */
        const double other = beta[m - 1] * fabs(upper ? low_last : high_last);
        /* Iterations go with 1 / (1 - modulus). */
        const double enough = fmax(fmin(1e-10, 1e-3 * (1.0 - rate->modulus)), 1e-14);
        settled = over || (rate->error <= enough && fmin(fabs(low), fabs(high)) + other <= rate->modulus + enough);
        check += check / 4;
        if (check > MOST_STEPS) check = MOST_STEPS;
    }
    free(v);
    free(before);
    free(w);
    free(alpha);
    free(beta);
    return good;
}

int mk_rate(const mk_averaging_t *protocol, mk_rate_t *rate) {
    symmetric_t s;
    open_symmetric(&s, protocol);
    const int good = protocol->links->nodes <= MK_DENSE_NODES ? dense_rate(&s, rate) : lanczos(&s, rate);
    close_symmetric(&s);
    return good;
}

/* --- one measuring node ---------------------------------------------------------------------------------------------------- */

/* With A the links and D the degrees, eigenvalues of nobody measuring are mu: D^-1/2 A D^-1/2 u = mu u. If node w measures, those of
   (A + e e') x = lambda (D + e e') x, e = unit vector w, are the roots of 1 + (1 - lambda) e' (A - lambda D)^-1 e = 0, which is
       1 + 1 / sum(d) + (1 - lambda) / d_w sum_j u_jw^2 / (mu_j - lambda) = 0   over all j but that of mu = 1.
   The left side increases between poles, so that each root stands between two mu. */
static double single_root(int nodes, const double *mu, const double *square, double constant, double low, double high) {
    /* Halving down to neighbours in double: at most some 60 times, but for an interval at 0 some hundred more; 100 settle 1e-16. */
    for (int i = 0; i < 100; i++) {
        const double middle = 0.5 * (low + high);
        double sum = constant;
        if (!(middle > low && middle < high)) break;
        for (int j = 0; j < nodes - 1; j++) sum += (1.0 - middle) * square[j] / (mu[j] - middle);
        if (sum < 0.0) low = middle;
        else high = middle;
    }
    return 0.5 * (low + high);
}

int mk_rates_single(const mk_links_t *links, double *modulus) {
    const int nodes = links->nodes;
    if (nodes == 1) {
        modulus[0] = 0.0;
        return 1;
    }
    unsigned char *none = mk_allocate((size_t)nodes, 1);
    const mk_averaging_t protocol = {links, none, 0};
    symmetric_t s;
    open_symmetric(&s, &protocol);
    double *S = make_packed(&s), *mu = numbers(nodes), *vectors = numbers(nodes * nodes), *square = numbers(nodes), total = 0.0;
    const int good = mk_eigen_symmetric(nodes, S, mu, vectors);
    for (int k = 0; k < nodes; k++) total += degree(links, k);
    for (int k = 0; k < nodes && good; k++) {
        for (int j = 0; j < nodes - 1; j++) square[j] = vectors[j * nodes + k] * vectors[j * nodes + k] / degree(links, k);
        const double constant = 1.0 + 1.0 / total;
        const double least = single_root(nodes, mu, square, constant, fmax(mu[0], -1.0), nodes > 2 ? mu[1] : 1.0);
        const double second = nodes > 2 ? single_root(nodes, mu, square, constant, mu[nodes - 2], 1.0) : least;
        modulus[k] = fmax(fabs(least), fabs(second));
    }
    close_symmetric(&s);
    free(none);
    free(S);
    free(mu);
    free(vectors);
    free(square);
    return good;
}

/* --- limit and iterations -------------------------------------------------------------------------------------------------- */

int mk_perron(const mk_averaging_t *p, double *pi) {
    const int nodes = p->links->nodes;
    double total = 0.0;
    for (int k = 0; k < nodes; k++) total += p->metropolis ? 1.0 : degree(p->links, k) + (!p->measures || p->measures[k]);
    if (!(total > 0.0)) return 0;
    for (int k = 0; k < nodes; k++) pi[k] = (p->metropolis ? 1.0 : degree(p->links, k) + (!p->measures || p->measures[k])) / total;
    return 1;
}

long mk_iterations(double modulus, double accuracy) {
    if (!(modulus < 1.0)) return -1;
    if (modulus <= accuracy) return 1;
    const double count = ceil(log(accuracy) / log(modulus));
    return count < 1e9 ? (long)count : -1;
}
