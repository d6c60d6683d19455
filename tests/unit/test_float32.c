/* SPDX-License-Identifier: MIT */
/* The published example (spec 1.9) as a network of 20 nodes in float32 beside the same network in float64, for 1e5 steps.
   Model and measurements are floats, so both get the same numbers and only the arithmetic differs. Gravity alone would carry the
   position away without bound, and float32 with it: here the known input r(t) also holds a thrust that keeps the true state within
   some tens of units. One reading and one estimate in ten are lost. The size that the difference is related to is the root mean
   square of the true state over all components and steps. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <meshkal/unrolled.h>

#include "generator.h"

#ifndef UNIT_LONG_RUN
#define UNIT_LONG_RUN 100000
#endif

enum { NODES = 20, STATES = 6, ROWS = 2, SLOTS = 9, PACKED = MK_PACKED(STATES), EDGES = 40 /* mean degree 5, itself included */ };

MK_RKFD_UNROLLED(single, f32, 6, 2, 9);
MK_RKFD_UNROLLED(twice, f64, 6, 2, 9);

/* One sensor's constants in both precisions. */
typedef struct {
    float C[12], F[12], S[PACKED], R_inverse[3];
    double C_twice[12], F_twice[12], S_twice[PACKED], R_inverse_twice[3];
    double deviation[ROWS];
    int component[ROWS];
} sensor_t;

typedef struct {
    int slots, heard[SLOTS]; /* heard[0] is the node itself */
    uint8_t rows[SLOTS];
    float weight[SLOTS], C[SLOTS * 12], F[SLOTS * 12], S[SLOTS * PACKED], R_inverse[SLOTS * 3];
    double weight_twice[SLOTS], C_twice[SLOTS * 12], F_twice[SLOTS * 12], S_twice[SLOTS * PACKED], R_inverse_twice[SLOTS * 3];
    single_config_t config;
    twice_config_t config_twice;
    single_t filter;
    twice_t filter_twice;
} station_t;

static float A[36], Q[PACKED], P0[PACKED], x0[STATES];
static double A_twice[36], Q_twice[PACKED], P0_twice[PACKED], x0_twice[STATES];
static sensor_t sensors[NODES];
static station_t stations[NODES];
static int joined[NODES][NODES];

/* A ring, so that the network is connected, and random chords; no node may hear more than it has slots for. */
static void draw_network(generator_t *g) {
    int degree[NODES], edges = NODES;
    memset(joined, 0, sizeof joined);
    for (int k = 0; k < NODES; k++) {
        joined[k][(k + 1) % NODES] = joined[(k + 1) % NODES][k] = 1;
        degree[k] = 3;
    }
    while (edges < EDGES) {
        const int i = draw_below(g, NODES), j = draw_below(g, NODES);
        if (i == j || joined[i][j] || degree[i] == SLOTS || degree[j] == SLOTS) continue;
        joined[i][j] = joined[j][i] = 1;
        degree[i]++;
        degree[j]++;
        edges++;
    }
}

static void draw_sensors(generator_t *g) {
    for (int k = 0; k < NODES; k++) {
        sensor_t *const s = &sensors[k];
        const int left_out = k % 3, level = draw_below(g, 3);
        float R[3] = {0.0f, 0.0f, 0.0f}, work[9];
        double R_twice[3], work_twice[9];
        memset(s, 0, sizeof *s);
        for (int r = 0, component = 0; component < 3; component++) {
            if (component == left_out) continue;
            /* R_k = sqrt(k) times two of 0.5 (1, 4, 7), in the role of variances */
            R[MK_PACKED(r) + r] = (float)(sqrt(k + 1.0) * 0.5 * (1.0 + 3.0 * ((level + r) % 3)));
            s->deviation[r] = sqrt((double)R[MK_PACKED(r) + r]);
            s->C[r * STATES + 3 + component] = 1.0f;
            s->component[r++] = component;
        }
        for (int i = 0; i < 12; i++) s->C_twice[i] = (double)s->C[i];
        for (int i = 0; i < 3; i++) R_twice[i] = (double)R[i];
        assert_int_equal(mk_rkfd_sensor_f32(STATES, ROWS, ROWS, s->C, R, s->F, s->S, s->R_inverse, work), MK_OK);
        assert_int_equal(mk_rkfd_sensor_f64(STATES, ROWS, ROWS, s->C_twice, R_twice, s->F_twice, s->S_twice, s->R_inverse_twice,
                                            work_twice),
                         MK_OK);
    }
}

static int degree_of(int k) {
    int degree = 1;
    for (int l = 0; l < NODES; l++) degree += joined[k][l];
    return degree;
}

