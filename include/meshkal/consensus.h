/* SPDX-License-Identifier: MIT */
/*
 * Consensus (spec 4.2): nodes that talk to their neighbours only agree on a mean of p numbers of each. Knows nothing of filters.
 *
 *     begin(values, measures)
 *     L times, l = 0 .. L-1:    message -> neighbours,  put(slot, l, values) for what arrives,  iterate
 *     average(values)
 *
 * All nodes run the same number L of iterations of the same protocol. Slot 0 is the node itself, the others are its neighbours. What has not been
 * put for iteration l when iterate ends it is left out of it; a later message is LATE. A neighbour may be one iteration ahead: its
 * message waits for that iteration, also from the last one of a run to the first one of the next, before its begin. Sums run over the slots in
 * their order: the result does not depend on the order of arrival.
 *
 * Protocols; a_ij > 0 weight of neighbour j (1 if none is given), g_i = 1 if node i measures now, else 0; sums over the neighbours
 * heard in this iteration:
 *
 *     MK_CONSENSUS_METROPOLIS   s_i := s_i + sum w_ij (s_j - s_i),  w_ij = 1 / (1 + max(deg_i, deg_j)). The average, where links go both ways
 *                               and nothing is lost; otherwise some convex combination.
 *     MK_CONSENSUS_PAPER        s_i := (g_i s_i + sum a_ij s_j) / (g_i + sum a_ij); 0 / 0: s_i stays. As published. Converges to
 *                               sum pi_j s_j, pi_j = (d_j + g_j) / sum (d + g), d_j = sum a_jk, for symmetric weights: not the average.
 *     MK_CONSENSUS_PERRON       the same, s_j scaled first so that the limit is the average.
 *                               total > 0: by total / (N (d_j + g_j)), 1 / (N pi_j), total = sum (d + g) over the network: where it is known who
 *                               measures, above all where all nodes do.
 *                               total = 0: by 1 / (d_j + g_j); and the same scale of the number 1 travels with the values. Its limit is
 *                               N / sum (d + g), the values' is sum s_j / sum (d + g): their ratio is the average, and no node need know
 *                               who measures. One number more in a message. What is lost leaves a convex combination.
 *     MK_CONSENSUS_RATIO        ratio consensus over running sums (Hadjicostis, Vaidya, Dominguez-Garcia 2016; push-sum). Each node splits its values
 *                               and a mass, 1 at first, in 1 + deg_i equal shares, keeps one, and sends the sum of all shares that one neighbour
 *                               has been given since begin. A receiver adds what this sum has grown by since it last heard it: what was lost comes with
 *                               the next message; who heard nobody gives nothing away in the next iteration, or an isolated node would give all
 *                               it has into the void [own]. values / mass is the average as soon as lost messages have been made up for; with a link
 *                               that stays down for the whole run a convex combination. Links may come and go in any iteration, and may go one way:
 *                               deg_i counts who receives. One number more in a message. Sums grow with L: not for float16 and large L.
 *     MK_CONSENSUS_SUM          L = 1: the sum of own values and those heard; no average. What the Kalman-consensus filter needs.
 *
 * Rates: disagreement falls as the second largest modulus of an eigenvalue of the weight matrix to the power L; `meshkal design` says so.
 *
 * Memory: (2 slots + 1) (p + 1) numbers. Cost of an iteration: p x slots multiplications and additions.
 * MK_CONSENSUS(name, real, p, slots) declares name_t and the functions below.
 */
#ifndef MESHKAL_CONSENSUS_H
#define MESHKAL_CONSENSUS_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MK_CONSENSUS_METROPOLIS, MK_CONSENSUS_PAPER, MK_CONSENSUS_PERRON, MK_CONSENSUS_RATIO, MK_CONSENSUS_SUM, MK_CONSENSUS_COUNT };

/* Scratch memory of iterate, in numbers, from the stack: p is that of the type. */
#define MK_CONSENSUS_WORK(p) (2 * ((p) + 1))

