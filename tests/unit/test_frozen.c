/* SPDX-License-Identifier: MIT */
/* The frozen gain: limits of random models from the definitions in double precision; a filter with the steady part beside one without and
   beside the definitions, with every way out of the mode and back. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "generator.h"
#include "node.h"

enum { LIMIT_STEPS = 4000, STEPS = 120, PERIOD = 16 };

/* Of V: beyond it the rounding of W leaves too little of a float32 filter to compare. */
typedef struct {
    const precision_t *precision;
    double condition, close, allowed;
} limits_t;

static const limits_t limits_float64 = {&float64, 1e5, 1e-11, 1e-13}, limits_float32 = {&float32, 1e3, 1e-5, 5e-6};

static const int dimensions[] = {1, 2, 3, 4, 6, 7, 9, 17};

/* Truth for long runs: an unstable model stays where it is. */
static const double nowhere[LARGEST_N];

static void draw_readings(generator_t *g, const model_t *model, const double *x, double (*y)[LARGEST_M]) {
    for (int l = 0; l < model->slots; l++) {
        for (int i = 0; i < model->rows[l]; i++) {
            y[l][i] = draw_normal(g);
            for (int j = 0; j < model->n; j++) y[l][i] += model->C[l][i * model->n + j] * x[j];
        }
        round_to_float(model->rows[l], y[l]);
    }
}

/* The limit by the definitions. 0: the recursion does not converge, or V is beyond the limits. */
static int find_limit(const model_t *model, double condition, double close, steady_t *steady, reference_t *state) {
    const int n = model->n;
    double zeros[LARGEST_M] = {0.0}, before[LARGEST_N * LARGEST_N], eigenvalues[LARGEST_N];
    const double *y[LARGEST_SLOTS];
    for (int l = 0; l < model->slots; l++) y[l] = zeros;
    reference_start(model, state);
    int still = 0;
    for (int step = 0; step < LIMIT_STEPS && still < 5; step++) {
        memcpy(before, state->V, sizeof before);
        reference_incremental(model, state, y, NULL, model->tolerance);
        still = relative_error(n * n, state->V, before, 0.0) < 1e-13 ? still + 1 : 0;
        for (int i = 0; i < n; i++) state->x[i] = 0.0;
    }
    reference_eigenvalues(n, state->V, eigenvalues);
    if (still < 5 || eigenvalues[n - 1] > condition * eigenvalues[0] || eigenvalues[n - 1] > 1e3) return 0;
    /* M = (V^-1 + sum C' R^-1 C)^-1 */
    double M[LARGEST_N * LARGEST_N], Y[LARGEST_N * LARGEST_N], R_inverse[LARGEST_M * LARGEST_M], F[LARGEST_SLOTS][LARGEST_N * LARGEST_M];
    memset(steady, 0, sizeof *steady);
    reference_inverse(n, state->V, steady->W);
    memcpy(Y, steady->W, sizeof Y);
    for (int l = 0; l < model->slots; l++) {
        const int rows = model->rows[l];
        if (rows > 0) reference_inverse(rows, model->R[l], R_inverse);
        for (int i = 0; i < n; i++)
            for (int r = 0; r < rows; r++) {
                F[l][i * rows + r] = 0.0;
                for (int s = 0; s < rows; s++) F[l][i * rows + r] += model->C[l][s * n + i] * R_inverse[s * rows + r];
            }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int r = 0; r < rows; r++) Y[i * n + j] += F[l][i * rows + r] * model->C[l][r * n + j];
    }
    reference_inverse(n, Y, M);
    memcpy(steady->Phi, model->A, sizeof steady->Phi);
    for (int l = 0; l < model->slots; l++) {
        const int rows = model->rows[l];
        for (int i = 0; i < n; i++)
            for (int r = 0; r < rows; r++)
                for (int j = 0; j < n; j++)
                    for (int k = 0; k < n; k++) steady->G[l][i * rows + r] += model->A[i * n + j] * M[j * n + k] * F[l][k * rows + r];
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++)
                for (int r = 0; r < rows; r++) steady->Phi[i * n + j] -= steady->G[l][i * rows + r] * model->C[l][r * n + j];
    }
    steady->theta = state->theta;
    for (int i = 0; i < n; i++) steady->trace_P += state->P[i * n + i];
    steady->close = close;
    steady->period = PERIOD;
    return 1;
}

