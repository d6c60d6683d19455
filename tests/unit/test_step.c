/* SPDX-License-Identifier: MIT */
/* Both steps of one filter against the definitions: random models, and at every step a random part of the messages missing. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "generator.h"
#include "node.h"

enum { STEPS = 25 };

/* W = V^-1 is what a filter carries and rounds: V can be no better than the rounding times its condition number, and an innovation
   no better than the rounding of x. A model whose V or x grows beyond these (unstable and unseen directions) is left there. */
typedef struct {
    const precision_t *precision;
    double condition, size, allowed;
} limits_t;

static const limits_t limits_float64 = {&float64, 1e5, 1e3, 1e-10}, limits_float32 = {&float32, 1e3, 1e2, 3e-4};

static const int dimensions[] = {1, 2, 3, 4, 6, 9, 17};

/* One step's messages, and pointers to those that arrive. Values are floats for both precisions' sake. */
typedef struct {
    double y[LARGEST_SLOTS][LARGEST_M], psi[LARGEST_SLOTS][LARGEST_N], input[LARGEST_N];
    const double *arrived_y[LARGEST_SLOTS], *arrived_psi[LARGEST_SLOTS];
} messages_t;

/* Measurements and neighbours' estimates scattered about x, so that innovations have the size of their variance. */
static void draw_messages(generator_t *g, const model_t *model, const reference_t *state, messages_t *messages) {
    const int n = model->n;
    memset(messages, 0, sizeof *messages);
    /* 0: all, 1: none, 2: only neighbours', otherwise each for itself */
    const int pattern_y = draw_below(g, 8), pattern_psi = draw_below(g, 8);
    for (int i = 0; i < n; i++) messages->input[i] = draw_normal(g);
    round_to_float(n, messages->input);
    for (int l = 0; l < model->slots; l++) {
        for (int i = 0; i < model->rows[l]; i++) {
            messages->y[l][i] = 2.0 * draw_normal(g);
            for (int j = 0; j < n; j++) messages->y[l][i] += model->C[l][i * n + j] * state->x[j];
        }
        for (int i = 0; i < n; i++) messages->psi[l][i] = state->x[i] + draw_normal(g);
        round_to_float(model->rows[l], messages->y[l]);
        round_to_float(n, messages->psi[l]);
        const int chance_y = draw_chance(g, 0.6), chance_psi = draw_chance(g, 0.6);
        if (pattern_y == 0 || (pattern_y == 2 && l > 0) || (pattern_y > 2 && chance_y)) messages->arrived_y[l] = messages->y[l];
        if (l > 0 && (pattern_psi == 0 || pattern_psi == 2 || (pattern_psi > 2 && chance_psi)))
            messages->arrived_psi[l] = messages->psi[l];
    }
}

static int arrived(int slots, const double *const *messages) {
    int count = 0;
    for (int l = 0; l < slots; l++) count += messages[l] != NULL;
    return count;
}

typedef struct {
    double x, psi, V, theta, trace, nis, predicted;
    int steps;
} errors_t;

static double condition(int n, const double *V) {
    double eigenvalues[LARGEST_N];
    reference_eigenvalues(n, V, eigenvalues);
    return eigenvalues[n - 1] / eigenvalues[0];
}

static double largest(int count, const double *values) {
    double result = 0.0;
    for (int i = 0; i < count; i++) result = fmax(result, fabs(values[i]));
    return result;
}

static void put_readings(const precision_t *precision, node_t *node, const model_t *model, const messages_t *messages) {
    for (int l = model->slots - 1; l >= 0; l--)
        if (messages->arrived_y[l]) assert_int_equal(precision->put(node, l, messages->arrived_y[l], 0), MK_OK);
}

static void put_estimates(const precision_t *precision, node_t *node, const model_t *model, const messages_t *messages) {
    for (int l = 1; l < model->slots; l++)
        if (messages->arrived_psi[l]) assert_int_equal(precision->put_estimate(node, l, messages->arrived_psi[l]), MK_OK);
}

