/* SPDX-License-Identifier: MIT */
/* Nodes with integrity monitors (MK_NODE and MK_WATCH): a network over frames that are lost, one of whose sensors drifts for a while. */
#include <meshkal/monitor.h>

enum { NODES = 6, WINDOW = 10, STEPS = 700, FROM = 200, TO = 450, DRIFTS = 11, SILENT_FROM = 330, SILENT_TO = 360, RESTORED = 300 };
#define RATE 0.15 /* of row 0, whose noise is 1.2, a step */

#define MK_WATCH_OF(name, real, m, slots, window) MK_WATCH(name, real, m, slots, window)

/* Of a run in float32 and float64: of all bits of all estimates and statistics. */
static unsigned long long hashes[2];

#define NODE_TESTS "node_watch.tmpl.h"
#include "node_variants.h"

int main(void) {
    const struct CMUnitTest tests[] = {EACH(drift), EACH(restored), EACH(restarted), EACH(refused_watch)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