#define MK_DECLARE_CONSENSUS_CORE(real)                                                                                       \
    /* May be const, in flash, and must outlive the object. An owner who keeps it in RAM may change weight, degree and total between an  \
       average and the next begin: a topology that changes. */                                                                \
    typedef struct {                                                                                                          \
        uint16_t values;             /* p, at most that of the type */                                                        \
        uint16_t slots;                                                                                                       \
        uint16_t iterations;         /* L >= 1; 1 for MK_CONSENSUS_SUM */                                                     \
        uint16_t network;            /* N >= 1, nodes of the whole network: for PERRON with a total */                        \
        uint8_t protocol;            /* MK_CONSENSUS_ */                                                                      \
        mk_##real##_t total;         /* PERRON: sum (d + g) over the network; 0: found on the way */                          \
        const mk_##real##_t *weight; /* PAPER, PERRON: a_ij, slots of them, the first is not read; null: 1 each */            \
        const uint16_t *degree;      /* METROPOLIS: neighbours of the node in each slot; RATIO: the first, who receives; else null */ \
    } mk_consensus_config_##real##_t;                                                                                         \
                                                                                                                              \
    /* First member `core` of every type. Read, do not write. */                                                              \
    typedef struct {                                                                                                          \
        const mk_consensus_config_##real##_t *config;                                                                         \
        uint16_t iteration;  /* that is being worked on; after the last one 0, that of the next run */                        \
        uint16_t kept;       /* iterations of this run, or of the last one, in which nobody was heard: s_i stayed */          \
        uint32_t heard;      /* messages used in them */                                                                      \
        uint32_t missing;    /* messages that were not there */                                                               \
        uint8_t running;     /* 1 from begin to the last iterate */                                                           \
        uint8_t known;       /* 1: average has something to say */                                                            \
        uint8_t measures;    /* g_i */                                                                                        \
    } mk_consensus_##real##_t;                                                                                                \
                                                                                                                              \
    /* Rows of p + 1 numbers. now[0] is the message, next[0] and sum are own. */                                              \
    typedef struct {                                                                                                          \
        mk_consensus_##real##_t *core;                                                                                        \
        mk_##real##_t *now, *next, *sum; /* slots rows, slots rows, one row */                                                \
        uint8_t *have;                   /* slots: bit 0 for this iteration, bit 1 for the next */                            \
        mk_##real##_t *work;                                                                                                  \
    } mk_consensus_view_##real##_t;                                                                                           \
                                                                                                                              \
    /* The same functions for dimensions known at run time only; p is that of the type, for the rows. */                      \
    mk_status_t mk_consensus_start_##real(int p, int slots, const mk_consensus_view_##real##_t *view,                         \
                                          const mk_consensus_config_##real##_t *config);                                      \
    mk_status_t mk_consensus_begin_##real(int p, const mk_consensus_view_##real##_t *view, const mk_##real##_t *values,       \
                                          int measures);                                                                      \
    int mk_consensus_numbers_##real(const mk_consensus_config_##real##_t *config);                                            \
    mk_status_t mk_consensus_expect_##real(const mk_consensus_view_##real##_t *view, int slot, uint32_t iteration);           \
    mk_status_t mk_consensus_put_##real(int p, const mk_consensus_view_##real##_t *view, int slot, uint32_t iteration,        \
                                        const mk_##real##_t *values);                                                         \
    mk_status_t mk_consensus_iterate_##real(int p, const mk_consensus_view_##real##_t *view);                                 \
    mk_status_t mk_consensus_average_##real(const mk_consensus_view_##real##_t *view, mk_##real##_t *values);                 \
    void mk_consensus_reset_##real(int p, const mk_consensus_view_##real##_t *view);

MK_DECLARE_CONSENSUS_CORE(f32)
MK_DECLARE_CONSENSUS_CORE(f64)

