/* SPDX-License-Identifier: MIT */
/*
 * Robust distributed Kalman filter: one object for each node of a sensor network.
 *
 * Model (spec 1.1), node l of N:
 *
 *     x(t+1) = A x(t) + r(t) + w(t)      w ~ N(0, Q)      n states
 *     y_l(t) = C_l x(t) + v_l(t)         v_l ~ N(0, R_l)  up to m rows
 *
 * A node listens to `slots` sensors: itself in slot 0, then its neighbours. Each step has two exchanges (spec 1.4):
 *
 *     put_measurement ...    readings that arrived, from slots 0 .. slots - 1, in any order
 *     incremental            psi = A x + r + A M sum F_l (y_l - C_l x),  M = (W + sum S_l)^-1,  P = A M A' + Q,
 *                            gamma(P, theta) = c,  W := P^-1 - theta I
 *     put_estimate ...       psi of the neighbours, in any order
 *     diffuse                x := sum w_l psi_l / sum w_l  over the slots that arrived
 *
 * F_l = C_l' R_l^-1, S_l = F_l C_l; W = V^-1 is the information matrix that the node carries. What did not arrive is left out
 * of the sums; with nothing at all the step is a plain prediction. Sums run over slots in ascending order, so the result does not
 * depend on the order of arrival.
 *
 * Tolerance c, in the unit of spec 1.2: TWICE the Kullback-Leibler divergence in nats. c stored in the configuration is RKFDNU2,
 * set before each step RKFDNU, zero KFD: one code path.
 *
 * Frozen gain. With every reading at every step and one tolerance, W converges, and the gain with it (spec 1.4). A configuration that holds
 * this limit (`steady`) lets the filter save the covariances: while W is at its limit, an incremental step with readings in all slots is
 *
 *     psi = Phi x + r + sum G_l y_l,     W, theta and P those of the limit.
 *
 * The filter enters this mode by itself, after a full step with all readings and the configuration's tolerance that has brought W close
 * to the limit: W is then put there, so the mode has the same bits however it was reached. Any other step is a full one: a reading
 * missing or given as innovation, another tolerance (set_tolerance), restart; it starts from W of the limit, and the filter comes
 * back by itself. So the slowest step is still the full one: what is saved is energy. A frozen step has no nis (nis_rows 0, nis 0:
 * the long way costs more than all the rest); after `period` of them one is full, which tells nis and looks whether W still belongs
 * to this limit. `close` is how much of the information may be neglected on entering: small values wait long after every loss, with
 * large ones W says more than is known; over random models the estimates were within 20 `close` standard deviations of those of a
 * filter that never freezes. No steady part where A, C or R change.
 *
 * Memory is the caller's, nothing is allocated; objects have no pointers into themselves and may be moved or copied between
 * calls. No function is re-entrant on one object; different objects are independent.
 *
 * MK_RKFD(name, real, n, m, slots), real f32 or f64, declares the type name_t and the functions name_start etc. below, which
 * call the shared kernels in libmeshkal.a. MK_RKFD_UNROLLED of <meshkal/unrolled.h> declares the same names with kernels
 * compiled for these dimensions: larger and several times faster. Both give the same bits.
 */
#ifndef MESHKAL_RKFD_H
#define MESHKAL_RKFD_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Faults of the last step, bits of mk_rkfd_*_t.faults. */
#define MK_FAULT_MEASUREMENT_MISSING 1u /* some slot had no measurement */
#define MK_FAULT_ESTIMATE_MISSING 2u    /* some slot had no estimate */
#define MK_FAULT_REJECTED 4u            /* an input was refused: not finite or repeated */
#define MK_FAULT_NO_MEASUREMENT 8u      /* no slot had a measurement */

