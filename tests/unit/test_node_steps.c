/* SPDX-License-Identifier: MIT */
/* The rules of <meshkal/node.h> for steps, one by one: early and late frames, nodes that were rebooted or slept, neighbours that lie, nodes
   without neighbours, errors while steps are made up for. tests/unit/test_node_network.c has all of them together. */
#define NODE_TESTS "node_steps.tmpl.h"
#include "node_variants.h"

int main(void) {
    const struct CMUnitTest tests[] = {
        EACH(early), EACH(late), EACH(slept), EACH(rebooted), EACH(majority), EACH(alone),
        EACH(application_advances), EACH(error_in_catching_up), EACH(failed_step),
        EACH(left_behind), EACH(goes_on), EACH(silence),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
