/* SPDX-License-Identifier: MIT */
/* Figures of several runs or values. */
#ifndef MESHKAL_SIMULATION_STATISTICS_H
#define MESHKAL_SIMULATION_STATISTICS_H

#include <stddef.h>

/* Value number `runs`, from 1, of each of `count` places into means and sums of squared differences from them (Welford): the same bits for the
   same values in the same order. */
void mk_welford(double runs, size_t count, const double *value, double *mean, double *squares);
/* Half-width of the 95 % confidence interval of a mean of mk_welford (Student); NaN for fewer than two runs. */
double mk_half_width(double runs, double squares);

/* In ascending order, infinite ones too; none NaN. */
void mk_sort(double *values, size_t count);
/* Of sorted values, NaN if there are none: the median, and, of finite ones, the quantile, between neighbours in proportion. */
double mk_median(const double *sorted, size_t count);
double mk_quantile(const double *sorted, size_t count, double share);

#endif
