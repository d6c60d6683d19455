/* SPDX-License-Identifier: MIT */
/*
 * The node object of the distributed unscented information filter (spec 4): an unscented filter (meshkal/unscented.h) with this
 * node's own sensor, consensus (meshkal/consensus.h) with its neighbours, messages (meshkal/frame.h), diagnostics. It has no clock and no radio:
 * the application calls it.
 *
 *     predict(dt) ... measure(z)             x, P; the node's own reading, if there is one now
 *     contribute                             reading -> s, S (gate in meshkal/unscented.h); the consensus begins, with zeros where there is no reading
 *     L times:  frame -> radio, radio -> accept ..., iterate
 *     fuse                                   P^-1 := P^-1 + N Sb,  x := P (P_old^-1 x + N sb);  ends the step
 *
 * s, S: information of spec 4.1, n + n (n + 1) / 2 numbers; Sb, sb: their average over the network of N nodes. s is S times a state: the farther
 * that is from zero, the more its rounding on the air costs. An `origin` in the middle of the area, the same in all nodes, makes it S times the
 * distance from there. Needed with float16, and with float32 where coordinates are geographic: 60 iterations, error in standard deviations of the
 * centralised filter (tests/unit/duif_network.tmpl.h):
 *
 *                                    float16: Metropolis    ratio     float32: Metropolis    ratio
 *     1 from the origin                           0.005     0.05                    7e-6     2e-5
 *     1000 from it                                1.2       21                      1e-3     7e-3
 *
 * fuse keeps the prediction, and says so in `flags`, where there is nothing to fuse: all are blind as far as this node has heard (S = 0), or
 * it has no average (consensus.h), or what arrived makes no covariance. A node that heard nobody in the whole step fuses its own reading
 * once, not N times. Otherwise every node trusts that the average is one of N nodes: it cannot know that the network is cut in parts.
 *
 * With MK_CONSENSUS_SUM it is the Kalman-consensus filter instead (Olfati-Saber, CDC 2007 and 2009): one exchange of s, S and the prediction x,
 *     P^-1 := P^-1 + sum S_j,   x := x + P (sum s_j - sum S_j x) + gamma P_old sum (x_j - x),   gamma = epsilon / (1 + |P_old|_F)
 * over itself and the neighbours heard; P does not know of the last term. (2007 has the new P in it.) Its s_j are linearised by the sender
 * at the sender's x: exact for linear models only. Where nobody measures x still moves.
 *
 * Steps. A frame has the step and the iteration that it is for. One iteration ahead is taken and waits, also where that is the first one of
 * the next step; farther is AHEAD, one that is over LATE, a second one REPEATED. A node that was rebooted or slept finds out when fuse ends a step:
 * the rule is that of meshkal/node.h, with the steps in which neighbours that were AHEAD will be by then. Up to config.catch_up steps it
 * makes up for by predictions over the last dt without readings; farther behind, or where these fail, it starts again from x0 and P0 at
 * that step. advance is for an application that knows the step.
 *
 * A node does not stop. Where a prediction is impossible, because x or P have left the range of the precision, it is made from x and P0, or from
 * x0 and P0 if that fails, too, without the reading: counter `reinitialised`.
 *
 * accept treats every byte as hostile. A refused frame changes nothing but its counter, what the rule above knows of steps and, if its seal was
 * good, which sequence numbers have been seen. A neighbour that lies is believed, up to config.limit: sealed frames keep strangers out.
 *
 * MK_DUIF(name, real, n, m, slots) declares name_t and the functions below. Objects may be copied and moved between calls; what name_secure
 * is given stays where it is. In a node without a sensor config.filter.sensor is any valid one, and it never measures.
 */
#ifndef MESHKAL_DUIF_H
#define MESHKAL_DUIF_H

#include <meshkal/consensus.h>
#include <meshkal/frame.h>
#include <meshkal/unscented.h>