/* One step: readings of the slots of the mask; weight is all on the node's own psi. */
static mk_status_t step(const precision_t *precision, node_t *node, const model_t *model, double (*y)[LARGEST_M], unsigned mask, seen_t *seen) {
    for (int l = 0; l < model->slots; l++)
        if (mask >> l & 1u) assert_int_equal(precision->put(node, l, y[l], 0), MK_OK);
    const mk_status_t status = precision->incremental(node, NULL);
    if (status != MK_OK) return status;
    assert_int_equal(precision->diffuse(node), MK_OK);
    return precision->see(node, seen);
}

static unsigned all(const model_t *model) { return (1u << model->slots) - 1u; }

/* Steps with all readings until the mode is there. Returns their number. */
static int freeze(generator_t *g, const precision_t *precision, node_t *node, const model_t *model, seen_t *seen) {
    double y[LARGEST_SLOTS][LARGEST_M];
    for (int count = 1; count < LIMIT_STEPS; count++) {
        draw_readings(g, model, nowhere, y);
        assert_int_equal(step(precision, node, model, y, all(model), seen), MK_OK);
        if (seen->frozen == 1.0) return count;
    }
    fail_msg("%s: n %d slots %d does not freeze", precision->name, model->n, model->slots);
    return 0;
}

static int draw_limited(generator_t *g, int trial, const limits_t *limits, model_t *model, steady_t *steady, reference_t *state) {
    const int n = dimensions[trial % (int)(sizeof dimensions / sizeof *dimensions)];
    draw_model(g, n, 1 + trial % LARGEST_M, 1 + trial % LARGEST_SLOTS, draw_uniform(g, 0.5, 1.02), model);
    if (trial % 5 == 0) model->tolerance = 0.0;
    return find_limit(model, limits->condition, limits->close, steady, state);
}

