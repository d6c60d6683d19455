/* SPDX-License-Identifier: MIT */
/* What range_node.c needs of a board. Here range_board.c: the neighbours, their radio and a target, played on the host. */
#ifndef RANGE_BOARD_H
#define RANGE_BOARD_H

#include <meshkal/duif.h>

/* Sleeps until it is time to measure. 1, or 0: no range now. */
int range_read(mk_f32_t *range);

/* Broadcasts a frame; nothing if length is 0. */
void radio_send(const uint8_t *frame, size_t length);

/* Sleeps until a frame comes or the time of the iteration is over. 1: a frame of *length bytes, at most `room`; 0: it is over. */
int radio_listen(uint8_t *frame, size_t room, size_t *length);

/* The node's estimate after a step, and its counters. */
void report(const mk_duif_f32_t *node, const mk_f32_t *estimate);

#endif
