/* SPDX-License-Identifier: MIT */
/* Models of a tracking scenario, as the filters of meshkal/unscented.h take them. Slot k is node k. */
#ifndef MESHKAL_TRACKING_MODELS_H
#define MESHKAL_TRACKING_MODELS_H

#include <meshkal/plugin.h>
#include <meshkal/unscented.h>

#include "scenario_tracking.h"

#define MK_DECLARE_MODELS(real)                                                                                               \
    /* Numbers and functions of one precision; configurations point into it. */                                               \
    typedef struct {                                                                                                          \
        const mk_scenario_t *scenario;                                                                                        \
        int n, m, slots; /* slots: all nodes; m: most rows of a sensor, at least 1 */                                         \
        mk_transition_##real##_t transition; /* without A; Q for one dt_s */                                                  \
        /* One a node. A node without sensor has one of a single row that never gives a reading (it would be the first state).*/ \
        mk_sensor_##real##_t *sensor;                                                                                         \
        const mk_##real##_t *x0, *P0;                                                                                         \
        mk_transform_##real##_t transform;                                                                                    \
        mk_gate_##real##_t gate; /* its thresholds suffice for all slots together; null ones where there is no gate */        \
        /* Kept for them; the first of spaces and contexts is the motion's. */                                                \
        mk_status_t (*noise)(const void *context, mk_##real##_t dt, mk_##real##_t *Q); /* of an own motion; null */           \
        mk_##real##_t *numbers;                                                                                               \
        mk_space_##real##_t *space;                                                                                           \
        mk_plugin_context_##real##_t *context;                                                                                \
    } mk_models_##real##_t;                                                                                                   \
                                                                                                                              \
    /* Null and an error: an own model that is not in `plugin` (null: no file), of another size, without this precision. Free it with \
       mk_models_close. */                                                                                                    \
    mk_models_##real##_t *mk_models_open_##real(const mk_scenario_t *scenario, const mk_plugin_t *plugin, mk_error_t *error); \
    void mk_models_close_##real(mk_models_##real##_t *models);                                                                \
    /* Q of a step of dt seconds, packed n. 1, or 0 and an error. */                                                          \
    int mk_models_noise_##real(const mk_models_##real##_t *models, double dt, mk_##real##_t *Q, mk_error_t *error);           \
    /* 1, or 0 and an error that names the motion or node without Jacobian: for filters that need it. */                      \
    int mk_models_differentiable_##real(const mk_models_##real##_t *models, mk_error_t *error);                               \
    /* Configuration of a filter, one of MK_TRACKING_FILTERS, over the slots first .. first + count - 1: all for a central one, (node, 1) for a \
       node's. Gate, increments, rule, transform are the scenario's; update is MK_UPDATE_UNSCENTED for the distributed ones. */ \
    void mk_models_config_##real(const mk_models_##real##_t *models, const char *filter, int first, int count,                \
                                 mk_unscented_config_##real##_t *config);

MK_DECLARE_MODELS(f32)
MK_DECLARE_MODELS(f64)

#endif
