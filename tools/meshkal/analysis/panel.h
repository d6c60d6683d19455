/* SPDX-License-Identifier: MIT */
/* Large matrices of n x n blocks, stored in panels of some columns each, and the two passes of a covariance step over them:

       T = (W' F X)'   then   X = W' (F T + N) + L H + Q

   with F block diagonal, W the sparse scalar weights of the diffusion, N sparse, L H of low rank. X is symmetric and stored whole; the
   second pass computes half of it. Sums run in an order that the data fix: results do not depend on threads or vector units. */
#ifndef MESHKAL_PANEL_H
#define MESHKAL_PANEL_H

#include <stddef.h>

/* Panel p holds columns p width .. (p + 1) width - 1 of all rows, row by row. blocks blocks a panel; rows counts padding. */
typedef struct {
    int n, estimators, blocks, width, panels;
    size_t rows;
} mk_panel_shape_t;

/* Shape for `estimators` blocks of n: a width that vector units divide. */
mk_panel_shape_t mk_panel_shape(int n, int estimators);
/* Doubles of one matrix. */
size_t mk_panel_size(const mk_panel_shape_t *shape);
/* Where element (row, 0) of the columns of block j stands; the next row is `width` further. */
size_t mk_panel_at(const mk_panel_shape_t *shape, int row_block, int column_block);

/* Whose intermediate estimates estimator e combines: slot[first[e]] .. with weights. */
typedef struct {
    const int *first, *slot;
    const double *weight;
} mk_mixing_t;

typedef struct {
    mk_panel_shape_t shape;
    mk_mixing_t mixing;
    const double *F;     /* estimators x n x n */
    int rank;            /* columns of L, 0 for none */
    const double *L, *H; /* L: estimators x n x rank. H: one rank x width piece a panel */
    const double *Q;     /* n x width: Q repeated */
} mk_panel_step_t;

/* y = F x, or y + F x: F n x n, x and y one block row of a panel (n x width). */
void mk_panel_product(const mk_panel_shape_t *shape, const double *F, const double *x, int onto, double *y);

/* Doubles of scratch that a pass needs. */
size_t mk_panel_scratch(const mk_panel_shape_t *shape);

/* Panel p of the first pass: reads panel p of X, writes its rows of T. */
void mk_panel_first(const mk_panel_step_t *step, int p, const double *X, double *T, double *scratch);
/* Panel p of the second: F T into scratch (estimators x n x width, to which the caller adds N), then rows up to p of X and, by symmetry,
   columns. */
void mk_panel_map(const mk_panel_step_t *step, int p, const double *T, double *scratch);
void mk_panel_second(const mk_panel_step_t *step, int p, double *X, double *scratch);

#endif
