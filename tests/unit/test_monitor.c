/* SPDX-License-Identifier: MIT */
/* <meshkal/monitor.h> against sums written out and solved in double by LAPACKE, and what it promises besides. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include <meshkal/monitor.h>

#include "generator.h"
#include "precision.h"

#define NAME2(name, function) JOIN(NAME(name), _##function)
#define NAME2_T(name, type) JOIN(NAME2(name, type), _t)
#define MK_WATCH_OF(name, real, m, slots, window) MK_WATCH(name, real, m, slots, window)
#define MK_MONITOR_OF(name, real, m, places, window) MK_MONITOR(name, real, m, places, window)
#define ONE(function) JOIN(NAME(one), _##function)
#define TWO(function) JOIN(NAME(two), _##function)
#define TEN(function) JOIN(NAME(ten), _##function)
#define DRIFT(function) JOIN(NAME(drift), _##function)
#define SMALL(function) JOIN(NAME(small), _##function)
#define MANY(function) JOIN(NAME(many), _##function)
#define SINGLE(function) JOIN(NAME(single), _##function)

#ifdef UNIT_LONG_RUN
enum { LONG_RUN = UNIT_LONG_RUN };
#else
enum { LONG_RUN = 1000000 };
#endif

enum { MOST_ROWS = 8, MOST_WINDOW = 10 };

typedef struct {
    int sensors;
    uint16_t id[MOST_ROWS];
    uint8_t rows[MOST_ROWS];
    double r[MOST_ROWS], S[MK_PACKED(MOST_ROWS)];
} epoch_t;

/* The window, oldest first. */
typedef struct {
    int count;
    epoch_t epoch[MOST_WINDOW];
} past_t;

/* Information of the window by sensor and row: id and row of each of n rows, J dense. */
typedef struct {
    int n;
    uint16_t id[MOST_ROWS];
    int row[MOST_ROWS];
    double J[MOST_ROWS * MOST_ROWS], v[MOST_ROWS];
} sums_t;

static void assert_close(double found, double expected, double tolerance) {
    if (fabs(found - expected) <= tolerance * (1.0 + fabs(expected))) return;
    print_error("%.17g is not %.17g\n", found, expected);
    fail();
}

static int rows_of(const epoch_t *epoch) {
    int n = 0;
    for (int l = 0; l < epoch->sensors; l++) n += epoch->rows[l];
    return n;
}

/* r ~ N(0, S) with a random S, rounded to float. */
static void draw_epoch(generator_t *g, epoch_t *epoch, double size) {
    double full[MOST_ROWS * MOST_ROWS], L[MOST_ROWS * MOST_ROWS], e[MOST_ROWS];
    const int n = rows_of(epoch);
    if (n == 0) return;
    draw_covariance_between(g, n, 0.3 * size, 3.0 * size, full);
    round_to_float(n * n, full);
    memcpy(L, full, sizeof L);
    assert_int_equal(LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, L, n), 0);
    for (int i = 0; i < n; i++) e[i] = draw_normal(g);
    for (int i = 0; i < n; i++) {
        epoch->r[i] = 0.0;
        for (int j = 0; j <= i; j++) {
            epoch->r[i] += L[i * n + j] * e[j];
            epoch->S[MK_PACKED(i) + j] = full[i * n + j];
        }
    }
    round_to_float(n, epoch->r);
}

/* The same for many: variances around `size`, one common part. */
static void quick_epoch(generator_t *g, epoch_t *epoch, double size) {
    const int n = rows_of(epoch);
    for (int i = 0; i < n; i++) {
        epoch->r[i] = draw_normal(g);
        for (int j = 0; j <= i; j++) epoch->S[MK_PACKED(i) + j] = size * (i == j ? draw_uniform(g, 1.0, 2.0) : 0.25);
    }
    round_to_float(n, epoch->r);
    round_to_float(MK_PACKED(n), epoch->S);
}

static void past_push(past_t *past, int window, const epoch_t *epoch) {
    if (past->count == window) memmove(past->epoch, past->epoch + 1, (size_t)--past->count * sizeof *epoch);
    past->epoch[past->count++] = *epoch;
}

/* How many sensors other than this one are in the window as it will be next, or in this epoch. */
static int past_others(const past_t *past, int window, const epoch_t *epoch, uint16_t id) {
    uint16_t seen[64];
    int count = 0;
    for (int t = past->count == window; t <= past->count; t++) {
        const epoch_t *const one = t < past->count ? past->epoch + t : epoch;
        for (int l = 0; l < one->sensors; l++) {
            int new = one->id[l] != id && (one->rows[l] > 0 || one == epoch);
            for (int k = 0; k < count; k++) new &= seen[k] != one->id[l];
            if (new) seen[count++] = one->id[l];
        }
    }
    return count;
}

