/* SPDX-License-Identifier: MIT */
/* UDP and Unix sockets of a node. None of them ever blocks. */
#ifndef MESHKAL_NODE_SOCKETS_H
#define MESHKAL_NODE_SOCKETS_H

#include <stddef.h>
#include <stdint.h>
#include <sys/socket.h>

#include "error.h"
#include "settings.h"

/* Larger than any UDP datagram. */
enum { MK_DATAGRAM = 65536 };

typedef struct {
    struct sockaddr_storage address;
    socklen_t length;
} mk_address_t;

/* Where frames come from and go to. */
typedef struct {
    int fd;
    mk_address_t *to;
    int count;
    uint64_t received, sent, failed; /* datagrams */
    int reason;                      /* errno of the last one that failed */
} mk_radio_t;

/* Opens the sockets that the settings ask for. 1, or 0 and an error that names the key. */
int mk_radio_open(mk_radio_t *radio, const mk_settings_t *settings, mk_error_t *error);
void mk_radio_close(mk_radio_t *radio);
/* To every peer, or to the group. What the system does not take is lost, as in the air, and counted. */
void mk_radio_send(mk_radio_t *radio, const uint8_t *bytes, size_t length);
/* The next datagram that waits, and when it arrived (nanoseconds since 1970, 0 if the system does not say). Its length, or -1: none waits. */
long mk_radio_receive(mk_radio_t *radio, uint8_t bytes[MK_DATAGRAM], int64_t *time);

/* Socket for datagrams (udp:) or, for unix:, of `type` at a path, where an old socket is removed. -1 and an error that names the key. */
int mk_socket_listen(const mk_settings_t *settings, const char *key, const mk_channel_t *channel, int type, mk_error_t *error);
/* Socket whose datagrams go to host:port. */
int mk_socket_connect(const mk_settings_t *settings, const char *key, const char *text, mk_error_t *error);

#endif
