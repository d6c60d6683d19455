/* SPDX-License-Identifier: MIT */
#include "readings.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "scenario_read.h"
#include "sockets.h"

enum { ROOM = MK_DATAGRAM, TAKEN = -1 };

int mk_readings_open(mk_readings_t *r, const mk_settings_t *s, int rows, mk_error_t *error) {
    const mk_channel_t *channel = &s->readings;
    memset(r, 0, sizeof *r);
    r->fd = -1;
    r->rows = rows;
    r->bits = s->bits;
    if (channel->kind == MK_CHANNEL_STANDARD) {
        r->fd = STDIN_FILENO;
    } else if (channel->kind != MK_CHANNEL_NONE) {
        r->fd = mk_socket_listen(s, "readings", channel, SOCK_DGRAM, error);
        if (r->fd < 0) return 0;
        r->datagrams = 1;
        if (channel->kind == MK_CHANNEL_UNIX) r->path = channel->text;
    }
    r->text = mk_allocate(ROOM + 1, 1);
    r->step = mk_allocate(MK_READINGS_AHEAD, sizeof *r->step);
    r->y = mk_allocate(MK_READINGS_AHEAD * (size_t)rows, sizeof *r->y);
    for (int i = 0; i < MK_READINGS_AHEAD; i++) r->step[i] = TAKEN;
    return 1;
}

void mk_readings_close(mk_readings_t *r) {
    if (r->fd >= 0 && r->datagrams) (void)close(r->fd);
    if (r->path) (void)unlink(r->path);
    free(r->text);
    free(r->step);
    free(r->y);
    memset(r, 0, sizeof *r);
    r->fd = -1;
}

static void refuse(mk_readings_t *r, const char *line, const char *why) {
    r->refused++;
    (void)snprintf(r->complaint, sizeof r->complaint, "\"%.60s\": %s", line, why);
}

/* One line, ended by a zero byte. Its numbers go straight to their place: it counts once the step does. */
static void take_line(mk_readings_t *r, char *line, int64_t first, int64_t now) {
    char *next = line + strspn(line, " \t"), *end;
    next[strcspn(next, "\r")] = 0;
    if (!*next || *next == '#') return;
    long long step = now;
    if (strncmp(next, "now", 3) == 0) {
        end = next + 3;
    } else {
        errno = 0;
        step = strtoll(next, &end, 10);
        if (end == next || errno || step < 0) {
            refuse(r, line, "must begin with a step or now");
            return;
        }
    }
    double y[MK_LARGEST_STATE];
    for (int i = 0; i < r->rows; i++) {
        next = end + strspn(end, " \t");
        if (*next != ',') {
            refuse(r, line, "has fewer numbers than the sensor has rows");
            return;
        }
        y[i] = strtod(next + 1, &end);
        if (end == next + 1 || !(fabs(y[i]) <= (r->bits == 32 ? (double)FLT_MAX : DBL_MAX))) {
            refuse(r, line, "holds what is no number, or not finite");
            return;
        }
    }
    if (end[strspn(end, " \t")]) {
        refuse(r, line, "goes on behind the sensor's last row");
        return;
    }
    int64_t *const place = &r->step[step % MK_READINGS_AHEAD];
    if (step < first) r->late++;
    else if (step >= first + MK_READINGS_AHEAD) r->ahead++;
    else if (*place == step) r->repeated++;
    else {
        *place = step;
        memcpy(r->y + (step % MK_READINGS_AHEAD) * r->rows, y, (size_t)r->rows * sizeof *y);
        r->taken++;
    }
}

/* All lines that are complete; of a datagram the last one needs no end. */
static void take_lines(mk_readings_t *r, int64_t first, int64_t now) {
    char *line = r->text, *end = r->text + r->used;
    for (char *stop; (stop = memchr(line, '\n', (size_t)(end - line))) != NULL; line = stop + 1) {
        *stop = 0;
        if (!r->skip) take_line(r, line, first, now);
        r->skip = 0;
    }
    if (r->datagrams && line < end) {
        *end = 0;
        take_line(r, line, first, now);
        line = end;
    }
    r->used = (unsigned)(end - line);
    memmove(r->text, line, r->used);
    if (r->used < ROOM) return;
    r->text[60] = 0;
    if (!r->skip) refuse(r, r->text, "is too long a line");
    r->skip = 1;
    r->used = 0;
}

void mk_readings_read(mk_readings_t *r, int64_t first, int64_t now) {
    /* A stream has been found readable once: a second read might block. */
    for (int i = 0; i < (r->datagrams ? 64 : 1); i++) {
        const ssize_t length = read(r->fd, r->text + r->used, ROOM - r->used);
        if (length < 0 && (errno == EAGAIN || errno == EINTR)) return;
        if (length <= 0 && !r->datagrams) {
            r->fd = -1;
            return;
        }
        if (length < 0) return;
        r->used += (unsigned)length;
        take_lines(r, first, now);
    }
}

const double *mk_readings_take(mk_readings_t *r, int64_t step) {
    int64_t *const place = &r->step[step % MK_READINGS_AHEAD];
    if (*place != step) return NULL;
    *place = TAKEN;
    return r->y + (step % MK_READINGS_AHEAD) * r->rows;
}
