/* SPDX-License-Identifier: MIT */
#include "filter.h"

#include <string.h>

#include "design.h"

const mk_filter_t mk_filters[MK_FILTERS] = {
    {"kfc", 1, MK_TOLERANCE_ZERO},     {"rkfc", 1, MK_TOLERANCE_GLOBAL},      {"kfd", 0, MK_TOLERANCE_ZERO},
    {"rkfdu", 0, MK_TOLERANCE_GLOBAL}, {"rkfdnu", 0, MK_TOLERANCE_SCHEDULE}, {"rkfdnu2", 0, MK_TOLERANCE_STEADY}};

int mk_filter_find(const char *name, const mk_filter_t **filter, mk_error_t *error) {
    *filter = NULL;
    for (int i = 0; i < MK_FILTERS; i++)
        if (strcmp(mk_filters[i].name, name) == 0) *filter = &mk_filters[i];
    return *filter || strcmp(name, "all") == 0 || mk_fail(error, "--filter %s: must be kfc, rkfc, kfd, rkfdu, rkfdnu, rkfdnu2 or all", name);
}

int mk_filter_tolerances(const mk_filter_t *filter, const mk_scenario_t *s, double tolerance, int steps, double *fixed, double **schedule,
                         mk_error_t *error) {
    const int estimators = filter->central ? 1 : s->nodes;
    *schedule = NULL;
    for (int e = 0; e < estimators; e++) fixed[e] = filter->mode == MK_TOLERANCE_GLOBAL ? tolerance : 0.0;
    if (filter->mode == MK_TOLERANCE_SCHEDULE) {
        *schedule = mk_design_schedule(s, tolerance, steps, error);
        return *schedule != NULL;
    }
    if (filter->mode != MK_TOLERANCE_STEADY) return 1;
    mk_design_t design;
    if (!mk_design_make(&design, s, tolerance, error)) return 0;
    memcpy(fixed, design.local, (size_t)s->nodes * sizeof *fixed);
    mk_design_free(&design);
    return 1;
}
