/* SPDX-License-Identifier: MIT */
/* Frames in and out of a node object: what is taken, every cause of refusal in the order of the documentation, and that a refused frame changes
   nothing but what <meshkal/node.h> says. Frames come from tests/unit/wire.c, which was written from the format page. */
#define NODE_TESTS "node_frames.tmpl.h"
#include "node_variants.h"

int main(void) {
    const struct CMUnitTest tests[] = {
        EACH(sent), EACH(taken_numbers), EACH(truncated), EACH(flipped), EACH(oversized), EACH(each_cause), EACH(in_order),
        EACH(bad_numbers), EACH(not_started), EACH(bad_configuration),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
