/* SPDX-License-Identifier: MIT */
/* What every Meshkal header rests on: real types, status codes, and the refusal of compilers that break IEEE arithmetic. */
#ifndef MESHKAL_BASE_H
#define MESHKAL_BASE_H

#include <float.h>
#include <stdint.h>

#define MK_VERSION "0.1.0"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "Meshkal needs IEEE arithmetic: NaN checks and bit-exact replay do not survive -ffast-math"
#endif
#if FLT_EVAL_METHOD != 0
#error "Meshkal needs operations rounded to their own type (FLT_EVAL_METHOD 0): on x86 use -mfpmath=sse"
#endif

/* Also compile with -ffp-contract=off (gcc -std=gnu99 fuses multiply and add by default): without it results differ between
   targets in the last bits. No macro tells, so it cannot be checked here. */

/* Functions that a type macro declares: not all of them are used in every translation unit. */
#if defined(__GNUC__) || defined(__clang__)
#define MK_INLINE static inline __attribute__((unused))
#define MK_NOINLINE static __attribute__((noinline, unused))
#else
#define MK_INLINE static inline
#define MK_NOINLINE static inline
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef float mk_f32_t;
typedef double mk_f64_t;

/* Every function that can fail returns one of these. On failure all state is as before the call. */
typedef enum {
    MK_OK = 0,
    MK_ERROR_ARGUMENT,              /* null pointer, or slot or size out of range */
    MK_ERROR_SHAPE,                 /* configuration was made for other dimensions than the filter's type */
    MK_ERROR_NOT_FINITE,            /* NaN or infinity in an input, or a result that overflowed */
    MK_ERROR_NOT_POSITIVE_DEFINITE, /* a covariance or information matrix has a pivot that is not positive */
    MK_ERROR_TOLERANCE,             /* tolerance negative, not finite, or without a root in this precision */
    MK_ERROR_ORDER,                 /* call out of turn: the header says which call comes first */
    MK_ERROR_REPEATED,              /* the slot has already been filled in this step: the new value was dropped */
    /* Why a node refused a frame (meshkal/frame.h, meshkal/node.h), in the order in which a frame is examined; but TYPE comes after
       CHECKSUM, TYPE and LENGTH once more where a neighbour's content is looked at, and REPEATED and NOT_FINITE come before IMPLAUSIBLE. */
    MK_ERROR_LENGTH,                /* truncated, or not as long as its content */
    MK_ERROR_VERSION,               /* another version of the format */
    MK_ERROR_TYPE,                  /* stage, number format or flags unknown or not expected from this neighbour */
    MK_ERROR_CHECKSUM,              /* CRC-32 does not match */
    MK_ERROR_SECURITY,              /* plain where only sealed frames are taken, or sealed and there is no key */
    MK_ERROR_MODEL,                 /* made for another model */
    MK_ERROR_STRANGER,              /* from a node that is not a neighbour */
    MK_ERROR_REPLAYED,              /* sealed frame that was seen before, or older than the replay window */
    MK_ERROR_FORGED,                /* the seal does not open */
    MK_ERROR_LATE,                  /* of a stage that is over */
    MK_ERROR_AHEAD,                 /* more than one stage ahead of this node */
    MK_ERROR_IMPLAUSIBLE,           /* information beyond the configured limit, or an estimate too large to be used */
    MK_ERROR_GATED,                 /* too far from what the filter expects */
    MK_ERROR_DOMAIN,                /* a point outside the domain of a model's function */
    MK_STATUS_COUNT
} mk_status_t;

/* Name of a status, for example "MK_OK"; never null. Static storage. */
const char *mk_status_name(mk_status_t status);

/* Elements of a symmetric n x n matrix in packed storage. Element (i, j), j <= i, stands at i * (i + 1) / 2 + j. */
#define MK_PACKED(n) ((n) * ((n) + 1) / 2)

#ifdef __cplusplus
}
#endif

#endif
