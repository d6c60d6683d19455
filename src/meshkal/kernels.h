/* SPDX-License-Identifier: MIT */
/* All kernels in both precisions, lowest layer first: algebra, filter, network. */
#ifndef MESHKAL_KERNELS_H
#define MESHKAL_KERNELS_H

#include <string.h>

#include <meshkal/gamma.h>
#include <meshkal/rkfd.h>
#include <meshkal/unscented.h>

#include "algebra/sqrt.h"
#include "inline.h"

/* Bisection alone halves the bracket once an evaluation: 100 evaluations leave nothing of it in either precision. */
#define MK_GAMMA_LIMIT 100

/* The polynomial root has its coefficients from P, P^2 and P^-1 up to n = 6. */
#define MK_FAST_LARGEST_N 6

/* MK_GAMMA_CLOSE: a relative step of the exact root search after which the next would be below rounding.
   MK_FAST_CLOSE: a step of the polynomial search whose third power is below MK_FAST_ERROR, its bound on the relative error. */

#ifdef __cplusplus
extern "C" {
#endif
/* Out of line in libmeshkal.a, for what steps do rarely. Is S positive definite: work MK_PACKED(n) numbers. */
int mk_positive_definite_f32(int n, const float *S, float *work);
int mk_positive_definite_f64(int n, const double *S, double *work);
/* Root of a covariance that may be singular: filter/unscented_object.tmpl.h. */
int mk_semidefinite_root_f32(int n, float *S, float *d, float *G);
int mk_semidefinite_root_f64(int n, double *S, double *d, double *G);
/* mk_gamma_root for P that is known to be positive definite. */
int mk_gamma_search_f32(int n, const float *P, float c, float *theta, float *work);
int mk_gamma_search_f64(int n, const double *P, double c, double *theta, double *work);
/* t - log(1 + t), t > 0.5. */
float mk_log_gap_far_f32(float t);
double mk_log_gap_far_f64(double t);
/* Normalised innovation squared as (e - C d)' R^-1 (e - C d) + d' W d, d = M b, a sum of squares without cancellation; the largest number
   where it overflows. L as the step's mk_ldl leaves it, b = L^-1 b, which is overwritten. Scratch: e, m numbers, which may be L. */
float mk_rkfd_exact_nis_f32(const mk_rkfd_config_f32_t *config, const float *x, const float *W, const float *y,
                            const uint8_t *have_y, const float *L, float *b, float *e);
double mk_rkfd_exact_nis_f64(const mk_rkfd_config_f64_t *config, const double *x, const double *W, const double *y,
                            const uint8_t *have_y, const double *L, double *b, double *e);
/* After a full step, complete or not, of a filter that has a steady part: core->steady says whether W has arrived; it is then put to the limit.
   work: n numbers. */
void mk_rkfd_settle_f32(int n, int complete, mk_rkfd_f32_t *core, float *W, float *work);
void mk_rkfd_settle_f64(int n, int complete, mk_rkfd_f64_t *core, double *W, double *work);
#ifdef __cplusplus
}
#endif

#define MK_BITS 32
#include "real.h"
#define MK_GAMMA_CLOSE 1e-3f
#define MK_FAST_CLOSE 2e-2f
#define MK_FAST_ERROR 1e-5f
#include "algebra/elementary.tmpl.h"
#include "algebra/row.tmpl.h"
#include "algebra/load.tmpl.h"
#include "algebra/columns.tmpl.h"
#include "algebra/symmetric.tmpl.h"
#include "algebra/triangular.tmpl.h"
#include "algebra/gamma_root.tmpl.h"
#include "algebra/gamma_fast.tmpl.h"
#include "filter/rkfd_step.tmpl.h"
#ifdef MK_NARROW
#include "filter/rkfd_narrow.tmpl.h"
#endif
#include "filter/rkfd_frozen.tmpl.h"
#include "filter/unscented_transform.tmpl.h"
#include "filter/unscented_kernels.tmpl.h"
#include "network/diffusion.tmpl.h"
#undef MK_GAMMA_CLOSE
#undef MK_FAST_CLOSE
#undef MK_FAST_ERROR
#undef MK_BITS

#define MK_BITS 64
#include "real.h"
#define MK_GAMMA_CLOSE 1e-7
#define MK_FAST_CLOSE 2e-4
#define MK_FAST_ERROR 1e-11
#include "algebra/elementary.tmpl.h"
#include "algebra/row.tmpl.h"
#include "algebra/load.tmpl.h"
#include "algebra/columns.tmpl.h"
#include "algebra/symmetric.tmpl.h"
#include "algebra/triangular.tmpl.h"
#include "algebra/gamma_root.tmpl.h"
#include "algebra/gamma_fast.tmpl.h"
#include "filter/rkfd_step.tmpl.h"
#ifdef MK_NARROW
#include "filter/rkfd_narrow.tmpl.h"
#endif
#include "filter/rkfd_frozen.tmpl.h"
#include "filter/unscented_transform.tmpl.h"
#include "filter/unscented_kernels.tmpl.h"
#include "network/diffusion.tmpl.h"
#undef MK_GAMMA_CLOSE
#undef MK_FAST_CLOSE
#undef MK_FAST_ERROR
#undef MK_BITS

#ifdef __cplusplus
extern "C" {
#endif
/* The update of meshkal/unscented.h with the kernels of filter/unscented_kernels.tmpl.h compiled elsewhere. */
mk_status_t mk_unscented_update_with_f32(int n, int m, int slots, const mk_unscented_view_f32_t *view, const mk_unscented_kernels_f32_t *kernels);
mk_status_t mk_unscented_update_with_f64(int n, int m, int slots, const mk_unscented_view_f64_t *view, const mk_unscented_kernels_f64_t *kernels);
mk_status_t mk_unscented_update_weighted_with_f32(int n, int m, int slots, const mk_unscented_view_f32_t *view, const mk_row_weights_f32_t *weights,
                                                  const mk_unscented_kernels_f32_t *kernels);
mk_status_t mk_unscented_update_weighted_with_f64(int n, int m, int slots, const mk_unscented_view_f64_t *view, const mk_row_weights_f64_t *weights,
                                                  const mk_unscented_kernels_f64_t *kernels);
#ifdef __cplusplus
}
#endif


#endif
