/* SPDX-License-Identifier: MIT */
/*
 * What main() needs of a board: a radio, a sensor, and somebody who wants the estimate. In the demonstration all of them are behind
 * one Ethernet port (link.h): the switch on the host is the air between the nodes, gives each its reading, and is their clock: it says
 * when the time of a stage is over.
 */
#ifndef DEMO_RADIO_H
#define DEMO_RADIO_H

#include <meshkal/node.h>

/* Tells the switch that this node is up. 1, or 0: no network. */
int radio_start(uint16_t node);

/* Broadcasts a frame; nothing if length is 0. */
void radio_send(const uint8_t *frame, size_t length);

/* Sleeps until a frame comes or the stage is over. 1: a frame of *length bytes, at most `room`; 0: the stage is over. */
int radio_listen(uint8_t *frame, size_t room, size_t *length);

/* Sleeps until it is time to measure. The reading stays until the next call. */
const mk_f32_t *sensor_read(void);

/* The node's prediction for its step, and its counters. */
void report(const mk_node_f32_t *node, const mk_f32_t *estimate);

#endif
