/* SPDX-License-Identifier: MIT */
/* The tolerance that logged data ask for (spec 1.8). Residuals of the nominal prediction of z = [x(t+1); all y(t)],
 *
 *     x(t+1) - A x(t) - r   ~ N(0, Q)     process noise, in the range of Q if Q is singular
 *     y_k(t) - C_k x(t)     ~ N(0, R_k)   sensor of node k
 *
 * are independent under the model. c, in the unit of spec 1.2, is TWICE the Kullback-Leibler divergence in nats of the normal law with their
 * actual mean and covariance: how it is estimated and tested stands in mismatch.h. Every part alone is a block; what the blocks leave over
 * is correlation between them.
 *
 * Joint fit: steps with all readings, when they are at least the number of rows plus MK_FIT_SPARE and, for residuals correlated in time,
 * count as at least MK_FIT_EFFECTIVE times the rows. Otherwise the sum over blocks, each on the steps it has, which takes the blocks as
 * independent and does not see correlation between them.
 *
 * The states must be the truth, or known much better than Q and R say of one step: estimates of a filter have steps K e that are not
 * process noise, and the fit would tell of the filter. */
#ifndef MESHKAL_FIT_H
#define MESHKAL_FIT_H

#include "fit/mismatch.h"
#include "simulation/source.h"

#define MK_FIT_SPARE 10
#define MK_FIT_EFFECTIVE 4

enum { MK_FIT_PROCESS = -1, MK_FIT_ACROSS = -2, MK_FIT_ALL = -3 };

typedef struct {
    int node; /* or one of the above */
    int rows, steps;
    int enough; /* 0: too few readings, left out: nothing below is set */
    mk_mismatch_t mismatch;
    double c, low, high;             /* c unbiased: may be below 0. No interval for correlation between blocks: low = high = NaN */
    double statistic, degrees, p;    /* test of c = 0 */
    double p_holm;                   /* of the blocks: corrected for their number */
} mk_fit_block_t;

typedef struct {
    int steps, complete_steps; /* with a next state; of these with the readings of all nodes that are not left out */
    int joint, left_out;
    double level;
    mk_fit_block_t all;
    int blocks, rejected;  /* rejected: with p_holm below 1 - level */
    mk_fit_block_t *block; /* process noise if Q is not 0, nodes 0 .., correlation between them if joint */
    int consistent;        /* all.p is 1 - level or above */
    double tolerance;      /* 0 if consistent, else c */
} mk_fit_t;

/* source: recorded, with truth; its file names for messages. 1, or 0 and an error; *fit is then empty. */
int mk_fit_make(mk_fit_t *fit, const mk_source_t *source, const char *states, const char *measurements, double level, mk_error_t *error);
void mk_fit_free(mk_fit_t *fit);

/* "process noise", "node 7", "between blocks", "all"; text holds at least 24 characters. Returns text. */
char *mk_fit_name(int node, char *text);

#endif
