/* SPDX-License-Identifier: MIT */
/*
 * Gates: is a reading one that the filter expects? (spec 2.3, 2.4). The statistic is the squared Mahalanobis distance of the innovation,
 * d2 = e' E^-1 e, compared with a quantile of chi-square (mk_gate_thresholds), or with any other threshold. Test ratio = d2 / threshold.
 *
 * Policies. SKIP: what lies beyond is left out. INFLATE (Chang 2014): it is used with its innovation variance E multiplied by f = test
 * ratio, that is R := (f - 1) (E - R) + f R, after which its test ratio is 1.
 *
 * Way back. P and the error grow together, so a filter that rejects for long can reject for ever. A count goes up by one with each update in which
 * most readings lie beyond, and down by one, to 0 at least, with each other. Above `patience` it is the filter that is wrong: P := P0, x stays, and
 * the readings are taken. (Updates in a row would not do where readings come one at a time: far from the target, too, one fits now and then.)
 */
#ifndef MESHKAL_GATE_H
#define MESHKAL_GATE_H

#include <meshkal/base.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { MK_GATE_SKIP = 0, MK_GATE_INFLATE = 1 };

#define MK_DECLARE_GATE(real)                                                                                                 \
    typedef struct {                                                                                                          \
        const mk_##real##_t *sensor;  /* thresholds for 1, 2, .. m rows of one sensor; null: sensors are not judged singly */ \
        const mk_##real##_t *stacked; /* for 1, 2, .. slots x m rows of all that is left then; null: they are not judged together */ \
        uint16_t patience;            /* of the way back; 0: there is none */                                                 \
        uint8_t policy;               /* MK_GATE_ */                                                                          \
    } mk_gate_##real##_t;                                                                                                     \
                                                                                                                              \
    /* Of one sensor, or of all together. A sensor's d2 and ratio are its own; its counts say what was done with its readings, also where that was
       decided for all together. */                                                                                  \
    typedef struct {                                                                                                          \
        mk_##real##_t d2;        /* of the last reading; the largest number where it cannot be had */                         \
        mk_##real##_t ratio;     /* test ratio of the last reading, 0 if it was not judged */                                 \
        uint32_t accepted, rejected, inflated;                                                                                \
        uint32_t since_accepted; /* readings since one that was accepted as it was */                                         \
    } mk_gate_record_##real##_t;                                                                                              \
                                                                                                                              \
    /* Fills threshold[r - 1], r = 1 .. count, with the chi-square quantile of r degrees at this upper tail. ARGUMENT (tail not between   \
       0 and 1, null): nothing is written. */                                                                                 \
    mk_status_t mk_gate_thresholds_##real(double tail, int count, mk_##real##_t *threshold);                                  \
    /* Decides and counts. Returns the factor f on the innovation variance: 1 accepted, 0 rejected, above 1 inflated. A threshold of 0 judges   \
       nothing: accepted. d2 that is NaN counts as the largest number. */                                   \
    mk_##real##_t mk_gate_judge_##real(int policy, mk_##real##_t threshold, mk_##real##_t d2, mk_gate_record_##real##_t *record);

MK_DECLARE_GATE(f32)
MK_DECLARE_GATE(f64)

#ifdef __cplusplus
}
#endif

#endif
