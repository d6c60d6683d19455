/* SPDX-License-Identifier: MIT */
/*
 * Integrity monitor (spec 3): watches the innovations of any filter for slow faults, and says which sensor, since when, and when it is over.
 *
 * Each epoch it is given the innovations r of the sensors that were read and their covariance S, both stacked (name_innovations of rkfd.h, unscented.h,
 * duif.h and node.h, or the caller's own):
 *
 *     RCTM    q_R = r' S^-1 r                                              this epoch alone
 *     AIME    I = sum S_i^-1,  v = sum S_i^-1 r_i,  b = I^-1 v,  q_A = v' b    over the last `window` epochs (spec 3.1: Sb = I^-1, rb = b)
 *
 * Without fault each is chi-square with as many degrees as there are rows; alarm where the statistic reaches its upper quantile of Pfa. b is the
 * maximum likelihood estimate of constant offsets of the sensors. Rows have an identity, and a row that was not read adds nothing to the sums: so
 * sensors come and go within the window, the statistic keeps its law (degrees: rows that the window holds), and nothing starts again.
 *
 * Which sensor. Leaving sensor j out of the pooled estimate takes w_j = v_j' (I_jj)^-1 v_j from q_A, which is chi-square with its rows where all are good
 * (Baarda's test of the average). The sensor whose leaving brings what is left nearest to its threshold is the suspect; where that does not bring it
 * below, a second one is sought among the others, and on, `most` at a time at most.
 *
 * Sums. What leaves the window is not subtracted: the window is kept as two stacks, one of sums over its older epochs, one running sum of the
 * newer ones, and every `window` epochs the second becomes the first. Each sum is one of at most `window` terms, whatever the precision, however
 * long it runs; an epoch costs two additions of symmetric matrices, and N / M of that more on average.
 *
 * MK_MONITOR(name, real, m, places, window) declares name_t for up to `places` sensors of up to m rows at a time. N = places x m <= 32.
 * MK_WATCH(name, real, m, slots, window), after the macro of a filter or node of that name, declares with it
 *     name_watch(f, monitor, id)      innovations to the monitor; readings of sensors that it holds faulty are dropped
 * to be called where all readings are in: before incremental, update, or contribute. So an excluded sensor is left out and still looked at.
 */
#ifndef MESHKAL_MONITOR_H
#define MESHKAL_MONITOR_H

#include <meshkal/gate.h>

