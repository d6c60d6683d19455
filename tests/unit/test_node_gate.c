/* SPDX-License-Identifier: MIT */
/* The gate of a node object and neighbours whose model comes with their readings. Compared with LAPACK. */
#include "reference.h"

#define NODE_TESTS "node_gate.tmpl.h"
#include "node_variants.h"

int main(void) {
    const struct CMUnitTest tests[] = {
        EACH(thresholds), EACH(as_if_not_heard), EACH(way_back), EACH(estimates), EACH(square_root), EACH(foreign_step), EACH(foreign_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
