/* SPDX-License-Identifier: MIT */
#include "simulation/network.h"

#include <math.h>
#include <meshkal/inline.h>
#include <stdlib.h>
#include <string.h>

#include "design/sized.h"
#include "design/steady.h"
#include "parallel.h"
#include "scenario_monitor.h"
#include "scenario_read.h"

/* Estimators that a thread takes at once. */
#define CHUNK 64

/* Bytes of configurations up to which every estimator has its own, ready for its steps. */
#define MOST_COPIED ((size_t)8 << 20)

/* The failure among them that is_worse than all others. */
typedef struct {
    mk_status_t status;
    int bad;
} chunk_t;

/* Something done for some estimators. */
typedef struct {
    enum { START, INCREMENT, DIFFUSE } kind;
    void *network;
    int begin, end;
    const double *y;
    const int *row_first;
    uint8_t *arrived;
    const void *halo;
    mk_snapshot_t *seen;
} phase_t;

/* Whether estimator e failed, and none of a lower number in the whole network did so far. */
static int is_worse(const mk_topology_t *topology, mk_status_t status, int e, mk_status_t first, int bad) {
    return status != MK_OK && (first == MK_OK || mk_topology_id(topology, e) < mk_topology_id(topology, bad));
}

/* Sensors that are heard: in a part of a network those of its estimators, then those of its halo. */
static int sensors_of(const mk_topology_t *topology, const mk_scenario_t *s) {
    return topology->id ? topology->estimators + topology->halo : s->nodes;
}

static int node_of(const mk_topology_t *topology, int sensor) {
    if (!topology->id) return sensor;
    return sensor < topology->estimators ? topology->id[sensor] : topology->halo_node[sensor - topology->estimators];
}

static int heard_of(const mk_topology_t *topology, int slot) {
    if (!topology->origin) return topology->slot[slot];
    const int origin = topology->origin[slot];
    return origin >= 0 ? origin : topology->estimators - 1 - origin;
}

/* Who is in which slot of a monitor: its number. A monitor has no more places. */
static const uint16_t slot_number[MK_MONITOR_ROWS] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15,
                                                      16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};

/* In a function of its own gcc takes it for nothing and drops it. */
#if defined __GNUC__
#define PREFETCH(address) __builtin_prefetch(address)
#else
#define PREFETCH(address) (void)(address)
#endif

#define MK_BITS 32
#include <meshkal/real.h>
#define MK_REAL_NAME "float32"
#include "simulation/network.tmpl.h"
#undef MK_REAL_NAME
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#define MK_REAL_NAME "float64"
#include "simulation/network.tmpl.h"

int mk_monitor_rows(const mk_topology_t *topology, const mk_scenario_t *s, int e) {
    return (topology->first[e + 1] - topology->first[e]) * mk_topology_rows(topology, s, e);
}

mk_snapshot_t mk_snapshot_make(const mk_network_t *network, int estimators, const mk_scenario_t *s, const int *own_first) {
    const size_t count = (size_t)estimators, size = network->real_size, own = own_first ? (size_t)own_first[estimators] : 0;
    mk_snapshot_t snapshot;
    snapshot.estimate = mk_allocate(count * (size_t)s->n, size);
    snapshot.variance = mk_allocate(count * (size_t)s->n, size);
    snapshot.own_first = own_first;
    snapshot.innovation = mk_allocate(own, size);
    snapshot.innovation_variance = mk_allocate(own, size);
    snapshot.position_covariance = mk_allocate(count * (size_t)MK_PACKED(s->position_count), size);
    snapshot.trace_covariance = mk_allocate(count, size);
    snapshot.theta = mk_allocate(count, size);
    snapshot.tolerance = mk_allocate(count, size);
    snapshot.nis = mk_allocate(count, size);
    snapshot.nis_rows = mk_allocate(count, sizeof *snapshot.nis_rows);
    snapshot.faults = mk_allocate(count, sizeof *snapshot.faults);
    snapshot.frozen = mk_allocate(count, 1);
    return snapshot;
}

void mk_snapshot_free(mk_snapshot_t *snapshot) {
    free(snapshot->estimate);
    free(snapshot->variance);
    free(snapshot->innovation);
    free(snapshot->innovation_variance);
    free(snapshot->trace_covariance);
    free(snapshot->position_covariance);
    free(snapshot->theta);
    free(snapshot->tolerance);
    free(snapshot->nis);
    free(snapshot->nis_rows);
    free(snapshot->faults);
    free(snapshot->frozen);
}
