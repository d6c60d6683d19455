/* SPDX-License-Identifier: MIT */
/* Steps out of the time of day, so that nodes agree on them without a master. Step s lasts from epoch + s period to epoch + (s + 1) period: readings
   first, then estimates. Times are nanoseconds since 1970.
   Before the epoch nodes wait: then x0 and P0 are those of step 0. */
#ifndef MESHKAL_NODE_CLOCK_H
#define MESHKAL_NODE_CLOCK_H

#include <stdint.h>

typedef struct {
    int64_t period, epoch, first; /* first: how long readings are waited for */
} mk_clock_t;

int64_t mk_clock_now(void);
/* Step that a time belongs to; negative before the epoch. */
int64_t mk_clock_step(const mk_clock_t *clock, int64_t time);
/* When stage 1 or 2 of a step ends. */
int64_t mk_clock_end(const mk_clock_t *clock, int64_t step, int stage);

#endif
