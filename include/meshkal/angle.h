/* SPDX-License-Identifier: MIT */
/*
 * Angles in radians: sine, cosine, arc tangent and wrapping, made of + - * / only, so that every target gives the same bits. For models
 * (meshkal/model.h) whose runs replay: libm's functions differ between targets. float32 uses no double.
 */
#ifndef MESHKAL_ANGLE_H
#define MESHKAL_ANGLE_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MK_DECLARE_ANGLE(real)                                                                                                \
    /* *sine := sin x, *cosine := cos x. Error below 1 unit in the last place for |x| up to 12 000 (float32) or 2e8 (float64),\
       next to the multiples of pi too; beyond, an absolute error of |x| epsilon; NaN from 6.5e6 or 3.5e15 on, where the      \
       numbers lie about a radian apart, and for what is not finite. */                                                       \
    void mk_sincos_##real(mk_##real##_t x, mk_##real##_t *sine, mk_##real##_t *cosine);                                       \
    /* The angle of the point (x, y), from -pi to pi; pi for y = 0 or -0 and x < 0. Error below 2 units in the last place.    \
       NaN at (0, 0) and where |x| + |y| is not finite. */                                                                    \
    mk_##real##_t mk_atan2_##real(mk_##real##_t y, mk_##real##_t x);                                                          \
    /* x less whole turns, in [-pi, pi) but for rounding at its ends; what lies there comes back as it is. Error below 1 unit \
       in the last place; range and NaN as mk_sincos. */                                                                      \
    mk_##real##_t mk_wrap_##real(mk_##real##_t x);

MK_DECLARE_ANGLE(f32)
MK_DECLARE_ANGLE(f64)

#ifdef __cplusplus
}
#endif

#endif
