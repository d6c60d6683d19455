/* SPDX-License-Identifier: MIT */
/*
 * The node object: one struct that holds a robust distributed filter (meshkal/rkfd.h), its neighbours, its messages
 * (meshkal/frame.h) and its diagnostics. It has no clock and no radio: the application calls it, and says when the time of a stage is over.
 *
 *     measure ... frame(MK_STAGE_MEASUREMENT) ... accept ...   stage 1: readings
 *     incremental
 *     frame(MK_STAGE_ESTIMATE) ... accept ...                  stage 2: estimates
 *     diffuse                                                  x is the prediction for the next step
 *
 * What has not come when a stage ends is missing in this step. A frame of a stage that is over is late, a second one of the same
 * node, step and stage a repeat: both are counted and dropped. Clocks need not agree exactly: a frame one stage ahead is kept for
 * that stage.
 *
 * Steps are counted modulo 2^32. A node that was rebooted or slept is behind its neighbours, and finds out when diffuse ends a step: if at
 * least half of the neighbours that it heard in it were more than one stage ahead, or if some were in each of MK_NODE_LEFT_BEHIND
 * steps in a row (steps in which it heard nobody are left out), it goes on to the lowest step in which those will be by then. So a
 * network follows its fastest clock, however many nodes were rebooted together. Up to config.catch_up steps it makes up for: each is
 * a prediction without readings, but for one that had come early. Farther behind, it starts again from x0 and P0 at that step. An
 * application that knows the step (from a clock that ran on) calls advance, which does the same; it must where a network has run for
 * 2^31 steps or more. A neighbour that lies about its step is believed as any other: sealed frames keep strangers out.
 *
 * A node does not stop. Where a step is impossible (what arrived overflows, or after a long silence P leaves the range of the
 * precision), its readings are dropped, W := P0^-1, and the step is taken from the present x, or from x0 if that fails, too: counter
 * `reinitialised`. Where estimates overflow in diffuse they are dropped: counted as IMPLAUSIBLE.
 *
 * accept treats every byte as hostile. A refused frame changes nothing but its counter, what the rule above knows of steps and, if its
 * seal was good, which sequence numbers have been seen.
 *
 * MK_NODE(name, real, n, m, slots) declares name_t and the functions below over MK_RKFD(name_filter, ...);
 * MK_NODE_UNROLLED of <meshkal/unrolled.h> the same over unrolled kernels. Objects may be copied and moved between calls; what
 * name_secure and name_record are given stays where it is.
 */
#ifndef MESHKAL_NODE_H
#define MESHKAL_NODE_H

#include <meshkal/frame.h>
#include <meshkal/gate.h>
#include <meshkal/record.h>
#include <meshkal/rkfd.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Numbers of the largest payload: an estimate, or a reading with its model. */
#define MK_NODE_NUMBERS(n, m) ((m) * ((n) + 1) > (n) ? (m) * ((n) + 1) : (n))
/* Scratch memory, in numbers, from the stack: of frame and accept; of the gate. */
#define MK_NODE_WORK(n, m) (MK_NODE_NUMBERS(n, m) + MK_PACKED(m))
#define MK_NODE_GATE_WORK(n, m)                                                                                               \
    (MK_RKFD_WORK(n, m) > MK_RKFD_PREDICT_WORK(n, m) + (m) + MK_PACKED(m) ? MK_RKFD_WORK(n, m)                                \
                                                                          : MK_RKFD_PREDICT_WORK(n, m) + (m) + MK_PACKED(m))
/* Bytes of a saved state, at most; `size` is that of a number. */
#define MK_NODE_BLOB(size, n, m, slots)                                                                                       \
    (85 + 4 * MK_STATUS_COUNT + 7 * (slots) + (size) * (4 + (n) + MK_PACKED(n) + (slots) * ((m) + (n) + (m) * (n))))

/* Steps in a row with a neighbour ahead, after which fewer than half of the neighbours are followed. */
#define MK_NODE_LEFT_BEHIND 4

