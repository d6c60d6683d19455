/* SPDX-License-Identifier: MIT */
#include "clock.h"

#include <time.h>

int64_t mk_clock_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

int64_t mk_clock_step(const mk_clock_t *clock, int64_t time) {
    const int64_t since = time - clock->epoch;
    return since / clock->period - (since % clock->period < 0);
}

int64_t mk_clock_end(const mk_clock_t *clock, int64_t step, int stage) {
    return clock->epoch + step * clock->period + (stage == 1 ? clock->first : clock->period);
}
