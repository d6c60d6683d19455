/* SPDX-License-Identifier: MIT */
/*
 * Unscented family (spec 2.2 to 2.4, 4.1): filters for nonlinear models (meshkal/model.h) that share one unscented transform, one gate
 * (meshkal/gate.h) and one update.
 *
 *     predict            x, P := mean and covariance of g(x) + w
 *     put ...            readings that arrived, of any of the `slots` sensors
 *     update             x, P := given these readings; with none, nothing
 *
 * in any order and number: readings may come one at a time, at different times.
 *
 * The transform is centred on the result y_0 at x, with results y_j+ and y_j- at x +- c L_j (P = L L', columns L_j, c = sqrt(spread)):
 *
 *     D_j = (y_j+ - y_j-) / 2 c     u_j = (y_j+ - y_0) + (y_j- - y_0)     mu = w sum u_j,  w = 1 / 2 spread
 *     mean = y_0 + mu     covariance = D D' + Omega,  Omega = w/2 sum u_j u_j' + correction mu mu'     cross covariance = L D'
 *
 * which is spec 2.2 rearranged: no difference of large numbers, and D L^-1 is the statistical linearisation, Omega its residual. An update is then
 * one of a linear model with rows D L^-1 and noise R + Omega. It is done row by row on the triangular factor L (Carlson 1973), and a
 * prediction triangularises [D, root of Omega, root of Q]: P is never formed, and stays positive definite in either precision.
 *
 * Where g is a function that is not linear, the prediction adds (epsilon x_i)^2 to the variance of state i, the rounding of its sigma points; a state
 * is known no better than its number. Keep states near zero in float32: a local origin, seconds since start.
 *
 * Updates, N = increments (spec 2.3):
 *     MK_UPDATE_UNSCENTED         UKF: one update
 *     MK_UPDATE_EXTENDED          EKF: the same with D = J L, Omega = 0, from the models' Jacobians; they then serve predict, too
 *     MK_UPDATE_PROGRESSIVE       PUKF: N updates with R N, sigma points drawn again from each; with a rule MPUKF
 *     MK_UPDATE_ITERATED          IUKF: Gauss-Newton on the posterior, linearised statistically over the present one; a step is halved, up to
 *                                 four times, until the cost |z - h(x)|^2_R + |x - x0|^2_P0 falls; ends after N steps or where it does not
 *     MK_UPDATE_ITERATED_LITERAL  as published: N updates with full R each. Over-confident; for comparisons only
 *
 * Rules that end progressive updates before increment i > 1 (spec 2.3 (20)): what is left out then inflates R.
 *     MK_RULE_INNOVATION          |e_i|^2 > |e_(i-1)|^2
 *     MK_RULE_MAHALANOBIS         the same with e' (R + spread)^-1 e
 *
 * Every function returns a status and on failure leaves the object as it was, but for core.failed. A model that refuses its points
 * or a result that is not finite stops the whole update; core.failed is then the slot, and drop removes its reading.
 *
 * MK_UNSCENTED(name, real, n, m, slots) declares name_t and the functions below: n states, sensors of up to m rows.
 */
#ifndef MESHKAL_UNSCENTED_H
#define MESHKAL_UNSCENTED_H

#include <meshkal/gate.h>
#include <meshkal/model.h>
#include <meshkal/weights.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MK_UPDATE_UNSCENTED, MK_UPDATE_EXTENDED, MK_UPDATE_PROGRESSIVE, MK_UPDATE_ITERATED, MK_UPDATE_ITERATED_LITERAL };
enum { MK_RULE_NONE, MK_RULE_INNOVATION, MK_RULE_MAHALANOBIS };

/* Initialisers of mk_transform_<real>_t: Julier with kappa > -n (3 - n suits Gaussians, 0 is the cubature rule), and the scaled form. The first can
   give an Omega that is not positive semidefinite where kappa < 0, the second where beta < alpha^2: a status then says so. */
