/* SPDX-License-Identifier: MIT */
/* A node that watches its own and its neighbours' sensors, all of it: what drifts is left out of the step, looked at, and taken again when
   it is good. */
#include <meshkal/monitor.h>

#include "node_00.h" /* made by meshkal design --c-header: node 0, six states, two rows a sensor, itself and two neighbours */
#include "radio.h"   /* the board: radio_start, radio_send, radio_listen, sensor_read; and report, who wants the estimate */

MK_WATCH(node00, f32, 2, 3, 10); /* after the header's MK_NODE_UNROLLED(node00, f32, 6, 2, 3): its rows and slots, and a window of 10 steps */

/* Filled below, once. Where the probabilities are settled, constants (scipy.stats.chi2.isf(Pfa, r) for r = 1, 2, ..; evidence
   11.5) save the 9 KB of code that computes them on a Cortex-M4F. */
static float threshold[6], zero[2], back[2];
/* m, places, window; thresholds, jump (not of this scheme), separation, evidence (below); zero, back, level, slope; most, patience */
static node00_monitor_config_t watch = {2, 3, 10, threshold, 20.0f, 10.0f, 0.0f, zero, back, 0.01f, 1e-4f, 2, 5, MK_MONITOR_EXCLUDE};
static node00_monitor_t monitor;
static node00_t node;

int main(void) {
    uint8_t frame[node00_frame_max];
    size_t length;
    if (mk_gate_thresholds_f32(1e-9, 6, threshold) != MK_OK || mk_gate_thresholds_f32(1e-3, 2, zero) != MK_OK ||
        mk_gate_thresholds_f32(0.1, 2, back) != MK_OK || mk_monitor_evidence_f32(0.01, 1000.0, &watch.evidence) != MK_OK)
        return 1;
    if (node00_monitor_start(&monitor, &watch) != MK_OK || node00_start(&node, &node00_config) != MK_OK) return 1;
    if (!radio_start(node00_config.nodes[0])) return 1;
    for (;;) {
        node00_measure(&node, sensor_read());
        radio_send(frame, node00_frame(&node, MK_STAGE_MEASUREMENT, frame));
        while (radio_listen(frame, sizeof frame, &length)) node00_accept(&node, frame, length);
        node00_watch(&node, &monitor, node00_config.nodes); /* all readings are in: it drops those of sensors that it holds faulty */
        node00_incremental(&node);
        radio_send(frame, node00_frame(&node, MK_STAGE_ESTIMATE, frame));
        while (radio_listen(frame, sizeof frame, &length)) node00_accept(&node, frame, length);
        node00_diffuse(&node);
        report(&node.node, node00_estimate(&node));
    }
}