#ifdef __cplusplus
extern "C" {
#endif

/* core.stage: what comes next. */
enum { MK_DUIF_READING, MK_DUIF_CONSENSUS, MK_DUIF_FUSION };

/* core.flags of the last step, from fuse. */
enum {
    MK_DUIF_BLIND = 1,      /* no reading of its own, or the gate refused it */
    MK_DUIF_MISSING = 2,    /* some message was not there */
    MK_DUIF_ISOLATED = 4,   /* none was, in the whole step */
    MK_DUIF_UNINFORMED = 8, /* prediction kept: nobody measured, as far as it was heard */
    MK_DUIF_UNFUSED = 16    /* prediction kept: there was no average, or it makes no covariance */
};

/* Numbers of the largest message; rows of the consensus have one more. */
#define MK_DUIF_VALUES(n) (MK_PACKED(n) + 2 * (n))
/* Scratch memory, in numbers, from the stack. */
#define MK_DUIF_WORK(n, m)                                                                                                    \
    (MK_UNSCENTED_WORK(n, m, 1) + 2 * MK_DUIF_VALUES(n) > MK_CONSENSUS_WORK(MK_DUIF_VALUES(n))                                \
         ? MK_UNSCENTED_WORK(n, m, 1) + 2 * MK_DUIF_VALUES(n)                                                                 \
         : MK_CONSENSUS_WORK(MK_DUIF_VALUES(n)))

#define MK_DECLARE_DUIF_CORE(real)                                                                                            \
    /* Configuration: may be const, in flash, and must outlive the node. The model hash must cover what has to be the same in all nodes:  \
       n, L, N, protocol, motion. */                                                                                          \
    typedef struct {                                                                                                          \
        mk_unscented_config_##real##_t filter;    /* slots = 1: its own sensor */                                             \
        mk_consensus_config_##real##_t consensus; /* values = n + MK_PACKED(n), with MK_CONSENSUS_SUM + n; network: N */      \
        const uint16_t *nodes;                    /* consensus.slots: number of the node in each; nodes[0] is this node */    \
        uint32_t model;                           /* hash of the model, the same in all nodes of a network */                 \
        uint16_t catch_up;                        /* most steps that are made up for */                                       \
        uint8_t numbers;                          /* MK_NUMBERS_ of the frames it sends, at most its own precision */         \
        uint8_t paper_information;                /* 1: contributions without the residual of the linearisation, as published */ \
        mk_##real##_t limit;                      /* largest trace of S that is believed; with a mass in the message, of S / mass; 0: none */ \
        mk_##real##_t epsilon;                    /* of the Kalman-consensus filter, >= 0 */                                  \
        const mk_##real##_t *origin;              /* n, the same in all nodes: what s and x of messages are relative to; null: zero */ \
    } mk_duif_config_##real##_t;                                                                                              \
                                                                                                                              \
    /* Member `core` of every type. Read, do not write. */                                                                    \
    typedef struct {                                                                                                          \
        const mk_duif_config_##real##_t *config;                                                                              \
        mk_secure_t *secure;                                                                                                  \
        mk_##real##_t dt;                 /* of the last prediction */                                                        \
        uint32_t step;                    /* that is being worked on */                                                       \
        uint32_t behind;                  /* steps that the neighbours were ahead, as the last fuse found; then made up for */ \
        uint32_t counts[MK_STATUS_COUNT]; /* frames by what accept said, MK_OK among them; IMPLAUSIBLE: also those whose sum overflowed */ \
        uint32_t early;                   /* of those that were taken, one iteration ahead */                                 \
        uint32_t caught_up;               /* steps made up for */                                                             \
        uint32_t restarts;                /* because it was too far behind */                                                 \
        uint32_t reinitialised;           /* P := P0, because a prediction left the range of the precision */                 \
        uint32_t unsent;                  /* frames that could not be written: number beyond the format, or no seal */        \
        uint32_t isolated, uninformed, unfused; /* steps with these flags */                                                  \
        uint32_t heard, missing;          /* messages of the last step, over its iterations */                                \
        uint16_t left_behind;             /* steps in a row in which some neighbour was ahead */                              \
        uint8_t measured;                 /* 1: in this step its own reading is used */                                       \
        uint8_t stage, flags;             /* MK_DUIF_ */                                                                      \
    } mk_duif_##real##_t;                                                                                                     \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_duif_##real##_t *core;                                                                                             \
        mk_unscented_view_##real##_t filter;                                                                                  \
        mk_consensus_view_##real##_t consensus;                                                                               \
        uint32_t *heard; /* slots */                                                                                          \
        uint8_t *seen;   /* slots */                                                                                          \
        mk_##real##_t *work;                                                                                                  \
    } mk_duif_view_##real##_t;                                                                                                \
                                                                                                                              \
    /* The same functions for dimensions known at run time only; view.work: MK_DUIF_WORK; rows of the consensus: MK_DUIF_VALUES(n) + 1. */ \
    mk_status_t mk_duif_start_##real(int n, int m, int slots, const mk_duif_view_##real##_t *view,                            \
                                     const mk_duif_config_##real##_t *config);                                                \
    mk_status_t mk_duif_secure_##real(const mk_duif_view_##real##_t *view, mk_secure_t *secure);                              \
    mk_status_t mk_duif_predict_##real(int n, const mk_duif_view_##real##_t *view, mk_##real##_t dt, const mk_##real##_t *Q); \
    mk_status_t mk_duif_measure_##real(int m, const mk_duif_view_##real##_t *view, const mk_##real##_t *z);                   \
    mk_status_t mk_duif_drop_##real(const mk_duif_view_##real##_t *view);                                                     \
    mk_status_t mk_duif_contribute_##real(int n, int m, const mk_duif_view_##real##_t *view);                                 \
    size_t mk_duif_frame_##real(const mk_duif_view_##real##_t *view, uint8_t *bytes);                                         \
    mk_status_t mk_duif_accept_##real(int n, const mk_duif_view_##real##_t *view, const uint8_t *bytes, size_t length);       \
    mk_status_t mk_duif_iterate_##real(int n, const mk_duif_view_##real##_t *view);                                           \
    mk_status_t mk_duif_fuse_##real(int n, const mk_duif_view_##real##_t *view);                                              \
    mk_status_t mk_duif_advance_##real(int n, const mk_duif_view_##real##_t *view, uint32_t step);                            \
    mk_status_t mk_duif_restart_##real(int n, const mk_duif_view_##real##_t *view, const mk_##real##_t *x0,                   \
                                       const mk_##real##_t *P0);

