/* SPDX-License-Identifier: MIT */
#include "exact_sum.h"

#include <math.h>
#include <string.h>

#define OTHER (MK_EXACT_DIGITS - 1)
#define LOW UINT64_C(0xffffffff)

void mk_exact_add(mk_exact_t *sum, double term) {
    uint64_t bits;
    memcpy(&bits, &term, sizeof bits);
    const int exponent = (int)(bits >> 52 & 0x7ff);
    if (exponent == 0x7ff) {
        sum->digit[OTHER]++;
        return;
    }
    /* term = +- mantissa 2^(place - 1074) */
    const int place = exponent ? exponent - 1 : 0;
    const uint64_t mantissa = (bits & UINT64_C(0xfffffffffffff)) | (uint64_t)(exponent > 0) << 52;
    const uint64_t low = (mantissa & LOW) << (place & 31), high = (mantissa >> 32) << (place & 31);
    const int64_t sign = bits >> 63 ? -1 : 1;
    int64_t *digit = sum->digit + (place >> 5);
    digit[0] += sign * (int64_t)(low & LOW);
    digit[1] += sign * (int64_t)((low >> 32) + (high & LOW));
    digit[2] += sign * (int64_t)(high >> 32);
}

void mk_exact_move(mk_exact_t *sum, mk_exact_t *from) {
    for (int i = 0; i < MK_EXACT_DIGITS; i++) sum->digit[i] += from->digit[i];
    memset(from, 0, sizeof *from);
}

/* Digits from..to from 0 to 2^32 - 1 but for the last, which keeps the sign. */
static void carry(int64_t *digit, int from, int to) {
    for (int i = from; i < to; i++) {
        const int64_t low = digit[i] & (int64_t)LOW, over = (digit[i] - low) / ((int64_t)LOW + 1);
        digit[i] = low;
        digit[i + 1] += over;
    }
}

static int is_zero(const int64_t *digit) {
    return (digit[0] | digit[1] | digit[2] | digit[3] | digit[4] | digit[5] | digit[6] | digit[7]) == 0;
}

double mk_exact_value(const mk_exact_t *sum) {
    if (sum->digit[OTHER]) return (double)NAN;
    /* Numbers of like size fill few digits, from `bottom` to `last`, and only those are worked on. */
    int bottom = 0, last = OTHER - 1;
    while (bottom + 8 <= last && is_zero(sum->digit + bottom)) bottom += 8;
    while (last - 8 >= bottom && is_zero(sum->digit + last - 7)) last -= 8;
    while (last > bottom && sum->digit[last] == 0) last--;
    last = last + 2 < OTHER ? last + 2 : OTHER - 1; /* a digit's 64 bits are carried over two */
    bottom = bottom > 2 ? bottom - 2 : 0;           /* read below, as zeros */
    int64_t digit[MK_EXACT_DIGITS];
    for (int i = bottom; i <= last; i++) digit[i] = sum->digit[i];
    carry(digit, bottom, last);
    const int negative = digit[last] < 0;
    if (negative) {
        for (int i = bottom; i <= last; i++) digit[i] = -digit[i];
        carry(digit, bottom, last);
    }
    int top = last, shift = 0;
    while (top > bottom + 1 && digit[top] == 0) top--;
    /* 64 leading bits, the last of them 1 if anything follows: the conversion to double then rounds as if it saw all. */
    uint64_t head = (uint64_t)digit[top] << 32 | (uint64_t)digit[top - 1], rest = top - 2 >= bottom ? (uint64_t)digit[top - 2] : 0;
    for (int width = 32; width > 0 && head; width /= 2) {
        if (head >> (64 - width)) continue;
        head = head << width | rest << width >> 32;
        rest = rest << width & LOW;
        shift += width;
    }
    for (int i = top - 3; i >= bottom && !rest; i--) rest = (uint64_t)digit[i];
    const double value = ldexp((double)(head | (rest != 0)), 32 * (top - 1) - 1074 - shift);
    return negative ? -value : value;
}
