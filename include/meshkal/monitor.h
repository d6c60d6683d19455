/* SPDX-License-Identifier: MIT */
/*
 * Integrity monitor (spec 3): watches the innovations of any filter for slow faults, and says which sensor, since when, and when it is
 * over.
 *
 * Each epoch it is given the innovations r of the sensors that were read and their covariance S, both stacked (name_innovations of rkfd.h,
 * unscented.h, duif.h and node.h, or the caller's own):
 *
 *     RCTM    q_R = r' S^-1 r                                              this epoch alone
 *     AIME    I = sum S_i^-1,  v = sum S_i^-1 r_i,  b = I^-1 v,  q_A = v' b    over the last `window` epochs (spec 3.1: Sb = I^-1, rb = b)
 *
 * Without fault each is chi-square with as many degrees as there are rows; alarm where the statistic reaches its upper quantile of Pfa, the
 * probability of one test: false alarms come every 1 / Pfa epochs or rarer. b is the maximum likelihood estimate of constant offsets of the
 * sensors. Rows have an identity, and a row that was not read adds nothing to the sums: so sensors come and go within the window, the
 * statistic keeps its law (degrees: rows that the window holds), and nothing starts again.
 *
 * Which sensor. Leaving sensor j out of the pooled estimate takes w_j = v_j' (I_jj)^-1 v_j from q_A, which is chi-square with its rows where
 * all are good (Baarda's test of the average). The sensor whose leaving brings what is left nearest to its threshold is the suspect; where
 * that does not bring it below, a second one is sought among the others, given an offset of the first, and on, `most` at a time at most.
 * Where no `most` sensors explain the alarm, or the last of them does it hardly better than another, nobody is suspected: unresolved. w of
 * one less w of another is twice the logarithm of the likelihood ratio of their offsets: with `separation` s, the wrong one of two, of a row
 * each, is taken with a probability below exp(-s / 2). A leap is not an offset of the whole window: where S varies in it, a large one is
 * explained by no such offset. Where the window is unresolved and RCTM refuses the epoch, the same is therefore asked of the epoch alone.
 * After `patience` unresolved epochs in a row the alarm is not left alone any longer: those who explain it are held, or, where none do, the
 * first suspect alone. separation 10 and patience 5 are good values with eight sensors (tests/host/integrity_guard.py).
 *
 * When it is over. A sensor held faulty is not in the sums, but its innovations, which the filter computes without it, are looked at, with
 * unit variance: u = L^-1 r_j, S_jj = L L'. While the fault goes on, a Kalman filter of level b and slope s follows each row; when it is
 * over, u is normal.
 *
 *     at the alarm   b = L^-1 (offset of the sensor in the window),  s = 0,  P = diag(1, 1 / window^2),  C = k = n = 0,  t = T = 0
 *     each later epoch  b += s,  P := F P F' + diag(q_level, q_slope),  V = 1 + P_11,  l = sum over rows ((u - b)^2 / V - u^2 + log V) / 2
 *                    C = max(0, C + l);  C > 0: k += 1, t += u, else k = 0, t = 0;  n += 1, T += u
 *                    (b, s), P: Kalman update with the gain times max(0, 1 - C / h)
 *     C > h          t' t <= c_0 k: over, as Page's test of the two laws says.  Else the fault has another value: begin with b = t / k; n, T stay.
 *     n = window     T' T <= c_back n: over: it is too small to be told from none (a wrong isolation, or a fault that shrank), so that no
 *                    sensor is locked out.  Else n = 0, T = 0
 *
 * In an epoch in which it was not read, only b and P are carried on. From the epoch after the end it is watched again: its rows are just not
 * there in the older epochs of the window. A sensor that vanishes while it is held faulty is held until it is back and its fault is over, or
 * name_clear.
 *
 * Sums. What leaves the window is not subtracted: the window is kept as two stacks, one of sums over its older epochs, one running sum of the
 * newer ones, and every `window` epochs the second becomes the first. Each sum is one of at most `window` terms, whatever the precision,
 * however long it runs. An epoch costs three additions of symmetric matrices, and every `window` epochs window - 2 more.
 *
 * MK_MONITOR(name, real, m, places, window) declares name_t for up to `places` sensors of up to m rows at a time. N = places x m <= 32.
 * MK_WATCH(name, real, m, slots, window), after the macro of a filter or node of that name, declares with it
 *     name_watch(f, monitor, id)      innovations to the monitor; readings of sensors that it holds faulty are dropped
 * to be called where all readings are in: before incremental, update, or contribute. So an excluded sensor is left out and still looked at.
 * tests/package/watch_node.c is a whole node with it. Values to begin with: those of `simulate --monitor exclude` (window 10, level 0.01,
 * slope 1e-4, separation 10, most 2, patience 5), which tries them on a scenario with `faults`.
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
                        over where, from two epochs after the alarm, rho exceeds the median of the last three rho, its own among them, by more than
                        `jump`: no alarm in that epoch, then RCTM alone for `window` epochs, then AIME again from an empty window.
   MK_MONITOR_EXCLUDE   AIME; what is isolated is held faulty until the decision above, and the window begins again, empty, without it: the others'
                        innovations were drawn towards the fault, through the filter */
