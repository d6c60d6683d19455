/* SPDX-License-Identifier: MIT */
/* Options of meshkal simulate, as text; null: not given. */
#ifndef MESHKAL_SIMULATE_OPTIONS_H
#define MESHKAL_SIMULATE_OPTIONS_H

typedef struct {
    const char *filter, *steps, *seed, *runs, *real, *loss, *tolerance, *measurements, *truth, *out, *json, *threads;
    const char *monitor, *window, *false_alarm; /* not for tracking */
    const char *horizon, *resume, *split, *frozen, *arrivals, *record;                              /* linear scenarios only */
    const char *imu; /* navigation only; from_step: and tracking */
    const char *models, *from_step, *lost_m, *increments, *rule, *gate, *iterations, *protocol; /* tracking only */
} mk_simulate_options_t;

#endif
