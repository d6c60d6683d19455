/* SPDX-License-Identifier: MIT */
/*
 * Readings of the node's own sensor, as text: one a line (of a stream) or several lines a datagram,
 *
 *     STEP,y1,y2,...      for that step (as an integer, counted from the epoch), which may be up to MK_READINGS_AHEAD steps ahead
 *     now,y1,y2,...       for the step whose readings are being collected, or next will be
 *
 * with all rows of the sensor. Blank lines and lines that begin with # are left out.
 */
#ifndef MESHKAL_NODE_READINGS_H
#define MESHKAL_NODE_READINGS_H

#include <stdint.h>

#include "settings.h"

enum { MK_READINGS_AHEAD = 1024 };

typedef struct {
    int fd, datagrams, rows, bits; /* fd -1: none, or ended */
    const char *path;              /* of a Unix socket, to be removed */
    char *text;                    /* a line that has not ended yet; of a datagram all of it */
    unsigned used, skip;           /* skip: the rest of a line that was too long */
    int64_t *step;                 /* of the reading kept at step % MK_READINGS_AHEAD; -1: none */
    double *y;
    uint64_t taken, late, ahead, repeated, refused; /* refused: not as above, or not finite */
    char complaint[160];           /* about the last one that was refused */
} mk_readings_t;

/* bits: of the node's numbers, which a reading must fit. 1, or 0 and an error that names the key. */
int mk_readings_open(mk_readings_t *readings, const mk_settings_t *settings, int rows, mk_error_t *error);
void mk_readings_close(mk_readings_t *readings);
/* Reads what waits. first: the earliest step that a reading can still be for; now: the one that "now" stands for. */
void mk_readings_read(mk_readings_t *readings, int64_t first, int64_t now);
/* The reading of a step, which is then gone; null: there is none. */
const double *mk_readings_take(mk_readings_t *readings, int64_t step);

#endif
