/* SPDX-License-Identifier: MIT */
/* The distributed unscented information filter: networks against Kalman filters in double, written out here with LAPACK, and what a node takes
   and refuses. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/duif.h>

#include "generator.h"
#include "precision.h"
#include "reference.h"
#include "wire.h"

#define MK_DUIF_OF(name, real, n, m, slots) MK_DUIF(name, real, n, m, slots)

enum { N = 4, M = 2, NODES = 5, MODEL = 0x2b5c81e7 };

static void path_graph(int count, int hears[NODES][NODES]) {
    memset(hears, 0, sizeof(int[NODES][NODES]));
    for (int i = 0; i + 1 < count; i++) hears[i][i + 1] = hears[i + 1][i] = 1;
}

static void draw_graph(generator_t *g, int count, int hears[NODES][NODES]) {
    memset(hears, 0, sizeof(int[NODES][NODES]));
    for (int i = 1; i < count; i++) {
        const int j = draw_below(g, i);
        hears[i][j] = hears[j][i] = 1;
    }
    for (int i = 0; i < count; i++)
        for (int j = 0; j < i; j++)
            if (draw_chance(g, 0.3)) hears[i][j] = hears[j][i] = 1;
}

/* x := A x, P := A P A' + Q */
static void dense_move(const double *A, const double *Q, double *x, double *P) {
    double moved[N], AP[N * N];
    for (int i = 0; i < N; i++) {
        moved[i] = 0.0;
        for (int j = 0; j < N; j++) {
            moved[i] += A[i * N + j] * x[j];
            AP[i * N + j] = 0.0;
            for (int k = 0; k < N; k++) AP[i * N + j] += A[i * N + k] * P[k * N + j];
        }
    }
    memcpy(x, moved, sizeof moved);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            P[i * N + j] = Q[i * N + j];
            for (int k = 0; k < N; k++) P[i * N + j] += AP[i * N + k] * A[j * N + k];
        }
}

/* The textbook update in gain form. */
static void dense_update(int rows, const double *H, const double *R, const double *z, double *x, double *P) {
    double PH[N * M], E[M * M], inverse[M * M], K[N * M], e[M];
    for (int r = 0; r < rows; r++) {
        e[r] = z[r];
        for (int i = 0; i < N; i++) {
            e[r] -= H[r * N + i] * x[i];
            PH[i * M + r] = 0.0;
            for (int k = 0; k < N; k++) PH[i * M + r] += P[i * N + k] * H[r * N + k];
        }
    }
    for (int r = 0; r < rows; r++)
        for (int s = 0; s < rows; s++) {
            E[r * rows + s] = R[r * rows + s];
            for (int i = 0; i < N; i++) E[r * rows + s] += H[r * N + i] * PH[i * M + s];
        }
    reference_inverse(rows, E, inverse);
    for (int i = 0; i < N; i++)
        for (int r = 0; r < rows; r++) {
            K[i * M + r] = 0.0;
            for (int s = 0; s < rows; s++) K[i * M + r] += PH[i * M + s] * inverse[s * rows + r];
        }
    for (int i = 0; i < N; i++)
        for (int r = 0; r < rows; r++) {
            x[i] += K[i * M + r] * e[r];
            for (int j = 0; j < N; j++) P[i * N + j] -= K[i * M + r] * PH[j * M + r];
        }
}

/* s += H' R^-1 z, S += H' R^-1 H */
static void dense_information(int rows, const double *H, const double *R, const double *z, double *s, double *S) {
    double inverse[M * M];
    reference_inverse(rows, R, inverse);
    for (int i = 0; i < N; i++)
        for (int r = 0; r < rows; r++)
            for (int q = 0; q < rows; q++) {
                s[i] += H[r * N + i] * inverse[r * rows + q] * z[q];
                for (int j = 0; j < N; j++) S[i * N + j] += H[r * N + i] * inverse[r * rows + q] * H[q * N + j];
            }
}

/* P^-1 := P^-1 + S, x := P (P_old^-1 x + s) */
static void dense_inform(double *x, double *P, const double *s, const double *S) {
    double Y[N * N], y[N];
    reference_inverse(N, P, Y);
    for (int i = 0; i < N; i++) {
        y[i] = s[i];
        for (int j = 0; j < N; j++) y[i] += Y[i * N + j] * x[j];
    }
    for (int k = 0; k < N * N; k++) Y[k] += S[k];
    reference_inverse(N, Y, P);
    for (int i = 0; i < N; i++) {
        x[i] = 0.0;
        for (int j = 0; j < N; j++) x[i] += P[i * N + j] * y[j];
    }
}

/* Adds the information of a range by Julier's transform with n + kappa = 3, as spec 4.1 has it; paper: without its residual. */
static void dense_range(int paper, double px, double py, double R, double z, const double *x, const double *P, double *s, double *S) {
    double L[N * N] = {0.0}, point[2 * N + 1][N], h[2 * N + 1], mean = 0.0, variance = 0.0, cross[N] = {0.0}, inverse[N * N], H[N], HPH = 0.0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++) {
            double sum = P[i * N + j];
            for (int k = 0; k < j; k++) sum -= L[i * N + k] * L[j * N + k];
            L[i * N + j] = i == j ? sqrt(sum) : sum / L[j * N + j];
        }
    for (int j = 0; j < 2 * N + 1; j++) {
        for (int i = 0; i < N; i++) point[j][i] = x[i] + (j == 0 ? 0.0 : (j <= N ? 1.0 : -1.0) * sqrt(3.0) * L[i * N + (j - 1) % N]);
        h[j] = hypot(point[j][0] - px, point[j][1] - py);
        mean += (j == 0 ? -1.0 / 3.0 : 1.0 / 6.0) * h[j];
    }
    for (int j = 0; j < 2 * N + 1; j++) {
        const double weight = j == 0 ? -1.0 / 3.0 : 1.0 / 6.0;
        variance += weight * (h[j] - mean) * (h[j] - mean);
        for (int i = 0; i < N; i++) cross[i] += weight * (point[j][i] - x[i]) * (h[j] - mean);
    }
    reference_inverse(N, P, inverse);
    for (int i = 0; i < N; i++) {
        H[i] = 0.0;
        for (int k = 0; k < N; k++) H[i] += inverse[i * N + k] * cross[k];
    }
    for (int i = 0; i < N; i++) HPH += H[i] * cross[i];
    const double noise = paper ? R : R + variance - HPH;
    double level = z - mean;
    for (int i = 0; i < N; i++) level += H[i] * x[i];
    for (int i = 0; i < N; i++) {
        s[i] += H[i] / noise * level;
        for (int k = 0; k < N; k++) S[i * N + k] += H[i] / noise * H[k];
    }
}

#define PRECISION f32
#define REAL float
#define BITS 32
#include "duif_network.tmpl.h"
#include "duif_frames.tmpl.h"
#include "duif_steps.tmpl.h"
#undef PRECISION
#undef REAL
#undef BITS

#define PRECISION f64
#define REAL double
#define BITS 64
#include "duif_network.tmpl.h"
#include "duif_frames.tmpl.h"
#include "duif_steps.tmpl.h"

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {
        BOTH(kalman), BOTH(central), BOTH(kalman_consensus), BOTH(isolated), BOTH(short_numbers), BOTH(same_bits), BOTH(sent),
        BOTH(damaged), BOTH(causes), BOTH(masses), BOTH(sealed), BOTH(behind), BOTH(hostile), BOTH(overflow), BOTH(turns),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