#define MK_DECLARE_NODE_CORE(real)                                                                                            \
    /* Refusal of what the filter does not expect. Readings are judged when stage 1 ends, each slot by itself, by                \
       e' (C V C' + R)^-1 e with e = y - C x (mk_rkfd predict); estimates when stage 2 ends, by (psi_l - psi)' W (psi_l - psi), a      \
       check of plausibility: the covariance of that difference is not known to the node. The way back: when most readings were       \
       refused in more than `patience` steps in a row, it is the filter that is wrong; then W := P0^-1, x stays, and the readings are \
       taken. */                                                                                                              \
    typedef struct {                                                                                                          \
        const mk_##real##_t *reading; /* slots: thresholds, for example a quantile of chi-square with rows degrees; 0: none */ \
        mk_##real##_t estimate;       /* 0: none */                                                                           \
        uint16_t patience;            /* 0: no way back but restart */                                                        \
        mk_gate_record_##real##_t *record; /* slots: what the gate says of each reading (meshkal/gate.h), in RAM; null: nothing */ \
    } mk_node_gate_##real##_t;                                                                                                \
                                                                                                                              \
    /* Neighbours whose C and R are not in the configuration and come with every reading. Their part of the filter's arrays is \
       in RAM, and these are those very arrays. Not with a steady part, whose gain is of models that stay: ARGUMENT. */         \
    typedef struct {                                                                                                          \
        const uint8_t *slot; /* slots: 1 for such a neighbour */                                                              \
        mk_##real##_t *C, *F, *S, *R_inverse;                                                                                 \
        mk_##real##_t limit; /* largest trace of the information S that is believed; 0: none */                               \
    } mk_node_foreign_##real##_t;                                                                                             \
                                                                                                                              \
    /* Configuration: may be const, in flash, and must outlive the node. */                                                   \
    typedef struct {                                                                                                          \
        mk_rkfd_config_##real##_t filter;                                                                                     \
        const uint16_t *nodes; /* slots: number of the node in each; nodes[0] is this node */                                 \
        uint32_t model;        /* hash of the model, the same in all nodes of a network */                                    \
        uint16_t catch_up;     /* most steps that are made up for */                                                          \
        uint8_t numbers;       /* MK_NUMBERS_ of the frames it sends, at most its own precision */                            \
        uint8_t with_model;    /* 1: its readings are sent with its model */                                                  \
        const mk_node_gate_##real##_t *gate;       /* null: none */                                                           \
        const mk_node_foreign_##real##_t *foreign; /* null: none */                                                           \
    } mk_node_config_##real##_t;                                                                                              \
                                                                                                                              \
    /* Member `node` of every node type. Read, do not write. */                                                               \
    typedef struct {                                                                                                          \
        const mk_node_config_##real##_t *config;                                                                              \
        mk_secure_t *secure;                                                                                                  \
        mk_recorder_t *recorder;                                                                                              \
        uint32_t step;                     /* that is being worked on */                                                      \
        uint32_t counts[MK_STATUS_COUNT];  /* frames by what accept said, MK_OK among them; GATED: readings and estimates that the \
                                              gate refused; IMPLAUSIBLE: also estimates that diffuse dropped */                 \
        uint32_t early;                    /* of those that were taken, one stage ahead */                                    \
        uint32_t caught_up;                /* steps made up for */                                                            \
        uint32_t restarts;                 /* because it was too far behind */                                                \
        uint32_t reinitialised;            /* W := P0^-1, by the gate's way back or because a step was impossible */          \
        uint32_t unsent;                   /* frames that could not be written: number beyond the format, or no seal */       \
        uint16_t gated;                    /* by the last step, readings and estimates */                                     \
        uint16_t gated_steps;              /* in a row, in which most readings were refused */                                \
        uint16_t left_behind;              /* steps in a row in which some neighbour was ahead */                             \
        uint32_t behind;                   /* steps that the neighbours are ahead, as the last diffuse found; then made up for */ \
    } mk_node_##real##_t;                                                                                                     \
                                                                                                                              \
    typedef struct {                                                                                                          \
        mk_node_##real##_t *node;                                                                                             \
        mk_rkfd_view_##real##_t filter;                                                                                       \
        uint32_t *heard; /* slots */                                                                                          \
        uint8_t *seen;   /* slots */                                                                                          \
    } mk_node_view_##real##_t;                                                                                                \
                                                                                                                              \
    /* The same functions for dimensions known at run time only; view.filter.work: the larger of MK_NODE_WORK and MK_NODE_GATE_WORK. */ \
    mk_status_t mk_node_start_##real(int n, int m, int slots, const mk_node_view_##real##_t *view,                            \
                                     const mk_node_config_##real##_t *config);                                                \
    mk_status_t mk_node_secure_##real(const mk_node_view_##real##_t *view, mk_secure_t *secure, int slots);                   \
    mk_status_t mk_node_measure_##real(int m, const mk_node_view_##real##_t *view, const mk_##real##_t *y);                   \
    size_t mk_node_frame_##real(int n, const mk_node_view_##real##_t *view, int stage, uint8_t *bytes);                       \
    mk_status_t mk_node_accept_##real(int n, int m, int slots, const mk_node_view_##real##_t *view, const uint8_t *bytes,     \
                                      size_t length);                                                                         \
    mk_status_t mk_node_incremental_##real(int n, int m, int slots, const mk_node_view_##real##_t *view,                      \
                                           const mk_##real##_t *input);                                                       \
    mk_status_t mk_node_diffuse_##real(int n, int m, int slots, const mk_node_view_##real##_t *view);                         \
    mk_status_t mk_node_advance_##real(int n, int m, int slots, const mk_node_view_##real##_t *view, uint32_t step);          \
    mk_status_t mk_node_set_tolerance_##real(const mk_node_view_##real##_t *view, mk_##real##_t tolerance);                   \
    mk_status_t mk_node_drop_##real(const mk_node_view_##real##_t *view, int slot);                                           \
    mk_status_t mk_node_restart_##real(int n, int slots, const mk_node_view_##real##_t *view, const mk_##real##_t *x0,        \
                                       const mk_##real##_t *P0);                                                              \
    size_t mk_node_save_##real(int n, int m, int slots, const mk_node_view_##real##_t *view, uint8_t *blob);                  \
    mk_status_t mk_node_restore_##real(int n, int m, int slots, const mk_node_view_##real##_t *view,                          \
                                       const mk_node_config_##real##_t *config, const uint8_t *blob, size_t length);          \
    mk_status_t mk_node_record_##real(int n, int m, int slots, const mk_node_view_##real##_t *view, mk_recorder_t *recorder); \
    /* What the frame of a record holds is taken as accept takes it after its seal or checksum. For replay. */                \
    mk_status_t mk_node_accept_recorded_##real(int n, int m, int slots, const mk_node_view_##real##_t *view,                  \
                                               const uint8_t *content, size_t length);                                        \
    /* incremental without its gate and its record, for hosts that look at what the gate left: after mk_node_judge_readings. */\
    mk_status_t mk_node_step_##real(int n, int m, int slots, const mk_node_view_##real##_t *view, const mk_##real##_t *input);\
    /* Parts of the steps, around the filter's own: for the typed functions. */                                               \
    void mk_node_judge_readings_##real(int n, int m, int slots, const mk_node_view_##real##_t *view);                         \
    void mk_node_judge_estimates_##real(int n, int slots, const mk_node_view_##real##_t *view);                               \
    void mk_node_end_step_##real(int slots, const mk_node_view_##real##_t *view);                                             \
    int mk_node_recover_##real(int n, int slots, const mk_node_view_##real##_t *view, mk_status_t status,                     \
                               const mk_##real##_t *input, int attempt);                                                      \
    int mk_node_drop_estimates_##real(int slots, const mk_node_view_##real##_t *view, mk_status_t status);                    \
    mk_status_t mk_node_begin_advance_##real(int n, int slots, const mk_node_view_##real##_t *view, uint32_t step);           \
    void mk_node_note_##real(int n, const mk_node_view_##real##_t *view, int kind, mk_status_t status, uint32_t step,         \
                             const mk_##real##_t *input);

