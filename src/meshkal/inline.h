/* SPDX-License-Identifier: MIT */
/* How the kernels are compiled. They take dimensions as arguments; where those are literals, always-inline and unrolling turn
   each use into straight-line code. MK_ROLLED (the shared build) keeps functions and loops. */
#ifndef MESHKAL_INLINE_H
#define MESHKAL_INLINE_H

#if (defined(__GNUC__) || defined(__clang__)) && !defined(MK_ROLLED)
#define MK_KERNEL static inline __attribute__((always_inline, unused))
#elif defined(__GNUC__) || defined(__clang__)
#define MK_KERNEL static __attribute__((unused))
#else
#define MK_KERNEL static inline
#endif

/* Inlined in the shared build, too: for parts of one large function, whose frames would otherwise add up on the stack. */
#if defined(__GNUC__) || defined(__clang__)
#define MK_PART static inline __attribute__((always_inline, unused))
#else
#define MK_PART static inline
#endif

/* gcc unrolls a loop of known count only as far as a size limit that these kernels exceed; clang's own limit suffices. */
#if defined(__GNUC__) && !defined(__clang__) && !defined(MK_ROLLED)
#define MK_UNROLL _Pragma("GCC unroll 8")
#define MK_UNROLL_ALL _Pragma("GCC unroll 64")
#elif defined(__clang__) && !defined(MK_ROLLED)
#define MK_UNROLL _Pragma("clang loop unroll_count(8)")
#define MK_UNROLL_ALL _Pragma("clang loop unroll(full)")
#else
#define MK_UNROLL
#define MK_UNROLL_ALL
#endif

#if defined(__GNUC__) || defined(__clang__)
#define MK_RESTRICT __restrict
#else
#define MK_RESTRICT
#endif

/* Size of the vector registers that algebra/row.tmpl.h uses; undefined where there are none. */
#if (defined(__GNUC__) || defined(__clang__)) && !defined(MK_ROLLED) && !defined(MK_NARROW)
#if defined(__AVX__)
#define MK_VECTOR_BYTES 32
#elif defined(__SSE2__) || defined(__aarch64__)
#define MK_VECTOR_BYTES 16
#endif
#endif

/* First of the elements 0 .. n - 1 of a row to be computed where only those from i are needed: with vector registers it takes no longer to compute
   all, and every piece of the row then starts where it started before. */
#ifdef MK_VECTOR_BYTES
#define MK_LANES_FROM(i) 0
#else
#define MK_LANES_FROM(i) (i)
#endif

/* Without vector registers filters of up to MK_NARROW_N states are compiled for few registers (filter/rkfd_narrow.tmpl.h). MK_NARROW
   may be given from outside: to test that code on the host. */
#define MK_NARROW_N 6
#if !defined(MK_VECTOR_BYTES) && !defined(MK_ROLLED) && !defined(MK_NARROW)
#define MK_NARROW
#endif

/* Arm cores with a single-precision unit but without vectors load several of its registers at once; clang knows. */
#if defined(__GNUC__) && !defined(__clang__) && !defined(MK_ROLLED) && defined(__thumb2__) && defined(__ARM_FP) && !defined(__SOFTFP__) && \
    !defined(__ARM_NEON)
#define MK_LOAD_MULTIPLE
#endif

/* Place of element (i, j), j <= i, of a packed symmetric matrix. */
#define MK_AT(i, j) ((i) * ((i) + 1) / 2 + (j))

/* The same for any i and j. */
#define MK_PLACE(i, j) ((i) > (j) ? MK_AT(i, j) : MK_AT(j, i))

#endif