#define MK_DECLARE_RKFD_CORE(real)                                                                                            \
    /* The limit of the recursion with every reading at every step and the configuration's tolerance (spec 1.4), in which the \
       gain is constant: psi = Phi x + r + sum G_l y_l. Arrays may be const, in flash. `meshkal design --frozen` writes it. */\
    typedef struct {                                                                                                          \
        const mk_##real##_t *Phi; /* n x n by columns: A - sum G_l C_l */                                                     \
        const mk_##real##_t *G;   /* slots x m x n: G_l = A M F_l by columns */                                               \
        const mk_##real##_t *W;   /* packed n: the limit of W, positive definite */                                           \
        mk_##real##_t theta;      /* of the limit */                                                                          \
        mk_##real##_t trace_P;                                                                                                \
        mk_##real##_t close;      /* > 0: W has arrived where |W_ij - limit| <= close sqrt(W_ii W_jj), W of the limit */      \
        uint16_t period;          /* >= 1: steps in a row with this gain, then a full one looks after nis and W */            \
    } mk_rkfd_steady_##real##_t;                                                                                              \
                                                                                                                              \
    /* Configuration: dimensions and the caller's arrays, which must outlive the filter. All may be const, in flash. A caller \
       whose C_l and R_l vary keeps C, F, S, R_inverse in RAM and rewrites a sensor with mk_rkfd_sensor before its step.      \
       Matrices are in row order; "packed" is MK_PACKED(n) numbers in the order of MK_PACKED. Sensors with fewer than m rows  \
       have zeros in the rest. */                                                                                             \
    typedef struct {                                                                                                          \
        uint16_t n, m, slots;                                                                                                 \
        const mk_##real##_t *A;         /* n x n */                                                                           \
        const mk_##real##_t *Q;         /* packed n, positive semidefinite */                                                 \
        const mk_##real##_t *input;     /* n: r, used when incremental is given none; null for zero */                        \
        const mk_##real##_t *x0;        /* n */                                                                               \
        const mk_##real##_t *P0;        /* packed n, positive definite */                                                     \
        const mk_##real##_t *weight;    /* slots: w_l >= 0 for this node, sum 1 */                                            \
        const uint8_t *rows;            /* slots: rows of each sensor, at most m */                                           \
        const mk_##real##_t *C;         /* slots x m x n */                                                                   \
        const mk_##real##_t *F;         /* slots x m x n: C' R^-1 by columns */                                               \
        const mk_##real##_t *S;         /* slots x packed n: C' R^-1 C */                                                     \
        const mk_##real##_t *R_inverse; /* slots x packed m */                                                                \
        mk_##real##_t tolerance;        /* c >= 0 */                                                                          \
        const mk_rkfd_steady_##real##_t *steady; /* lets the filter freeze its gain; null: it never does */                   \
    } mk_rkfd_config_##real##_t;                                                                                              \
                                                                                                                              \
    /* What every filter has, whatever its dimensions; first member `core` of every filter type. Read, do not write. */       \
    typedef struct {                                                                                                          \
        const mk_rkfd_config_##real##_t *config;                                                                              \
        mk_##real##_t tolerance;            /* c that the next incremental step uses */                                       \
        mk_##real##_t theta;                /* risk sensitivity of the last incremental step, 0 for c = 0 */                  \
        mk_##real##_t trace_P;              /* trace of P of the last incremental step */                                     \
        mk_##real##_t nis;                  /* normalised innovation squared, all readings of the last step together */       \
        uint16_t nis_rows;                  /* its degrees of freedom */                                                      \
        uint16_t iterations;                /* evaluations of gamma in the last step, 0 for c = 0 */                          \
        uint16_t measurements, estimates;   /* used in the last step */                                                       \
        uint32_t steps;                     /* completed (diffused) steps since start */                                      \
        uint32_t steps_since_measurement;   /* incremental steps since one that used a reading */                             \
        uint32_t rejected;                  /* inputs refused since start */                                                  \
        uint16_t faults;                    /* MK_FAULT_ bits of the last step */                                             \
        uint8_t stage;                      /* 0: before start, 1: incremental comes next, 2: diffuse comes next */           \
        uint8_t rejected_now;               /* an input was refused since the last incremental step */                        \
        uint16_t steady;                    /* so many steps with all readings will take the steady gain, then a full one */  \
        uint8_t frozen;                     /* 1: the last incremental step took the steady gain */                           \
    } mk_rkfd_##real##_t;                                                                                                     \
                                                                                                                              \
    /* Where the parts of one filter object are; made on the fly by the typed functions. */                                   \
    typedef struct {                                                                                                          \
        mk_rkfd_##real##_t *core;                                                                                             \
        mk_##real##_t *x, *W, *y, *psi;                                                                                       \
        uint8_t *have_y, *have_psi;                                                                                           \
        mk_##real##_t *work;                                                                                                  \
    } mk_rkfd_view_##real##_t;                                                                                                \
                                                                                                                              \
    /* Fills F (by columns), S (packed n), R_inverse (packed m) of one sensor from C (m x n) and R (packed m, the leading     \
       rows x rows block positive definite, the rest not read), for spec 1.1. C rows beyond `rows` must be zero. work:        \
       3 MK_PACKED(m) numbers. Errors: MK_ERROR_ARGUMENT, MK_ERROR_NOT_FINITE, MK_ERROR_NOT_POSITIVE_DEFINITE; outputs are then \
       untouched. */                                                                                                          \
    mk_status_t mk_rkfd_sensor_##real(int n, int m, int rows, const mk_##real##_t *C, const mk_##real##_t *R,                 \
                                      mk_##real##_t *F, mk_##real##_t *S, mk_##real##_t *R_inverse, mk_##real##_t *work);     \
                                                                                                                              \
    /* The shared kernels: for callers whose dimensions are known at run time only. Contracts below. */                       \
    mk_status_t mk_rkfd_start_##real(int n, int m, int slots, const mk_rkfd_view_##real##_t *view,                            \
                                     const mk_rkfd_config_##real##_t *config);                                                \
    mk_status_t mk_rkfd_put_##real(int n, int m, const mk_rkfd_view_##real##_t *view, int slot, const mk_##real##_t *values,  \
                                   int is_innovation);                                                                        \
    mk_status_t mk_rkfd_incremental_##real(int n, int m, int slots, const mk_rkfd_view_##real##_t *view,                      \
                                           const mk_##real##_t *input);                                                       \
    mk_status_t mk_rkfd_put_estimate_##real(int n, const mk_rkfd_view_##real##_t *view, int slot, const mk_##real##_t *psi);  \
    mk_status_t mk_rkfd_diffuse_##real(int n, int slots, const mk_rkfd_view_##real##_t *view);                                \
    mk_status_t mk_rkfd_set_tolerance_##real(mk_rkfd_##real##_t *core, mk_##real##_t tolerance);                              \
    mk_status_t mk_rkfd_restart_##real(int n, int slots, const mk_rkfd_view_##real##_t *view, const mk_##real##_t *x0,        \
                                       const mk_##real##_t *P0);                                                              \
    mk_status_t mk_rkfd_covariance_##real(int n, const mk_rkfd_view_##real##_t *view, mk_##real##_t *V);                      \
    mk_status_t mk_rkfd_predict_##real(int n, int m, const mk_rkfd_view_##real##_t *view, int slot,                           \
                                       mk_##real##_t *innovation, mk_##real##_t *variance);                                   \
    mk_status_t mk_rkfd_innovations_##real(int n, int m, int slots, const mk_rkfd_view_##real##_t *view, mk_##real##_t *r,    \
                                           mk_##real##_t *S, uint8_t *rows);                                                  \
    mk_status_t mk_rkfd_drop_##real(const mk_rkfd_view_##real##_t *view, int slot);

