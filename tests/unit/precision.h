/* SPDX-License-Identifier: MIT */
/* Names for tests that are written once and compiled in both precisions: define PRECISION as f32 or f64 and REAL, include the
   *.tmpl.h files, undefine both. */
#ifndef UNIT_PRECISION_H
#define UNIT_PRECISION_H

#define PASTE(a, b) a##b
#define JOIN(a, b) PASTE(a, b)
#define NAME(name) JOIN(name##_, PRECISION)
#define TYPE(name) JOIN(NAME(name), _t)
#define TINY(function) JOIN(NAME(tiny), _##function)

/* Arguments are expanded before the library's macros paste them. */
#define MK_RKFD_OF(name, real, n, m, slots) MK_RKFD(name, real, n, m, slots)

#endif