enum { MK_MONITOR_RCTM, MK_MONITOR_AIME, MK_MONITOR_IMPROVED, MK_MONITOR_EXCLUDE };

/* Rows of a monitor, places x m, at most. */
#define MK_MONITOR_ROWS 32
/* Scratch memory, in numbers, of watch, which the typed function takes from the stack; N = places x m. */
#define MK_MONITOR_WORK(N) (3 * MK_PACKED(N) + 4 * (N))

#define MK_DECLARE_MONITOR(real)                                                                                              \
    /* Configuration: may be const, in flash, and must outlive the monitor. */                                                \
    typedef struct {                                                                                                          \
        uint16_t m, places, window;                                                                                           \
        /* N: for 1, 2, .. rows: mk_gate_thresholds(Pfa, N, ..) of meshkal/gate.h, at start-up or, as constants, before */    \
        const mk_##real##_t *threshold;                                                                                       \
        mk_##real##_t jump;             /* MK_MONITOR_IMPROVED: eta > 0; not published, 2 x window is the best value found */ \
        /* MK_MONITOR_EXCLUDE, >= 0: how much more than the next one's the w of a suspect must be; 0: nothing */              \
        mk_##real##_t separation;                                                                                             \
        mk_##real##_t evidence;         /* MK_MONITOR_EXCLUDE: h of the end of a fault, > 0: mk_monitor_evidence */           \
        /* m each: its c_0, c_back for 1, 2, .. rows: mk_gate_thresholds(1e-3, m, ..), (0.1, m, ..) */                        \
        const mk_##real##_t *zero, *back;                                                                                     \
        mk_##real##_t level, slope;     /* its q_level, q_slope, >= 0, variances an epoch */                                  \
        uint16_t most;                  /* MK_MONITOR_EXCLUDE: sensors held faulty at a time, >= 1 */                         \
        uint16_t patience;              /* MK_MONITOR_EXCLUDE: epochs in a row that stay unresolved; 0: any number */         \
        uint8_t scheme;                 /* MK_MONITOR_ */                                                                     \
    } mk_monitor_config_##real##_t;                                                                                           \
                                                                                                                              \
    /* A sensor that the window holds, or that is held faulty; or, unused, that was one. Which place a sensor has, `id` tells.  \
       Read, do not write. */                                                                                                 \
    typedef struct {                                                                                                          \
        uint16_t id;                                                                                                          \
        uint8_t used;                /* 0: this place is free */                                                              \
        uint8_t rows;                /* of its last reading */                                                                \
        uint8_t faulty;                                                                                                       \
        uint8_t begun;               /* faulty: its innovations are being followed */                                         \
        mk_##real##_t w;             /* of the last epoch; 0 where the window has no rows of it */                            \
        /* faulty: evidence for the end, C / h, of the last epoch in which it was read, that of the end among them */         \
        mk_##real##_t ratio;                                                                                                  \
        mk_##real##_t evidence;      /* C, k, n */                                                                            \
        uint32_t speaking, counted;                                                                                           \
        uint32_t since, until;       /* epochs, counted from 1, in which it was last taken as faulty, and let go; 0: never */ \
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
        uint16_t failed;                      /* index, in the last call, of the sensor that it failed at; their number: none */ \
        uint8_t alarm;                        /* 1: the scheme's test refuses this epoch */                                   \
        uint8_t ended;                        /* 1: in this epoch a fault was found to be over */                             \
        uint8_t unresolved;                   /* 1: alarm, but no `most` sensors explain it, or two do as well */             \
        uint32_t epoch;                       /* epochs watched: the number of the last one */                                \
        uint32_t alarm_since;                 /* epoch in which the present or last alarm began */                            \
        uint32_t alarms, ends;                /* times that one began; decisions that a fault is over */                      \
        uint32_t crowded;                     /* readings that were not watched: no place free */                             \
        uint32_t rejected;                    /* epochs refused */                                                            \
        uint16_t front, back;                 /* epochs in each of the two stacks */                                          \
        uint16_t quiet;                       /* MK_MONITOR_IMPROVED: epochs of RCTM alone that are left */                   \
        uint16_t waited;                      /* MK_MONITOR_EXCLUDE: unresolved epochs in a row */                            \
        mk_##real##_t rhos[3];                /* the last three */                                                            \
    } mk_monitor_##real##_t;                                                                                                  \
                                                                                                                              \
    /* Of a row of a sensor held faulty: what the decision on its end keeps, in standard deviations of the row's innovation. */ \
    typedef struct {                                                                                                          \
        mk_##real##_t level, slope, P[3]; /* b, s an epoch, packed P */                                                       \
        mk_##real##_t sum, all;           /* t, T */                                                                          \
    } mk_fault_##real##_t;                                                                                                    \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_monitor_##real##_t *core;                                                                                          \
        mk_watched_##real##_t *sensor; /* places */                                                                           \
        mk_fault_##real##_t *fault;    /* N */                                                                                \
        mk_##real##_t *information;    /* I, (window + 1) x packed N: the stacks, then the running sum */                     \
        mk_##real##_t *v;              /* (window + 1) x N */                                                                 \
        uint32_t *seen;                /* window: bit r: row r was read in that epoch */                                      \
        mk_##real##_t *work;                                                                                                  \
    } mk_monitor_view_##real##_t;                                                                                             \
                                                                                                                              \
    /* evidence := log(epochs / early): while a fault goes on as the tracker models it, it is called over with a probability  \
       of at most `early` in as many epochs; 0.01 in 1000 are 11.5. ARGUMENT: null, early not between 0 and 1, epochs not     \
       between 1 and 1e300. */                                                                                                \
    mk_status_t mk_monitor_evidence_##real(double early, double epochs, mk_##real##_t *evidence);                             \
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
 * name_start(monitor, config)  Empty. ARGUMENT: null, thresholds not positive, N > 32, window 0, scheme unknown, or what this scheme needs is null
 *                              or out of range; SHAPE; NOT_FINITE. What another scheme needs is not looked at.
 * name_restart(monitor)        An empty window, nobody faulty; epoch and counters stay. ORDER, here and below: not started.
 * name_watch(monitor, sensors, id[sensors], rows[sensors], T r[], T S[])
 *                              One epoch, also one in which nothing was read. rows[l] is 0 for a sensor that was not read; r and packed S hold
 *                              the rows of the others, one sensor after another. ARGUMENT: null, sensors x m above 32767, more rows than
 *                              m, an id twice among those that were read; NOT_FINITE, also where a statistic overflows;
 *                              NOT_POSITIVE_DEFINITE: S of those not held faulty, or S_jj of one that is; `failed` is the sensor at which
 *                              it shows. Where I is singular in this precision, the rows that others determine count neither in q_A nor
 *                              in its degrees. Cost: one inverse of S, one solve with I.
 * name_faulty(monitor, id)     1 if this sensor is held faulty.
 * name_clear(monitor, id)      It no longer is: it was mended. ARGUMENT: it is not held.
 */
#define MK_MONITOR(name, real, most_rows, place_count, epochs)                                                                \
    typedef struct {                                                                                                          \
        mk_monitor_##real##_t core;                                                                                           \
        mk_watched_##real##_t sensor[place_count];                                                                            \
        mk_fault_##real##_t fault[(place_count) * (most_rows)];                                                               \
        mk_##real##_t information[((epochs) + 1) * MK_PACKED((place_count) * (most_rows))];                                   \
        mk_##real##_t v[((epochs) + 1) * (place_count) * (most_rows)];                                                        \
        uint32_t seen[epochs];                                                                                                \
    } name##_t;                                                                                                               \
    typedef mk_monitor_config_##real##_t name##_config_t;                                                                     \
    typedef char name##_has_too_many_rows[(place_count) * (most_rows) <= MK_MONITOR_ROWS ? 1 : -1];                             \
    MK_INLINE mk_monitor_view_##real##_t name##_view(name##_t *monitor, mk_##real##_t *work) {                                \
        mk_monitor_view_##real##_t view;                                                                                      \
        view.core = &monitor->core;                                                                                           \
        view.sensor = monitor->sensor;                                                                                        \
        view.fault = monitor->fault;                                                                                          \
        view.information = monitor->information;                                                                              \
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