#ifdef __cplusplus
extern "C" {
#endif

/* MK_MONITOR_RCTM      alarm by q_R
   MK_MONITOR_AIME      alarm by q_A
   MK_MONITOR_IMPROVED  AIME with the published decision that a fault is over (spec 3.3): rho = 1 while AIME accepts, q_A / max(q_R, 0.1) in alarm;
                        over where, from two epochs after the alarm, rho exceeds the median of the last three rho by more than `jump`. Then RCTM alone
                        for `window` epochs, then AIME again from an empty window.
   MK_MONITOR_EXCLUDE   AIME; what is isolated is held faulty until the decision below, and the window begins again without it */
enum { MK_MONITOR_RCTM, MK_MONITOR_AIME, MK_MONITOR_IMPROVED, MK_MONITOR_EXCLUDE };

/* Scratch memory, in numbers, of watch; N = places x m. */
#define MK_MONITOR_WORK(N) (3 * MK_PACKED(N) + 4 * (N))

#define MK_DECLARE_MONITOR(real)                                                                                              \
    /* Configuration: may be const, in flash, and must outlive the monitor. */                                                \
    typedef struct {                                                                                                          \
        uint16_t m, places, window;                                                                                           \
        const mk_##real##_t *threshold; /* N: for 1, 2, .. rows: mk_gate_thresholds(Pfa, N, ..) of meshkal/gate.h */          \
        mk_##real##_t jump;             /* MK_MONITOR_IMPROVED: eta > 0; not published, 2 x window is the best value found */ \
        mk_##real##_t separation;       /* MK_MONITOR_EXCLUDE, >= 0: how much more than the next one's the w of a suspect must be; 0: nothing */ \
        mk_##real##_t evidence;         /* MK_MONITOR_EXCLUDE, > 0: log likelihood ratio that ends a fault */                 \
        uint16_t most;                  /* MK_MONITOR_EXCLUDE: sensors held faulty at a time */                               \
        uint8_t scheme;                 /* MK_MONITOR_ */                                                                     \
    } mk_monitor_config_##real##_t;                                                                                           \
                                                                                                                              \
    /* A sensor that the window holds, or that is held faulty. Read, do not write. */                                         \
    typedef struct {                                                                                                          \
        uint16_t id;                                                                                                          \
        uint8_t used;                /* 0: this place is free */                                                              \
        uint8_t rows;                                                                                                         \
        uint8_t faulty;                                                                                                       \
        mk_##real##_t w;             /* of the last epoch */                                                                  \
        mk_##real##_t ratio;         /* MK_MONITOR_EXCLUDE, faulty: evidence for the end / `evidence` */                      \
        uint32_t since, until;       /* epochs in which it was last held faulty and no longer */                              \
        uint32_t faults;             /* times that it was held faulty */                                                      \
    } mk_watched_##real##_t;                                                                                                  \
                                                                                                                              \
    /* What every monitor has; first member `core`. Read, do not write. */                                                    \
    typedef struct {                                                                                                          \
        const mk_monitor_config_##real##_t *config;                                                                           \
        mk_##real##_t rctm, aime;             /* q_R, q_A of the last epoch, of the sensors not held faulty */                \
        mk_##real##_t rctm_ratio, aime_ratio; /* test ratios: statistic / threshold */                                        \
        mk_##real##_t rho, median;            /* of MK_MONITOR_IMPROVED */                                                    \
        uint16_t rows, window_rows;           /* degrees of freedom of q_R and q_A */                                         \
        uint16_t held;                        /* epochs that the window holds, at most `window` */                            \
        uint16_t faulty;                      /* sensors held faulty */                                                       \
        uint16_t failed;                      /* index, in the last call, of the sensor that it failed at */                  \
        uint8_t alarm;                        /* 1: the scheme's test refuses this epoch */                                   \
        uint8_t ended;                        /* 1: in this epoch a fault was found to be over */                             \
        uint8_t unresolved;                   /* 1: alarm, but no `most` sensors explain it, or two do as well */             \
        uint32_t epoch;                       /* epochs watched */                                                            \
        uint32_t alarm_since;                 /* epoch in which the present or last alarm began */                            \
        uint32_t alarms, ends;                /* times that one began; decisions that a fault is over */                      \
        uint32_t crowded;                     /* readings that were not watched: no place free */                             \
        uint32_t rejected;                    /* epochs refused */                                                            \
        uint16_t front, back;                 /* epochs in each of the two stacks */                                          \
        uint16_t quiet;                       /* MK_MONITOR_IMPROVED: epochs of RCTM alone that are left */                   \
        mk_##real##_t rhos[3];                /* the last three */                                                            \
    } mk_monitor_##real##_t;                                                                                                  \
                                                                                                                              \
    /* Of a row of a sensor held faulty: what the decision on its end keeps. */                                               \
    typedef struct {                                                                                                          \
        mk_##real##_t level, slope, P[3]; /* of the fault, in standard deviations of the row's innovation, a step an epoch */ \
    } mk_fault_##real##_t;                                                                                                    \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_monitor_##real##_t *core;                                                                                          \
        mk_watched_##real##_t *sensor; /* places */                                                                           \
        mk_fault_##real##_t *fault;    /* N */                                                                                \
        mk_##real##_t *I;              /* (window + 1) x packed N: the stacks, then the running sum */                        \
        mk_##real##_t *v;              /* (window + 1) x N */                                                                 \
        uint32_t *seen;                /* window: bit r: row r was read in that epoch */                                      \
        mk_##real##_t *work;                                                                                                  \
    } mk_monitor_view_##real##_t;                                                                                             \
                                                                                                                              \
    /* The same functions for dimensions known at run time only; contracts below. */                                          \
    mk_status_t mk_monitor_start_##real(int m, int places, int window, const mk_monitor_view_##real##_t *view,                \
                                        const mk_monitor_config_##real##_t *config);                                          \
    mk_status_t mk_monitor_restart_##real(const mk_monitor_view_##real##_t *view);                                            \
    mk_status_t mk_monitor_watch_##real(const mk_monitor_view_##real##_t *view, int sensors, const uint16_t *id,              \
                                        const uint8_t *rows, const mk_##real##_t *r, const mk_##real##_t *S);                 \
    int mk_monitor_faulty_##real(const mk_monitor_view_##real##_t *view, uint16_t id);                                        \
    mk_status_t mk_monitor_clear_##real(const mk_monitor_view_##real##_t *view, uint16_t id);

MK_DECLARE_MONITOR(f32)
MK_DECLARE_MONITOR(f64)

