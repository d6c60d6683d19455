/* SPDX-License-Identifier: MIT */
/* Dense algebra of the central unit on matrices built to have known answers, in random orthogonal bases. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "dense.h"
#include "random.h"

enum { LARGEST = 8 };
#define PACKED(n) ((n) * ((n) + 1) / 2)
#define AT(i, j) ((i) * ((i) + 1) / 2 + (j))

static mk_random_t source;
static double draw(void) { return mk_random_normal(&source); }

/* Random orthogonal matrix, rows by Gram-Schmidt, twice for its rounding. */
static void draw_orthogonal(int n, double *U) {
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) U[i * n + j] = draw();
        for (int pass = 0; pass < 2; pass++) {
            double size = 0.0;
            for (int k = 0; k < i; k++) {
                double dot = 0.0;
                for (int j = 0; j < n; j++) dot += U[i * n + j] * U[k * n + j];
                for (int j = 0; j < n; j++) U[i * n + j] -= dot * U[k * n + j];
            }
            for (int j = 0; j < n; j++) size += U[i * n + j] * U[i * n + j];
            for (int j = 0; j < n; j++) U[i * n + j] /= sqrt(size);
        }
    }
}

/* to = U' M U, full matrices. */
static void change_basis(int n, const double *U, const double *M, double *to) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            to[i * n + j] = 0.0;
            for (int a = 0; a < n; a++)
                for (int b = 0; b < n; b++) to[i * n + j] += U[a * n + i] * M[a * n + b] * U[b * n + j];
        }
}

static void pack(int n, const double *full, double *S) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) S[AT(i, j)] = full[i * n + j];
}

static void eigen_symmetric(void **unused) {
    (void)unused;
    mk_random_start(&source, 21, 0, 0, 0, MK_DRAW_NETWORK);
    for (int n = 1; n <= LARGEST; n++) {
        double U[LARGEST * LARGEST], D[LARGEST * LARGEST] = {0}, full[LARGEST * LARGEST], S[PACKED(LARGEST)];
        double values[LARGEST], alone[LARGEST], vectors[LARGEST * LARGEST];
        draw_orthogonal(n, U);
        for (int i = 0; i < n; i++) D[i * n + i] = i - 2.0 + 0.5 * (i > 3); /* negative, zero and positive */
        change_basis(n, U, D, full);
        pack(n, full, S);
        assert_int_equal(mk_eigen_symmetric(n, S, values, vectors), 1);
        assert_int_equal(mk_eigen_symmetric(n, S, alone, NULL), 1);
        for (int i = 0; i < n; i++) {
            assert_true(fabs(values[i] - D[i * n + i]) < 1e-13 && fabs(alone[i] - values[i]) < 1e-13);
            double size = 0.0;
            for (int j = 0; j < n; j++) {
                double image = -values[i] * vectors[i * n + j];
                for (int k = 0; k < n; k++) image += full[j * n + k] * vectors[i * n + k];
                assert_true(fabs(image) < 1e-13);
                size += vectors[i * n + j] * vectors[i * n + j];
            }
            assert_true(fabs(size - 1.0) < 1e-13);
        }
    }
}

/* S = L U' D U L' and B = L L': B^-1 S is similar to D. */
static void eigen_generalised(void **unused) {
    (void)unused;
    mk_random_start(&source, 22, 0, 0, 0, MK_DRAW_NETWORK);
    for (int n = 1; n <= LARGEST; n++) {
        double U[LARGEST * LARGEST], D[LARGEST * LARGEST] = {0}, inner[LARGEST * LARGEST], L[LARGEST * LARGEST] = {0};
        double full[LARGEST * LARGEST], B[PACKED(LARGEST)] = {0}, S[PACKED(LARGEST)], values[LARGEST];
        draw_orthogonal(n, U);
        for (int i = 0; i < n; i++) {
            D[i * n + i] = 0.25 * i * i - 1.0;
            for (int j = 0; j <= i; j++) L[j * n + i] = i == j ? 1.5 : 0.3 * draw(); /* L' */
        }
        change_basis(n, U, D, inner);
        change_basis(n, L, inner, full);
        pack(n, full, S);
        for (int i = 0; i < n; i++)
            for (int j = 0; j <= i; j++)
                for (int k = 0; k < n; k++) B[AT(i, j)] += L[k * n + i] * L[k * n + j];
        assert_int_equal(mk_eigen_generalised(n, S, B, values), 1);
        for (int i = 0; i < n; i++) assert_true(fabs(values[i] - D[i * n + i]) < 1e-11);
        B[AT(n - 1, n - 1)] = -1.0;
        assert_int_equal(mk_eigen_generalised(n, S, B, values), 0);
    }
}

