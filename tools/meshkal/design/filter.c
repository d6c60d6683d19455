/* SPDX-License-Identifier: MIT */
#include "design/filter.h"

#include <string.h>

#include "design/design.h"

const mk_filter_t mk_filters[MK_FILTERS] = {
    {"kfc", 1, MK_TOLERANCE_ZERO},     {"rkfc", 1, MK_TOLERANCE_GLOBAL},      {"kfd", 0, MK_TOLERANCE_ZERO},
    {"rkfdu", 0, MK_TOLERANCE_GLOBAL}, {"rkfdnu", 0, MK_TOLERANCE_SCHEDULE}, {"rkfdnu2", 0, MK_TOLERANCE_STEADY}};

int mk_filter_find(const char *name, const mk_filter_t **filter, mk_error_t *error) {
    *filter = NULL;
    for (int i = 0; i < MK_FILTERS; i++)
        if (strcmp(mk_filters[i].name, name) == 0) *filter = &mk_filters[i];
    return *filter || strcmp(name, "all") == 0 || mk_fail(error, "--filter %s: must be kfc, rkfc, kfd, rkfdu, rkfdnu, rkfdnu2 or all", name);
}

int mk_filter_tolerances(const mk_filter_t *filter, const mk_scenario_t *s, double tolerance, int steps, const mk_topology_t *topology,
                         int threads, double *fixed, double **schedule, mk_error_t *error) {
    const int estimators = topology->estimators;
    *schedule = NULL;
    for (int e = 0; e < estimators; e++) fixed[e] = filter->mode == MK_TOLERANCE_GLOBAL ? tolerance : 0.0;
    if (filter->mode == MK_TOLERANCE_SCHEDULE) {
        *schedule = mk_design_schedule(s, tolerance, steps, topology->id, estimators, threads, error);
        return *schedule != NULL;
    }
    if (filter->mode != MK_TOLERANCE_STEADY) return 1;
    mk_design_t design;
    const int good = mk_design_central(&design, s, tolerance, error) &&
                     mk_design_local(&design, s, topology->id, estimators, threads, fixed, error);
    mk_design_free(&design);
    return good;
}
