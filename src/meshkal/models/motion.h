/* SPDX-License-Identifier: MIT */
/* What both precisions of <meshkal/tracking.h> share. */
#ifndef MESHKAL_MODELS_MOTION_H
#define MESHKAL_MODELS_MOTION_H

#include <meshkal/tracking.h>

/* What a sensor asks of the target: nothing, not to be at its place, not to be on the vertical through it. */
typedef enum { MK_ANYWHERE, MK_APART, MK_ASIDE } mk_apart_t;

mk_status_t mk_motion_check(const mk_motion_t *motion, int reads) {
    uint8_t states[7];
    int count = 0;
    if (!motion || motion->dimensions < 2 || motion->dimensions > 3) return MK_ERROR_ARGUMENT;
    for (int axis = 0; axis < motion->dimensions; axis++) {
        states[count++] = motion->position[axis];
        if (reads & MK_MOTION_VELOCITY) states[count++] = motion->velocity[axis];
    }
    if (reads & MK_MOTION_TURN_RATE) states[count++] = motion->turn_rate;
    for (int i = 0; i < count; i++) {
        if (states[i] >= motion->n) return MK_ERROR_ARGUMENT;
        for (int j = 0; j < i; j++)
            if (states[i] == states[j]) return MK_ERROR_ARGUMENT;
    }
    return MK_OK;
}

#endif
