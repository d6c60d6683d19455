/* SPDX-License-Identifier: MIT */
/* The central designer: fixed points of the covariance recursions and local tolerances (spec 1.3 to 1.5). Needs the model only, no
   data. float64; symmetric matrices packed. Work over nodes runs on several threads; results and errors do not depend on how many. */
#ifndef MESHKAL_DESIGN_H
#define MESHKAL_DESIGN_H

#include "scenario.h"

/* A covariance recursion (spec 1.3, 1.4) with fixed information S for each step, run by the node's own kernels. */
typedef struct {
    int n;
    const double *A, *Q;
    double tolerance;
    double *S, *W;   /* information of a step; information V^-1 carried */
    double *P;
    double theta;
    double *work;
} mk_recursion_t;

/* Starts at V = P0 with S = 0: add sensors with mk_recursion_add. */
void mk_recursion_open(mk_recursion_t *recursion, const mk_scenario_t *scenario, double tolerance);
void mk_recursion_close(mk_recursion_t *recursion);
/* S += information of one sensor, C' R^-1 C. */
void mk_recursion_add(mk_recursion_t *recursion, const mk_sensor_t *sensor);
/* With M = (W + S)^-1 of the step that mk_recursion_step takes next: MA = M A' and A - A M S, the error's own map (n x n), the latter as
   A M W, without the difference. scratch: 3 packed matrices and two of n x n. */
void mk_recursion_gain(const mk_recursion_t *recursion, double *MA, double *map, double *scratch);
/* P, theta and W of the next step. 1, or 0: a matrix is not positive definite or theta has no root. */
int mk_recursion_step(mk_recursion_t *recursion);
/* Steps until P stands still to rounding, or until it is certain where it will (fixed_point.h). 1, or 0 if it does not within `limit`
   steps, or fails. */
int mk_recursion_settle(mk_recursion_t *recursion, long limit);

/* Fixed point of one filter. */
typedef struct {
    int exists; /* 0: the node has none, and what follows is 0 */
    double theta, trace_P, trace_V;
    double *P, *V; /* V = (P^-1 - theta I)^-1; null if not kept */
} mk_steady_t;

typedef struct {
    int n, nodes;
    double tolerance; /* c of the centralised filter */
    mk_steady_t central;
    double *local;     /* c_k, one a node; null if not asked for */
    mk_steady_t *node; /* every node with c_k; null if not asked for */
    double *block;     /* of the nodes' P and V */
} mk_design_t;

/* F (by columns), S and R^-1 of one sensor, as mk_rkfd_sensor_f64 makes them with m = rows. Any of the three may be null. */
void mk_sensor_matrices(int n, const mk_sensor_t *sensor, double *F, double *S, double *R_inverse);

/* S_Nk: sum of C' R^-1 C over the neighbourhood of node k, packed. */
void mk_neighbourhood_information(const mk_scenario_t *scenario, long k, double *S);

/* RKFC to its fixed point (1.3). 1, or 0 and an error; *design is then empty. */
int mk_design_central(mk_design_t *design, const mk_scenario_t *scenario, double tolerance, mk_error_t *error);
/* c_k (1.5) of nodes id[0 .. count - 1], or, id being null, of nodes 0 .. count - 1, into c: needs no more of the design than its
   central fixed point and tolerance. 1, or 0 and an error that names the first node that has none. */
int mk_design_local(const mk_design_t *design, const mk_scenario_t *scenario, const int *id, long count, int threads, double *c,
                    mk_error_t *error);
/* Both, for every node, on all cores. 1, or 0 and an error; *design is then empty. */
int mk_design_make(mk_design_t *design, const mk_scenario_t *scenario, double tolerance, mk_error_t *error);
/* Then every node's own fixed point (1.4, c_k fixed), its P and V only where `keep`. may_grow, one entry a node: where it is not 0 the node
   need not have one. 1, or 0 and an error that names the first node that does not converge. */
int mk_design_nodes(mk_design_t *design, const mk_scenario_t *scenario, const int *may_grow, int keep, int threads, mk_error_t *error);
void mk_design_free(mk_design_t *design);

/* c_k(t) for t = 0, 1, ..: tolerances of RKFDNU, V(0) = P0, of the nodes id[0 .. count - 1] (null: of nodes 0 .. count - 1). `id` is not
   copied. Memory: n (n + 1) / 2 numbers a node. */
typedef struct mk_schedule mk_schedule_t;
mk_schedule_t *mk_schedule_open(const mk_scenario_t *scenario, double tolerance, const int *id, long count, int threads);
/* c of the next step, one for each node asked for. 1, or 0 and an error. */
int mk_schedule_step(mk_schedule_t *schedule, double *c, mk_error_t *error);
void mk_schedule_close(mk_schedule_t *schedule);
/* The first steps, row by row (steps x count). Null and an error on failure. */
double *mk_design_schedule(const mk_scenario_t *scenario, double tolerance, int steps, const int *id, long count, int threads, mk_error_t *error);

/* Dimensions of what cannot be observed or reached. */
typedef struct {
    int global, unreachable;
    int *node;       /* of each node's neighbourhood */
    int blind_nodes; /* nodes with a dimension above 0 */
} mk_observability_t;

/* 1, or 0 and an error. Free result->node. */
int mk_check_observability(const mk_scenario_t *scenario, int threads, mk_observability_t *result, mk_error_t *error);

#endif