static void check_predictions(const precision_t *precision, node_t *node, const model_t *model, const reference_t *state,
                              const messages_t *messages, errors_t *errors) {
    const int n = model->n, m = model->m;
    for (int l = 0; l < model->slots; l++) {
        double e[LARGEST_M], variance[LARGEST_M * LARGEST_M], expected_variance[LARGEST_M * LARGEST_M];
        if (!messages->arrived_y[l]) {
            assert_int_equal(precision->predict(node, l, e, variance), MK_ERROR_ARGUMENT);
            continue;
        }
        assert_int_equal(precision->predict(node, l, e, variance), MK_OK);
        reference_variance(model, state, l, expected_variance);
        const int rows = model->rows[l];
        double worst = 0.0, size = 0.0;
        for (int i = 0; i < m; i++) {
            double predicted = 0.0;
            if (i >= rows) assert_true(e[i] == 0.0);
            for (int j = 0; i < rows && j < n; j++) {
                predicted += model->C[l][i * n + j] * state->x[j];
                size += fabs(model->C[l][i * n + j] * state->x[j]);
            }
            if (i < rows) worst = fmax(worst, fabs(e[i] - (messages->y[l][i] - predicted)));
            for (int j = 0; j < m; j++) {
                if (i >= rows || j >= rows) assert_true(variance[i * m + j] == 0.0);
                else
                    errors->predicted = fmax(errors->predicted, fabs(variance[i * m + j] - expected_variance[i * rows + j]) /
                                                                    fmax(expected_variance[i * rows + i], expected_variance[j * rows + j]));
            }
        }
        if (rows > 0) errors->predicted = fmax(errors->predicted, worst / fmax(size, 1.0));
    }
}

/* All readings together against the definition, and each for itself as predict gives it, bit for bit. */
static void check_innovations(const precision_t *precision, node_t *node, const model_t *model, const reference_t *state, const messages_t *messages,
                              errors_t *errors) {
    double e[LARGEST_STACK], S[LARGEST_STACK * LARGEST_STACK], expected[LARGEST_STACK * LARGEST_STACK], expected_e[LARGEST_STACK];
    uint8_t rows[LARGEST_SLOTS];
    const int count = reference_innovations(model, state, messages->arrived_y, expected_e, expected);
    int first = 0;
    assert_int_equal(precision->innovations(node, e, S, rows), MK_OK);
    for (int l = 0; l < model->slots; l++) {
        double alone[LARGEST_M], variance[LARGEST_M * LARGEST_M];
        assert_int_equal(rows[l], messages->arrived_y[l] ? model->rows[l] : 0);
        if (rows[l]) assert_int_equal(precision->predict(node, l, alone, variance), MK_OK);
        for (int i = 0; i < rows[l]; i++) {
            assert_true(e[first + i] == alone[i]);
            for (int j = 0; j < rows[l]; j++) assert_true(S[(first + i) * count + first + j] == variance[i * model->m + j]);
        }
        first += rows[l];
    }
    assert_int_equal(first, count);
    for (int i = 0; i < count; i++)
        for (int j = 0; j < count; j++)
            errors->predicted = fmax(errors->predicted, fabs(S[i * count + j] - expected[i * count + j]) /
                                                            fmax(expected[i * count + i], expected[j * count + j]));
}