#define MK_TRANSFORM_JULIER(n, kappa) {(n) + (kappa), -1}
#define MK_TRANSFORM_CUBATURE(n) {(n), -1}
#define MK_TRANSFORM_SCALED(n, alpha, beta, kappa) {(alpha) * (alpha) * ((n) + (kappa)), (beta) - (alpha) * (alpha)}

/* Scratch memory, in numbers, taken from the stack by the typed functions: of predict, of update and contribution, of the rest; all of them. */
#define MK_UNSCENTED_PREDICT_WORK(n) (2 * (n) * (2 * (n) + 1) + 4 * (n))
#define MK_UNSCENTED_UPDATE_WORK(n, m, slots)                                                                                 \
    (MK_UNSCENTED_STACK_(n, m, (m) * (slots)) + 2 * (slots) + MK_UNSCENTED_LARGER_(MK_UNSCENTED_POINTS_(n, m), MK_UNSCENTED_SCRATCH_(n, (m) * (slots))))
#define MK_UNSCENTED_STACK_(n, m, rows) ((rows) * (2 * (n) + 3) + MK_PACKED(rows) + 2 * MK_PACKED(n) + (n) + 2 * (m))
#define MK_UNSCENTED_POINTS_(n, m) (((n) + (m)) * (2 * (n) + 1))
#define MK_UNSCENTED_SCRATCH_(n, rows) ((rows) * ((n) + 1) + MK_PACKED(rows) + 3 * (n) + MK_PACKED(n))
#define MK_UNSCENTED_LARGER_(a, b) ((a) > (b) ? (a) : (b))
#define MK_UNSCENTED_OTHER_WORK(n, m) ((n) * (n) + 2 * MK_PACKED(n) + 2 * (n) + MK_PACKED(m))
#define MK_UNSCENTED_WORK(n, m, slots) (MK_UNSCENTED_PREDICT_WORK(n) + MK_UNSCENTED_UPDATE_WORK(n, m, slots) + MK_PACKED(m))

