/* SPDX-License-Identifier: MIT */
/*
 * Does consensus on this graph converge? The protocol of spec 4.2,
 *
 *     s_i(l + 1) = (g_i s_i(l) + sum_j a_ij s_j(l)) / (g_i + sum_j a_ij)
 *
 * is s(l + 1) = P s(l) with a row-stochastic P: entry (i, j) is positive where node i hears node j, (i, i) where node i measures (g_i = 1).
 * A source is a set of nodes that hear each other, directly or not, and nobody else: a closed class of the Markov chain P. There is at least
 * one, and every node hears one of them in the end. All nodes reach one and the same value from every start if and only if
 *
 *     there is exactly one source, and the lengths of its cycles have no common divisor but 1.
 *
 * Two sources never learn of each other; a source with cycle lengths of common divisor d swings with period d. A node of the source that
 * measures is a cycle of length 1. So the two conditions of spec 4.2 are cases of this one: strongly connected with coprime cycle lengths (all
 * nodes are the source), and a spanning tree whose root has a self-loop (the root belongs to the only source). The third case, in neither:
 * a source that is a part of the graph, measures nothing and has coprime cycle lengths. For undirected links the sources are the connected
 * components, and one without a measuring node swings (d = 2) if and only if it is bipartite and larger than a node.
 * A node that hears nobody and does not measure has no equation: it keeps its value, and is a source of period 1.
 */
#ifndef MESHKAL_GRAPH_CONVERGENCE_H
#define MESHKAL_GRAPH_CONVERGENCE_H

typedef struct {
    int nodes;
    const int *first, *slot; /* node k hears slot[first[k]] .. slot[first[k + 1] - 1]; k itself, if among them, is passed over */
} mk_links_t;

typedef struct {
    int converges; /* to one value, from every start */
    int sources;
    int *source;   /* of each node: the number of the source it belongs to, or -1 */
    int *period;   /* of each source */
    int *size;     /* of each source: nodes */
} mk_convergence_t;

/* measures: one a node, null for none. Sources are numbered in the order of their first nodes. Time and memory: nodes + links. Free the
   result by mk_convergence_free. */
void mk_convergence_make(mk_convergence_t *result, const mk_links_t *links, const unsigned char *measures);
void mk_convergence_free(mk_convergence_t *result);

#endif