static void check_incremental(const model_t *model, const reference_t *state, const seen_t *seen, const messages_t *messages,
                              double c, errors_t *errors) {
    const int n = model->n, count = arrived(model->slots, messages->arrived_y);
    double trace = 0.0, deviation = 0.0;
    for (int i = 0; i < n; i++) {
        trace += state->P[i * n + i];
        deviation = fmax(deviation, sqrt(state->V[i * n + i]));
    }
    errors->psi = fmax(errors->psi, relative_error(n, seen->psi, state->psi, deviation));
    errors->V = fmax(errors->V, relative_error(n * n, seen->V, state->V, 0.0));
    errors->trace = fmax(errors->trace, fabs(seen->trace_P / trace - 1.0));
    if (c > 0.0) errors->theta = fmax(errors->theta, fabs(seen->theta / state->theta - 1.0));
    else assert_true(seen->theta == 0.0);
    assert_true(c > 0.0 ? seen->iterations >= 1.0 : seen->iterations == 0.0);
    /* The difference of two sums, the larger of which is the innovations' square in the metric of R. */
    errors->nis = fmax(errors->nis, fabs(seen->nis - state->nis) / fmax(1.0, state->square));
    assert_true(seen->nis_rows == state->nis_rows);
    assert_true(seen->measurements == count);
    const unsigned faults = (count < model->slots ? MK_FAULT_MEASUREMENT_MISSING : 0u) | (count == 0 ? MK_FAULT_NO_MEASUREMENT : 0u);
    assert_true(seen->faults == faults);
}

static void run_model(generator_t *g, const limits_t *limits, model_t *model, int sensors_change, errors_t *errors) {
    const precision_t *const precision = limits->precision;
    reference_t state;
    seen_t seen;
    messages_t messages;
    double c = model->tolerance;
    int since = 0;
    node_t *const node = precision->make(model);
    assert_int_equal(precision->start(node), MK_OK);
    reference_start(model, &state);
    for (int step = 0; step < STEPS; step++) {
        if (sensors_change) {
            const int slot = draw_below(g, model->slots);
            model->rows[slot] = draw_below(g, model->m + 1);
            draw_sensor(g, model, slot);
            assert_int_equal(precision->sensor(node, model, slot), MK_OK);
        }
        if (draw_chance(g, 0.3)) {
            c = draw_chance(g, 0.2) ? 0.0 : (double)(float)draw_log_uniform(g, 1e-9, 0.3);
            assert_int_equal(precision->set_tolerance(node, c), MK_OK);
        }
        draw_messages(g, model, &state, &messages);
        put_readings(precision, node, model, &messages);
        check_predictions(precision, node, model, &state, &messages, errors);
        check_innovations(precision, node, model, &state, &messages, errors);
        const double *const input = draw_chance(g, 0.5) ? messages.input : NULL;
        assert_int_equal(precision->incremental(node, input), MK_OK);
        reference_incremental(model, &state, messages.arrived_y, input, c);
        if (condition(model->n, state.V) > limits->condition || largest(model->n, state.psi) > limits->size) break;
        assert_int_equal(precision->see(node, &seen), MK_OK);
        check_incremental(model, &state, &seen, &messages, c, errors);
        since = seen.measurements > 0.0 ? 0 : since + 1;
        assert_true(seen.steps_since_measurement == since);

        put_estimates(precision, node, model, &messages);
        assert_int_equal(precision->diffuse(node), MK_OK);
        reference_diffuse(model, &state, messages.arrived_psi);
        assert_int_equal(precision->see(node, &seen), MK_OK);
        errors->x = fmax(errors->x, relative_error(model->n, seen.x, state.x, 1.0));
        const int estimates = 1 + arrived(model->slots, messages.arrived_psi);
        errors->steps++;
        assert_true(seen.estimates == estimates && seen.steps == step + 1);
        assert_true(!((unsigned)seen.faults & MK_FAULT_ESTIMATE_MISSING) == (estimates == model->slots));
    }
    node_free(node);
}