/* A frozen step against the definition at the limit, and everything it says of itself. */
static void agreement(const limits_t *limits) {
    const precision_t *const precision = limits->precision;
    generator_t g = {61};
    double worst = 0.0;
    int models = 0, most = 0;
    for (int trial = 0; trial < 160; trial++) {
        model_t model;
        steady_t steady;
        reference_t state;
        seen_t seen, before;
        double y[LARGEST_SLOTS][LARGEST_M], packed[LARGEST_N * (LARGEST_N + 1) / 2], input[LARGEST_N];
        const double *arrived[LARGEST_SLOTS];
        if (!draw_limited(&g, trial, limits, &model, &steady, &state)) continue;
        models++;
        node_t *const node = precision->make(&model);
        precision->give_steady(node, &steady);
        assert_int_equal(precision->start(node), MK_OK);
        const int count = freeze(&g, precision, node, &model, &seen);
        most = count > most ? count : most;
        double deviation = 0.0;
        for (int i = 0; i < model.n; i++) deviation = fmax(deviation, sqrt(state.V[i * model.n + i]));
        pack(model.n, steady.W, packed);
        for (int k = 1; k < PERIOD; k++) {
            before = seen;
            draw_readings(&g, &model, before.x, y);
            for (int i = 0; i < model.n; i++) input[i] = draw_normal(&g);
            round_to_float(model.n, input);
            for (int l = 0; l < model.slots; l++) {
                assert_int_equal(precision->put(node, l, y[l], 0), MK_OK);
                arrived[l] = y[l];
            }
            assert_int_equal(precision->incremental(node, k % 2 ? input : NULL), MK_OK);
            assert_int_equal(precision->see(node, &seen), MK_OK);
            reference_t expected = state;
            memcpy(expected.x, before.x, sizeof expected.x);
            reference_incremental(&model, &expected, arrived, k % 2 ? input : NULL, model.tolerance);
            worst = fmax(worst, relative_error(model.n, seen.psi, expected.psi, deviation));
            assert_true(seen.frozen == 1.0 && seen.steady == PERIOD - 1 - k);
            for (int i = 0; i < model.n * (model.n + 1) / 2; i++)
                assert_true(seen.W[i] == (precision == &float32 ? (double)(float)packed[i] : packed[i]));
            assert_true(fabs(seen.theta - steady.theta) <= precision->epsilon * steady.theta);
            assert_true(fabs(seen.trace_P - steady.trace_P) <= precision->epsilon * steady.trace_P);
            assert_true(seen.nis == 0.0 && seen.nis_rows == 0.0 && seen.iterations == 0.0 && seen.faults == 0.0);
            assert_true(seen.measurements == model.slots && seen.steps_since_measurement == 0.0);
            assert_int_equal(precision->incremental(node, NULL), MK_ERROR_ORDER);
            assert_int_equal(precision->diffuse(node), MK_OK);
            assert_int_equal(precision->see(node, &seen), MK_OK);
        }
        /* The step after them looks after nis and W, then the mode goes on. */
        draw_readings(&g, &model, seen.x, y);
        assert_int_equal(step(precision, node, &model, y, all(&model), &seen), MK_OK);
        assert_true(seen.frozen == 0.0 && seen.steady == PERIOD && (seen.nis > 0.0 || seen.nis_rows == 0.0));
        node_free(node);
    }
    print_message("- %s, %d models, frozen after at most %d steps: worst relative error of psi %.1e\n", precision->name, models, most, worst);
    assert_true(models > 80);
    assert_true(worst < limits->allowed);
}

static void agreement_float64(void **unused) {
    (void)unused;
    agreement(&limits_float64);
}

static void agreement_float32(void **unused) {
    (void)unused;
    agreement(&limits_float32);
}

/* Readings come and go: beside a filter without the steady part the difference stays what entering the mode may change. */
static void in_and_out(const limits_t *limits) {
    const precision_t *const precision = limits->precision;
    generator_t g = {62};
    double worst_x = 0.0, worst_V = 0.0;
    int frozen = 0, switches = 0;
    for (int trial = 0; trial < 80; trial++) {
        model_t model;
        steady_t steady;
        reference_t state;
        seen_t a, b;
        double y[LARGEST_SLOTS][LARGEST_M];
        if (!draw_limited(&g, trial, limits, &model, &steady, &state)) continue;
        node_t *const with = precision->make(&model), *const without = precision->make(&model);
        precision->give_steady(with, &steady);
        assert_int_equal(precision->start(with), MK_OK);
        assert_int_equal(precision->start(without), MK_OK);
        int lost = 0, last = 0;
        double deviation = 0.0;
        for (int i = 0; i < model.n; i++) deviation = fmax(deviation, sqrt(state.V[i * model.n + i]));
        for (int t = 0; t < 8 * STEPS; t++) {
            draw_readings(&g, &model, nowhere, y);
            /* Longer and longer quiet times, short and long losses, all of them and one of them. */
            if (lost > 0) lost--;
            else if (draw_chance(&g, 0.02)) lost = 1 + draw_below(&g, 6);
            const unsigned mask = lost == 0 ? all(&model) : lost % 2 ? all(&model) & ~(1u << draw_below(&g, model.slots)) : (unsigned)draw_below(&g, 1 << model.slots);
            assert_int_equal(step(precision, without, &model, y, mask, &b), MK_OK);
            assert_int_equal(step(precision, with, &model, y, mask, &a), MK_OK);
            assert_true(b.frozen == 0.0 && (a.frozen == 0.0 || mask == all(&model)));
            if (mask != all(&model)) assert_true(a.steady == 0.0 && ((unsigned)a.faults & MK_FAULT_MEASUREMENT_MISSING));
            switches += (int)a.frozen != last;
            last = (int)a.frozen;
            frozen += last;
            worst_x = fmax(worst_x, relative_error(model.n, a.x, b.x, deviation));
            worst_V = fmax(worst_V, relative_error(model.n * model.n, a.V, b.V, 0.0));
        }
        node_free(with);
        node_free(without);
    }
    print_message("- %s: %d frozen steps, %d switches: worst relative difference of x %.1e, of V %.1e\n", precision->name, frozen, switches, worst_x, worst_V);
    assert_true(frozen > 10000 && switches > 500);
    assert_true(worst_x < 30.0 * limits->close && worst_V < 60.0 * limits->close);
}

