/* SPDX-License-Identifier: MIT */
/* The frozen gain of an estimator (mk_rkfd_steady_*_t): limit of its recursion with every reading, made in float64 and rounded once. One place
   that decides these numbers, for the simulator and for the generated headers. */
#ifndef MESHKAL_STEADY_H
#define MESHKAL_STEADY_H

#include "design/node_config.h"

/* What may be asked for as `close`. */
#define MK_LEAST_CLOSE 1e-12
#define MK_MOST_CLOSE 0.5

/* Frozen steps between two full ones. */
#define MK_STEADY_PERIOD 63

/* Numbers of the arrays. */
#define MK_STEADY_NUMBERS(n, m, slots) ((n) * (n) + (slots) * (m) * (n) + MK_PACKED(n))

/* Of estimator e, whose configuration (without a steady part) is given; tolerance: before it was rounded for that. `numbers` are written and
   must outlive the steady part. The filter is let run on from the limit and towards it, and `close` of the steady part is at least four
   times as far as rounding drives it away, or keeps it away. 1, or 0 and *why, a phrase: the recursion does not converge, or rounding keeps it
   further away than MK_MOST_CLOSE. */
int mk_steady_make_f32(mk_rkfd_steady_f32_t *steady, mk_f32_t *numbers, const mk_rkfd_config_f32_t *config, const mk_scenario_t *scenario,
                       const mk_topology_t *topology, int e, double tolerance, double close, const char **why);
int mk_steady_make_f64(mk_rkfd_steady_f64_t *steady, mk_f64_t *numbers, const mk_rkfd_config_f64_t *config, const mk_scenario_t *scenario,
                       const mk_topology_t *topology, int e, double tolerance, double close, const char **why);

#endif