static void run_models(const limits_t *limits, uint64_t seed, int models, int sensors_change) {
    errors_t worst;
    int possible = 0;
    memset(&worst, 0, sizeof worst);
    generator_t g = {seed};
    for (size_t k = 0; k < sizeof dimensions / sizeof *dimensions; k++) {
        for (int trial = 0; trial < models; trial++) {
            model_t model;
            errors_t e;
            memset(&e, 0, sizeof e);
            const int n = dimensions[k], m = 1 + trial % LARGEST_M, slots = 1 + trial % LARGEST_SLOTS;
            draw_model(&g, n, m, slots, draw_uniform(&g, 0.5, 1.1), &model);
            run_model(&g, limits, &model, sensors_change, &e);
            const double all = fmax(fmax(fmax(e.x, e.psi), fmax(e.V, e.theta)), fmax(fmax(e.trace, e.nis), e.predicted));
            possible += STEPS;
            worst.steps += e.steps;
            if (!(all < limits->allowed))
                fail_msg("n %d m %d slots %d trial %d: x %.1e psi %.1e V %.1e theta %.1e trace %.1e nis %.1e predicted %.1e", n, m,
                         slots, trial, e.x, e.psi, e.V, e.theta, e.trace, e.nis, e.predicted);
            worst.x = fmax(worst.x, e.x);
            worst.psi = fmax(worst.psi, e.psi);
            worst.V = fmax(worst.V, e.V);
            worst.theta = fmax(worst.theta, e.theta);
            worst.trace = fmax(worst.trace, e.trace);
            worst.nis = fmax(worst.nis, e.nis);
            worst.predicted = fmax(worst.predicted, e.predicted);
        }
    }
    print_message("- %s%s, %d steps: worst relative errors: x %.1e psi %.1e V %.1e theta %.1e trace %.1e nis %.1e predicted %.1e\n",
                  limits->precision->name, sensors_change ? ", sensors change" : "", worst.steps, worst.x, worst.psi, worst.V, worst.theta, worst.trace,
                  worst.nis, worst.predicted);
    assert_true(worst.steps > possible / 2);
}

static void models_float64(void **unused) {
    (void)unused;
    run_models(&limits_float64, 11, 72, 0);
}

static void models_float32(void **unused) {
    (void)unused;
    run_models(&limits_float32, 12, 72, 0);
}

static void sensors_change(void **unused) {
    (void)unused;
    run_models(&limits_float64, 13, 18, 1);
    run_models(&limits_float32, 14, 18, 1);
}

/* c = 0 and no say for the neighbours' estimates: the textbook's filter in gain form, which itself loses digits where V is large
   against R. */
static void plain_kalman(void **unused) {
    (void)unused;
    generator_t g = {15};
    double worst = 0.0;
    for (int trial = 0; trial < 60; trial++) {
        model_t model;
        messages_t messages;
        seen_t seen;
        draw_model(&g, dimensions[trial % 7], 1 + trial % 3, 1 + trial % 6, 0.95, &model);
        model.tolerance = 0.0;
        for (int l = 0; l < model.slots; l++) model.weight[l] = l == 0 ? 1.0 : 0.0;
        double x[LARGEST_N], V[LARGEST_N * LARGEST_N];
        memcpy(x, model.x0, sizeof x);
        memcpy(V, model.P0, sizeof V);
        node_t *const node = float64.make(&model);
        assert_int_equal(float64.start(node), MK_OK);
        for (int step = 0; step < STEPS; step++) {
            reference_t state;
            memcpy(state.x, x, sizeof x);
            draw_messages(&g, &model, &state, &messages);
            put_readings(&float64, node, &model, &messages);
            assert_int_equal(float64.incremental(node, NULL), MK_OK);
            assert_int_equal(float64.diffuse(node), MK_OK);
            reference_kalman(&model, messages.arrived_y, NULL, x, V);
            assert_int_equal(float64.see(node, &seen), MK_OK);
            worst = fmax(worst, relative_error(model.n, seen.x, x, 1.0));
            worst = fmax(worst, relative_error(model.n * model.n, seen.V, V, 0.0));
        }
        node_free(node);
    }
    print_message("- plain Kalman filter: worst relative error %.1e\n", worst);
    assert_true(worst < 1e-9);
}