MK_DECLARE_DUIF_CORE(f32)
MK_DECLARE_DUIF_CORE(f64)

/*
 * The typed functions; T is mk_<real>_t. On failure the node is as it was, but for its counters and core.failed of the filter. Before
 * start a node of zeros refuses everything else: ORDER, 0, or ARGUMENT of secure.
 *
 * name_start(node, config)     Filter to x0 and P0, step 0, counters 0, plain frames. Errors as name_start of unscented.h and consensus.h; ARGUMENT:
 *                              null, nodes named twice, numbers beyond the precision, limit or epsilon
 *                              negative or not finite; NOT_FINITE: origin; SHAPE.
 * name_secure(node, secure, aead, sequence)
 *                              As in node.h.
 * name_predict(node, dt, Q)    As in unscented.h, any number of times. ORDER: not before contribute; its errors where they remain from x0 and P0.
 * name_measure(node, z)        The reading of its own sensor; from contribute to fuse it is for the next step. Errors of name_put in unscented.h.
 * name_drop(node)              The reading is no longer there.
 * name_innovations(node, T r[m], T S[MK_PACKED(m)], uint8_t rows[1])
 *                              Before contribute: of its own reading, as in unscented.h. MK_WATCH(name_filter, real, m, 1, window) of
 *                              meshkal/monitor.h makes name_filter_watch(&node.filter, monitor, nodes), which looks at it and drops it
 *                              while its sensor is held faulty: contribute, then, as a blind node.
 * name_contribute(node)        Ends the readings, begins the consensus. ORDER; errors of name_contribution in unscented.h (MK_ERROR_DOMAIN: a
 *                              reading of something outside the sensor's domain): drop, then contribute once more, as a blind node.
 * name_frame(node, uint8_t bytes[name_frame_max])
 *                              The frame of this iteration; returns its length, or 0: not the time, or it could not be written
 *                              (counter `unsent`). May be called again, to send it again.
 * name_accept(node, bytes, length)
 *                              A frame that arrived. Not changed. OK: taken; otherwise why it was refused, also counted in counts[].
 * name_iterate(node)           Ends the iteration with what arrived; the L-th ends the consensus. ORDER. Where numbers of neighbours overflow
 *                              in it they are left out, and counted as IMPLAUSIBLE.
 * name_fuse(node)              Ends the step; where the node is behind it makes up for that here (see above). ORDER.
 * name_advance(node, step)     Before contribute: goes on to this step as described above, dropping readings. ORDER; ARGUMENT: not ahead of this node.
 * name_restart(node, T x0[n], T P0[])
 *                              As in unscented.h, at any time; the step stays, and begins again with its readings.
 * name_estimate, name_root, name_covariance: as in unscented.h. The filter itself is member `filter`, the consensus member `consensus`.
 */