static void in_and_out_float64(void **unused) {
    (void)unused;
    in_and_out(&limits_float64);
}

static void in_and_out_float32(void **unused) {
    (void)unused;
    in_and_out(&limits_float32);
}

/* Every way out, one at a time, and the way back. The step that leaves is the full one from the limit: its twin starts there. */
static void ways_out(void **unused) {
    (void)unused;
    const limits_t *const both[] = {&limits_float64, &limits_float32};
    generator_t g = {63};
    for (int trial = 0; trial < 120; trial++) {
        const limits_t *const limits = both[trial % 2];
        const precision_t *const precision = limits->precision;
        model_t model;
        steady_t steady;
        reference_t state;
        seen_t seen, before;
        double y[LARGEST_SLOTS][LARGEST_M], e[LARGEST_M];
        const double *arrived[LARGEST_SLOTS];
        if (!draw_limited(&g, trial, limits, &model, &steady, &state)) continue;
        node_t *const node = precision->make(&model);
        precision->give_steady(node, &steady);
        assert_int_equal(precision->start(node), MK_OK);
        const int steps = freeze(&g, precision, node, &model, &seen);
        const double c = (double)(float)model.tolerance, other = c > 0.0 ? 2.0 * c : 1e-3;
        for (int way = 0; way < 7; way++) {
            const int slot = draw_below(&g, model.slots);
            double tolerance = c;
            before = seen;
            assert_true(before.frozen == 1.0 && before.steady > 0.0);
            draw_readings(&g, &model, before.x, y);
            for (int l = 0; l < model.slots; l++) arrived[l] = y[l];
            if (way == 0) arrived[slot] = NULL;
            if (way == 1) memset(arrived, 0, sizeof arrived);
            if (way == 2) { /* one as an innovation: the same step, but a full one */
                for (int i = 0; i < model.rows[slot]; i++) {
                    e[i] = y[slot][i];
                    for (int j = 0; j < model.n; j++) e[i] -= model.C[slot][i * model.n + j] * before.x[j];
                }
                if (precision == &float32) round_to_float(model.rows[slot], e);
            }
            if (way == 3) assert_int_equal(precision->set_tolerance(node, tolerance = other), MK_OK);
            if (way == 4) { /* there and back before the step: only the trial is missed */
                assert_int_equal(precision->set_tolerance(node, other), MK_OK);
                assert_int_equal(precision->set_tolerance(node, c), MK_OK);
            }
            if (way == 5) { /* refused, so missing */
                double bad[LARGEST_M] = {(double)NAN, 0.0, 0.0};
                arrived[slot] = NULL;
                if (model.rows[slot] > 0) assert_int_equal(precision->put(node, slot, bad, 0), MK_ERROR_NOT_FINITE);
            }
            if (way == 6) assert_int_equal(precision->restart(node), MK_OK);
            for (int l = 0; l < model.slots; l++)
                if (arrived[l]) assert_int_equal(precision->put(node, l, way == 2 && l == slot ? e : y[l], way == 2 && l == slot), MK_OK);
            assert_int_equal(precision->incremental(node, NULL), MK_OK);
            assert_int_equal(precision->see(node, &seen), MK_OK);
            assert_true(seen.frozen == 0.0 && (seen.nis_rows > 0.0 || seen.nis == 0.0));
            /* Left alone it is back; a step with all readings and the right tolerance is back at once. */
            assert_true((seen.steady == PERIOD) == (way == 4));
            reference_t expected = state;
            if (way == 6) reference_start(&model, &expected);
            else memcpy(expected.x, before.x, sizeof expected.x);
            reference_incremental(&model, &expected, arrived, NULL, tolerance);
            double deviation = 0.0;
            for (int i = 0; i < model.n; i++) deviation = fmax(deviation, sqrt(expected.V[i * model.n + i]));
            assert_true(relative_error(model.n, seen.psi, expected.psi, deviation) < 100.0 * limits->allowed);
            assert_true(relative_error(model.n * model.n, seen.V, expected.V, 0.0) < 1000.0 * limits->allowed);
            assert_int_equal(precision->diffuse(node), MK_OK);
            if (way == 3) { /* while the tolerance is another it stays out, however long */
                for (int t = 0; t < 50; t++) {
                    draw_readings(&g, &model, nowhere, y);
                    assert_int_equal(step(precision, node, &model, y, all(&model), &seen), MK_OK);
                    assert_true(seen.frozen == 0.0 && seen.steady == 0.0);
                }
                assert_int_equal(precision->set_tolerance(node, c), MK_OK);
            }
            const int back = freeze(&g, precision, node, &model, &seen);
            assert_true(way == 4 ? back == 1 : way == 6 ? back <= steps + 1 : back >= 1);
        }
        /* The tolerance it has already is no reason to leave. */
        assert_int_equal(precision->set_tolerance(node, c), MK_OK);
        draw_readings(&g, &model, seen.x, y);
        assert_int_equal(step(precision, node, &model, y, all(&model), &seen), MK_OK);
        assert_true(seen.frozen == 1.0);
        node_free(node);
    }
}

