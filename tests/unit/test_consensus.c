/* SPDX-License-Identifier: MIT */
/* Consensus against its definition: dense matrices in double, written out here, share no code with src/meshkal. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include <meshkal/consensus.h>

#include "generator.h"
#include "precision.h"

#define MK_CONSENSUS_OF(name, real, p, slots) MK_CONSENSUS(name, real, p, slots)

enum { NODES = 7, P = 5 };

static void path_graph(int count, int hears[NODES][NODES]) {
    memset(hears, 0, sizeof(int[NODES][NODES]));
    for (int i = 0; i + 1 < count; i++) hears[i][i + 1] = hears[i + 1][i] = 1;
}

/* Connected, links both ways, symmetric weights. */
static void draw_graph(generator_t *g, int count, int hears[NODES][NODES], double weight[NODES][NODES]) {
    memset(hears, 0, sizeof(int[NODES][NODES]));
    for (int i = 1; i < count; i++) {
        const int j = draw_below(g, i);
        hears[i][j] = hears[j][i] = 1;
    }
    for (int i = 0; i < count; i++)
        for (int j = 0; j < i; j++) {
            if (draw_chance(g, 0.3)) hears[i][j] = hears[j][i] = 1;
            weight[i][j] = weight[j][i] = draw_below(g, 7) / 4.0 + 0.25;
        }
}

static int degree_of(int count, int hears[NODES][NODES], int sender) {
    int degree = 0;
    for (int i = 0; i < count; i++) degree += hears[i][sender];
    return degree;
}

/* x(l+1) = W x(l) with what arrives. weight null: ones. */
static void dense_matrix(int protocol, int count, int hears[NODES][NODES], double weight[NODES][NODES], const int *measures,
                         int arrives[NODES][NODES], double W[NODES][NODES]) {
    for (int i = 0; i < count; i++) {
        double sum = 0.0;
        for (int j = 0; j < count; j++) {
            W[i][j] = 0.0;
            if (i == j || !arrives[i][j]) continue;
            const int own = degree_of(count, hears, i), other = degree_of(count, hears, j);
            W[i][j] = protocol == MK_CONSENSUS_METROPOLIS ? 1.0 / (1 + (own > other ? own : other)) : weight ? weight[i][j] : 1.0;
            sum += W[i][j];
        }
        if (protocol == MK_CONSENSUS_METROPOLIS) {
            W[i][i] = 1.0 - sum;
            continue;
        }
        W[i][i] = measures[i];
        sum += measures[i];
        for (int j = 0; j < count && sum > 0.0; j++) W[i][j] /= sum;
        if (sum == 0.0) W[i][i] = 1.0;
    }
}

static double second_modulus(int count, double W[NODES][NODES]) {
    double A[NODES * NODES], real[NODES], imaginary[NODES], first = 0.0, second = 0.0;
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++) A[i * count + j] = W[i][j];
    assert_int_equal(LAPACKE_dgeev(LAPACK_ROW_MAJOR, 'N', 'N', count, A, count, real, imaginary, NULL, count, NULL, count), 0);
    for (int i = 0; i < count; i++) {
        const double modulus = hypot(real[i], imaginary[i]);
        if (modulus > first) {
            second = first;
            first = modulus;
        } else if (modulus > second) {
            second = modulus;
        }
    }
    assert_true(fabs(first - 1.0) < 1e-12);
    return second;
}

static double spread_of(int count, double X[NODES][P]) {
    double spread = 0.0;
    for (int i = 1; i < count; i++)
        for (int k = 0; k < P; k++) spread = fmax(spread, fabs(X[i][k] - X[0][k]));
    return spread;
}

/* The network in double. link: what is on its way to a receiver from a sender, for the ratio consensus told with mass instead of running sums. */
typedef struct {
    int count, shares[NODES];
    double X[NODES][P], mass[NODES], link[NODES][NODES][P + 1];
} dense_t;

static void dense_give(dense_t *dense, int hears[NODES][NODES]) {
    for (int j = 0; j < dense->count; j++) {
        if (!dense->shares[j]) continue;
        const double parts = 1.0 + degree_of(dense->count, hears, j);
        dense->mass[j] /= parts;
        for (int k = 0; k < P; k++) dense->X[j][k] /= parts;
        for (int i = 0; i < dense->count; i++) {
            if (!hears[i][j]) continue;
            dense->link[i][j][P] += dense->mass[j];
            for (int k = 0; k < P; k++) dense->link[i][j][k] += dense->X[j][k];
        }
    }
}

static void dense_start(dense_t *dense, int count, double X[NODES][P], const double *mass) {
    memset(dense, 0, sizeof *dense);
    dense->count = count;
    for (int i = 0; i < count; i++) {
        memcpy(dense->X[i], X[i], sizeof X[i]);
        dense->mass[i] = mass[i];
        dense->shares[i] = 1;
    }
}

static void dense_iterate(dense_t *dense, int protocol, int hears[NODES][NODES], double weight[NODES][NODES], const int *measures,
                          int arrives[NODES][NODES]) {
    const int count = dense->count;
    if (protocol == MK_CONSENSUS_RATIO) {
        dense_give(dense, hears);
        for (int i = 0; i < count; i++) {
            dense->shares[i] = 0;
            for (int j = 0; j < count; j++) {
                if (!arrives[i][j]) continue;
                dense->shares[i] = 1;
                dense->mass[i] += dense->link[i][j][P];
                for (int k = 0; k < P; k++) dense->X[i][k] += dense->link[i][j][k];
                memset(dense->link[i][j], 0, sizeof dense->link[i][j]);
            }
        }
        return;
    }
    double W[NODES][NODES], X[NODES][P], mass[NODES];
    dense_matrix(protocol, count, hears, weight, measures, arrives, W);
    for (int i = 0; i < count; i++) {
        mass[i] = 0.0;
        for (int k = 0; k < P; k++) X[i][k] = 0.0;
        for (int j = 0; j < count; j++) {
            mass[i] += W[i][j] * dense->mass[j];
            for (int k = 0; k < P; k++) X[i][k] += W[i][j] * dense->X[j][k];
        }
    }
    memcpy(dense->X, X, sizeof X);
    memcpy(dense->mass, mass, sizeof mass);
}

#define PRECISION f32
#define REAL float
#define BITS 32
#include "consensus.tmpl.h"
#undef PRECISION
#undef REAL
#undef BITS

#define PRECISION f64
#define REAL double
#define BITS 64
#include "consensus.tmpl.h"

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {
        BOTH(dense), BOTH(limits), cmocka_unit_test(rate_f64), BOTH(loss), BOTH(changing), BOTH(order), BOTH(iterations), BOTH(alone), BOTH(refused), BOTH(no_mass),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
