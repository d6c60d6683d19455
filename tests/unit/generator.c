/* SPDX-License-Identifier: MIT */
#include "generator.h"

#include <math.h>
#include <string.h>

#include <lapacke.h>

uint64_t draw_bits(generator_t *g) {
    uint64_t z = g->state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

double draw_uniform(generator_t *g, double low, double high) {
    return low + (high - low) * (double)(draw_bits(g) >> 11) * 0x1p-53;
}

double draw_log_uniform(generator_t *g, double low, double high) { return exp(draw_uniform(g, log(low), log(high))); }

double draw_normal(generator_t *g) {
    const double radius = sqrt(-2.0 * log(1.0 - draw_uniform(g, 0.0, 1.0)));
    return radius * cos(6.283185307179586477 * draw_uniform(g, 0.0, 1.0));
}

int draw_below(generator_t *g, int count) { return (int)(draw_bits(g) % (uint64_t)count); }

int draw_chance(generator_t *g, double probability) { return draw_uniform(g, 0.0, 1.0) < probability; }

void round_to_float(int count, double *values) {
    for (int i = 0; i < count; i++) values[i] = (double)(float)values[i];
}

void draw_covariance(generator_t *g, int n, const double *spectrum, double *result) {
    double Q[LARGEST_N * LARGEST_N], reflectors[LARGEST_N];
    for (int i = 0; i < n * n; i++) Q[i] = draw_normal(g);
    LAPACKE_dgeqrf(LAPACK_ROW_MAJOR, n, n, Q, n, reflectors);
    LAPACKE_dorgqr(LAPACK_ROW_MAJOR, n, n, n, Q, n, reflectors);
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) sum += Q[i * n + k] * spectrum[k] * Q[j * n + k];
            result[i * n + j] = result[j * n + i] = sum;
        }
    }
}

void draw_covariance_between(generator_t *g, int n, double low, double high, double *result) {
    double spectrum[LARGEST_N] = {0.0};
    for (int i = 0; i < n; i++) spectrum[i] = draw_log_uniform(g, low, high);
    draw_covariance(g, n, spectrum, result);
}

void draw_sensor(generator_t *g, model_t *model, int slot) {
    const int n = model->n, rows = model->rows[slot];
    double *const C = model->C[slot], *const R = model->R[slot];
    memset(C, 0, sizeof model->C[slot]);
    memset(R, 0, sizeof model->R[slot]);
    for (int i = 0; i < rows * n; i++) C[i] = draw_normal(g);
    if (rows > 0) draw_covariance_between(g, rows, 0.05, 5.0, R);
    round_to_float(rows * n, C);
    round_to_float(rows * rows, R);
}

/* A random composition of 1024; a zero now and then, for a slot that is heard but has no say. */
static void draw_weights(generator_t *g, int slots, double *weight) {
    int left = 1024;
    for (int l = 0; l < slots; l++) {
        int share = l == slots - 1 || left == 0 ? left : draw_below(g, 1 + 2 * left / (slots - l));
        if (share > left) share = left;
        if (l < slots - 1 && draw_chance(g, 0.15)) share = 0;
        weight[l] = share / 1024.0;
        left -= share;
    }
}

void draw_model(generator_t *g, int n, int m, int slots, double size, model_t *model) {
    memset(model, 0, sizeof *model);
    model->n = n;
    model->m = m;
    model->slots = slots;
    /* Circular law: a matrix of independent normal numbers has its spectral radius near sqrt(n). */
    for (int i = 0; i < n * n; i++) model->A[i] = size * draw_normal(g) / sqrt((double)n);
    for (int i = 0; i < n; i++) model->A[i * n + i] += 0.3 * size;
    for (int i = 0; i < n; i++) model->r[i] = draw_normal(g);
    for (int i = 0; i < n; i++) model->x0[i] = 3.0 * draw_normal(g);
    draw_covariance_between(g, n, 0.01, 1.0, model->Q);
    draw_covariance_between(g, n, 0.1, 10.0, model->P0);
    draw_weights(g, slots, model->weight);
    for (int l = 0; l < slots; l++) {
        model->rows[l] = l == 0 ? m : draw_below(g, m + 1);
        draw_sensor(g, model, l);
    }
    round_to_float(n * n, model->A);
    round_to_float(n, model->r);
    round_to_float(n, model->x0);
    round_to_float(n * n, model->Q);
    round_to_float(n * n, model->P0);
    model->tolerance = draw_chance(g, 0.2) ? 0.0 : (double)(float)draw_log_uniform(g, 1e-9, 0.3);
}
