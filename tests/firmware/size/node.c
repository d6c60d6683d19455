/* SPDX-License-Identifier: MIT */
#include "node.h"

mk_status_t node_start(filter_t *f, const filter_config_t *config) { return filter_start(f, config); }
mk_status_t node_put(filter_t *f, int slot, const size_real_t *y) { return filter_put_measurement(f, slot, y); }
mk_status_t node_incremental(filter_t *f) { return filter_incremental(f, 0); }
mk_status_t node_put_estimate(filter_t *f, int slot, const size_real_t *psi) { return filter_put_estimate(f, slot, psi); }
mk_status_t node_diffuse(filter_t *f) { return filter_diffuse(f); }
