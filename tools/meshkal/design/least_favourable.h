/* SPDX-License-Identifier: MIT */
/* The least favourable model of the centralised robust filter RKFC over a finite horizon (spec 1.7), in n x n matrices however many
   sensors there are. With M, theta of RKFC at step t, G = A M C' R^-1, Ag = A - A M S, Z = Bg Bg' = Q + A M S M A' and
   W = Oi(t+1) + theta I (Oi of the step after the last: 0):

       N  = (W^-1 - Z)^-1 = W + W Bg Kt Bg' W,   Kt = (I - Bg' W Bg)^-1 = I + Bg' N Bg,   H = Kt Bg' W Ag = Bg' N Ag,   Oi(t) = Ag' N Ag

   (Woodbury, push-through). Kt is positive definite exactly where I - W^1/2 Z W^1/2 is, which it is wherever RKFC's own V is: backwards in
   time V(t+1)^-1 > Oi(t+1) gives P(t+1)^-1 > W, so W^-1 > P(t+1) = Ag V Ag' + Z and V(t)^-1 > Ag' N Ag = Oi(t). A recursion that fails has
   drowned in rounding: seen at tolerances above 1e12. In law, v = H e + L eps is then

       w(t) = w0 + Q g,   v_k(t) = v0_k - C_k M A' g,   g ~ N(N Ag e, N),   w0 ~ N(0, Q), v0_k ~ N(0, R_k) as the nominal model draws them
*/
#ifndef MESHKAL_LEAST_FAVOURABLE_H
#define MESHKAL_LEAST_FAVOURABLE_H

#include "scenario.h"

/* For t = 0 .. horizon, one after another: Ag, MA = M A', N, root_N (all n x n; lower triangular, N = root root', zero columns where N is
   singular) and V(t) (packed) and theta(t), 0 all but V where the tolerance is 0. */
typedef struct {
    int n, horizon;
    double *Ag, *MA, *N, *root_N, *V, *theta;
} mk_least_favourable_t;

/* The scenario need not have links. 1, or 0 and an error: RKFC fails (covariance not positive definite), or the backward recursion does,
   at a step it names. *model is then empty. Memory: about 36 n^2 bytes a step. */
int mk_least_favourable_make(mk_least_favourable_t *model, const mk_scenario_t *scenario, double tolerance, int horizon, mk_error_t *error);
void mk_least_favourable_free(mk_least_favourable_t *model);

#endif
