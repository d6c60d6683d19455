/* SPDX-License-Identifier: MIT */
#include "duif_node.h"

mk_status_t duif_start(node_t *f, const node_config_t *config) { return node_start(f, config); }
mk_status_t duif_predict(node_t *f, float dt) { return node_predict(f, dt, 0); }
mk_status_t duif_measure(node_t *f, const float *z) { return node_measure(f, z); }
mk_status_t duif_contribute(node_t *f) { return node_contribute(f); }
size_t duif_frame(node_t *f, uint8_t *bytes) { return node_frame(f, bytes); }
mk_status_t duif_accept(node_t *f, const uint8_t *bytes, size_t length) { return node_accept(f, bytes, length); }
mk_status_t duif_iterate(node_t *f) { return node_iterate(f); }
mk_status_t duif_fuse(node_t *f) { return node_fuse(f); }
