/* SPDX-License-Identifier: MIT */
/* Sums that do not depend on the order of their terms: a fixed-point number as wide as the range of double (Kulisch). What threads and
   processes add in any order, and merge in any order, gives the same bits. */
#ifndef MESHKAL_HOST_EXACT_SUM_H
#define MESHKAL_HOST_EXACT_SUM_H

#include <stddef.h>
#include <stdint.h>

/* Digits of 32 bits with room for carries, least first; the last one counts terms that are not finite. Adding two such numbers digit by
   digit merges them. Zeroed memory is 0. At most 2^30 terms. */
#define MK_EXACT_DIGITS 68
typedef struct {
    int64_t digit[MK_EXACT_DIGITS];
} mk_exact_t;

void mk_exact_add(mk_exact_t *sum, double term);
/* Adds `from` to `sum` and leaves 0 there. */
void mk_exact_move(mk_exact_t *sum, mk_exact_t *from);
/* The sum, rounded once to nearest; NaN if a term was not finite. Leaves the value as it is. */
double mk_exact_value(const mk_exact_t *sum);

#endif
