/* SPDX-License-Identifier: MIT */
/* The true covariance X = E[chi chi'] of the errors of all estimators and of RKFC (spec 1.7), chi = [x - xh_1; ..; x - xh_E; e], under the
   nominal or the least favourable model. In the law of least_favourable.h, with Phi_l = A - A M_l S_Nl and MA = M A',

       error of psi_l = Phi_l (x - xh_l) + w0 - A M_l sum over j in N_l of F_j v0_j + E_l g,    E_l = Q + A M_l S_Nl MA of RKFC
       e(t+1)         = Ag e + w0 - A M sum over all j of F_j v0_j + Z g,                       g ~ N(N Ag e, N)

   so that the adversary adds matrices of rank n to X and the sensors' noise joins only those who hear the same sensor. */
#ifndef MESHKAL_ERROR_COVARIANCE_H
#define MESHKAL_ERROR_COVARIANCE_H

#include "analysis/panel.h"
#include "design/node_config.h"

typedef struct {
    int n, estimators, sensors, threads;
    const double *Q;
    const mk_topology_t *topology; /* who hears which sensors */
    mk_mixing_t mixing;            /* who combines which estimates: nobody where `diffuses` is 0 */
    mk_panel_shape_t shape;
    double *X, *T;                 /* of the estimators, in panels */
    double *cross, *next;          /* E[(x - xh_l) e'], estimators x n x n */
    double *central;               /* E[e e'], n x n */
    double *sensor, *heard;        /* S of each sensor; S_Nl of each estimator; n x n each */
    double *MA_transposed, *Z, *E, *K, *L, *H, *Q_full, *Q_repeated, *small, *scratch;
    int *listener_first, *listener; /* who hears sensor s: listener[listener_first[s]] .. */
    int *own_first, *own_slot, *marks;
    double *own_weight;
} mk_error_covariance_t;

/* What one step needs: of the estimators Phi and MA (estimators x n x n), of RKFC Ag, MA and, of the least favourable model, N; null
   under the nominal one. */
typedef struct {
    const double *Phi, *MA, *Ag, *central_MA, *N;
} mk_error_maps_t;

/* X(0): every block P0. diffuses 0: the estimators exchange no estimates. topology must outlive it. Memory: 16 (estimators n)^2 bytes. */
void mk_error_covariance_open(mk_error_covariance_t *x, const mk_scenario_t *scenario, const mk_topology_t *topology, int diffuses, int threads);
void mk_error_covariance_close(mk_error_covariance_t *x);
/* X(t) to X(t+1). The same bits for any number of threads. */
void mk_error_covariance_step(mk_error_covariance_t *x, const mk_error_maps_t *maps);
/* Block of estimators k and j: first element, the next row is *stride further. */
const double *mk_error_covariance_block(const mk_error_covariance_t *x, int k, int j, int *stride);

#endif
