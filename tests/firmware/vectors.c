/* SPDX-License-Identifier: MIT */
#include "vectors.h"

#include <math.h>
#include <string.h>

#include <meshkal/gamma.h>
#include <meshkal/quantile.h>

enum { N = 9, M = 3, SLOTS = 4, STEPS = 6 };
/* Largest products over the dimensions below: slots * m * n, slots * packed n. */
enum { ALL_C = 2 * 3 * 9, ALL_S = 2 * MK_PACKED(9) };

/* Exponents of two: largest change of units, and a matrix A that overflows P. */
#if MK_BITS == 32
enum { SCALE = 24, OVERFLOW = 80 };
#else
enum { SCALE = 200, OVERFLOW = 700 };
#endif

static const MK_REAL not_a_number = (MK_REAL)NAN;
static const MK_REAL infinite = (MK_REAL)INFINITY;

/* --- dimensions ----------------------------------------------------------------------------------------------------------- */

#define TYPED(real, number, n, m, slots)                                                                                      \
    MK_RKFD_UNROLLED(filter##number, real, n, m, slots);                                                                      \
    static filter##number##_t object##number;                                                                                 \
    static MK_F_T(mk_rkfd_view) view##number(MK_REAL *work) { return filter##number##_view(&object##number, work); }          \
    static mk_status_t incremental##number(const MK_REAL *input) { return filter##number##_incremental(&object##number, input); } \
    static mk_status_t diffuse##number(void) { return filter##number##_diffuse(&object##number); }

#if MK_BITS == 32
#define DIMENSIONS(number, n, m, slots) TYPED(f32, number, n, m, slots)
#else
#define DIMENSIONS(number, n, m, slots) TYPED(f64, number, n, m, slots)
#endif

DIMENSIONS(0, 1, 1, 1)
DIMENSIONS(1, 2, 1, 2)
DIMENSIONS(2, 4, 1, 4)
DIMENSIONS(3, 6, 2, 4)
DIMENSIONS(4, 9, 3, 2)

typedef struct {
    int n, m, slots;
    MK_F_T(mk_rkfd_view) (*view)(MK_REAL *work);
    mk_status_t (*incremental)(const MK_REAL *input);
    mk_status_t (*diffuse)(void);
} dimensions_t;

static const dimensions_t dimensions[] = {
    {1, 1, 1, view0, incremental0, diffuse0}, {2, 1, 2, view1, incremental1, diffuse1}, {4, 1, 4, view2, incremental2, diffuse2},
    {6, 2, 4, view3, incremental3, diffuse3}, {9, 3, 2, view4, incremental4, diffuse4},
};

const char *const vectors_passes[2] = {"shared kernels", "unrolled kernels"};
static vectors_kernels_t kernels;
static const dimensions_t *now;
static MK_F_T(mk_rkfd_view) view;

static mk_status_t incremental(const MK_REAL *input) {
    return kernels == VECTORS_UNROLLED ? now->incremental(input) : MK_F(mk_rkfd_incremental)(now->n, now->m, now->slots, &view, input);
}

static mk_status_t diffuse(void) {
    return kernels == VECTORS_UNROLLED ? now->diffuse() : MK_F(mk_rkfd_diffuse)(now->n, now->slots, &view);
}

/* --- gamma ---------------------------------------------------------------------------------------------------------------- */

static void tell_root(int n, const MK_REAL *P, MK_REAL c) {
    MK_REAL work[MK_GAMMA_WORK(N)], theta = MK_R(-7.0), gamma = MK_R(-7.0), slope = MK_R(-7.0);
    vector_word("evaluations", (uint32_t)MK_F(mk_gamma_root)(n, P, c, &theta, work));
    vector_numbers("theta", 1, &theta);
    vector_word("gamma found", (uint32_t)MK_F(mk_gamma)(n, P, theta, &gamma, &slope, work));
    vector_numbers("gamma", 1, &gamma);
    vector_numbers("slope", 1, &slope);
}

static void gamma_vectors(void) {
    static const MK_REAL tolerance[] = {MK_R(1e-9), MK_R(1e-6), MK_R(1e-3), MK_R(0.02), MK_R(1.0), MK_R(10.0)};
    static const int spread[] = {0, 3, MK_BITS / 4}, scale[] = {0, -2 * SCALE, 2 * SCALE};
    const int n = now->n;
    MK_REAL P[MK_PACKED(N)];
    int number = 0;
    for (int c = 0; c < 6; c++) {
        for (int s = 0; s < 3; s++) {
            vector_begin("gamma root", n, 0, 0, number++);
            draw_covariance(n, spread[s], power(scale[(c + s) % 3]), P);
            vector_numbers("P", MK_PACKED(n), P);
            tell_root(n, P, tolerance[c]);
        }
    }
    const MK_REAL wrong[] = {MK_R(0.0), MK_R(-1.0), not_a_number, infinite};
    for (int i = 0; i < 4; i++) {
        vector_begin("gamma root, wrong c", n, 0, 0, i);
        draw_covariance(n, 2, MK_R(1.0), P);
        tell_root(n, P, wrong[i]);
    }
    for (int i = 0; i < 4; i++) {
        vector_begin("gamma root, wrong P", n, 0, 0, i);
        draw_covariance(n, 2, MK_R(1.0), P);
        P[MK_AT(n - 1, draw_below(n))] = i ? wrong[i] : MK_R(-100.0);
        P[MK_AT(n - 1, n - 1)] = wrong[i];
        tell_root(n, P, MK_R(0.1));
    }
}

/* --- sensors -------------------------------------------------------------------------------------------------------------- */

static MK_REAL work[MK_RKFD_WORK(N, M) > MK_RKFD_PREDICT_WORK(N, M) ? MK_RKFD_WORK(N, M) : MK_RKFD_PREDICT_WORK(N, M)];

static void tell_sensor(int rows, const MK_REAL *C, const MK_REAL *R) {
    const int n = now->n, m = now->m;
    MK_REAL F[M * N], S[MK_PACKED(N)], R_inverse[MK_PACKED(M)];
    for (int i = 0; i < M * N; i++) F[i] = MK_R(-7.0);
    for (int i = 0; i < MK_PACKED(N); i++) S[i] = MK_R(-7.0);
    for (int i = 0; i < MK_PACKED(M); i++) R_inverse[i] = MK_R(-7.0);
    vector_word("status", (uint32_t)MK_F(mk_rkfd_sensor)(n, m, rows, C, R, F, S, R_inverse, work));
    vector_numbers("F", m * n, F);
    vector_numbers("S", MK_PACKED(n), S);
    vector_numbers("R inverse", MK_PACKED(m), R_inverse);
}

static void sensor_vectors(void) {
    static const int scale[] = {0, -SCALE, SCALE};
    const int n = now->n, m = now->m;
    MK_REAL C[M * N], R[MK_PACKED(M)];
    for (int i = 0; i < 12; i++) {
        const int rows = i < 6 ? (i < 2 ? m : draw_below(m + 1)) : i == 11 ? m + 1 : m;
        draw_many(m * n, power(scale[i % 3]), C);
        for (int k = rows * n; k < m * n; k++) C[k] = MK_R(0.0);
        draw_covariance(m, 2, power(-scale[i % 3]), R);
        vector_begin("sensor", n, m, 0, i);
        vector_numbers("C", m * n, C);
        vector_numbers("R", MK_PACKED(m), R);
        if (i == 6) C[draw_below(m * n)] = not_a_number;
        if (i == 7) C[draw_below(m * n)] = -infinite;
        if (i == 8) R[MK_AT(m - 1, m - 1)] = MK_R(-1.0);
        if (i == 9) R[draw_below(MK_PACKED(m))] = not_a_number;
        if (i == 10) C[draw_below(m * n)] = MK_LARGEST;
        tell_sensor(rows, C, R);
    }
}

/* --- the filter ----------------------------------------------------------------------------------------------------------- */

static MK_F_T(mk_rkfd_config) config;
static MK_REAL A[N * N], Q[MK_PACKED(N)], input[N], x0[N], P0[MK_PACKED(N)], weight[SLOTS];
static MK_REAL C[ALL_C], F[ALL_C], S[ALL_S], R_inverse[SLOTS * MK_PACKED(M)];
static uint8_t rows[SLOTS];

/* A model whose states are measured in units of 2^-scale. */
static void draw_model(int scale, MK_REAL tolerance) {
    const int n = now->n, m = now->m, slots = now->slots;
    MK_REAL sum = MK_R(0.0), R[MK_PACKED(M)];
    draw_many(n * n, MK_R(0.5), A);
    for (int i = 0; i < n; i++) A[i * n + i] += MK_R(0.75);
    draw_covariance(n, 2, power(2 * scale - 5), Q);
    draw_many(n, power(scale - 4), input);
    draw_many(n, power(scale), x0);
    draw_covariance(n, 2, power(2 * scale), P0);
    for (int l = 0; l < slots; l++) sum += weight[l] = MK_R(1.0) + (l ? draw() : MK_R(0.0));
    for (int l = 0; l < slots; l++) weight[l] /= sum;
    for (int l = 0; l < slots; l++) {
        rows[l] = (uint8_t)(l ? 1 + draw_below(m) : m);
        draw_many(m * n, power(-scale), C + l * m * n);
        for (int k = rows[l] * n; k < m * n; k++) C[l * m * n + k] = MK_R(0.0);
        draw_covariance(m, 1, MK_R(0.5), R);
        vector_word("sensor", (uint32_t)MK_F(mk_rkfd_sensor)(n, m, rows[l], C + l * m * n, R, F + l * m * n, S + l * MK_PACKED(n),
                                                             R_inverse + l * MK_PACKED(m), work));
    }
    const MK_F_T(mk_rkfd_config) made = {(uint16_t)n, (uint16_t)m, (uint16_t)slots, A, Q, draw_below(2) ? input : NULL, x0, P0, weight, rows,
                                         C, F, S, R_inverse, tolerance, 0};
    config = made;
}

/* Everything that a step leaves. */
static void tell_filter(mk_status_t status) {
    const MK_F_T(mk_rkfd) *const core = view.core;
    const MK_REAL numbers[4] = {core->tolerance, core->theta, core->trace_P, core->nis};
    vector_word("status", (uint32_t)status);
    vector_numbers("tolerance, theta, trace P, nis", 4, numbers);
    vector_word("rows of nis", core->nis_rows);
    vector_word("iterations", core->iterations);
    vector_word("measurements", core->measurements);
    vector_word("estimates", core->estimates);
    vector_word("steps since measurement", core->steps_since_measurement);
    vector_word("steps, rejected", core->steps << 16 | core->rejected);
    vector_word("faults, stage", (uint32_t)core->faults << 16 | core->stage);
    vector_numbers("x", now->n, view.x);
    vector_numbers("W", MK_PACKED(now->n), view.W);
    vector_numbers("psi", now->n, view.psi);
}

static void put_readings(int t) {
    const int n = now->n, m = now->m, first = draw_below(now->slots);
    MK_REAL y[M], e[M], variance[MK_PACKED(M)];
    for (int i = 0; i < now->slots; i++) {
        const int l = (first + i) % now->slots;
        draw_many(m, MK_R(2.0), y);
        for (int r = rows[l]; r < m; r++) y[r] = not_a_number; /* not read */
        /* All in the first step, none in the second, then 20 % are lost. */
        if (t == 1 || (t > 1 && draw_below(5) == 0)) continue;
        vector_word("put", (uint32_t)MK_F(mk_rkfd_put)(n, m, &view, l, y, draw_below(4) == 0));
        const mk_status_t status = MK_F(mk_rkfd_predict)(n, m, &view, l, e, variance);
        vector_word("predict", (uint32_t)status);
        if (status != MK_OK) continue;
        vector_numbers("innovation", m, e);
        vector_numbers("its variance", MK_PACKED(m), variance);
        if (t % 3 == 2) vector_word("put again", (uint32_t)MK_F(mk_rkfd_put)(n, m, &view, l, y, 0));
    }
    if (t != 2) return;
    y[0] = not_a_number;
    vector_word("put NaN", (uint32_t)MK_F(mk_rkfd_put)(n, m, &view, 0, y, 0));
    vector_word("put nowhere", (uint32_t)MK_F(mk_rkfd_put)(n, m, &view, now->slots, y, 0));
    vector_word("diffuse too early", (uint32_t)diffuse());
    vector_word("estimate too early", (uint32_t)MK_F(mk_rkfd_put_estimate)(n, &view, 1, x0));
}

static void put_estimates(int t) {
    MK_REAL psi[N];
    for (int l = 1; l < now->slots; l++) {
        for (int i = 0; i < now->n; i++) psi[i] = view.psi[i] + P0[MK_AT(i, i)] * draw();
        if (t == 1 || draw_below(5) == 0) continue;
        vector_word("put estimate", (uint32_t)MK_F(mk_rkfd_put_estimate)(now->n, &view, l, psi));
    }
    if (t != 2) return;
    psi[now->n - 1] = infinite;
    vector_word("put infinite estimate", (uint32_t)MK_F(mk_rkfd_put_estimate)(now->n, &view, 1, psi));
    vector_word("put own estimate", (uint32_t)MK_F(mk_rkfd_put_estimate)(now->n, &view, 0, x0));
    vector_word("incremental too early", (uint32_t)incremental(NULL));
}

static void one_step(int t) {
    MK_REAL V[MK_PACKED(N)], r[N];
    put_readings(t);
    draw_many(now->n, power(-3), r);
    tell_filter(incremental(t % 2 ? r : NULL));
    put_estimates(t);
    tell_filter(diffuse());
    const mk_status_t status = MK_F(mk_rkfd_covariance)(now->n, &view, V);
    vector_word("covariance", (uint32_t)status);
    if (status == MK_OK) vector_numbers("V", MK_PACKED(now->n), V);
}

static mk_status_t start(void) { return MK_F(mk_rkfd_start)(now->n, now->m, now->slots, &view, &config); }

static void filter_run(int number, MK_REAL tolerance, int scale) {
    vector_begin("filter", now->n, now->m, now->slots, number);
    draw_model(scale, tolerance);
    tell_filter(start());
    for (int t = 0; t < STEPS; t++) {
        one_step(t);
        if (t == 3) {
            vector_word("set tolerance", (uint32_t)MK_F(mk_rkfd_set_tolerance)(view.core, tolerance * MK_R(1.5)));
            vector_word("set negative tolerance", (uint32_t)MK_F(mk_rkfd_set_tolerance)(view.core, MK_R(-1.0)));
            vector_word("set no tolerance", (uint32_t)MK_F(mk_rkfd_set_tolerance)(view.core, not_a_number));
        }
        if (t == 4) {
            MK_REAL P[MK_PACKED(N)];
            draw_covariance(now->n, 2, power(2 * scale), P);
            tell_filter(MK_F(mk_rkfd_restart)(now->n, now->slots, &view, input, P));
            P[MK_AT(now->n - 1, now->n - 1)] = MK_R(0.0);
            tell_filter(MK_F(mk_rkfd_restart)(now->n, now->slots, &view, x0, P));
        }
    }
}

/* A start that is refused, or a step that fails and leaves all as it was. */
static void filter_failure(int number) {
    const int n = now->n;
    vector_begin("filter, failing", n, now->m, now->slots, number);
    draw_model(0, MK_R(0.05));
    if (number == 0) config.n++;
    if (number == 1) weight[0] = MK_R(-0.1);
    if (number == 2) A[n * n - 1] = not_a_number;
    if (number == 3) P0[MK_AT(n - 1, n - 1)] = MK_R(-1.0);
    if (number == 4) x0[0] = infinite;
    if (number == 5) config.tolerance = MK_R(-0.05);
    if (number == 6) Q[MK_AT(n - 1, n - 1)] = MK_R(-100.0);
    if (number == 7) A[0] = power(OVERFLOW);
    if (number == 8) A[0] = MK_LARGEST;
    if (number == 9) config.tolerance = MK_LARGEST;
    vector_word("start", (uint32_t)start());
    if (number < 6) return;
    one_step(0);
    one_step(1);
}

static void filter_vectors(void) {
    static const MK_REAL tolerance[] = {MK_R(0.0), MK_R(1e-9), MK_R(1e-6), MK_R(1e-3), MK_R(0.02), MK_R(1.0), MK_R(10.0)};
    for (int c = 0; c < 7; c++) filter_run(c, tolerance[c], 0);
    filter_run(7, MK_R(0.02), -SCALE);
    filter_run(8, MK_R(0.02), SCALE);
    for (int i = 0; i < 10; i++) filter_failure(i);
}

/* --- quantiles: double only, and not in the image that promises single precision ------------------------------------------ */

#if MK_BITS == 64
static void quantile_vectors(void) {
    /* Every method: below, about and beyond the change from few degrees to many; near the middle and far from it. */
    static const double degrees[] = {0.5, 1.0, 2.0, 3.0, 9.5, 119.0, 130.0, 5000.25, 1e6};
    for (int i = 0; i < 9; i++) {
        vector_begin("quantile", 0, 0, 0, i);
        for (int j = 0; j < 8; j++) {
            double p = 0.5 + 0.5 * draw();
            /* Not near 2^-33: there libgcc's 1 - p differs on Cortex-M4F and M33. */
            if (j > 3) p = p * power(-40 * (j - 3));
            const double tails[2] = {p, 1.0 - p};
            double x[4], again[4];
            for (int k = 0; k < 2; k++) {
                x[k] = mk_chi2_quantile(tails[k], degrees[i]);
                x[2 + k] = mk_student_quantile(tails[k], degrees[i]);
                again[k] = mk_chi2_tail(x[k], degrees[i]);
                again[2 + k] = mk_student_tail(x[2 + k], degrees[i]);
            }
            vector_numbers("tail", 1, tails);
            vector_numbers("quantiles", 4, x);
            vector_numbers("their tails", 4, again);
        }
    }
}
#endif

void vectors_run(vectors_kernels_t chosen) {
    kernels = chosen;
    draw_seed(20250117);
    for (now = dimensions; now < dimensions + sizeof dimensions / sizeof dimensions[0]; now++) {
        /* Whatever was run before on this object. */
        view = now->view(work);
        memset(view.core, 0, sizeof *view.core);
        memset(view.x, 0, (size_t)now->n * sizeof *view.x);
        memset(view.W, 0, (size_t)MK_PACKED(now->n) * sizeof *view.W);
        memset(view.psi, 0, (size_t)now->n * sizeof *view.psi);
        gamma_vectors();
        sensor_vectors();
        filter_vectors();
    }
    vectors_models();
#if MK_BITS == 64
    quantile_vectors();
#endif
}