/* Slots beyond the neighbours have no rows and no weight, and nothing ever arrives there. */
static void build_station(int k, float c) {
    station_t *const s = &stations[k];
    int total = 0;
    memset(s, 0, sizeof *s);
    s->heard[s->slots++] = k;
    for (int l = 0; l < NODES; l++)
        if (joined[k][l]) s->heard[s->slots++] = l;
    for (int i = 0; i < s->slots; i++) total += degree_of(s->heard[i]);
    for (int i = 0; i < s->slots; i++) {
        const sensor_t *const from = &sensors[s->heard[i]];
        s->rows[i] = ROWS;
        s->weight[i] = (float)degree_of(s->heard[i]) / (float)total;
        s->weight_twice[i] = (double)s->weight[i];
        memcpy(s->C + i * 12, from->C, sizeof from->C);
        memcpy(s->F + i * 12, from->F, sizeof from->F);
        memcpy(s->S + i * PACKED, from->S, sizeof from->S);
        memcpy(s->R_inverse + i * 3, from->R_inverse, sizeof from->R_inverse);
        memcpy(s->C_twice + i * 12, from->C_twice, sizeof from->C_twice);
        memcpy(s->F_twice + i * 12, from->F_twice, sizeof from->F_twice);
        memcpy(s->S_twice + i * PACKED, from->S_twice, sizeof from->S_twice);
        memcpy(s->R_inverse_twice + i * 3, from->R_inverse_twice, sizeof from->R_inverse_twice);
    }
    const single_config_t config = {STATES,  ROWS, SLOTS, A,    Q,    NULL,         x0, P0, s->weight,
                                    s->rows, s->C, s->F,  s->S, s->R_inverse, c, NULL};
    const twice_config_t config_twice = {STATES,  ROWS,       SLOTS,      A_twice,    Q_twice,            NULL,     x0_twice, P0_twice, s->weight_twice,
                                         s->rows, s->C_twice, s->F_twice, s->S_twice, s->R_inverse_twice, (double)c, NULL};
    memcpy(&s->config, &config, sizeof config);
    memcpy(&s->config_twice, &config_twice, sizeof config_twice);
    assert_int_equal(single_start(&s->filter, &s->config), MK_OK);
    assert_int_equal(twice_start(&s->filter_twice, &s->config_twice), MK_OK);
}

static void build(generator_t *g) {
    for (int i = 0; i < STATES; i++) A[i * STATES + i] = 1.0f;
    for (int i = 0; i < 3; i++) A[(3 + i) * STATES + i] = 0.1f;
    for (int i = 0; i < STATES; i++) {
        Q[MK_PACKED(i) + i] = 0.001f;
        P0[MK_PACKED(i) + i] = 1.0f;
    }
    for (int i = 0; i < 36; i++) A_twice[i] = (double)A[i];
    for (int i = 0; i < PACKED; i++) Q_twice[i] = (double)Q[i];
    for (int i = 0; i < PACKED; i++) P0_twice[i] = (double)P0[i];
    draw_network(g);
    draw_sensors(g);
    for (int k = 0; k < NODES; k++) build_station(k, 0.02f);
}

/* W of one node in double: its Cholesky factor exists. */
static int positive_definite(const float *W) {
    double L[PACKED];
    for (int i = 0; i < STATES; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = (double)W[MK_PACKED(i) + j];
            for (int k = 0; k < j; k++) sum -= L[MK_PACKED(i) + k] * L[MK_PACKED(j) + k];
            if (i == j) {
                if (!(sum > 0.0)) return 0;
                L[MK_PACKED(i) + i] = sqrt(sum);
            } else {
                L[MK_PACKED(i) + j] = sum / L[MK_PACKED(j) + j];
            }
        }
    }
    return 1;
}

/* r(t) is gravity and a thrust that holds against it and steers the true state along three slow waves. The noise is that of
   spec 1.9. */
static void advance_truth(generator_t *g, int step, double *truth, float *input) {
    double next[STATES];
    for (int i = 0; i < 3; i++) {
        const double aim = 20.0 * sin(0.003 * (i + 1) * step + i);
        input[i] = (float)(-0.1 * (2.0 * truth[i] + truth[3 + i] - aim));
        input[3 + i] = 0.0f;
    }
    for (int i = 0; i < STATES; i++) {
        next[i] = (double)input[i] + sqrt(0.001) * draw_normal(g);
        for (int j = 0; j < STATES; j++) next[i] += A_twice[i * STATES + j] * truth[j];
    }
    memcpy(truth, next, sizeof next);
}