MK_DECLARE_RKFD_CORE(f32)
MK_DECLARE_RKFD_CORE(f64)

/* Scratch memory, in numbers: of the root search with the inverse, of every kernel but predict, and of predict. The typed functions take
   it from the stack. */
#define MK_ROBUST_WORK(n) (MK_PACKED(n) + (MK_PACKED(n) > 2 * (n) ? MK_PACKED(n) : 2 * (n)))
#define MK_RKFD_WORK(n, m) (3 * MK_PACKED(n) + 2 * (n) + (m) + (n) * (n) + 1)
#define MK_RKFD_PREDICT_WORK(n, m) (MK_PACKED(n) + (n) * (m) + 4 * MK_PACKED(m))
/* The same of innovations. */
#define MK_RKFD_INNOVATIONS_WORK(n, m) (MK_PACKED(n) + (n) * (m) + MK_PACKED(m))

/*
 * The typed functions of MK_RKFD(name, real, n, m, slots). T is mk_<real>_t. Every one returns a status; on failure the object
 * is as it was, but for the counter `rejected`.
 *
 * name_start(f, config)        x := x0, W := P0^-1, counters 0; tolerance from the configuration. SHAPE if the configuration has
 *                              other dimensions; ARGUMENT, NOT_FINITE, NOT_POSITIVE_DEFINITE (P0, W of the steady part), TOLERANCE.
 * name_put_measurement(f, slot, T y[m])
 *                              The reading of a slot, its sensor's rows first; what stands beyond them is not read. Copied.
 *                              ORDER between incremental and diffuse; ARGUMENT; NOT_FINITE; REPEATED: the first reading stays.
 * name_put_innovation(f, slot, T e[m])
 *                              The same with y - h(x) computed by the caller, for a sensor that is linearised at the estimate.
 * name_incremental(f, T input[n])
 *                              The incremental step with what arrived; input r(t), or null for the configuration's. Leaves psi in
 *                              slot 0, for the radio: name_intermediate(f). ORDER if called twice without diffuse. NOT_POSITIVE_DEFINITE,
 *                              NOT_FINITE (input, or overflow), TOLERANCE (no root): W and x as before, readings kept; restart is
 *                              the way back. Cost about 9 n^3 + slots (4 n m + n^2 / 2) operations; frozen 2 n (n + slots m).
 * name_put_estimate(f, slot, T psi[n])
 *                              psi of a neighbour, slot >= 1. ORDER before incremental; ARGUMENT; NOT_FINITE; REPEATED.
 * name_diffuse(f)              The diffusion step over slot 0 and what arrived; ends the step. With no positive weight among
 *                              them x := psi of slot 0. ORDER before incremental; NOT_FINITE: the sum overflows.
 * name_estimate(f)             x (n): the prediction for the next step's time. Valid until the next diffuse.
 * name_intermediate(f)         psi (n) of this node, between incremental and diffuse.
 * name_set_tolerance(f, c)     c for the following steps; another than before ends frozen mode. TOLERANCE if negative or not finite.
 * name_restart(f, x0, P0)      x and W anew (packed P0), readings and estimates of the step dropped, counters kept: the way back after
 *                              a long silence or a failure. ORDER before start; NOT_FINITE, NOT_POSITIVE_DEFINITE.
 * name_covariance(f, T V[MK_PACKED(n)])
 *                              V = W^-1. It is not diffused: not the covariance of the error of x (spec 1.10, trap 4).
 * name_predict(f, slot, T e[m], T E[MK_PACKED(m)])
 *                              Innovation of a filled slot and its variance C V C' + R, before incremental: what a gate needs.
 *                              ORDER afterwards; ARGUMENT if the slot is empty; NOT_FINITE: overflow, e and E are then undefined.
 *                              Entries beyond the sensor's rows: 0.
 * name_innovations(f, T r[slots x m], T S[MK_PACKED(slots x m)], uint8_t rows[slots])
 *                              The same of all filled slots together, one after another, with C_k V C_l' between them: what meshkal/monitor.h
 *                              needs. rows: of each slot, 0 where it is empty. ORDER after incremental; NOT_FINITE: overflow; the outputs are
 *                              undefined then.
 * name_drop(f, slot)           The reading of this slot is no longer there. ORDER after incremental; ARGUMENT.
 */
