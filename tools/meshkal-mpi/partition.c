/* SPDX-License-Identifier: MIT */
#include "partition.h"

#include <metis.h>
#include <stdlib.h>

int mk_partition(const mk_scenario_t *s, int parts, int *part, mk_error_t *error) {
    if (parts == 1 || s->nodes < parts) {
        for (int k = 0; k < s->nodes; k++) part[k] = parts == 1 ? 0 : k;
        return 1;
    }
    /* Links without the node itself, which stands first among its slots. */
    idx_t nodes = s->nodes, constraints = 1, count = parts, cut = 0, options[METIS_NOPTIONS];
    idx_t *first = mk_allocate((size_t)s->nodes + 1, sizeof *first), *weight = mk_allocate((size_t)s->nodes, sizeof *weight);
    idx_t *link = mk_allocate((size_t)s->first[s->nodes] + 1, sizeof *link), *result = mk_allocate((size_t)s->nodes, sizeof *result);
    for (int k = 0; k < s->nodes; k++) {
        const int degree = s->first[k + 1] - s->first[k];
        for (int i = 1; i < degree; i++) link[first[k] + i - 1] = s->slot[s->first[k] + i];
        first[k + 1] = first[k] + degree - 1;
        weight[k] = degree + 4; /* a step costs about four slots more than its readings */
    }
    (void)METIS_SetDefaultOptions(options);
    options[METIS_OPTION_SEED] = 1;
    const int status = METIS_PartGraphKway(&nodes, &constraints, first, link, weight, NULL, NULL, &count, NULL, NULL, options, &cut, result);
    for (int k = 0; k < s->nodes; k++) part[k] = (int)result[k];
    free(first);
    free(weight);
    free(link);
    free(result);
    return status == METIS_OK || mk_fail(error, "METIS cannot divide %d nodes into %d parts (status %d)", s->nodes, parts, status);
}
