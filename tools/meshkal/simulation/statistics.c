/* SPDX-License-Identifier: MIT */
#include "simulation/statistics.h"

#include <math.h>
#include <meshkal/quantile.h>
#include <stdlib.h>

void mk_welford(double runs, size_t count, const double *value, double *mean, double *squares) {
    for (size_t i = 0; i < count; i++) {
        const double change = value[i] - mean[i];
        mean[i] += change / runs;
        squares[i] += change * (value[i] - mean[i]);
    }
}

double mk_half_width(double runs, double squares) {
    return runs < 2.0 ? (double)NAN : mk_student_quantile(0.025, runs - 1.0) * sqrt(squares / (runs - 1.0) / runs);
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

void mk_sort(double *values, size_t count) {
    if (count > 0) qsort(values, count, sizeof *values, compare);
}

double mk_median(const double *sorted, size_t count) {
    if (count == 0) return (double)NAN;
    return count % 2 ? sorted[count / 2] : 0.5 * (sorted[count / 2 - 1] + sorted[count / 2]);
}

double mk_quantile(const double *sorted, size_t count, double share) {
    if (count == 0) return (double)NAN;
    const double at = share * (double)(count - 1);
    const size_t low = (size_t)at, high = low + 1 < count ? low + 1 : low;
    return sorted[low] + (at - (double)low) * (sorted[high] - sorted[low]);
}
