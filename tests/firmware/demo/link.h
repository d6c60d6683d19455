/* SPDX-License-Identifier: MIT */
/*
 * Messages between a node and the switch: kind (1 byte), zero (1), length of the content (2), content. All numbers little-endian. On
 * the boards they travel in Ethernet frames of the local experimental type 0x88b5, to all.
 *
 *     kind     from      content
 *     FRAME    both      a frame of meshkal/frame.h
 *     HELLO    node      number of the node (2 bytes): it has started
 *     SENSOR   switch    reading, float32, one for each row: a new step begins
 *     END      switch    nothing: the time of the stage is over
 *     REPORT   node      step; counts[MK_STATUS_COUNT], early, caught_up, restarts, unsent; estimate of that step, float32: 4 bytes each
 */
#ifndef DEMO_LINK_H
#define DEMO_LINK_H

#include <stddef.h>
#include <stdint.h>

enum { LINK_FRAME, LINK_HELLO, LINK_SENSOR, LINK_END, LINK_REPORT };
enum { LINK_HEADER = 4, LINK_MAX = 512 }; /* bytes; of the content, at most */

/* 1, or 0: no network. */
int link_start(uint16_t node);
void link_send(int kind, const void *content, size_t length);
/* Sleeps until a message comes: its kind, its content in up to LINK_MAX bytes. */
int link_receive(uint8_t *content, size_t *length);

#endif