/* A filter that has lost one sensor for good must not be taken back to the limit, however little that sensor weighs. */
static void weak_sensor(void **unused) {
    (void)unused;
    generator_t g = {64};
    model_t model;
    steady_t steady;
    reference_t state;
    seen_t seen;
    double y[LARGEST_SLOTS][LARGEST_M] = {{0.0}};
    memset(&model, 0, sizeof model);
    model.n = 2;
    model.m = 1;
    model.slots = 2;
    model.A[0] = 0.5;
    model.A[3] = 1.0; /* nothing but the weak sensor sees it */
    model.Q[0] = model.Q[3] = 0.0009765625;
    model.P0[0] = model.P0[3] = 1.0;
    model.weight[0] = 1.0;
    for (int l = 0; l < 2; l++) {
        model.rows[l] = 1;
        model.C[l][l] = 1.0;
        model.R[l][0] = l == 0 ? 1.0 : 64.0;
    }
    assert_true(find_limit(&model, 1e5, 1e-2, &steady, &state));
    node_t *const node = float64.make(&model);
    float64.give_steady(node, &steady);
    assert_int_equal(float64.start(node), MK_OK);
    (void)freeze(&g, &float64, node, &model, &seen);
    const double settled = seen.V[3];
    for (int t = 0; t < 2000; t++) assert_int_equal(step(&float64, node, &model, y, 1u, &seen), MK_OK);
    assert_true(seen.V[3] > settled + 0.9 * 2000.0 * model.Q[3]);
    node_free(node);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(agreement_float64),
        cmocka_unit_test(agreement_float32),
        cmocka_unit_test(in_and_out_float64),
        cmocka_unit_test(in_and_out_float32),
        cmocka_unit_test(ways_out),
        cmocka_unit_test(weak_sensor),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
