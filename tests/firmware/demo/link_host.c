/* SPDX-License-Identifier: MIT */
/* The link of a node that runs on the host: messages on standard input and output. The program ends where its input ends. */
#include <stdio.h>
#include <stdlib.h>

#include "link.h"

int link_start(uint16_t node) {
    (void)node;
    return 1;
}

void link_send(int kind, const void *content, size_t length) {
    const uint8_t header[LINK_HEADER] = {(uint8_t)kind, 0, (uint8_t)length, (uint8_t)(length >> 8)};
    (void)fwrite(header, 1, sizeof header, stdout);
    (void)fwrite(content, 1, length, stdout);
}

int link_receive(uint8_t *content, size_t *length) {
    uint8_t header[LINK_HEADER];
    if (fread(header, 1, sizeof header, stdin) != sizeof header) exit(0);
    *length = (size_t)(header[2] | header[3] << 8);
    if (*length > LINK_MAX || fread(content, 1, *length, stdin) != *length) exit(1);
    return header[0];
}
