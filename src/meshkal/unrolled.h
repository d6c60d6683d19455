/* SPDX-License-Identifier: MIT */
/* MK_RKFD_UNROLLED(name, real, n, m, slots): the type and functions of MK_RKFD in <meshkal/rkfd.h>, with the two steps compiled
   for these very dimensions: no loop over states is left up to n = 8. Everything else still comes from libmeshkal.a.
   Use it in one translation unit for each type, or every unit carries its own copy of the code. */
#ifndef MESHKAL_UNROLLED_H
#define MESHKAL_UNROLLED_H

#include <meshkal/kernels.h>
#include <meshkal/node.h>

#define MK_NODE_UNROLLED(name, real, n, m, slots) MK_NODE_TYPE(name, real, n, m, slots, mk_inline_rkfd_, MK_RKFD_UNROLLED_STEP)
#define MK_RKFD_UNROLLED(name, real, n, m, slots) MK_RKFD_TYPE(name, real, n, m, slots, mk_inline_rkfd_, MK_RKFD_UNROLLED_STEP)

/* The parts of mk_inline_rkfd_incremental in functions of their own: the frozen step, which calls nothing, then needs few registers and no
   stack, and the robust one is compiled as if there were no other. */
#define MK_RKFD_UNROLLED_STEP(name, real, n, m, slot_count)                                                                   \
    MK_NOINLINE mk_status_t name##_robust(name##_t *f, const mk_##real##_t *input) {                                          \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_robust_##real(n, m, slot_count, &view, input);                                                         \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_robust_then_settle(name##_t *f, const mk_##real##_t *input) {                              \
        mk_##real##_t work[n];                                                                                                \
        const int complete = mk_rkfd_complete_##real(slot_count, f->have_y);                                                  \
        const mk_status_t status = name##_robust(f, input);                                                                   \
        if (status == MK_OK) mk_rkfd_settle_##real(n, complete, &f->core, f->W, work);                                        \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_incremental(name##_t *f, const mk_##real##_t *input) {                                       \
        mk_##real##_t work[n];                                                                                                \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        if (mk_rkfd_is_frozen_##real(slot_count, &f->core, f->have_y))                                                        \
            return mk_rkfd_frozen_##real(n, m, slot_count, &view, input);                                                     \
        return mk_rkfd_may_freeze_##real(&f->core) ? name##_robust_then_settle(f, input) : name##_robust(f, input);           \
    }

#endif