static void exchange_measurements(generator_t *g, const double *truth) {
    float y[NODES][ROWS];
    for (int k = 0; k < NODES; k++)
        for (int r = 0; r < ROWS; r++)
            y[k][r] = (float)(truth[3 + sensors[k].component[r]] + sensors[k].deviation[r] * draw_normal(g));
    for (int k = 0; k < NODES; k++) {
        station_t *const s = &stations[k];
        for (int i = 0; i < s->slots; i++) {
            const float *const values = y[s->heard[i]];
            const double values_twice[ROWS] = {(double)values[0], (double)values[1]};
            if (i > 0 && draw_bits(g) % 10 == 0) continue;
            assert_int_equal(single_put_measurement(&s->filter, i, values), MK_OK);
            assert_int_equal(twice_put_measurement(&s->filter_twice, i, values_twice), MK_OK);
        }
    }
}

static void exchange_estimates(generator_t *g) {
    for (int k = 0; k < NODES; k++) {
        station_t *const s = &stations[k];
        for (int i = 1; i < s->slots; i++) {
            station_t *const from = &stations[s->heard[i]];
            if (draw_bits(g) % 10 == 0) continue;
            assert_int_equal(single_put_estimate(&s->filter, i, single_intermediate(&from->filter)), MK_OK);
            assert_int_equal(twice_put_estimate(&s->filter_twice, i, twice_intermediate(&from->filter_twice)), MK_OK);
        }
    }
}

/* Worst differences between the precisions; sums of squares of the true state and of the float64 estimate's error. */
typedef struct {
    double difference, covariance, theta, square, error;
} findings_t;

static void look(const double *truth, int thorough, findings_t *found) {
    for (int k = 0; k < NODES; k++) {
        station_t *const s = &stations[k];
        const float *const x = single_estimate(&s->filter);
        const double *const x_twice = twice_estimate(&s->filter_twice);
        for (int i = 0; i < STATES; i++) {
            found->difference = fmax(found->difference, fabs((double)x[i] - x_twice[i]));
            found->error += (x_twice[i] - truth[i]) * (x_twice[i] - truth[i]);
            found->square += truth[i] * truth[i];
        }
        assert_true(positive_definite(s->filter.W));
        if (!thorough) continue;
        float V[PACKED];
        double V_twice[PACKED], wide[PACKED], full[36], eigenvalues[STATES];
        assert_int_equal(single_covariance(&s->filter, V), MK_OK);
        assert_int_equal(twice_covariance(&s->filter_twice, V_twice), MK_OK);
        for (int i = 0; i < PACKED; i++) wide[i] = (double)V[i];
        found->covariance = fmax(found->covariance, relative_error(PACKED, wide, V_twice, 0.0));
        found->theta = fmax(found->theta, fabs((double)s->filter.core.theta / s->filter_twice.core.theta - 1.0));
        unpack(STATES, wide, full);
        reference_eigenvalues(STATES, full, eigenvalues);
        assert_true(eigenvalues[0] > 0.0);
    }
}

static void published_example(void **unused) {
    (void)unused;
    generator_t g = {61};
    double truth[STATES] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    findings_t found = {0.0, 0.0, 0.0, 0.0, 0.0};
    build(&g);
    for (int step = 0; step < UNIT_LONG_RUN; step++) {
        float input[STATES];
        double input_twice[STATES];
        exchange_measurements(&g, truth);
        advance_truth(&g, step, truth, input);
        for (int i = 0; i < STATES; i++) input_twice[i] = (double)input[i];
        for (int k = 0; k < NODES; k++) {
            assert_int_equal(single_incremental(&stations[k].filter, input), MK_OK);
            assert_int_equal(twice_incremental(&stations[k].filter_twice, input_twice), MK_OK);
        }
        exchange_estimates(&g);
        for (int k = 0; k < NODES; k++) {
            assert_int_equal(single_diffuse(&stations[k].filter), MK_OK);
            assert_int_equal(twice_diffuse(&stations[k].filter_twice), MK_OK);
        }
        look(truth, step % 100 == 99, &found);
    }
    const double count = (double)NODES * UNIT_LONG_RUN;
    const double size = sqrt(found.square / count / STATES);
    print_message("- %d steps: state %.2f (root mean square), estimate off by %.2f, float32 from float64 by %.1e of the state; V %.1e, "
                  "theta %.1e (relative)\n",
                  UNIT_LONG_RUN, size, sqrt(found.error / count / STATES), found.difference / size, found.covariance, found.theta);
    assert_true(found.difference < 1e-4 * size);
    assert_true(found.covariance < 1e-4);
    assert_true(found.theta < 1e-3);
    /* The filters do filter: better than the best sensor alone. */
    assert_true(found.error / count / STATES < 0.5);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(published_example)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