#define MK_DECLARE_UNSCENTED_CORE(real)                                                                                       \
    typedef struct {                                                                                                          \
        mk_##real##_t spread;     /* c^2 = n + kappa or alpha^2 (n + kappa), > 0 */                                           \
        mk_##real##_t correction; /* -1, or beta - alpha^2 */                                                                 \
    } mk_transform_##real##_t;                                                                                                \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_model_##real##_t model;                                                                                            \
        const mk_##real##_t *R; /* packed, rows: positive definite */                                                         \
        uint8_t rows;           /* 1 .. m */                                                                                  \
    } mk_sensor_##real##_t;                                                                                                   \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_model_##real##_t model;                                                                                            \
        const mk_##real##_t *A; /* n x n in row order: g(x) = A x, whatever dt, exactly and without model; null: model */     \
        const mk_##real##_t *Q; /* packed n, positive semidefinite: of predict without one */                                 \
    } mk_transition_##real##_t;                                                                                               \
                                                                                                                              \
    /* Configuration: may be const, in flash, and must outlive the filter. */                                                 \
    typedef struct {                                                                                                          \
        uint16_t n, m, slots;                                                                                                 \
        mk_transition_##real##_t transition;                                                                                  \
        const mk_sensor_##real##_t *sensor; /* slots */                                                                       \
        const mk_##real##_t *x0;            /* n */                                                                           \
        const mk_##real##_t *P0;            /* packed n, positive definite */                                                 \
        mk_transform_##real##_t transform;                                                                                    \
        const mk_gate_##real##_t *gate;     /* null: none */                                                                  \
        uint16_t increments;                /* N >= 1 */                                                                      \
        uint8_t update, rule;               /* MK_UPDATE_, MK_RULE_ */                                                        \
        uint8_t one_at_a_time;              /* 1: functions are called for single points */                                   \
        const mk_row_weights_##real##_t *weights; /* robust gain (meshkal/weights.h) of MK_UPDATE_UNSCENTED and _EXTENDED; null: none */ \
    } mk_unscented_config_##real##_t;                                                                                         \
                                                                                                                              \
    /* What every filter has; first member `core` of every filter type. Read, do not write. */                                \
    typedef struct {                                                                                                          \
        const mk_unscented_config_##real##_t *config;                                                                         \
        mk_gate_record_##real##_t stacked;  /* of all readings of an update together, at the prediction */                    \
        mk_##real##_t nis;                  /* normalised innovation squared of the readings used, at the prediction */       \
        uint16_t nis_rows;                  /* its degrees of freedom */                                                      \
        uint16_t measurements;              /* sensors used by the last update */                                             \
        uint16_t increments;                /* updates or steps that the last update took */                                  \
        uint16_t gated_updates;             /* in which most readings were beyond the gate, less the others, from 0 up */     \
        uint16_t failed;                    /* slot whose model stopped the last call; `slots` if it was the transition */    \
        uint8_t stopped;                    /* 1: the rule ended the last update */                                           \
        uint8_t started;                                                                                                      \
        uint32_t predictions, updates;      /* updates: those with readings */                                                \
        uint32_t rule_fired;                /* updates that the rule ended */                                                 \
        uint32_t reinitialised;             /* by the gate's way back */                                                      \
        uint32_t rejected;                  /* inputs refused: not finite or repeated */                                      \
        uint16_t weighted_rows;             /* of the last update: rows with a weight below 1 */                              \
        uint16_t unused_rows;               /* and of these: with weight 0; all of them: the update was none, x and P are the prediction */ \
    } mk_unscented_##real##_t;                                                                                                \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_unscented_##real##_t *core;                                                                                        \
        mk_##real##_t *x, *L, *z;                                                                                             \
        uint8_t *have;                                                                                                        \
        mk_gate_record_##real##_t *record;                                                                                    \
        mk_##real##_t *work;                                                                                                  \
    } mk_unscented_view_##real##_t;                                                                                           \
                                                                                                                              \
    /* The kernels, for callers whose dimensions are known at run time only; contracts below. */                              \
    mk_status_t mk_unscented_start_##real(int n, int m, int slots, const mk_unscented_view_##real##_t *view,                  \
                                          const mk_unscented_config_##real##_t *config);                                      \
    mk_status_t mk_unscented_restart_##real(int n, int slots, const mk_unscented_view_##real##_t *view,                       \
                                            const mk_##real##_t *x0, const mk_##real##_t *P0);                                \
    mk_status_t mk_unscented_predict_##real(int n, const mk_unscented_view_##real##_t *view, mk_##real##_t dt,                \
                                            const mk_##real##_t *Q);                                                          \
    mk_status_t mk_unscented_put_##real(int m, int slots, const mk_unscented_view_##real##_t *view, int slot,                 \
                                        const mk_##real##_t *z);                                                              \
    mk_status_t mk_unscented_drop_##real(int slots, const mk_unscented_view_##real##_t *view, int slot);                      \
    mk_status_t mk_unscented_update_##real(int n, int m, int slots, const mk_unscented_view_##real##_t *view);                \
    mk_status_t mk_unscented_covariance_##real(int n, const mk_unscented_view_##real##_t *view, mk_##real##_t *P);            \
    mk_status_t mk_unscented_contribution_##real(int n, int m, int slots, const mk_unscented_view_##real##_t *view,           \
                                                 int without_residual, mk_##real##_t *s, mk_##real##_t *S);                   \
    mk_status_t mk_unscented_inform_##real(int n, const mk_unscented_view_##real##_t *view, mk_##real##_t scale,              \
                                           const mk_##real##_t *s, const mk_##real##_t *S);                                   \
    mk_status_t mk_unscented_innovations_##real(int n, int m, int slots, const mk_unscented_view_##real##_t *view,            \
                                                mk_##real##_t *r, mk_##real##_t *S, uint8_t *rows);                           \
    mk_status_t mk_unscented_move_##real(int n, const mk_unscented_view_##real##_t *view, const mk_##real##_t *dx);

