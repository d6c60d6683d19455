/* SPDX-License-Identifier: MIT */
/* Square roots: the one operation beyond + - * / that IEEE 754 rounds exactly, so the one libm call the library makes. */
#ifndef MESHKAL_ALGEBRA_SQRT_H
#define MESHKAL_ALGEBRA_SQRT_H

#include <math.h>

#include "../inline.h"

/* The builtins become one instruction where the target has it; elsewhere they call libm. */
#if defined(__GNUC__) || defined(__clang__)
MK_KERNEL float mk_sqrt_f32(float x) { return __builtin_sqrtf(x); }
MK_KERNEL double mk_sqrt_f64(double x) { return __builtin_sqrt(x); }
#else
MK_KERNEL float mk_sqrt_f32(float x) { return sqrtf(x); }
MK_KERNEL double mk_sqrt_f64(double x) { return sqrt(x); }
#endif

#endif