#define MK_RKFD(name, real, n, m, slots) MK_RKFD_TYPE(name, real, n, m, slots, mk_rkfd_, MK_RKFD_STEP)

#define MK_RKFD_STEP(name, real, n, m, slot_count)                                                                            \
    MK_INLINE mk_status_t name##_incremental(name##_t *f, const mk_##real##_t *input) {                                       \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_incremental_##real(n, m, slot_count, &view, input);                                                    \
    }

#define MK_RKFD_TYPE(name, real, n, m, slot_count, kernel, STEP)                                                              \
    typedef struct {                                                                                                          \
        mk_rkfd_##real##_t core;                                                                                              \
        mk_##real##_t x[n];                 /* estimate */                                                                    \
        mk_##real##_t W[MK_PACKED(n)];      /* information matrix V^-1, packed */                                             \
        mk_##real##_t y[(slot_count) * (m)];   /* readings or innovations of the step */                                      \
        mk_##real##_t psi[(slot_count) * (n)]; /* intermediate estimates of the step */                                       \
        uint8_t have_y[slot_count];         /* 0 nothing, 1 reading, 2 innovation */                                          \
        uint8_t have_psi[slot_count];                                                                                         \
    } name##_t;                                                                                                               \
    typedef mk_rkfd_config_##real##_t name##_config_t;                                                                        \
    MK_INLINE mk_rkfd_view_##real##_t name##_view(name##_t *f, mk_##real##_t *work) {                                         \
        mk_rkfd_view_##real##_t view;                                                                                         \
        view.core = &f->core;                                                                                                 \
        view.x = f->x;                                                                                                        \
        view.W = f->W;                                                                                                        \
        view.y = f->y;                                                                                                        \
        view.psi = f->psi;                                                                                                    \
        view.have_y = f->have_y;                                                                                              \
        view.have_psi = f->have_psi;                                                                                          \
        view.work = work;                                                                                                     \
        return view;                                                                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_start(name##_t *f, const name##_config_t *config) {                                          \
        mk_##real##_t work[MK_PACKED(n)];                                                                                     \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_start_##real(n, m, slot_count, &view, config);                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_put_measurement(name##_t *f, int slot, const mk_##real##_t *y) {                             \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_rkfd_put_##real(n, m, &view, slot, y, 0);                                                                   \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_put_innovation(name##_t *f, int slot, const mk_##real##_t *e) {                              \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_rkfd_put_##real(n, m, &view, slot, e, 1);                                                                   \
    }                                                                                                                         \
    STEP(name, real, n, m, slot_count)                                                                                        \
    MK_INLINE mk_status_t name##_put_estimate(name##_t *f, int slot, const mk_##real##_t *psi) {                              \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_rkfd_put_estimate_##real(n, &view, slot, psi);                                                              \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_diffuse(name##_t *f) {                                                                       \
        mk_##real##_t work[n];                                                                                                \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return kernel##diffuse_##real(n, slot_count, &view);                                                                  \
    }                                                                                                                         \
    MK_INLINE const mk_##real##_t *name##_estimate(const name##_t *f) { return f->x; }                                        \
    MK_INLINE const mk_##real##_t *name##_intermediate(const name##_t *f) { return f->psi; }                                  \
    MK_INLINE mk_status_t name##_set_tolerance(name##_t *f, mk_##real##_t c) {                                                \
        return mk_rkfd_set_tolerance_##real(&f->core, c);                                                                     \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_restart(name##_t *f, const mk_##real##_t *x0, const mk_##real##_t *P0) {                     \
        mk_##real##_t work[MK_PACKED(n)];                                                                                     \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_restart_##real(n, slot_count, &view, x0, P0);                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_covariance(name##_t *f, mk_##real##_t *V) {                                                  \
        mk_##real##_t work[MK_PACKED(n)];                                                                                     \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_covariance_##real(n, &view, V);                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_predict(name##_t *f, int slot, mk_##real##_t *e, mk_##real##_t *E) {                         \
        mk_##real##_t work[MK_RKFD_PREDICT_WORK(n, m)];                                                                       \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_predict_##real(n, m, &view, slot, e, E);                                                               \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_innovations(name##_t *f, mk_##real##_t *r, mk_##real##_t *S, uint8_t *rows) {                \
        mk_##real##_t work[MK_RKFD_INNOVATIONS_WORK(n, m)];                                                                   \
        const mk_rkfd_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_rkfd_innovations_##real(n, m, slot_count, &view, r, S, rows);                                               \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_drop(name##_t *f, int slot) {                                                                \
        const mk_rkfd_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_rkfd_drop_##real(&view, slot);                                                                              \
    }                                                                                                                         \
    /* Last: a declaration that takes the semicolon after the macro. */                                                       \
    typedef name##_t name##_filter_t

#ifdef __cplusplus
}
#endif

#endif
