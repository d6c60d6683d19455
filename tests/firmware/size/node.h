/* SPDX-License-Identifier: MIT */
/* The filter type that an image measures. Given from outside: SIZE_N, SIZE_M, SIZE_SLOTS, SIZE_BITS (32 or 64), SIZE_UNROLLED (0 or 1). */
#ifndef SIZE_NODE_H
#define SIZE_NODE_H

#include <meshkal/unrolled.h>

#if SIZE_BITS == 32
typedef float size_real_t;
#define SIZE_TYPE(macro) macro(filter, f32, SIZE_N, SIZE_M, SIZE_SLOTS)
typedef mk_rkfd_steady_f32_t size_steady_t;
#else
typedef double size_real_t;
#define SIZE_TYPE(macro) macro(filter, f64, SIZE_N, SIZE_M, SIZE_SLOTS)
typedef mk_rkfd_steady_f64_t size_steady_t;
#endif

#if SIZE_UNROLLED
SIZE_TYPE(MK_RKFD_UNROLLED);
#else
SIZE_TYPE(MK_RKFD);
#endif

/* What firmware needs of the filter, and nothing else of the library: size/node.c. */
mk_status_t node_start(filter_t *f, const filter_config_t *config);
mk_status_t node_put(filter_t *f, int slot, const size_real_t *y);
mk_status_t node_incremental(filter_t *f);
mk_status_t node_put_estimate(filter_t *f, int slot, const size_real_t *psi);
mk_status_t node_diffuse(filter_t *f);

#endif
