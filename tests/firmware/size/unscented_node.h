/* SPDX-License-Identifier: MIT */
/* The unscented filter type that an image measures. Given from outside: SIZE_N, SIZE_M, SIZE_SLOTS, SIZE_BITS (32), SIZE_UNROLLED (0 or 1). */
#ifndef SIZE_UNSCENTED_NODE_H
#define SIZE_UNSCENTED_NODE_H

#include <meshkal/unrolled.h>

#if SIZE_UNROLLED
MK_UNSCENTED_UNROLLED(filter, f32, SIZE_N, SIZE_M, SIZE_SLOTS);
#else
MK_UNSCENTED(filter, f32, SIZE_N, SIZE_M, SIZE_SLOTS);
#endif

/* What firmware needs of the filter, and nothing else of the library: size/unscented_node.c. */
mk_status_t unscented_start(filter_t *f, const filter_config_t *config);
mk_status_t unscented_predict(filter_t *f, float dt);
mk_status_t unscented_put(filter_t *f, int slot, const float *z);
mk_status_t unscented_update(filter_t *f);
mk_status_t unscented_update_weighted(filter_t *f, const mk_row_weights_f32_t *weights);

#endif
