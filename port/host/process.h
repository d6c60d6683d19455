/* SPDX-License-Identifier: MIT */
/* What the process costs. */
#ifndef MESHKAL_HOST_PROCESS_H
#define MESHKAL_HOST_PROCESS_H

/* Most bytes it ever held at once, as the system counts them (pages that were touched). */
double mk_peak_memory(void);
/* Seconds on a clock that nobody sets: differences are durations. */
double mk_seconds(void);

#endif