/*
 * The typed functions; T is mk_<real>_t. On failure the object is as it was.
 *
 * name_start(c, config)        No run, nothing put. ARGUMENT: null, no iterations, unknown protocol, negative or not finite weight or total, no degrees
 *                              where they are needed; SHAPE.
 * name_begin(c, values, measures)
 *                              A run from these p numbers; measures: g_i, 0 or 1. ORDER: before start or in a run; ARGUMENT; NOT_FINITE.
 * name_numbers(config)         How many numbers a message has: p, or p + 1.
 * name_message(c)              They; null where there is no run. Up to the next iterate.
 * name_put(c, slot, iteration, values)
 *                              A neighbour's message of this or the next iteration; L stands for the first of the next run in the last of this
 *                              one. ORDER: before start; ARGUMENT: slot; LATE; AHEAD: more than one; REPEATED; NOT_FINITE.
 * name_iterate(c)              Ends the iteration. ORDER: no run; NOT_FINITE: the result overflows.
 * name_average(c, values)      The present estimate of the average; the run's result from its last iterate to the next begin. ORDER: no run yet;
 *                              NOT_FINITE: it has no mass, so nothing is known (PERRON: a node that measures nothing and has never
 *                              been sent a message; RATIO: it was all sent and nothing came).
 * name_reset(c)                Abandons the run and drops what was put.
 */
#define MK_CONSENSUS(name, real, p, slot_count)                                                                               \
    typedef struct {                                                                                                          \
        mk_consensus_##real##_t core;                                                                                         \
        mk_##real##_t now[(slot_count) * ((p) + 1)], next[(slot_count) * ((p) + 1)], sum[(p) + 1];                            \
        uint8_t have[slot_count];                                                                                             \
    } name##_t;                                                                                                               \
    typedef mk_consensus_config_##real##_t name##_config_t;                                                                   \
    MK_INLINE mk_consensus_view_##real##_t name##_view(name##_t *c, mk_##real##_t *work) {                                    \
        mk_consensus_view_##real##_t view;                                                                                    \
        view.core = &c->core;                                                                                                 \
        view.now = c->now;                                                                                                    \
        view.next = c->next;                                                                                                  \
        view.sum = c->sum;                                                                                                    \
        view.have = c->have;                                                                                                  \
        view.work = work;                                                                                                     \
        return view;                                                                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_start(name##_t *c, const name##_config_t *config) {                                          \
        const mk_consensus_view_##real##_t view = name##_view(c, 0);                                                          \
        return mk_consensus_start_##real(p, slot_count, &view, config);                                                       \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_begin(name##_t *c, const mk_##real##_t *values, int measures) {                              \
        mk_##real##_t work[MK_CONSENSUS_WORK(p)];                                                                             \
        const mk_consensus_view_##real##_t view = name##_view(c, work);                                                       \
        return mk_consensus_begin_##real(p, &view, values, measures);                                                         \
    }                                                                                                                         \
    MK_INLINE int name##_numbers(const name##_config_t *config) { return mk_consensus_numbers_##real(config); }               \
    MK_INLINE const mk_##real##_t *name##_message(const name##_t *c) { return c->core.running ? c->now : 0; }                 \
    MK_INLINE mk_status_t name##_put(name##_t *c, int slot, uint32_t iteration, const mk_##real##_t *values) {                \
        const mk_consensus_view_##real##_t view = name##_view(c, 0);                                                          \
        return mk_consensus_put_##real(p, &view, slot, iteration, values);                                                    \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_iterate(name##_t *c) {                                                                       \
        mk_##real##_t work[MK_CONSENSUS_WORK(p)];                                                                             \
        const mk_consensus_view_##real##_t view = name##_view(c, work);                                                       \
        return mk_consensus_iterate_##real(p, &view);                                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_average(name##_t *c, mk_##real##_t *values) {                                                \
        const mk_consensus_view_##real##_t view = name##_view(c, 0);                                                          \
        return mk_consensus_average_##real(&view, values);                                                                    \
    }                                                                                                                         \
    MK_INLINE void name##_reset(name##_t *c) {                                                                                \
        const mk_consensus_view_##real##_t view = name##_view(c, 0);                                                          \
        mk_consensus_reset_##real(p, &view);                                                                                  \
    }                                                                                                                         \
    typedef name##_t name##_consensus_t

#ifdef __cplusplus
}
#endif

#endif
