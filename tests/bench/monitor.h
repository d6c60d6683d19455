/* SPDX-License-Identifier: MIT */
/* The plain window beside which the integrity monitor is timed: 8 or 16 rows. Returns 1, or 0 where S is not positive definite. */
#ifndef BENCH_MONITOR_H
#define BENCH_MONITOR_H

#ifdef __cplusplus
extern "C" {
#endif

#define BENCH_WINDOW 10

int eigen_watch_f32(int rows, const float *r, const float *S, float *q_R, float *q_A);
int eigen_watch_f64(int rows, const double *r, const double *S, double *q_R, double *q_A);

#ifdef __cplusplus
}
#endif

#endif
