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

/* Digits from 0 to 2^32 - 1 but for the last, which keeps the sign. */
static void carry(int64_t *digit) {
    for (int i = 0; i + 1 < OTHER; i++) {
        const int64_t low = digit[i] & (int64_t)LOW, over = (digit[i] - low) / ((int64_t)LOW + 1);
        digit[i] = low;
        digit[i + 1] += over;
    }
}

double mk_exact_value(const mk_exact_t *sum) {
    if (sum->digit[OTHER]) return (double)NAN;
    int64_t digit[MK_EXACT_DIGITS];
    memcpy(digit, sum->digit, sizeof digit);
    carry(digit);
    const int negative = digit[OTHER - 1] < 0;
    if (negative) {
        for (int i = 0; i < OTHER; i++) digit[i] = -digit[i];
        carry(digit);
    }
    int top = OTHER - 1;
    while (top > 1 && digit[top] == 0) top--;
    /* 64 leading bits, the last of them 1 if anything follows: the conversion to double then rounds as if it saw all. */
    uint64_t head = (uint64_t)digit[top] << 32 | (uint64_t)digit[top - 1], rest = top > 1 ? (uint64_t)digit[top - 2] : 0;
    int shift = 0;
    while (head && !(head >> 63)) {
        head = head << 1 | (rest >> 31 & 1);
        rest = rest << 1 & LOW;
        shift++;
    }
    for (int i = top - 3; i >= 0 && !rest; i--) rest = (uint64_t)digit[i];
    const double value = ldexp((double)(head | (rest != 0)), 32 * (top - 1) - 1074 - shift);
    return negative ? -value : value;
}
