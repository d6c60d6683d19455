/* SPDX-License-Identifier: MIT */
/* Seeded random numbers, covariances and network models: the same seed gives the same test on every machine. */
#ifndef UNIT_GENERATOR_H
#define UNIT_GENERATOR_H

#include <stdint.h>

#include "reference.h"

typedef struct {
    uint64_t state;
} generator_t;

/* splitmix64 */
uint64_t draw_bits(generator_t *g);

double draw_uniform(generator_t *g, double low, double high);
double draw_log_uniform(generator_t *g, double low, double high);
double draw_normal(generator_t *g);
int draw_below(generator_t *g, int count);
int draw_chance(generator_t *g, double probability);

/* result (n x n) := Q diag(spectrum) Q' with a random orthogonal Q. */
void draw_covariance(generator_t *g, int n, const double *spectrum, double *result);

/* The same with a spectrum that is log-uniform in [low, high]. */
void draw_covariance_between(generator_t *g, int n, double low, double high, double *result);

/* A random model: full A of the given spectral size, full Q, P0 and R_l, row counts that differ between sensors, some weights
   zero. Every number is a float, so that both precisions are given the same model, and the weights are multiples of 1/1024
   that sum to exactly one. */
void draw_model(generator_t *g, int n, int m, int slots, double size, model_t *model);

/* C and R of one sensor anew, with the rows the model says. */
void draw_sensor(generator_t *g, model_t *model, int slot);

/* Rounds every number to float. */
void round_to_float(int count, double *values);

#endif