MK_DECLARE_NODE_CORE(f32)
MK_DECLARE_NODE_CORE(f64)

/*
 * The typed functions. T is mk_<real>_t. On failure the node is as it was, but for its counters, unless a line below says more.
 * Before start or restore a node of zeros refuses everything else: ORDER, 0, or ARGUMENT of secure.
 *
 * name_start(node, config)     Filter to x0 and P0, step 0, counters 0, plain frames, no recorder. Errors as name_start of rkfd.h;
 *                              ARGUMENT: null, nodes named twice, numbers beyond the precision, thresholds negative or not finite; SHAPE.
 * name_secure(node, secure, aead, sequence)
 *                              From now on only sealed frames are sent and taken. secure: name_secure_t of the caller, zeroed before the
 *                              first use. Call it after every start and restore: they go back to plain frames. What was sent before that
 *                              can be played to the node again; only the steps in it stand against that. ARGUMENT: null.
 * name_measure(node, T y[])    The reading of this node's own sensor, its rows; in stage 2 it is for the next step. ARGUMENT: null;
 *                              NOT_FINITE, REPEATED.
 * name_frame(node, stage, uint8_t bytes[name_frame_max])
 *                              Writes the frame of a stage; returns its length, or 0: nothing to send (no reading, or not the time), or it
 *                              could not be written (counter `unsent`). May be called again, to send it again.
 * name_accept(node, bytes, length)
 *                              A frame that arrived. Not changed. OK: taken; otherwise why it was refused, also counted in counts[].
 * name_incremental(node)       Ends stage 1. ORDER; NOT_FINITE: input; then readings that the gate refused stay refused. Any other error of
 *                              name_incremental in rkfd.h only if it remains from x0 and P0 (a tolerance that has no root there), where
 *                              the node then stands, without readings.
 * name_incremental_with(node, T input[n])
 *                              The same with r(t).
 * name_diffuse(node)           Ends stage 2 and the step; where the node is behind it makes up for that here (see above). ORDER;
 *                              as advance while it makes up, then with the steps so far done.
 * name_advance(node, step)     Between diffuse and incremental: goes on to this step as described above. ARGUMENT: not ahead of this node;
 *                              ORDER; errors of the steps, with those before done.
 * name_restart(node, T x0[n], T P0[])
 *                              As in rkfd.h; the step stays, and begins again with stage 1.
 * name_innovations, name_drop  As in rkfd.h; drop is recorded. MK_WATCH(name, real, m, slots, window) of meshkal/monitor.h, after this macro, makes
 *                              name_watch of them: the node watches its own and its neighbours' sensors, id being config.nodes. Before
 *                              incremental. What the monitor found is in the record as drops: a replay needs no monitor.
 * name_estimate, name_intermediate, name_set_tolerance: as in rkfd.h. The filter itself is member `filter`.
 * name_save(node, uint8_t blob[name_blob_max])
 *                              The whole state but for secure and recorder, with version, dimensions, model, node and CRC-32: the
 *                              same bytes on every target. Returns its length. At any time.
 * name_restore(node, config, blob, length)
 *                              In place of start: the node goes on bit for bit, with plain frames and no recorder. LENGTH, CHECKSUM,
 *                              VERSION, SHAPE, MODEL, STRANGER (of another node); NOT_FINITE, NOT_POSITIVE_DEFINITE, TOLERANCE,
 *                              IMPLAUSIBLE and ARGUMENT: what it holds is no state; and those of start.
 * name_record(node, recorder)  Empties the recorder and begins a record with the state; null ends it. ARGUMENT: no buffer; LENGTH: the
 *                              beginning does not fit. Cost: copying and a CRC of every item.
 */