MK_DECLARE_UNSCENTED_CORE(f32)
MK_DECLARE_UNSCENTED_CORE(f64)

/*
 * The typed functions; T is mk_<real>_t.
 *
 * name_start(f, config)        x0, P0, no readings. ARGUMENT, SHAPE, NOT_FINITE, NOT_POSITIVE_DEFINITE (P0, Q or some R); also of the gate's
 *                              thresholds, which are not negative, and of the weights': 0 < k0 < k1 or both 0; ARGUMENT with another update.
 * name_restart(f, x0, P0)      the same with other values; readings that wait are dropped, counters stay.
 * name_predict(f, dt, Q)       one prediction over dt seconds (> 0, or 0); Q packed, null: the configuration's. ORDER (before start), ARGUMENT,
 *                              NOT_FINITE, NOT_POSITIVE_DEFINITE (Q, or what is predicted), what the model's function returned.
 * name_put(f, slot, z)         a reading, `rows` numbers. NOT_FINITE, REPEATED (already one since the last update): dropped and counted.
 * name_drop(f, slot)           the reading of this slot is no longer there.
 * name_update(f)               uses and clears the readings. OK also where gate or weights refused them all: x and P are then the prediction.
 *                              With weights nis stays e' S^-1 e, of all rows that the gate left.
 *                              NOT_POSITIVE_DEFINITE (R + Omega), NOT_FINITE, what a sensor's function returned.
 * name_estimate(f)             x, n numbers; name_root(f): L, packed lower triangular rows, L L' = P.
 * name_covariance(f, P)        P, packed.
 * name_contribution(f, s, S)   the readings as information (spec 4.1), gated, R + Omega being their noise: S = H' (R + Omega)^-1 H, packed n,
 *                              s = H' (R + Omega)^-1 (nu + H x), n numbers, H = D L^-1. They are used up; x and P do not change. Both
 *                              are zero where there is none. Without weights. without_residual of the kernel: R alone, as published.
 * name_inform(f, scale, s, S)  the update from information: P^-1 := P^-1 + scale S, x := P (P_old^-1 x + scale s). S need not be positive
 *                              semidefinite, as long as the sum is positive definite. ARGUMENT, NOT_FINITE, NOT_POSITIVE_DEFINITE.
 * name_innovations(f, T r[slots x m], T S[MK_PACKED(slots x m)], uint8_t rows[slots])
 *                              Innovations of the readings that wait, one sensor after another, and their covariance D D' + Omega + R before
 *                              gate and weights: what meshkal/monitor.h needs. rows: of each slot, 0 where there is no reading. Nothing
 *                              changes but core.failed. Errors of name_update; the outputs are undefined then.
 * name_move(f, T dx[n])        x := x + dx, P stays: for error-state filters, whose reference has just been moved by -dx. ARGUMENT, ORDER,
 *                              NOT_FINITE.
 */
#define MK_UNSCENTED(name, real, n, m, slots) MK_UNSCENTED_TYPE(name, real, n, m, slots, MK_UNSCENTED_STEP)

#define MK_UNSCENTED_STEP(name, real, n, m, slot_count)                                                                       \
    MK_INLINE mk_status_t name##_predict(name##_t *f, mk_##real##_t dt, const mk_##real##_t *Q) {                             \
        mk_##real##_t work[MK_UNSCENTED_PREDICT_WORK(n)];                                                                     \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_predict_##real(n, &view, dt, Q);                                                                  \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_update(name##_t *f) {                                                                        \
        mk_##real##_t work[MK_UNSCENTED_UPDATE_WORK(n, m, slot_count)];                                                       \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_update_##real(n, m, slot_count, &view);                                                           \
    }

