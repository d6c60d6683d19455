/* SPDX-License-Identifier: MIT */
/* A node of the network: the node object between its sockets and the time of day. */
#ifndef MESHKAL_NODE_DAEMON_H
#define MESHKAL_NODE_DAEMON_H

#include "clock.h"
#include "keys.h"
#include "object.h"
#include "readings.h"
#include "settings.h"
#include "sockets.h"
#include "telemetry.h"

/* What the object does not count itself. */
typedef struct {
    uint64_t steps;                          /* done in their time, or as soon as there was time */
    uint64_t sent;                           /* frames */
    uint64_t belated;                        /* not sent: their time was over */
    uint64_t jumps, jumped;                  /* times that steps were left out, and how many, because the clock was ahead */
    uint64_t pulled, pulled_steps;           /* the same, because the neighbours were ahead of the clock, which was put forward */
    uint64_t restarts;                       /* from x0 and P0, because more than catch_up steps were missed */
    uint64_t put_back;                       /* times that the clock was behind by more than catch_up steps */
    uint64_t unsaved;                        /* states that could not be written */
    uint64_t failures;                       /* of the filter, which then started again from x0 and P0 */
    uint64_t reading_repeated;               /* own readings that the object had already, or refused */
    uint64_t *reading_missing, *estimate_missing; /* by slot */
} mk_tally_t;

typedef struct {
    mk_settings_t settings;
    mk_scenario_t scenario;
    double tolerance;
    int slots;
    const mk_object_t *kind;
    void *object;
    mk_clock_t clock;
    int64_t step; /* the object's, not modulo 2^32 */
    int64_t save_at;
    mk_radio_t radio;
    mk_readings_t readings;
    mk_telemetry_t telemetry;
    mk_keys_t keys;
    mk_tally_t tally;
    mk_object_look_t before; /* counters that came with a restored state: of earlier lives */
    uint32_t counts_before[MK_STATUS_COUNT];
    uint8_t *frame, *blob, *datagram;
    int signals; /* descriptor */
} mk_daemon_t;

/* Reads the settings, opens everything and brings the object to the step of the clock. 1, or 0 and an error: wrong input. */
int mk_daemon_open(mk_daemon_t *daemon, const char *path, mk_error_t *error);
/* Works until a signal ends it. 1, or 0 and an error. */
int mk_daemon_run(mk_daemon_t *daemon, mk_error_t *error);
/* Saves the state, if told to by the settings, closes telemetry and the rest. */
void mk_daemon_close(mk_daemon_t *daemon);

/* Steps: everything that is due at `time`. now: 1 where it is the time of day, 0 where it is an earlier moment, that a frame came in. */
int mk_daemon_until(mk_daemon_t *daemon, int64_t time, int now, mk_error_t *error);
/* Goes to a step without the steps in between, where they are more than catch_up; also back. */
int mk_daemon_go(mk_daemon_t *daemon, int64_t step, mk_error_t *error);
/* The object's reading, if it has come and it is time. */
void mk_daemon_feed(mk_daemon_t *daemon);

/* The state's file. Restoring says on standard error what was found; 1: restored. */
int mk_daemon_restore(mk_daemon_t *daemon);
void mk_daemon_save(mk_daemon_t *daemon);

/* All counters, to standard error. */
void mk_daemon_report(const mk_daemon_t *daemon);
/* "meshkal-node K: message" to standard error. */
void mk_daemon_say(const mk_daemon_t *daemon, const char *format, ...) MK_PRINTF(2, 3);

#endif
