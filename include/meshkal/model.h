/* SPDX-License-Identifier: MIT */
/*
 * Nonlinear models as functions, the caller's or those of meshkal/tracking.h:
 *
 *     motion   x(t + dt) = g(x(t)) + w      w ~ N(0, Q)      n states
 *     sensor   z = h(x) + v                 v ~ N(0, R)      its rows
 *
 * They are the only functions that the library calls back (besides seal and open of meshkal/frame.h). A function may keep what it
 * needs in its context; it must not change the filter that calls it.
 */
#ifndef MESHKAL_MODEL_H
#define MESHKAL_MODEL_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MK_DECLARE_MODEL(real)                                                                                                \
    /* y := g(x) or h(x) at `count` points: x holds them one after another, n numbers each, y takes n or `rows` numbers each; \
       they do not overlap. dt: seconds that pass, 0 for a sensor. Any status but MK_OK says that a point is outside the      \
       model's domain (MK_ERROR_DOMAIN, or another one): the filter returns it and stays as it was. Results that are not      \
       finite count as MK_ERROR_NOT_FINITE. */                                                                                \
    typedef mk_status_t (*mk_function_##real##_t)(const void *context, mk_##real##_t dt, int count, const mk_##real##_t *x,   \
                                                  mk_##real##_t *y);                                                          \
    /* J := the derivative at one point, n x n or rows x n in row order. Extended filters need it. */                         \
    typedef mk_status_t (*mk_jacobian_##real##_t)(const void *context, mk_##real##_t dt, const mk_##real##_t *x,              \
                                                  mk_##real##_t *J);                                                          \
                                                                                                                              \
    /* Where results do not add like numbers, as angles do not. */                                                            \
    typedef struct {                                                                                                          \
        /* d := a - b, the short way round. */                                                                                \
        void (*difference)(const void *context, const mk_##real##_t *a, const mk_##real##_t *b, mk_##real##_t *d);            \
        /* Weighted mean of `count` results y, one after another; the weights sum to 1. Null: the mean of the differences from \
           the result at the central point, added to it. */                                                                   \
        void (*mean)(const void *context, int count, const mk_##real##_t *weight, const mk_##real##_t *y, mk_##real##_t *mean); \
        const void *context;                                                                                                  \
    } mk_space_##real##_t;                                                                                                    \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_function_##real##_t function;                                                                                      \
        mk_jacobian_##real##_t jacobian;  /* null where no filter needs it */                                                 \
        const void *context;                                                                                                  \
        const mk_space_##real##_t *space; /* null: ordinary numbers */                                                        \
    } mk_model_##real##_t;

MK_DECLARE_MODEL(f32)
MK_DECLARE_MODEL(f64)

#ifdef __cplusplus
}
#endif

#endif
