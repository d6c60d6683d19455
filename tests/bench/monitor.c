/* SPDX-License-Identifier: MIT */
/* The integrity monitor beside a plain window in Eigen that is summed anew in every epoch: first that their statistics agree, then ns an epoch, medians of
   rounds in which both take turns. The monitor does more: places, the statistic of each sensor. Usage: monitor [ROUNDS]
   Exit status 1 if they disagree or one fails, never for a time. */
#define _POSIX_C_SOURCE 200112L

#include <meshkal/monitor.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "monitor.h"

#define EPOCHS 400
#define ROUNDS 1000 /* at most */

/* With what its arguments stand for. */
#define MONITOR(name, real, m, places, window) MK_MONITOR(name, real, m, places, window)

static uint64_t state = 1;

/* Uniform on [-1, 1): a fixed sequence on every machine. */
static double draw(void) {
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(state >> 11) * 0x1p-52 - 1.0;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

#define REAL double
#define KIND f64
#define EIGEN eigen_watch_f64
#define LIMIT 1e-11
#define ROWS 8
#define NAME(name) eight_double_##name
#include "monitor.tmpl.h"
#undef ROWS
#undef NAME
#define ROWS 16
#define NAME(name) sixteen_double_##name
#include "monitor.tmpl.h"
#undef ROWS
#undef NAME
#undef REAL
#undef KIND
#undef EIGEN
#undef LIMIT

#define REAL float
#define KIND f32
#define EIGEN eigen_watch_f32
#define LIMIT 1e-3
#define ROWS 8
#define NAME(name) eight_single_##name
#include "monitor.tmpl.h"
#undef ROWS
#undef NAME
#define ROWS 16
#define NAME(name) sixteen_single_##name
#include "monitor.tmpl.h"

int main(int argc, char **argv) {
    const int rounds = argc == 2 ? atoi(argv[1]) : 100;
    if (argc > 2 || rounds < 1 || rounds > ROUNDS) return fprintf(stderr, "usage: monitor [1..%d]\n", ROUNDS), 2;
    printf("An epoch of the integrity monitor in ns beside a window in Eigen that is summed anew, medians; largest relative difference of the statistics.\n\n"
           "| rows, window | real | Meshkal | Eigen, summed anew | ratio | difference |\n|---|---|---|---|---|---|\n");
    return eight_double_run(rounds) && sixteen_double_run(rounds) && eight_single_run(rounds) && sixteen_single_run(rounds) ? 0 : 1;
}
