/* SPDX-License-Identifier: MIT */
/*
 * Ready models of meshkal/model.h: a target that moves in the plane or in space, and sensors at known places that see it.
 * SI units: m, m/s, rad, rad/s, s. Same bits on every target.
 *
 *     static const mk_motion_t motion = {.n = 4, .dimensions = 2, .position = {0, 2}, .velocity = {1, 3}};     // [px, vx, py, vy]
 *     static const mk_site_f32_t mast = {&motion, {10, 0}, {0}};
 *     const mk_model_f32_t moves = {mk_constant_velocity_f32, mk_constant_velocity_jacobian_f32, &motion, NULL};
 *     const mk_model_f32_t sees = {mk_range_f32, mk_range_jacobian_f32, &mast, NULL};
 *
 * Functions and Jacobians follow the contract of meshkal/model.h (counts, shapes, no overlap); their contexts are checked once, by
 * mk_motion_check, not at every call. A function that returns another status than MK_OK may have written part of its results.
 */
#ifndef MESHKAL_TRACKING_H
#define MESHKAL_TRACKING_H

#include <meshkal/model.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Which states are what. A filter may have more states than these: the others stay as they are. */
typedef struct {
    uint8_t n;           /* states of the filter: x is n numbers */
    uint8_t dimensions;  /* 2 or 3; of the arrays below the first 2 or 3 elements count: x, y, z */
    uint8_t position[3]; /* m */
    uint8_t velocity[3]; /* m/s; not read by mk_range, mk_bearing, mk_range_bearing, mk_tdoa */
    uint8_t turn_rate;   /* rad/s, counterclockwise seen from +z; read by mk_constant_turn* only */
} mk_motion_t;

/* What a model reads. Positions are always read. */
#define MK_MOTION_VELOCITY 1
#define MK_MOTION_TURN_RATE 2

/* MK_ERROR_ARGUMENT: a null pointer, dimensions other than 2 and 3, or a state that is read is n or beyond, or read twice.
   reads: sum of the above; both for mk_constant_turn. */
mk_status_t mk_motion_check(const mk_motion_t *motion, int reads);

/*
 * Motions, context mk_motion_t:
 *     constant velocity   p(t + dt) = p + dt v,  v(t + dt) = v                                        (spec 2.1, 4.3)
 *     constant turn       v turns by omega dt, p moves on the arc: the exact solution of dv/dt = omega e_z x v;
 *                         smooth at omega = 0, where it is constant velocity; z moves at constant velocity
 * They are MK_OK always; omega dt beyond the range of mk_sincos (meshkal/angle.h) gives NaN.
 *
 * Noises: Q, packed, MK_PACKED(n) numbers, is written whole, 0 for all other states. For each axis, with the spectral density
 * q[axis] >= 0 of its white acceleration (m^2/s^3), position and velocity have q [dt^3/3 dt^2/2; dt^2/2 dt]; the turn rate is a random
 * walk, q_turn dt, q_turn in rad^2/s^3. For the turn that neglects how the acceleration turns within dt.
 * MK_ERROR_ARGUMENT: null pointer, dt or a density negative. MK_ERROR_NOT_FINITE: one of them is not, or Q would not be. Q then stays.
 *
 * Sensors, context mk_site_<real>_t. d = p - position, r = |d|:
 *     range           1 row                r
 *     bearing         dimensions - 1 rows  azimuth atan2(d_y, d_x), from the x axis to the y axis; in 3 dimensions also elevation
 *                                          atan2(d_z, sqrt(d_x^2 + d_y^2))
 *     range_bearing   dimensions rows      r, then the rows of bearing
 *     range_rate      1 row                dr/dt = d'v / r of a sensor that stands still
 *     tdoa            1 row                r - |p - reference|: time difference of arrival times speed of propagation; without
 *                                          the cancellation that a difference of two large ranges would have
 * MK_ERROR_DOMAIN at r = 0: bearing, range_rate and every Jacobian; bearing rows in 3 dimensions on the whole vertical through the
 * sensor; the Jacobian of tdoa at either place. Zero is a distance whose square is below the smallest normal number: 1.1e-19 m
 * (float32), 1.5e-154 m (float64). MK_ERROR_NOT_FINITE: a position that is not finite, or a distance whose square overflows: above
 * 1.8e19 m or 1.3e154 m. A velocity that is not finite, or overflows, gives results that are not.
 */
#define MK_DECLARE_TRACKING_MODEL(name, real)                                                                                 \
    mk_status_t mk_##name##_##real(const void *context, mk_##real##_t dt, int count, const mk_##real##_t *x, mk_##real##_t *y); \
    mk_status_t mk_##name##_jacobian_##real(const void *context, mk_##real##_t dt, const mk_##real##_t *x, mk_##real##_t *J);

#define MK_DECLARE_TRACKING(real)                                                                                             \
    /* Place of a sensor, in the first `dimensions` elements. */                                                              \
    typedef struct {                                                                                                          \
        const mk_motion_t *motion;                                                                                            \
        mk_##real##_t position[3];                                                                                            \
        mk_##real##_t reference[3]; /* the other receiver; read by mk_tdoa* only */                                           \
    } mk_site_##real##_t;                                                                                                     \
                                                                                                                              \
    MK_DECLARE_TRACKING_MODEL(constant_velocity, real)                                                                        \
    MK_DECLARE_TRACKING_MODEL(constant_turn, real)                                                                            \
    mk_status_t mk_constant_velocity_noise_##real(const mk_motion_t *motion, mk_##real##_t dt, const mk_##real##_t *q,        \
                                                  mk_##real##_t *Q);                                                          \
    mk_status_t mk_constant_turn_noise_##real(const mk_motion_t *motion, mk_##real##_t dt, const mk_##real##_t *q,            \
                                              mk_##real##_t q_turn, mk_##real##_t *Q);                                        \
                                                                                                                              \
    MK_DECLARE_TRACKING_MODEL(range, real)                                                                                    \
    MK_DECLARE_TRACKING_MODEL(bearing, real)                                                                                  \
    MK_DECLARE_TRACKING_MODEL(range_bearing, real)                                                                            \
    MK_DECLARE_TRACKING_MODEL(range_rate, real)                                                                               \
    MK_DECLARE_TRACKING_MODEL(tdoa, real)                                                                                     \
                                                                                                                              \
    /* Differences for mk_space_<real>_t, context mk_motion_t, without a mean of their own: {mk_bearing_difference_f32, NULL, \
       &motion}. Rows that are angles are wrapped to [-pi, pi) (mk_wrap of meshkal/angle.h). d may be a or b. */              \
    void mk_bearing_difference_##real(const void *context, const mk_##real##_t *a, const mk_##real##_t *b, mk_##real##_t *d); \
    void mk_range_bearing_difference_##real(const void *context, const mk_##real##_t *a, const mk_##real##_t *b, mk_##real##_t *d);

MK_DECLARE_TRACKING(f32)
MK_DECLARE_TRACKING(f64)

#ifdef __cplusplus
}
#endif

#endif
