/* SPDX-License-Identifier: MIT */
/* The node of meshkal/duif.h that an image measures. Given from outside: SIZE_N, SIZE_M, SIZE_SLOTS. */
#ifndef SIZE_DUIF_NODE_H
#define SIZE_DUIF_NODE_H

#include <meshkal/duif.h>

MK_DUIF(node, f32, SIZE_N, SIZE_M, SIZE_SLOTS);

/* What firmware needs of the node, and nothing else of the library: size/duif_node.c. */
mk_status_t duif_start(node_t *f, const node_config_t *config);
mk_status_t duif_predict(node_t *f, float dt);
mk_status_t duif_measure(node_t *f, const float *z);
mk_status_t duif_contribute(node_t *f);
size_t duif_frame(node_t *f, uint8_t *bytes);
mk_status_t duif_accept(node_t *f, const uint8_t *bytes, size_t length);
mk_status_t duif_iterate(node_t *f);
mk_status_t duif_fuse(node_t *f);

#endif
