/* SPDX-License-Identifier: MIT */
/*
 * What readings in a window say of the state at its first instant t0 (observability along a trajectory):
 *
 *     I(t0) = sum over s = 0 .. W - 1 of Phi(t0 + s, t0)' H' R^-1 H Phi(t0 + s, t0)      over all sensors that are counted
 *
 * without process noise. States have different units, so I is measured by P0 = L L': the eigenvalues of L' I L do not depend on units, and 1 means
 * as much information as the prior has in that direction. An eigenvalue up to 1e-10 of the largest counts as none: that direction is not
 * seen (a filter's linearised models say the same; two mirror images of a target are not told apart by I, which is local).
 */
#ifndef MESHKAL_WINDOWS_H
#define MESHKAL_WINDOWS_H

#include "tracking/trajectory.h"

#define MK_UNSEEN 1e-10

typedef struct {
    double smallest;  /* eigenvalue */
    double condition; /* largest eigenvalue by smallest; infinite where less than n are seen */
    int seen;         /* directions */
} mk_window_t;

/* Of all windows. */
typedef struct {
    long worst, unseen, ill; /* first instant, from 0, of the window with the smallest eigenvalue; windows that see less than n; seen, but with
                                a condition beyond the limit */
    long readings, heard;    /* instants with an own reading; with one of the node or its neighbours */
    int least_seen;
    double smallest, condition; /* of the worst window; the largest condition of all windows that see n */
} mk_windows_t;

/* Windows of a trajectory: instants - length + 1 of them. */
/* The whole network: one entry of `window` for each. */
void mk_windows_network(const mk_trajectory_t *trajectory, const double *P0, long length, double limit, int threads, mk_window_t *window,
                        mk_windows_t *all);
/* Every node by itself and its neighbours, slots as in mk_scenario_t: one entry of `all` for each node. */
void mk_windows_nodes(const mk_trajectory_t *trajectory, const double *P0, const int *first, const int *slot, long length, double limit, int threads,
                      mk_windows_t *all);

#endif
