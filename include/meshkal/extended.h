/* SPDX-License-Identifier: MIT */
/*
 * The robust distributed filter (meshkal/rkfd.h) on nonlinear models (meshkal/model.h): extended, that is linearised at the node's own
 * estimate (spec 1 and 4.2, baselines). The filter is an MK_RKFD whose configuration points into memory that these functions rewrite:
 *
 *     observe ...      C_l := Jacobian of h_l at x, the innovation z_l - h_l(x) put in slot l, in any order
 *     correct          psi = x + M sum F_l (z_l - h_l(x)),  M = (W + sum S_l)^-1,  W := M^-1
 *     put_estimate, diffuse   as in meshkal/rkfd.h: x := weighted mean of psi
 *     propagate        x := g(x),  P = J M J' + Q,  gamma(P, theta) = c,  W := P^-1 - theta I
 *
 * which is the step of spec 1.4 cut in two, between correction and prediction, and the same where g is linear: weights sum to 1, so that
 * a mean of predictions is the prediction of the mean. After diffuse x belongs to the time of the readings; intervals may differ from step to step.
 *
 *     MK_RKFD(node, f32, 4, 1, 3);
 *     MK_EXTENDED(node, f32, 4, 1, 3);
 *     node_observe(&node, &model, 0, &range); node_correct(&node, &model); .. node_diffuse(&node); node_propagate(&node, &model, dt, 0);
 */
#ifndef MESHKAL_EXTENDED_H
#define MESHKAL_EXTENDED_H

#include <meshkal/rkfd.h>
#include <meshkal/unscented.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Scratch memory, in numbers. */
#define MK_EXTENDED_WORK(n, m) (MK_RKFD_WORK(n, m) + (n) * ((m) > (n) ? (m) : (n)) + 2 * ((n) + (m)) + 3 * MK_PACKED(m))

/*
 * T is mk_<real>_t.
 *
 * name_observe(f, model, slot, T z[rows])
 *                     ORDER, ARGUMENT (also where the model has no Jacobian), REPEATED, NOT_FINITE, NOT_POSITIVE_DEFINITE (R), what the
 *                     sensor's functions returned. On failure the slot is empty as before.
 * name_correct(f, model)
 *                     Leaves psi for the neighbours (name_intermediate), nis and nis_rows. Errors of name_incremental.
 * name_propagate(f, model, T dt, T Q[MK_PACKED(n)])
 *                     Q null: the transition's. Keeps nis and faults of the correction. ORDER (correct without diffuse, or readings that
 *                     wait), ARGUMENT (dt negative, no Jacobian), NOT_FINITE, NOT_POSITIVE_DEFINITE, TOLERANCE, what the motion's functions
 *                     returned; x and W are then as before.
 */
#define MK_DECLARE_EXTENDED(real)                                                                                             \
    /* The models, and where the filter's configuration has the arrays that belong to them: the same pointers, not const. The \
       configuration's input and steady are null. */                                                                          \
    typedef struct {                                                                                                          \
        const mk_transition_##real##_t *transition;                                                                           \
        const mk_sensor_##real##_t *sensor; /* slots */                                                                       \
        mk_##real##_t *A, *Q;               /* n x n; packed n */                                                             \
        mk_##real##_t *C, *F, *S, *R_inverse;                                                                                 \
    } mk_extended_##real##_t;                                                                                                 \
                                                                                                                              \
    /* The kernels. work of the view: MK_EXTENDED_WORK(n, m). */                                                              \
    mk_status_t mk_extended_observe_##real(int n, int m, const mk_rkfd_view_##real##_t *view, const mk_extended_##real##_t *model, \
                                           int slot, const mk_##real##_t *z);                                                 \
    mk_status_t mk_extended_correct_##real(int n, int m, int slots, const mk_rkfd_view_##real##_t *view,                      \
                                           const mk_extended_##real##_t *model);                                              \
    mk_status_t mk_extended_propagate_##real(int n, int m, int slots, const mk_rkfd_view_##real##_t *view,                    \
                                             const mk_extended_##real##_t *model, mk_##real##_t dt, const mk_##real##_t *Q);

MK_DECLARE_EXTENDED(f32)
MK_DECLARE_EXTENDED(f64)

#define MK_EXTENDED(name, real, n, m, slots)                                                                                  \
    MK_INLINE mk_status_t name##_observe(name##_t *f, const mk_extended_##real##_t *model, int slot, const mk_##real##_t *z) { \
        mk_##real##_t work[MK_EXTENDED_WORK(n, m)];                                                                           \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_extended_observe_##real(n, m, &view, model, slot, z);                                                       \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_correct(name##_t *f, const mk_extended_##real##_t *model) {                                  \
        mk_##real##_t work[MK_EXTENDED_WORK(n, m)];                                                                           \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_extended_correct_##real(n, m, slots, &view, model);                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_propagate(name##_t *f, const mk_extended_##real##_t *model, mk_##real##_t dt, const mk_##real##_t *Q) { \
        mk_##real##_t work[MK_EXTENDED_WORK(n, m)];                                                                           \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_extended_propagate_##real(n, m, slots, &view, model, dt, Q);                                                \
    }                                                                                                                         \
    typedef mk_extended_##real##_t name##_extended_t

#ifdef __cplusplus
}
#endif

#endif
