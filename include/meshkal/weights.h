/* SPDX-License-Identifier: MIT */
/*
 * Weights of rows by how far their innovations stand out (spec 3.2, IGG-III): the gain of row j is multiplied by
 *
 *     w = 1 (|u| <= k0);  (k0 / |u|) ((k1 - |u|) / (k1 - k0))^2;  0 (|u| > k1)
 *
 *     MK_STATISTIC_NORMAL   REKF-N: u_j = r_j / sqrt(S_jj), normal
 *     MK_STATISTIC_STUDENT  REKF-t: t_j = (u_j - mean of the others) / (s of the others sqrt(1 + 1 / (rows - 1))), Student with rows - 2 degrees;
 *                           needs four rows, with fewer all weights are 1
 *
 * A filter with such weights (unscented.h) computes x += Kw r and, the gain not being optimal,
 *
 *     P := (I - Kw H) P (I - Kw H)' + Kw (R + Omega) Kw',  Kw = K diag(w)
 *
 * as what that is equal to,
 *
 *     (P of the optimal gain) + K (I - W) S (I - W) K',  S the innovations' covariance, W = diag(w)
 *
 * in which nothing is subtracted, on triangular factors. Where all weights are 1, it has the bits of a filter without them.
 *
 * What weights cannot do: several readings that are wrong alike hide each other from Student's statistic; a filter that is surer of a wrong estimate
 * than it may be refuses every reading for as long as its P says so; and where P is much wider than the noise, a weight just below 1 leaves much of it.
 */
#ifndef MESHKAL_WEIGHTS_H
#define MESHKAL_WEIGHTS_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MK_STATISTIC_NORMAL, MK_STATISTIC_STUDENT };

#define MK_DECLARE_WEIGHTS(real)                                                                                              \
    typedef struct {                                                                                                          \
        const mk_##real##_t *k0, *k1; /* for 1, 2, .. slots x m rows; 0 < k0 < k1, or both 0: all weights are 1 */            \
        mk_##real##_t *weight;        /* slots x m: those of the last update, in RAM, 0 where nothing was read; null: not kept */ \
        mk_##real##_t *statistic;     /* slots x m: u or t; null: not kept */                                                 \
        uint8_t kind;                 /* MK_STATISTIC_ */                                                                     \
    } mk_row_weights_##real##_t;                                                                                                  \
                                                                                                                              \
    /* k[r - 1], r = 1 .. count: the two-sided quantile of this significance for r rows; Student: 0 below four rows. ARGUMENT                  \
       (significance not between 0 and 1, kind unknown, count below 1, null): nothing is written. */                          \
    mk_status_t mk_weight_thresholds_##real(int kind, double significance, int count, mk_##real##_t *k);                      \
    /* w above; 0 where u is NaN, else 1 where k1 is 0. */                                                                    \
    mk_##real##_t mk_igg3_weight_##real(mk_##real##_t u, mk_##real##_t k0, mk_##real##_t k1);                                 \
    /* statistic[j] of rows j from innovations r and variances S_jj > 0; may be r or variance. t where the others do not vary at all: 0, or the    \
       largest number with its sign; of fewer than four rows: 0. */                                                           \
    void mk_weight_statistics_##real(int kind, int rows, const mk_##real##_t *r, const mk_##real##_t *variance, mk_##real##_t *statistic);

MK_DECLARE_WEIGHTS(f32)
MK_DECLARE_WEIGHTS(f64)

#ifdef __cplusplus
}
#endif

#endif
