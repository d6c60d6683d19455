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

#ifdef MK_NARROW
/* The phases of filter/rkfd_narrow.tmpl.h in a function of their own, so that its scratch memory is gone before what is rare is called. */
#define MK_RKFD_UNROLLED_NARROW(name, real, n, m, slot_count)                                                                 \
    MK_NOINLINE int name##_phases(name##_t *f, const mk_##real##_t *input, mk_##real##_t *psi, mk_##real##_t *P,              \
                                  mk_narrow_##real##_t *done) {                                                               \
        union {                                                                                                               \
            mk_##real##_t X[(n) * (n)];                                                                                       \
            struct {                                                                                                          \
                mk_##real##_t Z[MK_PACKED(n)];                                                                                \
                mk_gamma_start_##real##_t start;                                                                              \
            } next;                                                                                                           \
        } work;                                                                                                               \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_narrow_phases_##real(n, m, slot_count, &view, input, work.X, work.next.Z, &work.next.start, psi, P, done);  \
    }                                                                                                                         \
    MK_NOINLINE int name##_search(const mk_##real##_t *P, mk_##real##_t c, mk_##real##_t *theta) {                            \
        mk_##real##_t work[MK_GAMMA_WORK(n)];                                                                                 \
        return mk_gamma_search_##real(n, P, c, theta, work);                                                                  \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_narrow(name##_t *f, const mk_##real##_t *input) {                                          \
        mk_##real##_t psi[n], P[MK_PACKED(n) > (m) ? MK_PACKED(n) : (m)];                                                     \
        mk_narrow_##real##_t done;                                                                                            \
        if (f->core.stage != 1) return MK_ERROR_ORDER;                                                                        \
        done.theta = 0;                                                                                                       \
        done.iterations = 0;                                                                                                  \
        done.exact = 0;                                                                                                       \
        int status;                                                                                                           \
        while ((status = name##_phases(f, input, psi, P, &done)) < 0) {                                                       \
            if (status == MK_NARROW_NIS) {                                                                                    \
                done.nis = mk_rkfd_exact_nis_##real(f->core.config, f->x, f->W, f->y, f->have_y, P, psi, P);                  \
                done.exact = 1;                                                                                               \
            } else {                                                                                                          \
                done.iterations = (uint8_t)name##_search(P, f->core.tolerance, &done.theta);                                 \
                if (!done.iterations) return MK_ERROR_TOLERANCE;                                                              \
            }                                                                                                                 \
        }                                                                                                                     \
        if (status != MK_OK) return (mk_status_t)status;                                                                      \
        const int freezes = mk_rkfd_may_freeze_##real(&f->core), complete = freezes && mk_rkfd_complete_##real(slot_count, f->have_y); \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        mk_rkfd_commit_##real(n, slot_count, &view, psi, done.theta, done.trace_P, done.iterations, done.nis, done.used, done.rows); \
        if (freezes) mk_rkfd_settle_##real(n, complete, &f->core, f->W, psi);                                                 \
        return MK_OK;                                                                                                         \
    }
#define MK_RKFD_UNROLLED_ROBUST(name, n) ((n) <= MK_NARROW_N ? name##_narrow(f, input) : name##_wide(f, input))
#else
#define MK_RKFD_UNROLLED_NARROW(name, real, n, m, slot_count)
#define MK_RKFD_UNROLLED_ROBUST(name, n) name##_wide(f, input)
#endif

/* The parts of mk_inline_rkfd_incremental in functions of their own: the frozen step, which calls nothing, then needs few registers and no
   stack, the robust one is compiled as if there were no other, and no frame waits below another's. */
