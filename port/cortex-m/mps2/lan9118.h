/* SPDX-License-Identifier: MIT */
/*
 * The LAN9118 Ethernet controller of Arm's MPS2 boards (AN385, AN386, AN500): raw frames, no network stack. Nothing here spins while it
 * waits and nothing needs an interrupt handler: the controller's interrupt only wakes the core. No other code may use the controller.
 *
 * A frame is destination (6 bytes), source (6), type (2, big-endian), content; without its check sequence, which the controller adds
 * and examines. Whether short frames arrive with padding is up to the link: content has to say its own length.
 */
#ifndef MESHKAL_MPS2_LAN9118_H
#define MESHKAL_MPS2_LAN9118_H

#include <stddef.h>
#include <stdint.h>

#define MK_ETHERNET_HEADER 14
#define MK_ETHERNET_MAX 1514

/* Resets the controller; from now on frames to this address and to all (ff:ff:ff:ff:ff:ff) are received. 1, or 0: there is none, or it does
   not get ready. */
int mk_lan9118_start(const uint8_t address[6]);

/* Hands a frame of MK_ETHERNET_HEADER to MK_ETHERNET_MAX bytes to the controller, which sends it from its own memory. 1, or 0: it has
   another length, or there is no room for it now. */
int mk_lan9118_send(const uint8_t *frame, size_t length);

/* The next frame received: its length, or 0 if there is none. Damaged frames and frames longer than `room` are dropped. */
size_t mk_lan9118_receive(uint8_t *frame, size_t room);

/* Sleeps until a frame is there. May return early: look again. */
void mk_lan9118_wait(void);

#endif
