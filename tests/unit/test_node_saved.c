/* SPDX-License-Identifier: MIT */
/* Saved states and records of a node object. A node with everything that has a state: a gate, a neighbour that sends its model, frames that came
   early, a way back. */
#include "reference.h"

#define NODE_TESTS "node_saved.tmpl.h"
#include "node_variants.h"

int main(void) {
    const struct CMUnitTest tests[] = {
        EACH(goes_on), EACH(blob_length), EACH(cut_or_flipped), EACH(repaired), EACH(bad_flags), EACH(of_another),
        EACH(recorded), EACH(stream), EACH(full),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
