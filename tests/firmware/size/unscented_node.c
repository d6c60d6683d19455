/* SPDX-License-Identifier: MIT */
#include "unscented_node.h"

mk_status_t unscented_start(filter_t *f, const filter_config_t *config) { return filter_start(f, config); }
mk_status_t unscented_predict(filter_t *f, float dt) { return filter_predict(f, dt, 0); }
mk_status_t unscented_put(filter_t *f, int slot, const float *z) { return filter_put(f, slot, z); }
mk_status_t unscented_update(filter_t *f) { return filter_update(f); }
mk_status_t unscented_update_weighted(filter_t *f, const mk_row_weights_f32_t *weights) { return filter_update_weighted(f, weights); }
