/* SPDX-License-Identifier: MIT */
/* Filter configurations out of a scenario: one place that decides their numbers, for the simulator and for the generated headers. */
#ifndef MESHKAL_NODE_CONFIG_H
#define MESHKAL_NODE_CONFIG_H

#include <meshkal/rkfd.h>

#include "scenario.h"

/* Who listens to whom: slots of estimator e are slot[first[e]] .. slot[first[e + 1] - 1], numbers of nodes. A network may be kept in parts:
   then id names the estimators of this part, those that hear only their like first. */
typedef struct {
    int estimators;
    const int *first, *slot;
    const double *weight;
    const int *id;     /* number of each estimator in the whole network; null: 0, 1, ... */
    const int *origin; /* where the estimate of each slot is: estimator of this part, or -1 - place in the halo; null: slot */
    int interior;      /* estimators without a slot in the halo */
    int halo, sends;   /* nodes whose values come from other parts; values that go to other parts, one for each receiver */
    const int *halo_node, *send_estimator;
} mk_topology_t;

/* Number of estimator e in the whole network. */
int mk_topology_id(const mk_topology_t *topology, int e);

mk_topology_t mk_distributed_topology(const mk_scenario_t *scenario);
/* One estimator with every node in a slot and all weight on the first. Free with mk_central_free. */
mk_topology_t mk_central_topology(const mk_scenario_t *scenario);
void mk_central_free(mk_topology_t *topology);

/* Most rows of the sensors of estimator e: the m of its filter type. */
int mk_topology_rows(const mk_topology_t *topology, const mk_scenario_t *scenario, int e);

/* The configuration of estimator e, its arrays in one block that mk_config_free_* releases. */
void mk_config_make_f32(mk_rkfd_config_f32_t *config, const mk_scenario_t *scenario, const mk_topology_t *topology, int e, double tolerance);
void mk_config_make_f64(mk_rkfd_config_f64_t *config, const mk_scenario_t *scenario, const mk_topology_t *topology, int e, double tolerance);
void mk_config_free_f32(mk_rkfd_config_f32_t *config);
void mk_config_free_f64(mk_rkfd_config_f64_t *config);

#endif
