/* SPDX-License-Identifier: MIT */
/* The largest tolerance for which convergence is guaranteed (spec 1.6), and the largest for which it is seen. */
#ifndef MESHKAL_ADMISSIBLE_H
#define MESHKAL_ADMISSIBLE_H

#include "design/design.h"

#define MK_HORIZONS 12

typedef struct {
    int count;               /* horizons evaluated: 2 n, 4 n, 8 n, .. */
    int horizon[MK_HORIZONS];
    double c[MK_HORIZONS];   /* guaranteed below this; INFINITY: for every c. The last is the answer */
} mk_admissible_t;

/* c_max over growing horizons, until twice in a row it gains less than one per cent, for the recursion's A, Q and S. Its P is left at
   the fixed point of the plain filter. 1, or 0 if that does not settle. */
int mk_admissible(mk_recursion_t *recursion, mk_admissible_t *result);

/* The largest c, up to `limit`, at which the recursion with this one's information, started anew from V = P0 for each trial, settles, to
   one per cent; limit if it settles there. */
double mk_largest_settling(mk_recursion_t *recursion, const mk_scenario_t *scenario, double limit);

#endif
