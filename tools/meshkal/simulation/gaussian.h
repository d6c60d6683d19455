/* SPDX-License-Identifier: MIT */
/* Normal draws with a covariance. Matrices packed. */
#ifndef MESHKAL_GAUSSIAN_H
#define MESHKAL_GAUSSIAN_H

#include "random.h"

/* Lower triangular L with L L' = S, n x n, S positive semidefinite: a pivot lost in rounding gives a zero column. */
void mk_gaussian_root(int n, const double *S, double *L);
/* target += L g, g standard normal; n at most 64. */
void mk_gaussian_add(mk_random_t *random, int n, const double *L, double *target);

#endif
