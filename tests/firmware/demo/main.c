/* SPDX-License-Identifier: MIT */
/* The application of a node, all of it. README.md shows it. */
#include "radio.h"     /* the board: radio_start, radio_send, radio_listen, sensor_read; and report, who wants the estimate */
#include "this_node.h" /* node_07.h, made by meshkal design --c-header: types and constants of this node */

static node_t node; /* all the memory there is */

int main(void) {
    uint8_t frame[node_frame_max];
    size_t length;
    if (node_start(&node, &node_config) != MK_OK || !radio_start(node_config.nodes[0])) return 1;
    for (;;) {
        node_measure(&node, sensor_read());
        radio_send(frame, node_frame(&node, MK_STAGE_MEASUREMENT, frame));
        while (radio_listen(frame, sizeof frame, &length)) node_accept(&node, frame, length);
        node_incremental(&node);
        radio_send(frame, node_frame(&node, MK_STAGE_ESTIMATE, frame));
        while (radio_listen(frame, sizeof frame, &length)) node_accept(&node, frame, length);
        node_diffuse(&node);
        report(&node.node, node_estimate(&node));
    }
}