/*
 * The typed functions. T is mk_<real>_t. On failure the monitor is as it was, but for `failed` and `rejected`.
 *
 * name_start(monitor, config)  Empty. ARGUMENT: null, thresholds not positive, N > 32, window 0, scheme unknown; SHAPE; NOT_FINITE.
 * name_restart(monitor)        An empty window, nobody faulty; epoch and counters stay.
 * name_watch(monitor, sensors, id[sensors], rows[sensors], T r[], T S[])
 *                              One epoch, also one in which nothing was read. rows[l] is 0 for a sensor that was not read; r and packed S hold
 *                              the rows of the others, one sensor after another. ARGUMENT: null, more rows than m, an id twice; NOT_FINITE;
 *                              NOT_POSITIVE_DEFINITE: S; `failed` is the sensor. Cost: one inverse of S, one solve with I.
 * name_faulty(monitor, id)     1 if this sensor is held faulty.
 * name_clear(monitor, id)      It no longer is: it was mended. ARGUMENT: it is not held.
 */
#define MK_MONITOR(name, real, most_rows, place_count, epochs)                                                                \
    typedef struct {                                                                                                          \
        mk_monitor_##real##_t core;                                                                                           \
        mk_watched_##real##_t sensor[place_count];                                                                            \
        mk_fault_##real##_t fault[(place_count) * (most_rows)];                                                               \
        mk_##real##_t I[((epochs) + 1) * MK_PACKED((place_count) * (most_rows))];                                             \
        mk_##real##_t v[((epochs) + 1) * (place_count) * (most_rows)];                                                        \
        uint32_t seen[epochs];                                                                                                \
    } name##_t;                                                                                                               \
    typedef mk_monitor_config_##real##_t name##_config_t;                                                                     \
    typedef char name##_has_at_most_32_rows[(place_count) * (most_rows) <= 32 ? 1 : -1];                                      \
    MK_INLINE mk_monitor_view_##real##_t name##_view(name##_t *monitor, mk_##real##_t *work) {                                \
        mk_monitor_view_##real##_t view;                                                                                      \
        view.core = &monitor->core;                                                                                           \
        view.sensor = monitor->sensor;                                                                                        \
        view.fault = monitor->fault;                                                                                          \
        view.I = monitor->I;                                                                                                  \
        view.v = monitor->v;                                                                                                  \
        view.seen = monitor->seen;                                                                                            \
        view.work = work;                                                                                                     \
        return view;                                                                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_start(name##_t *monitor, const name##_config_t *config) {                                    \
        const mk_monitor_view_##real##_t view = name##_view(monitor, 0);                                                      \
        return mk_monitor_start_##real(most_rows, place_count, epochs, &view, config);                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_restart(name##_t *monitor) {                                                                 \
        const mk_monitor_view_##real##_t view = name##_view(monitor, 0);                                                      \
        return mk_monitor_restart_##real(&view);                                                                              \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_watch(name##_t *monitor, int sensors, const uint16_t *id, const uint8_t *rows,               \
                                       const mk_##real##_t *r, const mk_##real##_t *S) {                                      \
        mk_##real##_t work[MK_MONITOR_WORK((place_count) * (most_rows))];                                                     \
        const mk_monitor_view_##real##_t view = name##_view(monitor, work);                                                   \
        return mk_monitor_watch_##real(&view, sensors, id, rows, r, S);                                                       \
    }                                                                                                                         \
    MK_INLINE int name##_faulty(name##_t *monitor, uint16_t id) {                                                             \
        const mk_monitor_view_##real##_t view = name##_view(monitor, 0);                                                      \
        return mk_monitor_faulty_##real(&view, id);                                                                           \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_clear(name##_t *monitor, uint16_t id) {                                                      \
        const mk_monitor_view_##real##_t view = name##_view(monitor, 0);                                                      \
        return mk_monitor_clear_##real(&view, id);                                                                            \
    }                                                                                                                         \
    typedef name##_t name##_monitor_type_t

/*
 * name_watch(f, name_monitor_t *monitor, id[slots])
 *                              id: who is in each slot; of a node its config's `nodes`. Errors of name_innovations of the filter and of the
 *                              monitor's watch; readings of sensors that were held faulty before are dropped then, too.
 */
#define MK_WATCH(name, real, m, slots, window)                                                                                \
    MK_MONITOR(name##_monitor, real, m, slots, window);                                                                       \
    MK_INLINE mk_status_t name##_watch(name##_t *f, name##_monitor_t *monitor, const uint16_t *id) {                          \
        mk_##real##_t r[(slots) * (m)], S[MK_PACKED((slots) * (m))];                                                          \
        uint8_t rows[slots];                                                                                                  \
        mk_status_t status = name##_innovations(f, r, S, rows);                                                               \
        if (status == MK_OK) status = name##_monitor_watch(monitor, slots, id, rows, r, S);                                   \
        for (int l = 0; l < (slots); l++)                                                                                     \
            if (name##_monitor_faulty(monitor, id[l])) (void)name##_drop(f, l);                                               \
        return status;                                                                                                        \
    }                                                                                                                         \
    typedef name##_monitor_t name##_watched_type_t

#ifdef __cplusplus
}
#endif

#endif
