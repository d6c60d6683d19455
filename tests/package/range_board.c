/* SPDX-License-Identifier: MIT */
/* Nodes 2, 3 and 9 around that of range_node.c, and a target that circles among them. One frame in five is lost, and one range in ten; node 9 hears no
   range at all. Ends after 200 steps: status 0 if the node's estimate was good. */
#include "range_board.h"

#include <math.h>
#include <meshkal/tracking.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 200, OTHERS = 3, SLOTS = 3 };

MK_DUIF(other, f32, 4, 1, SLOTS);
MK_DUIF(last, f32, 4, 1, 2);

static const mk_motion_t motion = {.n = 4, .dimensions = 2, .position = {0, 2}, .velocity = {1, 3}};
static const mk_site_f32_t site[1 + OTHERS] = {
    {&motion, {12.0f, 3.5f}, {0}}, {&motion, {55.0f, 10.0f}, {0}}, {&motion, {30.0f, 60.0f}, {0}}, {&motion, {0.0f, 50.0f}, {0}}};
static const float R[1] = {0.09f}, x0[4] = {20, 0, 20, 0}, P0[10] = {100, 0, 4, 0, 0, 100, 0, 0, 0, 4};
static const float Q[10] = {0.0167f, 0.025f, 0.05f, 0, 0, 0.0167f, 0, 0, 0.025f, 0.05f};
static const uint16_t nodes[OTHERS][SLOTS] = {{2, 7, 3}, {3, 7, 2}, {9, 7}}, degree[OTHERS][SLOTS] = {{2, 3, 2}, {2, 3, 2}, {1, 3}};

static mk_sensor_f32_t sensor[OTHERS];
static mk_duif_config_f32_t config[OTHERS];
static other_t two, three;
static last_t nine;
static uint8_t frames[OTHERS][other_frame_max];
static size_t lengths[OTHERS];
static float truth[4];
static double squares;
static int step, next;
static uint32_t seed = 1;

static uint32_t draw(void) {
    seed = seed * UINT32_C(1664525) + UINT32_C(1013904223);
    return seed >> 8;
}

static void expect(mk_status_t status, const char *what) {
    if (status == MK_OK) return;
    printf("step %d: %s: %s\n", step, what, mk_status_name(status));
    exit(1);
}

static int measured(int k, float *range) {
    expect(mk_range_f32(site + k, 0.0f, 1, truth, range), "range");
    *range += ((float)(draw() % 1000u) - 499.5f) / 1000.0f;
    return draw() % 10u > 0;
}

static void configure(int k) {
    const mk_sensor_f32_t made = {{mk_range_f32, NULL, site + 1 + k, NULL}, R, 1};
    const mk_duif_config_f32_t like = {
        .filter = {.n = 4, .m = 1, .slots = 1, .transition = {.model = {mk_constant_velocity_f32, NULL, &motion, NULL}, .Q = Q},
                   .sensor = sensor + k, .x0 = x0, .P0 = P0, .transform = MK_TRANSFORM_CUBATURE(4), .increments = 1},
        .consensus = {.values = 14, .slots = (uint16_t)(k == 2 ? 2 : SLOTS), .iterations = 10, .network = 4,
                      .protocol = MK_CONSENSUS_METROPOLIS, .degree = degree[k]},
        .nodes = nodes[k], .model = 0x52414e47, .catch_up = 10, .numbers = MK_NUMBERS_F32,
    };
    sensor[k] = made;
    config[k] = like;
}

static void begin(void) {
    for (int k = 0; k < OTHERS; k++) configure(k);
    expect(other_start(&two, config), "start");
    expect(other_start(&three, config + 1), "start");
    expect(last_start(&nine, config + 2), "start");
    truth[0] = 30.0f;
    truth[1] = -1.0f;
    truth[2] = 15.0f;
    truth[3] = 0.5f;
}

int range_read(mk_f32_t *range) {
    float r, before[4];
    if (step == 0) begin();
    truth[1] += 0.004f * (27.0f - truth[0]);
    truth[3] += 0.004f * (30.0f - truth[2]);
    memcpy(before, truth, sizeof truth);
    expect(mk_constant_velocity_f32(&motion, 1.0f, 1, before, truth), "motion");
    expect(other_predict(&two, 1.0f, NULL), "predict");
    expect(other_predict(&three, 1.0f, NULL), "predict");
    expect(last_predict(&nine, 1.0f, NULL), "predict");
    if (measured(1, &r)) expect(other_measure(&two, &r), "measure");
    if (measured(2, &r)) expect(other_measure(&three, &r), "measure");
    expect(other_contribute(&two), "contribute");
    expect(other_contribute(&three), "contribute");
    expect(last_contribute(&nine), "contribute");
    return measured(0, range);
}

static int lost(void) { return draw() % 5u == 0; }

void radio_send(const uint8_t *frame, size_t length) {
    lengths[0] = other_frame(&two, frames[0]);
    lengths[1] = other_frame(&three, frames[1]);
    lengths[2] = last_frame(&nine, frames[2]);
    if (!lost()) expect(other_accept(&two, frame, length), "accept");
    if (!lost()) expect(other_accept(&three, frame, length), "accept");
    if (!lost()) expect(last_accept(&nine, frame, length), "accept");
    if (!lost()) expect(other_accept(&two, frames[1], lengths[1]), "accept");
    if (!lost()) expect(other_accept(&three, frames[0], lengths[0]), "accept");
    next = 0;
}

int radio_listen(uint8_t *frame, size_t room, size_t *length) {
    while (next < OTHERS && lost()) next++;
    if (next < OTHERS) {
        *length = lengths[next];
        if (*length > room) expect(MK_ERROR_LENGTH, "listen");
        memcpy(frame, frames[next++], *length);
        return 1;
    }
    expect(other_iterate(&two), "iterate");
    expect(other_iterate(&three), "iterate");
    expect(last_iterate(&nine), "iterate");
    return 0;
}

void report(const mk_duif_f32_t *node, const mk_f32_t *estimate) {
    const double dx = (double)(estimate[0] - truth[0]), dy = (double)(estimate[2] - truth[2]);
    expect(other_fuse(&two), "fuse");
    expect(other_fuse(&three), "fuse");
    expect(last_fuse(&nine), "fuse");
    if (++step > 20) squares += dx * dx + dy * dy;
    if (step < STEPS) return;
    const double error = sqrt(squares / (STEPS - 20));
    const double apart = fabs((double)(nine.filter.x[0] - estimate[0])) + fabs((double)(nine.filter.x[2] - estimate[2]));
    printf("position %.1f, %.1f m; RMS error %.2f m; the node without ranges %.2f m from it; frames taken %u\n", (double)estimate[0],
           (double)estimate[2], error, apart, (unsigned)node->counts[MK_OK]);
    /* Standard deviations: of a range 0.29 m; frames of 30 a step, four in five. */
    exit(error < 0.5 && apart < 0.3 && node->counts[MK_OK] > 22 * STEPS && node->counts[MK_OK] < 26 * STEPS ? 0 : 1);
}
