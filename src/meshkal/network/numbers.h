/* SPDX-License-Identifier: MIT */
/* Floating-point numbers as bytes of a frame. Conversions work on bits, because targets without hardware for a format round
   in libraries that are not all exact. Part of the shared build. */
#ifndef MESHKAL_NETWORK_NUMBERS_H
#define MESHKAL_NETWORK_NUMBERS_H

#include <meshkal/frame.h>
#include <string.h>

#include "bytes.h"

/* A binary format: bits of the fraction and of the exponent. */
typedef struct {
    int fraction, exponent;
} mk_format_t;

static mk_format_t mk_numbers_format(int numbers) {
    const mk_format_t f32 = {23, 8}, f64 = {52, 11}, f16 = {10, 5};
    return numbers == MK_NUMBERS_F64 ? f64 : numbers == MK_NUMBERS_F16 ? f16 : f32;
}

/* The bits of a number in another format, to the nearest, ties to even. Infinity and NaN stay so, too large becomes infinity. */
static uint64_t mk_convert_bits(uint64_t bits, mk_format_t from, mk_format_t to) {
    const uint64_t sign = bits >> (from.fraction + from.exponent) << (to.fraction + to.exponent);
    const int special = (1 << from.exponent) - 1, infinity = (1 << to.exponent) - 1;
    int exponent = (int)(bits >> from.fraction) & special;
    uint64_t fraction = bits & (((uint64_t)1 << from.fraction) - 1);
    if (exponent == special) return sign | (uint64_t)infinity << to.fraction | (fraction ? (uint64_t)1 << (to.fraction - 1) : 0);
    if (exponent == 0) { /* subnormal: no hidden bit; normalised here */
        if (fraction == 0) return sign;
        exponent = 1;
        while (!(fraction >> from.fraction)) {
            fraction <<= 1;
            exponent--;
        }
    } else {
        fraction |= (uint64_t)1 << from.fraction;
    }
    exponent += infinity / 2 - special / 2;
    /* Value: fraction 2^-from.fraction times 2^exponent in the new bias; below exponent 1 the result is subnormal. */
    int drop = from.fraction - to.fraction + (exponent < 1 ? 1 - exponent : 0);
    if (drop > from.fraction + 2) drop = from.fraction + 2;
    if (drop <= 0) {
        fraction <<= -drop;
    } else {
        const uint64_t half = (uint64_t)1 << (drop - 1), odd = fraction >> drop & 1u;
        fraction = (fraction + (half - 1) + odd) >> drop;
    }
    /* Adding the exponent above the fraction lets a carry of the rounding pass into it; the hidden bit adds one. */
    const uint64_t magnitude = exponent < 1 ? fraction : fraction + ((uint64_t)(exponent - 1) << to.fraction);
    return sign | (magnitude >> to.fraction >= (uint64_t)infinity ? (uint64_t)infinity << to.fraction : magnitude);
}

static int mk_bits_finite(uint64_t bits, mk_format_t format) {
    const uint64_t special = ((uint64_t)1 << format.exponent) - 1;
    return (bits >> format.fraction & special) != special;
}

#endif