#define MK_NODE(name, real, n, m, slots) MK_NODE_TYPE(name, real, n, m, slots, mk_rkfd_, MK_RKFD_STEP)

#define MK_NODE_TYPE(name, real, n, m, slot_count, kernel, STEP)                                                              \
    MK_RKFD_TYPE(name##_filter, real, n, m, slot_count, kernel, STEP);                                                        \
    typedef struct {                                                                                                          \
        name##_filter_t filter;                                                                                               \
        mk_node_##real##_t node;                                                                                              \
        uint32_t heard[slot_count]; /* of each neighbour: the step of its last frame; of one ahead, where it will be next */   \
        uint8_t seen[slot_count];   /* in this step: 0 not heard, 1 heard, 2 ahead */                                         \
    } name##_t;                                                                                                               \
    typedef mk_node_config_##real##_t name##_config_t;                                                                        \
    enum {                                                                                                                    \
        name##_frame_max = MK_FRAME_SEALED + (int)sizeof(mk_##real##_t) * MK_NODE_NUMBERS(n, m),                              \
        name##_blob_max = MK_NODE_BLOB((int)sizeof(mk_##real##_t), n, m, slot_count)                                          \
    };                                                                                                                        \
    typedef struct {                                                                                                          \
        mk_secure_t core;                                                                                                     \
        mk_replay_t window[slot_count];                                                                                       \
        uint8_t text[8 * MK_NODE_NUMBERS(n, m)];                                                                              \
    } name##_secure_t;                                                                                                        \
    MK_INLINE mk_node_view_##real##_t name##_node_view(name##_t *f, mk_##real##_t *work) {                                    \
        mk_node_view_##real##_t view;                                                                                         \
        view.node = &f->node;                                                                                                 \
        view.filter = name##_filter_view(&f->filter, work);                                                                   \
        view.heard = f->heard;                                                                                                \
        view.seen = f->seen;                                                                                                  \
        return view;                                                                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_start(name##_t *f, const name##_config_t *config) {                                          \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_start_##real(n, m, slot_count, &view, config);                                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_secure(name##_t *f, name##_secure_t *secure, const mk_aead_t *aead, uint64_t sequence) {     \
        if (!secure) return MK_ERROR_ARGUMENT;                                                                                \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        const mk_secure_t before = secure->core;                                                                              \
        secure->core = mk_secure_make(aead, sequence, secure->window, secure->text, sizeof secure->text);                     \
        const mk_status_t status = mk_node_secure_##real(&view, &secure->core, slot_count);                                   \
        if (status != MK_OK) secure->core = before;                                                                           \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_measure(name##_t *f, const mk_##real##_t *y) {                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        return mk_node_measure_##real(m, &view, y);                                                                           \
    }                                                                                                                         \
    MK_INLINE size_t name##_frame(name##_t *f, int stage, uint8_t *bytes) {                                                   \
        mk_##real##_t work[MK_NODE_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_frame_##real(n, &view, stage, bytes);                                                                  \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_accept(name##_t *f, const uint8_t *bytes, size_t length) {                                   \
        mk_##real##_t work[MK_NODE_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_accept_##real(n, m, slot_count, &view, bytes, length);                                                 \
    }                                                                                                                         \
    /* Not inlined: the filter's step, which may be unrolled, is in the image once. */                                        \
    MK_NOINLINE mk_status_t name##_step_incremental(name##_t *f, const mk_##real##_t *input) {                                \
        return name##_filter_incremental(&f->filter, input);                                                                  \
    }                                                                                                                         \
    /* Also apart: their scratch memory is not on the stack beside that of the steps. */                                      \
    MK_NOINLINE void name##_judge_readings(name##_t *f) {                                                                     \
        mk_##real##_t work[MK_NODE_GATE_WORK(n, m)];                                                                          \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        mk_node_judge_readings_##real(n, m, slot_count, &view);                                                               \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_begin_advance(name##_t *f, uint32_t step) {                                                \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_begin_advance_##real(n, slot_count, &view, step);                                                      \
    }                                                                                                                         \
    MK_NOINLINE int name##_recover(name##_t *f, mk_status_t status, const mk_##real##_t *input, int attempt) {                \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_recover_##real(n, slot_count, &view, status, input, attempt);                                          \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_run_incremental(name##_t *f, const mk_##real##_t *input) {                                 \
        int attempt;                                                                                                          \
        mk_status_t status;                                                                                                   \
        if (f->node.config && f->node.config->gate) name##_judge_readings(f);                                                 \
        status = name##_step_incremental(f, input);                                                                           \
        for (attempt = 0; attempt < 2 && status != MK_OK && name##_recover(f, status, input, attempt); attempt++)             \
            status = name##_step_incremental(f, input);                                                                       \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_run_diffuse(name##_t *f) {                                                                 \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        if (f->node.config && f->node.config->gate) mk_node_judge_estimates_##real(n, slot_count, &view);                     \
        mk_status_t status = name##_filter_diffuse(&f->filter);                                                               \
        if (status != MK_OK && mk_node_drop_estimates_##real(slot_count, &view, status))                                      \
            status = name##_filter_diffuse(&f->filter);                                                                       \
        if (status == MK_OK) mk_node_end_step_##real(slot_count, &view);                                                      \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_NOINLINE mk_status_t name##_run_advance(name##_t *f, uint32_t step) {                                                  \
        mk_status_t status = name##_begin_advance(f, step);                                                                   \
        while (status == MK_OK && f->node.step != step) {                                                                     \
            status = name##_run_incremental(f, 0);                                                                            \
            if (status == MK_OK) status = name##_run_diffuse(f);                                                              \
        }                                                                                                                     \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_incremental_with(name##_t *f, const mk_##real##_t *input) {                                  \
        const mk_status_t status = name##_run_incremental(f, input);                                                          \
        if (f->node.recorder) {                                                                                               \
            const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                      \
            mk_node_note_##real(n, &view, MK_ITEM_INCREMENTAL, status, 0, input);                                             \
        }                                                                                                                     \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_incremental(name##_t *f) { return name##_incremental_with(f, 0); }                           \
    MK_INLINE mk_status_t name##_diffuse(name##_t *f) {                                                                       \
        mk_status_t status = name##_run_diffuse(f);                                                                           \
        if (status == MK_OK && f->node.behind) status = name##_run_advance(f, f->node.step + f->node.behind);                 \
        if (f->node.recorder) {                                                                                               \
            const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                      \
            mk_node_note_##real(n, &view, MK_ITEM_DIFFUSE, status, 0, 0);                                                     \
        }                                                                                                                     \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_advance(name##_t *f, uint32_t step) {                                                        \
        const mk_status_t status = name##_run_advance(f, step);                                                               \
        if (f->node.recorder) {                                                                                               \
            const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                      \
            mk_node_note_##real(n, &view, MK_ITEM_ADVANCE, status, step, 0);                                                  \
        }                                                                                                                     \
        return status;                                                                                                        \
    }                                                                                                                         \
    MK_INLINE const mk_##real##_t *name##_estimate(const name##_t *f) { return f->filter.x; }                                 \
    MK_INLINE const mk_##real##_t *name##_intermediate(const name##_t *f) { return f->filter.psi; }                           \
    MK_INLINE mk_status_t name##_set_tolerance(name##_t *f, mk_##real##_t c) {                                                \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        return mk_node_set_tolerance_##real(&view, c);                                                                        \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_restart(name##_t *f, const mk_##real##_t *x0, const mk_##real##_t *P0) {                     \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_restart_##real(n, slot_count, &view, x0, P0);                                                          \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_innovations(name##_t *f, mk_##real##_t *r, mk_##real##_t *S, uint8_t *rows) {                \
        return name##_filter_innovations(&f->filter, r, S, rows);                                                             \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_drop(name##_t *f, int slot) {                                                                \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        return mk_node_drop_##real(&view, slot);                                                                              \
    }                                                                                                                         \
    MK_INLINE size_t name##_save(name##_t *f, uint8_t *blob) {                                                                \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        return mk_node_save_##real(n, m, slot_count, &view, blob);                                                            \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_restore(name##_t *f, const name##_config_t *config, const uint8_t *blob, size_t length) {    \
        mk_##real##_t work[MK_RKFD_WORK(n, m)];                                                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, work);                                                       \
        return mk_node_restore_##real(n, m, slot_count, &view, config, blob, length);                                         \
    }                                                                                                                         \
    MK_INLINE mk_status_t name##_record(name##_t *f, mk_recorder_t *recorder) {                                               \
        const mk_node_view_##real##_t view = name##_node_view(f, 0);                                                          \
        return mk_node_record_##real(n, m, slot_count, &view, recorder);                                                      \
    }                                                                                                                         \
    typedef name##_t name##_node_t

#ifdef __cplusplus
}
#endif

#endif