#define MK_RKFD_UNROLLED_STEP(name, real, n, m, slot_count)                                                                   \
    MK_RKFD_UNROLLED_NARROW(name, real, n, m, slot_count)                                                                     \
    MK_NOINLINE mk_status_t name##_alone(name##_t *f, const mk_##real##_t *input) {                                           \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_robust_##real(n, m, slot_count, &view, input);                                                         \
    }                                                                                                                         \
    MK_NOINLINE void name##_settle(name##_t *f, int complete) {                                                               \
        mk_##real##_t work[n];                                                                                                \
        mk_rkfd_settle_##real(n, complete, &f->core, f->W, work);                                                             \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_alone_then_settle(name##_t *f, const mk_##real##_t *input) {                               \
        const int complete = mk_rkfd_complete_##real(slot_count, f->have_y);                                                  \
        const mk_status_t status = name##_alone(f, input);                                                                    \
        if (status == MK_OK) name##_settle(f, complete);                                                                      \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_wide(name##_t *f, const mk_##real##_t *input) {                                              \
        return mk_rkfd_may_freeze_##real(&f->core) ? name##_alone_then_settle(f, input) : name##_alone(f, input);             \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_frozen(name##_t *f, const mk_##real##_t *input) {                                          \
        mk_##real##_t work[n];                                                                                                \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_frozen_##real(n, m, slot_count, &view, input);                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_incremental(name##_t *f, const mk_##real##_t *input) {                                       \
        if (mk_rkfd_is_frozen_##real(slot_count, &f->core, f->have_y)) return name##_frozen(f, input);                        \
        return MK_RKFD_UNROLLED_ROBUST(name, n);                                                                              \
    }

/* MK_UNSCENTED_UNROLLED(name, real, n, m, slots): the type and functions of MK_UNSCENTED in <meshkal/unscented.h>, with the prediction and what takes
   the time of an update compiled for these very dimensions. */
#define MK_UNSCENTED_UNROLLED(name, real, n, m, slots) MK_UNSCENTED_TYPE(name, real, n, m, slots, MK_UNSCENTED_UNROLLED_STEP)

/* Where speed counts more than size, a copy for the usual case that all readings have come. */
#ifdef MK_VECTOR_BYTES
#define MK_UNSCENTED_WHOLE(real, n, most) \
    if (rows == (most) && L && (most) <= 4) return mk_inline_absorb_##real(n, u, 0, most, scale, L, x);
#else
#define MK_UNSCENTED_WHOLE(real, n, most)
#endif

#define MK_UNSCENTED_UNROLLED_STEP(name, real, n, m, slot_count)                                                              \
    MK_NOINLINE mk_status_t name##_predict(name##_t *f, mk_##real##_t dt, const mk_##real##_t *Q) {                           \
        mk_##real##_t work[2 * (n) * (2 * (n) + 1)], rest[4 * (n)];                                                           \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_inline_unscented_predict_##real(n, &view, rest, dt, Q);                                                     \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_stack(mk_updating_##real##_t *u, const mk_##real##_t *x, const mk_##real##_t *L) {         \
        return mk_inline_stack_##real(n, m, slot_count, u, x, L);                                                             \
    }                                                                                                                         \
    MK_NOINLINE mk_##real##_t name##_absorb(mk_updating_##real##_t *u, int first, int rows, mk_##real##_t scale,              \
                                            mk_##real##_t *L, mk_##real##_t *x) {                                             \
        MK_UNSCENTED_WHOLE(real, n, (m) * (slot_count))                                                                       \
        return mk_inline_absorb_##real(n, u, first, rows, scale, L, x);                                                       \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_update(name##_t *f) {                                                                        \
        const mk_unscented_kernels_##real##_t kernels = {name##_stack, name##_absorb};                                        \
        mk_##real##_t work[MK_UNSCENTED_UPDATE_WORK(n, m, slot_count)];                                                       \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_update_with_##real(n, m, slot_count, &view, &kernels);                                            \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_update_weighted(name##_t *f, const mk_row_weights_##real##_t *weights) {                     \
        const mk_unscented_kernels_##real##_t kernels = {name##_stack, name##_absorb};                                        \
        mk_##real##_t work[MK_UNSCENTED_UPDATE_WORK(n, m, slot_count)];                                                       \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_update_weighted_with_##real(n, m, slot_count, &view, weights, &kernels);                          \
    }

#endif
