/* SPDX-License-Identifier: MIT */
/* A node that tracks a target by ranges, all of it. Anchors at known places measure how far the target is; each talks to its neighbours only, and
   each knows where the target is, also one that hears no range. */
#include <meshkal/duif.h>
#include <meshkal/tracking.h>

#include "range_board.h" /* yours: range_read, radio_send, radio_listen; and report, who wants the estimate */

MK_DUIF(node, f32, 4, 1, 4); /* 4 states, 1 row a reading, 4 slots: itself and three neighbours */

static const mk_motion_t motion = {.n = 4, .dimensions = 2, .position = {0, 2}, .velocity = {1, 3}}; /* x = [px, vx, py, vy] */
static const mk_site_f32_t here = {&motion, {12.0f, 3.5f}, {0}};                                     /* where this anchor stands, m */
static const float R[1] = {0.09f};                                                                   /* ranges to 0.3 m */
static const mk_sensor_f32_t sensor = {{mk_range_f32, NULL, &here, NULL}, R, 1};
/* Acceleration of 0.05 m^2/s^3 for a step of one second; the target begins somewhere within 20 m of (20, 20), at no more than some m/s. */
static const float Q[10] = {0.0167f, 0.025f, 0.05f, 0, 0, 0.0167f, 0, 0, 0.025f, 0.05f};
static const float x0[4] = {20, 0, 20, 0}, P0[10] = {100, 0, 4, 0, 0, 100, 0, 0, 0, 4};
static const uint16_t nodes[4] = {7, 2, 3, 9}; /* this node is number 7 */
static const uint16_t degree[4] = {3, 2, 2, 1}; /* how many neighbours each of them has */
static const node_config_t config = {
    .filter = {.n = 4, .m = 1, .slots = 1, .transition = {.model = {mk_constant_velocity_f32, NULL, &motion, NULL}, .Q = Q}, .sensor = &sensor,
               .x0 = x0, .P0 = P0, .transform = MK_TRANSFORM_CUBATURE(4), .increments = 1},
    .consensus = {.values = 14, .slots = 4, .iterations = 10, .network = 4, .protocol = MK_CONSENSUS_METROPOLIS, .degree = degree},
    .nodes = nodes, .model = 0x52414e47, .catch_up = 10, .numbers = MK_NUMBERS_F32,
};
static node_t node; /* all the memory there is */

int main(void) {
    uint8_t frame[node_frame_max];
    size_t length;
    float range;
    if (node_start(&node, &config) != MK_OK) return 1;
    for (;;) { /* once a second */
        node_predict(&node, 1.0f, NULL);
        if (range_read(&range)) node_measure(&node, &range);
        if (node_contribute(&node) != MK_OK) { /* the model has no use for this range */
            node_drop(&node);
            node_contribute(&node);
        }
        for (int i = 0; i < config.consensus.iterations; i++) {
            radio_send(frame, node_frame(&node, frame));
            while (radio_listen(frame, sizeof frame, &length)) node_accept(&node, frame, length);
            node_iterate(&node);
        }
        node_fuse(&node);
        report(&node.core, node_estimate(&node));
    }
}