#define MK_UNSCENTED_TYPE(name, real, n, m, slot_count, step)                                                                 \
    typedef struct {                                                                                                          \
        mk_unscented_##real##_t core;                                                                                         \
        mk_##real##_t x[n];                       /* estimate */                                                              \
        mk_##real##_t L[MK_PACKED(n)];            /* P = L L' */                                                              \
        mk_##real##_t z[(m) * (slot_count)]; /* readings */                                                     \
        mk_gate_record_##real##_t record[slot_count]; /* of each sensor */                                                    \
        uint8_t have[slot_count];                                                                                             \
    } name##_t;                                                                                                               \
    typedef mk_unscented_config_##real##_t name##_config_t;                                                                   \
    MK_INLINE mk_unscented_view_##real##_t name##_view(name##_t *f, mk_##real##_t *work) {                                    \
        mk_unscented_view_##real##_t view;                                                                                    \
        view.core = &f->core;                                                                                                 \
        view.x = f->x;                                                                                                        \
        view.L = f->L;                                                                                                        \
        view.z = f->z;                                                                                                        \
        view.have = f->have;                                                                                                  \
        view.record = f->record;                                                                                              \
        view.work = work;                                                                                                     \
        return view;                                                                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_start(name##_t *f, const name##_config_t *config) {                                          \
        mk_##real##_t work[MK_UNSCENTED_OTHER_WORK(n, m)];                                                                    \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_start_##real(n, m, slot_count, &view, config);                                                    \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_restart(name##_t *f, const mk_##real##_t *x0, const mk_##real##_t *P0) {                     \
        mk_##real##_t work[MK_UNSCENTED_OTHER_WORK(n, m)];                                                                    \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_restart_##real(n, slot_count, &view, x0, P0);                                                     \
    }                                                                                                                         \
    step(name, real, n, m, slot_count)                                                                                        \
    MK_INLINE mk_status_t name##_put(name##_t *f, int slot, const mk_##real##_t *z) {                                         \
        const mk_unscented_view_##real##_t view = name##_view(f, 0);                                                          \
        return mk_unscented_put_##real(m, slot_count, &view, slot, z);                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_drop(name##_t *f, int slot) {                                                                \
        const mk_unscented_view_##real##_t view = name##_view(f, 0);                                                          \
        return mk_unscented_drop_##real(slot_count, &view, slot);                                                             \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_innovations(name##_t *f, mk_##real##_t *r, mk_##real##_t *S, uint8_t *rows) {                \
        mk_##real##_t work[MK_UNSCENTED_UPDATE_WORK(n, m, slot_count)];                                                       \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_innovations_##real(n, m, slot_count, &view, r, S, rows);                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_move(name##_t *f, const mk_##real##_t *dx) {                                                 \
        const mk_unscented_view_##real##_t view = name##_view(f, 0);                                                          \
        return mk_unscented_move_##real(n, &view, dx);                                                                        \
    }                                                                                                                         \
    MK_INLINE const mk_##real##_t *name##_estimate(const name##_t *f) { return f->x; }                                        \
    MK_INLINE const mk_##real##_t *name##_root(const name##_t *f) { return f->L; }                                            \
    MK_INLINE mk_status_t name##_covariance(name##_t *f, mk_##real##_t *P) {                                                  \
        const mk_unscented_view_##real##_t view = name##_view(f, 0);                                                          \
        return mk_unscented_covariance_##real(n, &view, P);                                                                   \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_contribution(name##_t *f, mk_##real##_t *s, mk_##real##_t *S) {                              \
        mk_##real##_t work[MK_UNSCENTED_UPDATE_WORK(n, m, slot_count)];                                                       \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_contribution_##real(n, m, slot_count, &view, 0, s, S);                                            \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_inform(name##_t *f, mk_##real##_t scale, const mk_##real##_t *s, const mk_##real##_t *S) {   \
        mk_##real##_t work[MK_UNSCENTED_OTHER_WORK(n, m)];                                                                    \
        const mk_unscented_view_##real##_t view = name##_view(f, work);                                                       \
        return mk_unscented_inform_##real(n, &view, scale, s, S);                                                             \
    }                                                                                                                         \
    typedef name##_t name##_filter_t

#ifdef __cplusplus
}
#endif

#endif
