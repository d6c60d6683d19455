/* SPDX-License-Identifier: MIT */
/* A trajectory without noise, and what the sensors say along it: who reaches the target, and the information H' R^-1 H of each reading. */
#ifndef MESHKAL_TRAJECTORY_H
#define MESHKAL_TRAJECTORY_H

#include "tracking/models.h"

typedef struct {
    int n, nodes;
    long instants;       /* numbered from 1 where people read it */
    double *t;           /* s */
    double *x;           /* instants x n */
    double *Phi;         /* instants x n x n: derivative of the motion from each instant to the next one; the last is not there */
    int *entry;          /* instants x nodes: number of a reading's information; -1 where the node has none */
    double *information; /* packed n each */
    int *measuring;      /* of each instant: nodes with a reading */
    /* Sensors that reach the target, which stands where their model has no derivative: they count as not measuring. */
    long undefined, undefined_instant;
    int undefined_node;
    int filled_velocity, kept_states; /* recorded: the file had no velocity; other states that stay as in x0 */
} mk_trajectory_t;

/*
 * truth null: x(0) = x0, x := g(x) every dt_s, one instant for each of `steps` steps, the first one dt_s after x0. Otherwise a CSV file, columns
 * t,state,value: an instant for each of its times, which need every state of the position; a velocity that the file has nowhere is the
 * quotient of differences, other states that it has nowhere stay as in x0. A state must be there always or never.
 * Every sensor within its range limit is taken to give its reading. Where a model has no Jacobian, central differences stand in for it (steps of
 * 6e-6 of |x| + the deviation in P0).
 * 1, or 0 and an error: the file; the motion leaves its domain. Free the result by mk_trajectory_free.
 */
int mk_trajectory_make(mk_trajectory_t *trajectory, const mk_models_f64_t *models, long steps, const char *truth, mk_error_t *error);
void mk_trajectory_free(mk_trajectory_t *trajectory);

#endif
