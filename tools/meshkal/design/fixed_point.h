/* SPDX-License-Identifier: MIT */
/* Newton's method on a covariance recursion: the fixed point that a recursion is on its way to, without the thousands of steps that it takes
   to get there. What the recursion promises, that it converges from where it was started, is not given up: mk_fixed_point says yes only if

     1. the step that the recursion has reached lies so close that Newton's corrections shrink at once, each below a quarter of the last,
     2. the derivative J of a step at the fixed point has a power J^(2^k), k <= 14, of Frobenius norm below 1/2 in the coordinates in which
        P is the identity: every disturbance dies out, however the filter was started, and
     3. the recursion's own steps have brought it at least half the way there since an earlier one.

   Between them they leave no room for a cycle around a fixed point that repels (2), nor for one that surrounds an attractive one (3: the
   recursion would come no closer). No means nothing: go on with steps. The derivative, for dP = L E L', P = L L', M = (W + S)^-1:

       E -> F E F' - theta tr(H^2 E) / tr(H^2) G G',     G = L^-1 A M, F = G L^-T, K = L' L, H = K (I - theta K)^-1

   with the rank-one term from d theta = -(d gamma / dP . dP) / (d gamma / d theta) at constant gamma. */
#ifndef MESHKAL_FIXED_POINT_H
#define MESHKAL_FIXED_POINT_H

#include "design/design.h"

/* Beyond this dimension a matrix of d = n (n + 1) / 2 rows, cubed a dozen times, costs more than the steps it saves. */
#define MK_FIXED_POINT_LARGEST_N 12

/* earlier: P of an earlier step, packed. work: MK_FIXED_POINT_WORK(n) numbers. 1, and the recursion stands at its fixed point (P, theta
   and W are of the step from there); or 0, and it is untouched. n <= MK_FIXED_POINT_LARGEST_N. */
int mk_fixed_point(mk_recursion_t *recursion, const double *earlier, double *work);

/* Rows of J, in places that suit vector registers. */
#define MK_FIXED_POINT_STRIDE(n) ((MK_PACKED(n) + 7) / 8 * 8)
#define MK_FIXED_POINT_MATRIX(n) ((size_t)((MK_PACKED(n) + 1) * MK_FIXED_POINT_STRIDE(n)))
#define MK_FIXED_POINT_WORK(n) (2 * MK_FIXED_POINT_MATRIX(n) + (size_t)(8 * MK_PACKED(n) + 7 * (n) * (n)) + MK_ROBUST_WORK((size_t)(n)))

#endif
