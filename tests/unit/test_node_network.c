/* SPDX-License-Identifier: MIT */
/* A whole network of node objects over a radio that loses, repeats and reorders, with clocks that differ, nodes that are rebooted and nodes
   that sleep. Beside each runs a plain filter that is given what the rules of <meshkal/node.h> say must be used: the same bits are
   wanted at every step. */
enum { NODES = 6, STAGES = 800, MOST_EVENTS = 512 };

#define NODE_TESTS "node_network.tmpl.h"
#include "node_variants.h"

int main(void) {
    const struct CMUnitTest tests[] = {EACH(calm), EACH(stormy), EACH(rebooted_together), EACH(around_zero)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
