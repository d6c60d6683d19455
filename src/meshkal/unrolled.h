/* SPDX-License-Identifier: MIT */
/* MK_RKFD_UNROLLED(name, real, n, m, slots): the type and functions of MK_RKFD in <meshkal/rkfd.h>, with the two steps compiled
   for these very dimensions: no loop over states is left up to n = 8. Everything else still comes from libmeshkal.a.
   Use it in one translation unit for each type, or every unit carries its own copy of the code. */
#ifndef MESHKAL_UNROLLED_H
#define MESHKAL_UNROLLED_H

#include <meshkal/kernels.h>
#include <meshkal/node.h>

#define MK_NODE_UNROLLED(name, real, n, m, slots) MK_NODE_TYPE(name, real, n, m, slots, mk_inline_rkfd_, MK_INLINE_RKFD_WORK(n, m))
#define MK_RKFD_UNROLLED(name, real, n, m, slots) MK_RKFD_TYPE(name, real, n, m, slots, mk_inline_rkfd_, MK_INLINE_RKFD_WORK(n, m))

#endif