#define MK_DUIF(name, real, n, m, slot_count)                                                                                 \
    MK_UNSCENTED(name##_filter, real, n, m, 1);                                                                               \
    MK_CONSENSUS(name##_agreement, real, MK_DUIF_VALUES(n), slot_count);                                                      \
    typedef struct {                                                                                                          \
        mk_duif_##real##_t core;                                                                                              \
        name##_filter_t filter;                                                                                               \
        name##_agreement_t consensus;                                                                                         \
        uint32_t heard[slot_count]; /* of each neighbour: the step of its last frame; of one ahead, where it will be next */  \
        uint8_t seen[slot_count];   /* in this step: 0 not heard, 1 heard, 2 ahead */                                         \
    } name##_t;                                                                                                               \
    typedef mk_duif_config_##real##_t name##_config_t;                                                                        \
    enum { name##_frame_max = MK_FRAME_SEALED + MK_CONSENSUS_HEADER + (int)sizeof(mk_##real##_t) * MK_DUIF_VALUES(n) };       \
    typedef struct {                                                                                                          \
        mk_secure_t core;                                                                                                     \
        mk_replay_t window[slot_count];                                                                                       \
        uint8_t text[MK_CONSENSUS_HEADER + 8 * MK_DUIF_VALUES(n)];                                                            \
    } name##_secure_t;                                                                                                        \
    MK_INLINE mk_duif_view_##real##_t name##_view(name##_t *f, mk_##real##_t *work) {                                         \
        mk_duif_view_##real##_t view;                                                                                         \
        view.core = &f->core;                                                                                                 \
        view.filter = name##_filter_view(&f->filter, work);                                                                   \
        view.consensus = name##_agreement_view(&f->consensus, work);                                                          \
        view.heard = f->heard;                                                                                                \
        view.seen = f->seen;                                                                                                  \
        view.work = work;                                                                                                     \
        return view;                                                                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_start(name##_t *f, const name##_config_t *config) {                                          \
        mk_##real##_t work[MK_DUIF_WORK(n, m)];                                                                               \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_start_##real(n, m, slot_count, &view, config);                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_secure(name##_t *f, name##_secure_t *secure, const mk_aead_t *aead, uint64_t sequence) {     \
        if (!secure) return MK_ERROR_ARGUMENT;                                                                                \
        const mk_duif_view_##real##_t view = name##_view(f, 0);                                                               \
        const mk_secure_t before = secure->core;                                                                              \
        secure->core = mk_secure_make(aead, sequence, secure->window, secure->text, sizeof secure->text);                     \
        const mk_status_t status = mk_duif_secure_##real(&view, &secure->core);                                               \
        if (status != MK_OK) secure->core = before;                                                                           \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_predict(name##_t *f, mk_##real##_t dt, const mk_##real##_t *Q) {                             \
        mk_##real##_t work[MK_DUIF_WORK(n, m)];                                                                               \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_predict_##real(n, &view, dt, Q);                                                                       \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_measure(name##_t *f, const mk_##real##_t *z) {                                               \
        const mk_duif_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_duif_measure_##real(m, &view, z);                                                                           \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_drop(name##_t *f) {                                                                          \
        const mk_duif_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_duif_drop_##real(&view);                                                                                    \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_innovations(name##_t *f, mk_##real##_t *r, mk_##real##_t *S, uint8_t *rows) {                \
        return name##_filter_innovations(&f->filter, r, S, rows);                                                             \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_contribute(name##_t *f) {                                                                    \
        mk_##real##_t work[MK_DUIF_WORK(n, m)];                                                                               \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_contribute_##real(n, m, &view);                                                                        \
    }                                                                                                                         \
    MK_INLINE size_t name##_frame(name##_t *f, uint8_t *bytes) {                                                              \
        const mk_duif_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_duif_frame_##real(&view, bytes);                                                                            \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_accept(name##_t *f, const uint8_t *bytes, size_t length) {                                   \
        mk_##real##_t work[MK_CONSENSUS_WORK(MK_DUIF_VALUES(n))];                                                             \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_accept_##real(n, &view, bytes, length);                                                                \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_iterate(name##_t *f) {                                                                       \
        mk_##real##_t work[MK_CONSENSUS_WORK(MK_DUIF_VALUES(n))];                                                             \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_iterate_##real(n, &view);                                                                              \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_fuse(name##_t *f) {                                                                          \
        mk_##real##_t work[MK_DUIF_WORK(n, m)];                                                                               \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_fuse_##real(n, &view);                                                                                 \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_advance(name##_t *f, uint32_t step) {                                                        \
        mk_##real##_t work[MK_DUIF_WORK(n, m)];                                                                               \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_advance_##real(n, &view, step);                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_restart(name##_t *f, const mk_##real##_t *x0, const mk_##real##_t *P0) {                     \
        mk_##real##_t work[MK_DUIF_WORK(n, m)];                                                                               \
        const mk_duif_view_##real##_t view = name##_view(f, work);                                                            \
        return mk_duif_restart_##real(n, &view, x0, P0);                                                                      \
    }                                                                                                                         \
    MK_INLINE const mk_##real##_t *name##_estimate(const name##_t *f) { return f->filter.x; }                                 \
    MK_INLINE const mk_##real##_t *name##_root(const name##_t *f) { return f->filter.L; }                                     \
    MK_INLINE mk_status_t name##_covariance(name##_t *f, mk_##real##_t *P) {                                                  \
        const mk_duif_view_##real##_t view = name##_view(f, 0);                                                               \
        return mk_unscented_covariance_##real(n, &view.filter, P);                                                            \
    }                                                                                                                         \
    typedef name##_t name##_duif_t

#ifdef __cplusplus
}
#endif

#endif
