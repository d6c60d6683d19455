/* SPDX-License-Identifier: MIT */
/*
 * What the node did, as a run log of this node alone (port/host/log-format.md): its header, one item a step, its end. A reader that is slow or
 * absent costs items, which are counted, never time.
 *
 *     -                 standard output
 *     PATH              a file, which is written anew
 *     unix:PATH         a socket to which readers connect (up to MK_TELEMETRY_READERS at once): each gets the header, then what happens from now on
 *     udp:HOST:PORT     a datagram for each item; the header once every MK_TELEMETRY_HEADER items, for readers that come later
 */
#ifndef MESHKAL_NODE_TELEMETRY_H
#define MESHKAL_NODE_TELEMETRY_H

#include <poll.h>

#include "object.h"
#include "run_log.h"
#include "settings.h"

enum { MK_TELEMETRY_READERS = 8, MK_TELEMETRY_HEADER = 100, MK_TELEMETRY_ROOM = 1 << 18 };

/* A stream that is written as fast as its reader takes it. */
typedef struct {
    int fd; /* -1: free */
    unsigned char *bytes;
    size_t room, used;
    uint64_t items;
} mk_reader_queue_t;

typedef struct {
    int kind, listener, udp; /* descriptors, -1: none */
    const char *path;        /* of a Unix socket, to be removed */
    mk_reader_queue_t queue[MK_TELEMETRY_READERS];
    mk_cbor_t header;
    mk_run_log_t log;        /* item that is being made */
    const mk_scenario_t *scenario;
    int node, most, *row;    /* most: rows a slot has in a moment; row: first row of each node in `measurements` */
    double *measurements;
    uint64_t items, dropped; /* made; not taken by one of the readers */
    int reason;              /* errno of the last failure */
} mk_telemetry_t;

/* real: name of the node's precision. 1, or 0 and an error that names the key. */
int mk_telemetry_open(mk_telemetry_t *telemetry, const mk_settings_t *settings, const mk_scenario_t *scenario, const char *real, mk_error_t *error);
/* The item of a step. run: within one, steps only grow. */
void mk_telemetry_step(mk_telemetry_t *telemetry, int run, int64_t step, const mk_moment_t *moment, size_t real_size);
/* What there is to wait for: fills up to MK_TELEMETRY_READERS + 1 entries and returns their number; then looks at what came of it. */
int mk_telemetry_wait(const mk_telemetry_t *telemetry, struct pollfd *polls);
void mk_telemetry_serve(mk_telemetry_t *telemetry, const struct pollfd *polls, int count);
/* The end item, a moment for the readers to take what is theirs, and the end of it all. */
void mk_telemetry_close(mk_telemetry_t *telemetry);

#endif
