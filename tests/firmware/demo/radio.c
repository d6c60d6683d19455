/* SPDX-License-Identifier: MIT */
#include "radio.h"

#include <string.h>

#include "link.h"

enum { REPORT_NUMBERS = 1 + MK_STATUS_COUNT + 4, STATES_MAX = 64, ROWS_MAX = 8 };

int radio_start(uint16_t node) {
    if (!link_start(node)) return 0;
    link_send(LINK_HELLO, &node, sizeof node);
    return 1;
}

void radio_send(const uint8_t *frame, size_t length) {
    if (length) link_send(LINK_FRAME, frame, length);
}

int radio_listen(uint8_t *frame, size_t room, size_t *length) {
    uint8_t content[LINK_MAX];
    for (;;) {
        const int kind = link_receive(content, length);
        if (kind == LINK_END) return 0;
        if (kind != LINK_FRAME) continue;
        /* Of a frame that is too long no more is needed than that it is. */
        if (*length > room) *length = room;
        memcpy(frame, content, *length);
        return 1;
    }
}

const mk_f32_t *sensor_read(void) {
    static mk_f32_t reading[ROWS_MAX];
    uint8_t content[LINK_MAX];
    size_t length;
    while (link_receive(content, &length) != LINK_SENSOR || length > sizeof reading) continue;
    memcpy(reading, content, length);
    return reading;
}

void report(const mk_node_f32_t *node, const mk_f32_t *estimate) {
    const size_t numbers = sizeof(uint32_t) * REPORT_NUMBERS, size = sizeof *estimate * node->config->filter.n;
    uint32_t content[REPORT_NUMBERS + STATES_MAX];
    uint32_t *const last = content + 1 + MK_STATUS_COUNT;
    if (size > sizeof content - numbers) return;
    content[0] = node->step;
    memcpy(content + 1, node->counts, sizeof node->counts);
    last[0] = node->early;
    last[1] = node->caught_up;
    last[2] = node->restarts;
    last[3] = node->unsent;
    memcpy(content + REPORT_NUMBERS, estimate, size);
    link_send(LINK_REPORT, content, numbers + size);
}
