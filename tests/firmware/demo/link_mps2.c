/* SPDX-License-Identifier: MIT */
/* The link over the Ethernet port of an MPS2 board. */
#include <lan9118.h>
#include <string.h>

#include "link.h"

static uint8_t header[MK_ETHERNET_HEADER] = {0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2, 0, 0, 0, 0, 0, 0x88, 0xb5};

int link_start(uint16_t node) {
    uint8_t *const address = header + 6; /* locally administered */
    address[4] = (uint8_t)(node >> 8);
    address[5] = (uint8_t)node;
    return mk_lan9118_start(address);
}

void link_send(int kind, const void *content, size_t length) {
    uint8_t bytes[MK_ETHERNET_HEADER + LINK_HEADER + LINK_MAX];
    uint8_t *const at = bytes + MK_ETHERNET_HEADER;
    if (length > LINK_MAX) return;
    memcpy(bytes, header, sizeof header);
    at[0] = (uint8_t)kind;
    at[1] = 0;
    at[2] = (uint8_t)length;
    at[3] = (uint8_t)(length >> 8);
    memcpy(at + LINK_HEADER, content, length);
    (void)mk_lan9118_send(bytes, MK_ETHERNET_HEADER + LINK_HEADER + length);
}

int link_receive(uint8_t *content, size_t *length) {
    uint8_t bytes[MK_ETHERNET_MAX];
    const uint8_t *const at = bytes + MK_ETHERNET_HEADER;
    for (;;) {
        const size_t size = mk_lan9118_receive(bytes, sizeof bytes);
        if (size == 0) mk_lan9118_wait();
        if (size < MK_ETHERNET_HEADER + LINK_HEADER || bytes[12] != header[12] || bytes[13] != header[13]) continue;
        *length = (size_t)(at[2] | at[3] << 8);
        if (*length > LINK_MAX || *length > size - MK_ETHERNET_HEADER - LINK_HEADER) continue;
        memcpy(content, at + LINK_HEADER, *length);
        return at[0];
    }
}
