/* SPDX-License-Identifier: MIT */
/* Interfaces and times of arrival are not POSIX. */
#define _DEFAULT_SOURCE
#include "sockets.h"

#include <errno.h>
#include <fcntl.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

/* "host:port" or "[v6]:port". 1, or 0: neither. */
static int split(const char *text, char host[256], char port[32]) {
    const char *colon = strrchr(text, ':');
    if (!colon || !colon[1] || strlen(colon + 1) >= 32) return 0;
    size_t length = (size_t)(colon - text);
    if (length >= 2 && *text == '[' && colon[-1] == ']') {
        text++;
        length -= 2;
    } else if (memchr(text, ':', length)) {
        return 0;
    }
    if (length == 0 || length >= 256) return 0;
    memcpy(host, text, length);
    host[length] = 0;
    memcpy(port, colon + 1, strlen(colon + 1) + 1);
    return strspn(port, "0123456789") == strlen(port) && atoi(port) > 0 && atoi(port) < 65536;
}

/* family: AF_UNSPEC, or that of the socket; IPv4 addresses are mapped for an IPv6 socket. */
static int resolve(const mk_settings_t *s, const char *key, const char *text, int family, mk_address_t *address, mk_error_t *error) {
    char host[256], port[32];
    struct addrinfo hints, *found;
    if (!split(text, host, port)) return mk_settings_bad(s, key, error, "%.200s: must be host:port, or [address]:port for IPv6", text);
    memset(&hints, 0, sizeof hints);
    hints.ai_family = family;
    hints.ai_socktype = SOCK_DGRAM;
    hints.ai_flags = family == AF_INET6 ? AI_V4MAPPED : 0;
    const int failed = getaddrinfo(host, port, &hints, &found);
    if (failed)
        return mk_settings_bad(s, key, error, "%.200s: %s%s", text, gai_strerror(failed), family == AF_INET ? " (for an IPv4 \"listen\")" : "");
    memset(address, 0, sizeof *address);
    memcpy(&address->address, found->ai_addr, found->ai_addrlen);
    address->length = found->ai_addrlen;
    freeaddrinfo(found);
    return 1;
}

static int set(int fd, int level, int option, int value) { return setsockopt(fd, level, option, &value, sizeof value) == 0; }

/* Of every socket: nonblocking, not for children. */
static int make_socket(int family, int type) {
    const int fd = socket(family, type, 0);
    if (fd < 0) return -1;
    if (fcntl(fd, F_SETFL, O_NONBLOCK) == 0 && fcntl(fd, F_SETFD, FD_CLOEXEC) == 0) return fd;
    (void)close(fd);
    return -1;
}

static int bound(const mk_settings_t *s, const char *key, const char *text, const mk_address_t *address, int shared, mk_error_t *error) {
    const int fd = make_socket(address->address.ss_family, SOCK_DGRAM);
    if (fd >= 0 && (address->address.ss_family != AF_INET6 || set(fd, IPPROTO_IPV6, IPV6_V6ONLY, 0)) &&
        (!shared || set(fd, SOL_SOCKET, SO_REUSEADDR, 1)) && bind(fd, (const struct sockaddr *)&address->address, address->length) == 0)
        return fd;
    (void)mk_settings_bad(s, key, error, "%.200s: %s", text, strerror(errno));
    if (fd >= 0) (void)close(fd);
    return -1;
}

/* --- multicast ------------------------------------------------------------------------------------------------------------- */

