/* SPDX-License-Identifier: MIT */
/* Filter configurations out of a scenario: one place that decides their numbers, for the simulator and for the generated headers. */
#ifndef MESHKAL_NODE_CONFIG_H
#define MESHKAL_NODE_CONFIG_H

#include <meshkal/node.h>

#include "scenario.h"

/* A node that is farther behind starts again: after that many predictions without readings little is left of its estimate. */
#define MK_CATCH_UP 32

/* Nodes of the largest network that can exchange frames: they have 16 bits for the number of a node. */
#define MK_MOST_FRAMED 65536

/* Digits of a node's number in the name of a file, so that names sort by number in networks that anyone lists. */
int mk_node_digits(int nodes);

/* What frames name the model by: the first 32 bits of the scenario's hash. */
uint32_t mk_scenario_model(const mk_scenario_t *scenario);

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

/* Numbers of the blocks below: what all filters of a network have in common; what a filter holds of its slots; of one sensor. */
#define MK_MODEL_NUMBERS(n) ((n) * (n) + 2 * (n) + 2 * MK_PACKED(n))
#define MK_CONFIG_NUMBERS(n, m, slots) ((slots) * (1 + 2 * (m) * (n) + MK_PACKED(n) + MK_PACKED(m)))
#define MK_SENSOR_NUMBERS(n, rows) (2 * (rows) * (n) + MK_PACKED(n) + MK_PACKED(rows))

#define MK_DECLARE_CONFIG(real)                                                                                               \
    /* Fills the model's block: A, Q, input, x0, P0. */                                                                       \
    void mk_model_put_##real(const mk_scenario_t *scenario, mk_##real##_t *model);                                            \
    /* Fills a sensor's block: C, F, S, R_inverse. work: as many doubles. */                                                  \
    void mk_sensor_put_##real(int n, const mk_sensor_t *sensor, mk_##real##_t *numbers, double *work);                        \
    /* A configuration over a model's block and a room for its slots (rows: a byte for each), which is filled by the two      \
       functions after this one. Nothing is copied: all of it must outlive the configuration. */                              \
    void mk_config_open_##real(mk_rkfd_config_##real##_t *config, int n, int m, int slots, double tolerance,                  \
                               const mk_##real##_t *model, const mk_##real##_t *room, const uint8_t *rows);                   \
    void mk_config_weights_##real(const double *weight, int slots, mk_##real##_t *room);                                      \
    /* The sensor of slot l, of `used` <= m rows, from its block. */                                                          \
    void mk_config_slot_##real(int n, int m, int slots, int l, const mk_##real##_t *numbers, int used, mk_##real##_t *room,   \
                               uint8_t *rows);                                                                                \
    /* The whole configuration of estimator e in one block of its own, which mk_config_free releases. */                      \
    void mk_config_make_##real(mk_rkfd_config_##real##_t *config, const mk_scenario_t *scenario,                              \
                               const mk_topology_t *topology, int e, double tolerance);                                       \
    void mk_config_free_##real(mk_rkfd_config_##real##_t *config);                                                            \
    /* The same for the node object of node k: its neighbours and model, MK_CATCH_UP, frames in its own precision; no gate. Slots of the\
       topology are numbers of nodes below 65536. Free with mk_node_config_free. */                                           \
    void mk_node_config_make_##real(mk_node_config_##real##_t *config, const mk_scenario_t *scenario,                         \
                                    const mk_topology_t *topology, int k, double tolerance);                                  \
    void mk_node_config_free_##real(mk_node_config_##real##_t *config);

MK_DECLARE_CONFIG(f32)
MK_DECLARE_CONFIG(f64)

#endif