/* mk_unobservable of (A, C'C) after a random orthogonal change of basis; C has one row that picks out the given state. */
static int unobservable(int n, const double *A, const int *measured, int count, double scale) {
    double U[LARGEST * LARGEST], G[LARGEST * LARGEST] = {0}, turned_A[LARGEST * LARGEST], turned_G[LARGEST * LARGEST], S[PACKED(LARGEST)];
    for (int i = 0; i < count; i++) G[measured[i] * n + measured[i]] = scale * (1.0 + i);
    draw_orthogonal(n, U);
    change_basis(n, U, A, turned_A);
    change_basis(n, U, G, turned_G);
    pack(n, turned_G, S);
    return mk_unobservable(n, turned_A, S);
}

/* One Jordan block, not diagonalisable: state i is driven by state i + 1, so measuring state j shows j, j + 1, .. and hides j states. */
static void hidden_in_a_chain(void **unused) {
    static const double eigenvalue[] = {0.0, 0.5, 1.0, -1.1}, scale[] = {1e-9, 1.0, 1e9}, coupling[] = {0.01, 1.0};
    (void)unused;
    mk_random_start(&source, 23, 0, 0, 0, MK_DRAW_NETWORK);
    for (int n = 1; n <= 6; n++)
        for (int e = 0; e < 4; e++)
            for (int j = 0; j < n; j++)
                for (int s = 0; s < 6; s++) {
                    double A[LARGEST * LARGEST] = {0};
                    for (int i = 0; i < n; i++) {
                        A[i * n + i] = eigenvalue[e];
                        if (i + 1 < n) A[i * n + i + 1] = coupling[s % 2];
                    }
                    assert_int_equal(unobservable(n, A, &j, 1, scale[s / 2]), j);
                }
}

/* [visible 0; coupling hidden]: what the visible part does to the hidden one is not seen either. */
static void hidden_block(void **unused) {
    (void)unused;
    mk_random_start(&source, 24, 0, 0, 0, MK_DRAW_NETWORK);
    for (int n = 2; n <= LARGEST; n++)
        for (int hidden = 0; hidden < n; hidden++)
            for (int trial = 0; trial < 10; trial++) {
                double A[LARGEST * LARGEST];
                const int seen = n - hidden, measured[2] = {0, seen - 1};
                for (int i = 0; i < n; i++)
                    for (int j = 0; j < n; j++) A[i * n + j] = i < seen && j >= seen ? 0.0 : draw();
                assert_int_equal(unobservable(n, A, measured, seen > 1 ? 2 : 1, 1.0), hidden);
            }
}

static void hidden_extremes(void **unused) {
    (void)unused;
    const int n = 4, all[4] = {0, 1, 2, 3};
    double A[16] = {0};
    mk_random_start(&source, 25, 0, 0, 0, MK_DRAW_NETWORK);
    /* Equal modes: one measured row tells one combination of them. */
    for (int i = 0; i < n; i++) A[i * n + i] = 0.9;
    assert_int_equal(unobservable(n, A, all, 1, 1.0), 3);
    assert_int_equal(unobservable(n, A, all, 3, 1.0), 1);
    assert_int_equal(unobservable(n, A, all, 4, 1.0), 0);
    assert_int_equal(unobservable(n, A, all, 0, 1.0), 4);
    memset(A, 0, sizeof A);
    assert_int_equal(unobservable(n, A, all, 2, 1.0), 2);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(eigen_symmetric), cmocka_unit_test(eigen_generalised),
                                       cmocka_unit_test(hidden_in_a_chain), cmocka_unit_test(hidden_block),
                                       cmocka_unit_test(hidden_extremes)};
    return cmocka_run_group_tests_name("test_dense", tests, NULL, NULL);
}
