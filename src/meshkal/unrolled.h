/* SPDX-License-Identifier: MIT */
/* MK_RKFD_UNROLLED(name, real, n, m, slots): the type and functions of MK_RKFD in <meshkal/rkfd.h>, with the two steps compiled
   for these very dimensions: no loop over states is left up to n = 8. Everything else still comes from libmeshkal.a.
   Use it in one translation unit for each type, or every unit carries its own copy of the code. */
#ifndef MESHKAL_UNROLLED_H
#define MESHKAL_UNROLLED_H

#include <meshkal/kernels.h>
#include <meshkal/node.h>

#define MK_RKFD_UNROLLED(name, real, n, m, slots) MK_RKFD_TYPE(name, real, n, m, slots, mk_inline_rkfd_, MK_RKFD_UNROLLED_STEP)
#define MK_NODE_UNROLLED(name, real, n, m, slots) MK_NODE_TYPE(name, real, n, m, slots, mk_inline_rkfd_, MK_RKFD_UNROLLED_STEP)

#define MK_RKFD_UNROLLED_WIDE(name, function, real, n, m, slot_count)                                                         \
    MK_NOINLINE mk_status_t function(name##_t *f, const mk_##real##_t *input) {                                               \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_robust_##real(n, m, slot_count, &view, input);                                                         \
    }

#ifdef MK_NARROW
/* Each phase of filter/rkfd_narrow.tmpl.h in a function of its own, so that its scratch memory is gone before the next. */
#define MK_RKFD_UNROLLED_ROBUST(name, real, n, m, slot_count)                                                                 \
    MK_RKFD_UNROLLED_WIDE(name, name##_wide, real, n, m, slot_count)                                                          \
    MK_NOINLINE mk_status_t name##_correct(name##_t *f, const mk_##real##_t *input, mk_##real##_t *psi, mk_##real##_t *P,     \
                                          mk_narrow_##real##_t *done) {                                                       \
        mk_##real##_t X[(n) * (n)], D[(n) > (m) ? (n) : (m)];                                                                 \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_narrow_correct_##real(n, m, slot_count, &view, input, X, D, psi, P, done);                                  \
    }                                                                                                                         \
    MK_NOINLINE int name##_information(name##_t *f, mk_##real##_t *P, mk_narrow_##real##_t *done) {                           \
        mk_##real##_t Z[MK_PACKED(n)];                                                                                        \
        return mk_narrow_information_##real(n, P, f->core.tolerance, Z, f->W, done);                                          \
    }                                                                                                                         \
    MK_NOINLINE int name##_search(const mk_##real##_t *P, mk_##real##_t c, mk_##real##_t *theta) {                            \
        mk_##real##_t work[MK_GAMMA_WORK(n)];                                                                                 \
        return mk_gamma_search_##real(n, P, c, theta, work);                                                                  \
    }                                                                                                                         \
    MK_NOINLINE void name##_nis(name##_t *f, mk_narrow_##real##_t *done) {                                                    \
        mk_##real##_t work[MK_PACKED(n) + (n) + (m)];                                                                         \
        done->nis = mk_rkfd_exact_nis_anew_##real(f->core.config, f->x, f->W, f->y, f->have_y, work);                         \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_robust(name##_t *f, const mk_##real##_t *input) {                                          \
        mk_##real##_t psi[n], P[MK_PACKED(n)];                                                                                \
        mk_narrow_##real##_t done;                                                                                            \
        if ((n) > MK_NARROW_N) return name##_wide(f, input);                                                                  \
        if (f->core.stage != 1) return MK_ERROR_ORDER;                                                                        \
        int status = (int)name##_correct(f, input, psi, P, &done);                                                            \
        if (status != MK_OK) return (mk_status_t)status;                                                                      \
        if (done.cancelled) name##_nis(f, &done);                                                                             \
        done.theta = 0;                                                                                                       \
        done.iterations = 0;                                                                                                  \
        status = name##_information(f, P, &done);                                                                             \
        if (status == MK_NARROW_SEARCH) {                                                                                     \
            done.iterations = name##_search(P, f->core.tolerance, &done.theta);                                               \
            if (!done.iterations) return MK_ERROR_TOLERANCE;                                                                  \
            status = name##_information(f, P, &done);                                                                         \
        }                                                                                                                     \
        if (status != MK_OK) return (mk_status_t)status;                                                                      \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        mk_rkfd_commit_##real(n, slot_count, &view, psi, done.theta, done.trace_P, done.iterations, done.nis, done.used, done.rows); \
        return MK_OK;                                                                                                         \
    }
#else
#define MK_RKFD_UNROLLED_ROBUST(name, real, n, m, slot_count) MK_RKFD_UNROLLED_WIDE(name, name##_robust, real, n, m, slot_count)
#endif

/* The parts of mk_inline_rkfd_incremental in functions of their own: the frozen step, which calls nothing, then needs few registers and no
   stack, the robust one is compiled as if there were no other, and no frame waits below another's. */
#define MK_RKFD_UNROLLED_STEP(name, real, n, m, slot_count)                                                                   \
    MK_RKFD_UNROLLED_ROBUST(name, real, n, m, slot_count)                                                                     \
    MK_NOINLINE void name##_settle(name##_t *f, int complete) {                                                               \
        mk_##real##_t work[n];                                                                                                \
        mk_rkfd_settle_##real(n, complete, &f->core, f->W, work);                                                             \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_robust_then_settle(name##_t *f, const mk_##real##_t *input) {                              \
        const int complete = mk_rkfd_complete_##real(slot_count, f->have_y);                                                  \
        const mk_status_t status = name##_robust(f, input);                                                                   \
        if (status == MK_OK) name##_settle(f, complete);                                                                      \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_frozen(name##_t *f, const mk_##real##_t *input) {                                          \
        mk_##real##_t work[n];                                                                                                \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_frozen_##real(n, m, slot_count, &view, input);                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_incremental(name##_t *f, const mk_##real##_t *input) {                                       \
        if (mk_rkfd_is_frozen_##real(slot_count, &f->core, f->have_y)) return name##_frozen(f, input);                        \
        return mk_rkfd_may_freeze_##real(&f->core) ? name##_robust_then_settle(f, input) : name##_robust(f, input);           \
    }

#endif