static int join(int fd, const mk_settings_t *s, const mk_address_t *group, unsigned index) {
    if (group->address.ss_family == AF_INET6) {
        struct ipv6_mreq request;
        struct sockaddr_in6 address;
        memcpy(&address, &group->address, sizeof address);
        request.ipv6mr_multiaddr = address.sin6_addr;
        request.ipv6mr_interface = index;
        return setsockopt(fd, IPPROTO_IPV6, IPV6_JOIN_GROUP, &request, sizeof request) == 0 &&
               set(fd, IPPROTO_IPV6, IPV6_MULTICAST_IF, (int)index) &&
               set(fd, IPPROTO_IPV6, IPV6_MULTICAST_HOPS, s->hops) && set(fd, IPPROTO_IPV6, IPV6_MULTICAST_LOOP, 1);
    }
    struct ip_mreqn request;
    struct sockaddr_in address;
    memset(&request, 0, sizeof request);
    memcpy(&address, &group->address, sizeof address);
    request.imr_multiaddr = address.sin_addr;
    request.imr_ifindex = (int)index;
    return setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request) == 0 &&
           setsockopt(fd, IPPROTO_IP, IP_MULTICAST_IF, &request, sizeof request) == 0 && set(fd, IPPROTO_IP, IP_MULTICAST_TTL, s->hops) &&
           set(fd, IPPROTO_IP, IP_MULTICAST_LOOP, 1);
}

static int is_multicast(const mk_address_t *address) {
    struct sockaddr_in6 six;
    struct sockaddr_in four;
    memcpy(&six, &address->address, sizeof six);
    memcpy(&four, &address->address, sizeof four);
    return address->address.ss_family == AF_INET6 ? IN6_IS_ADDR_MULTICAST(&six.sin6_addr) : IN_MULTICAST(ntohl(four.sin_addr.s_addr));
}

static int open_group(mk_radio_t *radio, const mk_settings_t *s, mk_error_t *error) {
    mk_address_t listen;
    radio->count = 1;
    radio->to = mk_allocate(1, sizeof *radio->to);
    if (!resolve(s, "multicast.group", s->group, AF_UNSPEC, radio->to, error)) return 0;
    if (!is_multicast(radio->to)) return mk_settings_bad(s, "multicast.group", error, "%.200s is not a multicast address", s->group);
    const int family = radio->to->address.ss_family;
    const unsigned index = if_nametoindex(s->interface);
    if (index == 0) return mk_settings_bad(s, "multicast.interface", error, "%.60s: there is no such interface", s->interface);
    if (family == AF_INET6) ((struct sockaddr_in6 *)(void *)&radio->to->address)->sin6_scope_id = index;
    /* Bound to the group, the socket takes nothing that was sent to another group or to this host. */
    listen = *radio->to;
    if (s->listen && !resolve(s, "listen", s->listen, family, &listen, error)) return 0;
    radio->fd = bound(s, s->listen ? "listen" : "multicast.group", s->listen ? s->listen : s->group, &listen, 1, error);
    if (radio->fd < 0) return 0;
    if (!join(radio->fd, s, radio->to, index))
        return mk_settings_bad(s, "multicast", error, "%.200s at %.60s: %s", s->group, s->interface, strerror(errno));
    return 1;
}

/* --- frames ---------------------------------------------------------------------------------------------------------------- */

static int open_peers(mk_radio_t *radio, const mk_settings_t *s, mk_error_t *error) {
    mk_address_t listen;
    if (!resolve(s, "listen", s->listen, AF_UNSPEC, &listen, error)) return 0;
    if (is_multicast(&listen)) return mk_settings_bad(s, "listen", error, "%.200s is a multicast address: that is for \"multicast\"", s->listen);
    radio->fd = bound(s, "listen", s->listen, &listen, 0, error);
    if (radio->fd < 0) return 0;
    radio->count = s->peers;
    radio->to = mk_allocate((size_t)s->peers, sizeof *radio->to);
    for (int i = 0; i < s->peers; i++) {
        char key[32];
        (void)snprintf(key, sizeof key, "peers.%d", s->peer[i].node);
        if (!resolve(s, key, s->peer[i].text, listen.address.ss_family, &radio->to[i], error)) return 0;
    }
    return 1;
}

int mk_radio_open(mk_radio_t *radio, const mk_settings_t *s, mk_error_t *error) {
    memset(radio, 0, sizeof *radio);
    radio->fd = -1;
    if (!(s->group ? open_group(radio, s, error) : open_peers(radio, s, error))) {
        mk_radio_close(radio);
        return 0;
    }
    /* Frames are judged by when they came, not by when there was time to look at them. */
    (void)set(radio->fd, SOL_SOCKET, SO_TIMESTAMPNS, 1);
    return 1;
}

