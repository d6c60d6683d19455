/* SPDX-License-Identifier: MIT */
/* CONFIG.json of meshkal-node, as settings.schema.json describes it, read and checked against its scenario. */
#ifndef MESHKAL_NODE_SETTINGS_H
#define MESHKAL_NODE_SETTINGS_H

#include <stdint.h>

#include "scenario.h"

typedef struct {
    int node;         /* number of the neighbour */
    const char *text; /* host:port */
} mk_peer_t;

/* Where readings come from, where telemetry goes. */
enum { MK_CHANNEL_NONE, MK_CHANNEL_STANDARD, MK_CHANNEL_FILE, MK_CHANNEL_UDP, MK_CHANNEL_UNIX };
typedef struct {
    int kind;
    const char *text; /* path, or host:port */
} mk_channel_t;

/* Texts belong to the settings; paths are relative to the folder of the file, and complete here. Null: not given. */
typedef struct {
    const char *path; /* of the file itself */
    char *text;
    struct json_t *root;
    char *file[8]; /* complete paths */
    int files;

    const char *scenario, *design;
    int node;
    int bits;    /* of a number: 32 or 64 */
    int numbers; /* MK_NUMBERS_ */
    int64_t period_ns, epoch_ns;
    double split; /* part of the period for readings */

    const char *listen;
    mk_peer_t *peer;
    int peers;
    const char *group, *interface; /* of multicast; group null: peers */
    int hops;

    const char *key, *boots;
    double gate_reading, gate_estimate; /* probability, 0 none; threshold, 0 none */
    int patience, catch_up;
    const char *state;
    double state_every_s;
    mk_channel_t readings, telemetry;
} mk_settings_t;

/* Reads the settings and their scenario. 1, or 0 and an error that names file, line and key; both are then empty. */
int mk_settings_load(mk_settings_t *settings, mk_scenario_t *scenario, const char *path, mk_error_t *error);
void mk_settings_free(mk_settings_t *settings);

/* An error of the value of a key that was found later, with file, line and key. Returns 0. */
int mk_settings_bad(const mk_settings_t *settings, const char *key, mk_error_t *error, const char *format, ...) MK_PRINTF(4, 5);

#endif
