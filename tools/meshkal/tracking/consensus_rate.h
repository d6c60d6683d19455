/* SPDX-License-Identifier: MIT */
/*
 * How fast consensus converges, and to what, on undirected connected links (spec 4.2). Weights of a protocol, s(l + 1) = P s(l), with d_i the
 * neighbours of node i:
 *
 *     paper       P_ij = 1 / (g_i + d_i), P_ii = g_i / (g_i + d_i);  limit sum_j pi_j s_j(0), pi_j = (d_j + g_j) / sum(d + g)
 *     Metropolis  P_ij = 1 / (1 + max(d_i, d_j)), P_ii = what is left;  limit the average, pi_j = 1 / N
 *
 * Both are reversible: D^1/2 P D^-1/2 is symmetric, D = diag(pi), so that the eigenvalues are real and, with |s|_pi^2 = sum_i pi_i s_i^2,
 *
 *     |s(L) - limit|_pi <= lambda^L |s(0) - limit|_pi,   lambda = the second largest eigenvalue modulus of P.
 *
 * No start is worse than this, and one is as bad. The largest error of a node may be 1 / sqrt(min pi) times that norm.
 */
#ifndef MESHKAL_CONSENSUS_RATE_H
#define MESHKAL_CONSENSUS_RATE_H

#include "tracking/graph_convergence.h"

/* Up to this many nodes eigenvalues are those of LAPACK (dsyev): errors of some 1e-15. Above: Lanczos on the links. */
#define MK_DENSE_NODES 500

typedef struct {
    const mk_links_t *links;       /* undirected */
    const unsigned char *measures; /* paper: one a node, null for all; not read for Metropolis */
    int metropolis;
} mk_averaging_t;

typedef struct {
    double modulus; /* second largest eigenvalue modulus; 0 for one node */
    double error;   /* bound of its error: |P v - lambda v| of what Lanczos found; for LAPACK 1e-14 */
    int steps;      /* of Lanczos; 0: LAPACK */
} mk_rate_t;

/* For a protocol that need not converge; the graph must be connected. error is what was reached if Lanczos did not settle. 1, or 0 if LAPACK
   gives up. */
int mk_rate(const mk_averaging_t *averaging, mk_rate_t *rate);

/* The rate of the paper's protocol if node k alone measures, for every k: one eigendecomposition and, for each k, the two roots of the
   equation of a change of rank one. At most MK_DENSE_NODES nodes, connected. Errors of some 1e-14. 1, or 0 if LAPACK gives up. */
int mk_rates_single(const mk_links_t *links, double *modulus);

/* pi of the protocol: nodes numbers that sum to 1; 0 and nothing written if all weights are 0 (a silent node that hears nobody). */
int mk_perron(const mk_averaging_t *averaging, double *pi);

/* The least L >= 1 with modulus^L <= accuracy; -1 if there is none below 1e9. */
long mk_iterations(double modulus, double accuracy);

#endif