void mk_radio_close(mk_radio_t *radio) {
    if (radio->fd >= 0) (void)close(radio->fd);
    free(radio->to);
    radio->to = NULL;
    radio->fd = -1;
}

void mk_radio_send(mk_radio_t *radio, const uint8_t *bytes, size_t length) {
    for (int i = 0; i < radio->count; i++) {
        const mk_address_t *to = &radio->to[i];
        if (sendto(radio->fd, bytes, length, MSG_DONTWAIT | MSG_NOSIGNAL, (const struct sockaddr *)&to->address, to->length) >= 0) {
            radio->sent++;
        } else {
            radio->failed++;
            radio->reason = errno;
        }
    }
}

long mk_radio_receive(mk_radio_t *radio, uint8_t bytes[MK_DATAGRAM], int64_t *time) {
    union {
        struct cmsghdr header; /* aligns */
        char room[CMSG_SPACE(sizeof(struct timespec))];
    } control;
    struct iovec piece = {bytes, MK_DATAGRAM};
    struct msghdr message;
    memset(&message, 0, sizeof message);
    message.msg_iov = &piece;
    message.msg_iovlen = 1;
    message.msg_control = &control;
    message.msg_controllen = sizeof control;
    const ssize_t length = recvmsg(radio->fd, &message, MSG_DONTWAIT);
    if (length < 0) return -1;
    *time = 0;
    for (struct cmsghdr *c = CMSG_FIRSTHDR(&message); c; c = CMSG_NXTHDR(&message, c)) {
        struct timespec at;
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
        memcpy(&at, CMSG_DATA(c), sizeof at);
        *time = (int64_t)at.tv_sec * 1000000000 + at.tv_nsec;
    }
    radio->received++;
    return (long)length;
}

/* --- readings and telemetry ------------------------------------------------------------------------------------------------ */

static int listen_at(const mk_settings_t *s, const char *key, const char *path, int type, mk_error_t *error) {
    struct sockaddr_un address;
    struct stat there;
    memset(&address, 0, sizeof address);
    address.sun_family = AF_UNIX;
    if (strlen(path) >= sizeof address.sun_path) {
        (void)mk_settings_bad(s, key, error, "unix:%.200s: the path is longer than %zu bytes", path, sizeof address.sun_path - 1);
        return -1;
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    if (lstat(path, &there) == 0 && S_ISSOCK(there.st_mode)) (void)unlink(path);
    const int fd = make_socket(AF_UNIX, type);
    if (fd >= 0 && bind(fd, (const struct sockaddr *)&address, sizeof address) == 0 && (type != SOCK_STREAM || listen(fd, 8) == 0)) return fd;
    (void)mk_settings_bad(s, key, error, "unix:%.200s: %s", path, strerror(errno));
    if (fd >= 0) (void)close(fd);
    return -1;
}

int mk_socket_listen(const mk_settings_t *s, const char *key, const mk_channel_t *channel, int type, mk_error_t *error) {
    mk_address_t address;
    if (channel->kind == MK_CHANNEL_UNIX) return listen_at(s, key, channel->text, type, error);
    return resolve(s, key, channel->text, AF_UNSPEC, &address, error) ? bound(s, key, channel->text, &address, 0, error) : -1;
}

int mk_socket_connect(const mk_settings_t *s, const char *key, const char *text, mk_error_t *error) {
    mk_address_t address;
    if (!resolve(s, key, text, AF_UNSPEC, &address, error)) return -1;
    const int fd = make_socket(address.address.ss_family, SOCK_DGRAM);
    if (fd >= 0 && connect(fd, (const struct sockaddr *)&address.address, address.length) == 0) return fd;
    (void)mk_settings_bad(s, key, error, "%.200s: %s", text, strerror(errno));
    if (fd >= 0) (void)close(fd);
    return -1;
}