/* Sum over the epochs from this one on. */
static void past_sum(const past_t *past, int from, sums_t *sums) {
    memset(sums, 0, sizeof *sums);
    for (int t = from; t < past->count; t++) {
        const epoch_t *const epoch = past->epoch + t;
        int at[MOST_ROWS] = {0}, n = 0;
        double Z[MOST_ROWS * MOST_ROWS];
        for (int l = 0; l < epoch->sensors; l++)
            for (int r = 0; r < epoch->rows[l]; r++) {
                int k = 0;
                while (k < sums->n && !(sums->id[k] == epoch->id[l] && sums->row[k] == r)) k++;
                sums->id[k] = epoch->id[l];
                sums->row[k] = r;
                if (k == sums->n) sums->n++;
                at[n++] = k;
            }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) Z[i * n + j] = epoch->S[i > j ? MK_PACKED(i) + j : MK_PACKED(j) + i];
        if (n == 0) continue;
        assert_int_equal(LAPACKE_dpotrf(LAPACK_ROW_MAJOR, 'L', n, Z, n), 0);
        assert_int_equal(LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', n, Z, n), 0);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                const double z = Z[i > j ? i * n + j : j * n + i];
                sums->J[at[i] * MOST_ROWS + at[j]] += z;
                sums->v[at[i]] += z * epoch->r[j];
            }
    }
    for (int i = 0; i < sums->n && MOST_ROWS != sums->n; i++) /* dense n x n */
        for (int j = 0; j < sums->n; j++) sums->J[i * sums->n + j] = sums->J[i * MOST_ROWS + j];
}

/* v' I^-1 v */
static double statistic(const sums_t *sums) {
    double A[MOST_ROWS * MOST_ROWS], x[MOST_ROWS], sum = 0.0;
    if (sums->n == 0) return 0.0;
    memcpy(A, sums->J, sizeof A);
    memcpy(x, sums->v, sizeof x);
    assert_int_equal(LAPACKE_dposv(LAPACK_ROW_MAJOR, 'L', sums->n, 1, A, sums->n, x, 1), 0);
    for (int i = 0; i < sums->n; i++) sum += x[i] * sums->v[i];
    return sum;
}

/* Statistic of the average offsets b = I^-1 v, with covariance I^-1, of all sensors but this one. */
static double without(const sums_t *sums, uint16_t id) {
    double A[MOST_ROWS * MOST_ROWS], x[MOST_ROWS], b[MOST_ROWS], c[MOST_ROWS], part[MOST_ROWS * MOST_ROWS], sum = 0.0;
    const int n = sums->n;
    int left = 0, at[MOST_ROWS] = {0};
    memcpy(A, sums->J, sizeof A);
    memcpy(x, sums->v, sizeof x);
    assert_int_equal(LAPACKE_dposv(LAPACK_ROW_MAJOR, 'L', n, 1, A, n, x, 1), 0);
    assert_int_equal(LAPACKE_dpotri(LAPACK_ROW_MAJOR, 'L', n, A, n), 0);
    for (int i = 0; i < n; i++)
        if (sums->id[i] != id) at[left++] = i;
    if (left == 0) return 0.0;
    for (int i = 0; i < left; i++) {
        b[i] = c[i] = x[at[i]];
        for (int j = 0; j < left; j++) part[i * left + j] = at[i] > at[j] ? A[at[i] * n + at[j]] : A[at[j] * n + at[i]];
    }
    assert_int_equal(LAPACKE_dposv(LAPACK_ROW_MAJOR, 'L', left, 1, part, left, c, 1), 0);
    for (int i = 0; i < left; i++) sum += b[i] * c[i];
    return sum;
}

#define PRECISION f32
#define REAL float
#include "monitor_reference.tmpl.h"
#include "monitor_bench.tmpl.h"
#include "monitor_contract.tmpl.h"
#include "monitor_schemes.tmpl.h"
#include "monitor_watch.tmpl.h"
#undef PRECISION
#undef REAL
#undef REFUSES
#undef MANY_CONFIG

#define PRECISION f64
#define REAL double
#include "monitor_reference.tmpl.h"
#include "monitor_bench.tmpl.h"
#include "monitor_contract.tmpl.h"
#include "monitor_schemes.tmpl.h"
#include "monitor_watch.tmpl.h"

#define BOTH(name) cmocka_unit_test(name##_f32), cmocka_unit_test(name##_f64)

int main(void) {
    const struct CMUnitTest tests[] = {
        BOTH(windows),  BOTH(no_drift),       BOTH(start_refused), BOTH(not_started), BOTH(refused_epochs), BOTH(nothing_read), BOTH(places),
        BOTH(rows_vary), BOTH(alarms),        BOTH(improved),      BOTH(improved_quiet), BOTH(exclude),     BOTH(taken_back),   BOTH(another_value),
        BOTH(all_faulty), BOTH(unresolved), BOTH(leap), BOTH(run_away),   BOTH(isolation),     BOTH(alone),       BOTH(watching), BOTH(two_offsets),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