/* The innovation y - C x put in the reading's place does what the reading does. */
static void innovation(void **unused) {
    (void)unused;
    generator_t g = {16};
    double worst = 0.0;
    for (int trial = 0; trial < 60; trial++) {
        model_t model;
        messages_t messages;
        seen_t a, b;
        reference_t state;
        draw_model(&g, dimensions[trial % 7], 1 + trial % 3, 1 + trial % 6, 0.95, &model);
        node_t *const direct = float64.make(&model), *const indirect = float64.make(&model);
        assert_int_equal(float64.start(direct), MK_OK);
        assert_int_equal(float64.start(indirect), MK_OK);
        for (int step = 0; step < 10; step++) {
            assert_int_equal(float64.see(indirect, &b), MK_OK);
            memcpy(state.x, b.x, sizeof state.x);
            draw_messages(&g, &model, &state, &messages);
            put_readings(&float64, direct, &model, &messages);
            for (int l = 0; l < model.slots; l++) {
                double e[LARGEST_M], seen_e[LARGEST_M], variance[LARGEST_M * LARGEST_M];
                if (!messages.arrived_y[l]) continue;
                for (int i = 0; i < model.rows[l]; i++) {
                    e[i] = messages.y[l][i];
                    for (int j = 0; j < model.n; j++) e[i] -= model.C[l][i * model.n + j] * b.x[j];
                }
                assert_int_equal(float64.put(indirect, l, e, 1), MK_OK);
                assert_int_equal(float64.predict(indirect, l, seen_e, variance), MK_OK);
                for (int i = 0; i < model.rows[l]; i++) assert_true(seen_e[i] == e[i]);
            }
            assert_int_equal(float64.incremental(direct, messages.input), MK_OK);
            assert_int_equal(float64.incremental(indirect, messages.input), MK_OK);
            assert_int_equal(float64.diffuse(direct), MK_OK);
            assert_int_equal(float64.diffuse(indirect), MK_OK);
            assert_int_equal(float64.see(direct, &a), MK_OK);
            assert_int_equal(float64.see(indirect, &b), MK_OK);
            worst = fmax(worst, relative_error(model.n, a.x, b.x, 1.0));
            worst = fmax(worst, fabs(a.nis - b.nis) / fmax(1.0, b.nis));
            assert_memory_equal(a.V, b.V, sizeof a.V);
        }
        node_free(direct);
        node_free(indirect);
    }
    print_message("- innovation for reading: worst relative difference %.1e\n", worst);
    assert_true(worst < 1e-12);
}

/* A start that knows nearly nothing and a good sensor, P0 up to 1e9 and R = 0.01: the first nis is what a gate would look at, and
   one per cent is what a gate needs. */
static void nis_after_flat_start(void **unused) {
    (void)unused;
    const precision_t *const both[] = {&float64, &float32};
    for (int k = 0; k < 2; k++) {
        double worst = 0.0;
        for (int decade = 0; decade <= 36; decade++) {
            model_t model;
            seen_t seen;
            const double P0 = (double)(float)pow(10.0, 0.25 * decade), y = (double)(float)(1.5 * sqrt(P0));
            const double expected = y * y / (P0 + (double)(float)0.01);
            memset(&model, 0, sizeof model);
            model.n = model.m = model.slots = model.rows[0] = 1;
            model.A[0] = model.Q[0] = model.weight[0] = model.C[0][0] = 1.0;
            model.P0[0] = P0;
            model.R[0][0] = (double)(float)0.01;
            node_t *const node = both[k]->make(&model);
            assert_int_equal(both[k]->start(node), MK_OK);
            assert_int_equal(both[k]->put(node, 0, &y, 0), MK_OK);
            assert_int_equal(both[k]->incremental(node, NULL), MK_OK);
            both[k]->see(node, &seen);
            node_free(node);
            const double error = fabs(seen.nis / expected - 1.0);
            worst = fmax(worst, error);
            if (!(error < 1e-2)) fail_msg("%s, P0 %g: nis %.9g, not %.9g", both[k]->name, P0, seen.nis, expected);
        }
        print_message("- nis after a flat start, %s: worst relative error %.1e\n", both[k]->name, worst);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(models_float64), cmocka_unit_test(models_float32), cmocka_unit_test(sensors_change),
        cmocka_unit_test(plain_kalman),   cmocka_unit_test(innovation),     cmocka_unit_test(nis_after_flat_start),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
