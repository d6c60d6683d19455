/* SPDX-License-Identifier: MIT */
/* Included before each pass over a *.tmpl.h file, which is compiled once for each precision. MK_BITS (32 or 64) chooses. */
/* No include guard: that is the point. */
#undef MK_F
#undef MK_F_T
#undef MK_REAL
#undef MK_UINT
#undef MK_R
#undef MK_EPSILON
#undef MK_LARGEST
#undef MK_SMALLEST
#if MK_BITS == 32
#define MK_F(name) name##_f32
#define MK_F_T(name) name##_f32_t
#define MK_REAL float
#define MK_UINT uint32_t
#define MK_R(value) value##f
#define MK_EPSILON FLT_EPSILON
#define MK_LARGEST FLT_MAX
#define MK_SMALLEST FLT_MIN
#elif MK_BITS == 64
#define MK_F(name) name##_f64
#define MK_F_T(name) name##_f64_t
#define MK_REAL double
#define MK_UINT uint64_t
#define MK_R(value) value
#define MK_EPSILON DBL_EPSILON
#define MK_LARGEST DBL_MAX
#define MK_SMALLEST DBL_MIN
#else
#error "MK_BITS is 32 or 64"
#endif
