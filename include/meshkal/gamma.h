/* SPDX-License-Identifier: MIT */
/*
 * gamma(P, theta) = log det(I - theta P) + tr[(I - theta P)^-1 - I]: the price of the risk sensitivity theta, in the unit of
 * spec 1.2, twice the Kullback-Leibler divergence in nats between N(0, (P^-1 - theta I)^-1) and N(0, P).
 *
 * P is packed (MK_PACKED(n) numbers), symmetric positive definite, and is not written. work: MK_GAMMA_WORK(n) numbers, no
 * overlap with P. Cost: 4 n^3 / 3 operations, and about 20 n for each evaluation.
 */
#ifndef MESHKAL_GAMMA_H
#define MESHKAL_GAMMA_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MK_GAMMA_WORK(n) (MK_PACKED(n) + 2 * (n))

/* The theta with gamma(P, theta) = c, c > 0. Relative error a few units of rounding of the type for every spectrum. Returns the
   number of evaluations of gamma (at most 100), or 0 and *theta untouched if there is no root in this precision: P not
   positive or not finite, c not positive or beyond what the precision resolves. */
int mk_gamma_root_f32(int n, const float *P, float c, float *theta, float *work);
int mk_gamma_root_f64(int n, const double *P, double c, double *theta, double *work);

/* gamma at theta >= 0 and, where slope is not null, theta dgamma/dtheta. Returns 1, or 0 and nothing written when theta is
   not in [0, 1 / lambda_max) or P is not positive. */
int mk_gamma_f32(int n, const float *P, float theta, float *gamma, float *slope, float *work);
int mk_gamma_f64(int n, const double *P, double theta, double *gamma, double *slope, double *work);

#ifdef __cplusplus
}
#endif

#endif
