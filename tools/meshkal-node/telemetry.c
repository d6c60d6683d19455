/* SPDX-License-Identifier: MIT */
#include "telemetry.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "clock.h"
#include "sockets.h"

/* How long readers have at the end, in nanoseconds. */
#define LAST_MOMENT 200000000

/* --- streams --------------------------------------------------------------------------------------------------------------- */

static void queue_drop(mk_telemetry_t *t, mk_reader_queue_t *q, int reason) {
    if (t->kind != MK_CHANNEL_STANDARD) (void)close(q->fd);
    q->fd = -1;
    q->used = 0;
    t->reason = reason;
}

/* Pieces of PIPE_BUF, each after the system has said that there is room: so a pipe that others hold, too, need not be made nonblocking. */
static void queue_write(mk_telemetry_t *t, mk_reader_queue_t *q) {
    const size_t most = t->kind == MK_CHANNEL_FILE ? q->used : PIPE_BUF;
    const ssize_t done = write(q->fd, q->bytes, q->used < most ? q->used : most);
    if (done >= 0) {
        q->used -= (size_t)done;
        memmove(q->bytes, q->bytes + done, q->used);
    } else if (errno != EAGAIN && errno != EINTR) {
        queue_drop(t, q, errno);
    }
}

static int queue_put(mk_reader_queue_t *q, const void *bytes, size_t length) {
    if (q->room - q->used < length) return 0;
    memcpy(q->bytes + q->used, bytes, length);
    q->used += length;
    return 1;
}

static void queue_open(mk_telemetry_t *t, mk_reader_queue_t *q, int fd) {
    q->fd = fd;
    q->used = 0;
    q->items = 0;
    q->room = t->header.used + MK_TELEMETRY_ROOM;
    q->room += 4 * sizeof(double) * (size_t)t->row[t->scenario->nodes]; /* items of large networks are large */
    if (!q->bytes) q->bytes = mk_allocate(q->room, 1);
    (void)queue_put(q, t->header.buffer, t->header.used);
}

/* The item in the log's buffer to everyone. */
static void put_item(mk_telemetry_t *t, int is_step) {
    for (int i = 0; i < MK_TELEMETRY_READERS; i++) {
        mk_reader_queue_t *const q = &t->queue[i];
        if (q->fd < 0) continue;
        if (!queue_put(q, t->log.out.buffer, t->log.out.used)) t->dropped++;
        else if (is_step) q->items++;
        if (t->kind == MK_CHANNEL_FILE) queue_write(t, q);
    }
    if (t->udp >= 0) {
        const int due = is_step && (t->items - 1) % MK_TELEMETRY_HEADER == 0;
        if (due && send(t->udp, t->header.buffer, t->header.used, MSG_DONTWAIT | MSG_NOSIGNAL) < 0) t->reason = errno;
        if (send(t->udp, t->log.out.buffer, t->log.out.used, MSG_DONTWAIT | MSG_NOSIGNAL) < 0) {
            t->dropped++;
            t->reason = errno;
        }
    }
    t->log.out.used = 0;
}

/* --- beginning and end ----------------------------------------------------------------------------------------------------- */

static void make_header(mk_telemetry_t *t, const mk_settings_t *s, const mk_scenario_t *scenario, const char *real) {
    mk_scenario_t timed = *scenario;
    mk_run_facts_t facts;
    const int slots = scenario->first[s->node + 1] - scenario->first[s->node], first[2] = {0, slots};
    memset(&facts, 0, sizeof facts);
    timed.dt_s = (double)s->period_ns * 1e-9;
    facts.filter = scenario->tolerance > 0.0 ? "rkfdnu2" : "kfd";
    facts.real = real;
    facts.source = "live";
    facts.truth = "unknown";
    facts.runs = 1;
    facts.estimators = 1;
    facts.estimator_node = &t->node;
    facts.first = first;
    facts.slot = scenario->slot + scenario->first[s->node];
    mk_log_header(&t->log, &timed, &facts);
    mk_cbor_append(&t->header, t->log.out.buffer, t->log.out.used);
    t->log.out.used = 0;
}

int mk_telemetry_open(mk_telemetry_t *t, const mk_settings_t *s, const mk_scenario_t *scenario, const char *real, mk_error_t *error) {
    memset(t, 0, sizeof *t);
    t->kind = s->telemetry.kind;
    t->listener = t->udp = -1;
    t->scenario = scenario;
    t->node = s->node;
    mk_log_keep(&t->log);
    for (int i = 0; i < MK_TELEMETRY_READERS; i++) t->queue[i].fd = -1;
    if (t->kind == MK_CHANNEL_NONE) return 1;
    make_header(t, s, scenario, real);
    t->row = mk_allocate((size_t)scenario->nodes + 1, sizeof *t->row);
    for (int k = 0; k < scenario->nodes; k++) t->row[k + 1] = t->row[k] + scenario->sensor[k].rows;
    const mk_topology_t topology = mk_distributed_topology(scenario);
    t->most = mk_topology_rows(&topology, scenario, s->node);
    t->measurements = mk_allocate((size_t)t->row[scenario->nodes], sizeof *t->measurements);
    if (t->kind == MK_CHANNEL_STANDARD) queue_open(t, &t->queue[0], STDOUT_FILENO);
    if (t->kind == MK_CHANNEL_FILE) {
        const int fd = open(s->telemetry.text, O_WRONLY | O_CREAT | O_TRUNC | O_NONBLOCK | O_CLOEXEC, 0666);
        if (fd < 0) return mk_settings_bad(s, "telemetry", error, "%.200s: %s", s->telemetry.text, strerror(errno));
        queue_open(t, &t->queue[0], fd);
    }
    if (t->kind == MK_CHANNEL_UNIX) {
        t->listener = mk_socket_listen(s, "telemetry", &s->telemetry, SOCK_STREAM, error);
        if (t->listener < 0) return 0;
        t->path = s->telemetry.text;
    }
    if (t->kind == MK_CHANNEL_UDP) {
        if (t->header.used > 65000)
            return mk_settings_bad(s, "telemetry", error, "the scenario (%zu bytes) does not fit in a datagram: use unix:PATH",
                                   scenario->text_length);
        t->udp = mk_socket_connect(s, "telemetry", s->telemetry.text, error);
        if (t->udp < 0) return 0;
    }
    return 1;
}

void mk_telemetry_close(mk_telemetry_t *t) {
    const int64_t until = mk_clock_now() + LAST_MOMENT;
    struct pollfd polls[MK_TELEMETRY_READERS + 1];
    int waiting = 0;
    for (int i = 0; i < MK_TELEMETRY_READERS; i++) {
        mk_reader_queue_t *const q = &t->queue[i];
        if (q->fd < 0) continue;
        mk_log_put_end(&t->log.out, "complete", q->items);
        (void)queue_put(q, t->log.out.buffer, t->log.out.used);
        t->log.out.used = 0;
    }
    if (t->udp >= 0) {
        mk_log_put_end(&t->log.out, "complete", t->items);
        put_item(t, 0);
    }
    if (t->listener >= 0) (void)close(t->listener);
    t->listener = -1;
    do {
        const int64_t left = until - mk_clock_now();
        for (int i = 0; i < MK_TELEMETRY_READERS; i++)
            if (t->queue[i].fd >= 0 && t->queue[i].used == 0) queue_drop(t, &t->queue[i], t->reason);
        waiting = mk_telemetry_wait(t, polls);
        if (left <= 0 || waiting == 0 || poll(polls, (nfds_t)waiting, (int)(left / 1000000)) <= 0) break;
        mk_telemetry_serve(t, polls, waiting);
    } while (waiting);
    for (int i = 0; i < MK_TELEMETRY_READERS; i++) {
        if (t->queue[i].fd >= 0) queue_drop(t, &t->queue[i], t->reason);
        free(t->queue[i].bytes);
    }
    if (t->udp >= 0) (void)close(t->udp);
    if (t->path) (void)unlink(t->path);
    free(t->header.buffer);
    free(t->log.out.buffer);
    free(t->row);
    free(t->measurements);
}

/* --- steps ----------------------------------------------------------------------------------------------------------------- */

void mk_telemetry_step(mk_telemetry_t *t, int run, int64_t step, const mk_moment_t *moment, size_t size) {
    const mk_scenario_t *s = t->scenario;
    const mk_snapshot_t *seen = &moment->seen;
    if (t->kind == MK_CHANNEL_NONE) return;
    const size_t rows = (size_t)t->row[s->nodes], positions = (size_t)s->position_count;
    const int first = s->first[t->node], slots = s->first[t->node + 1] - first;
    for (size_t i = 0; i < rows; i++) t->measurements[i] = (double)NAN;
    for (int l = 0; l < slots; l++) {
        const int k = s->slot[first + l];
        for (int r = 0; r < s->sensor[k].rows; r++) t->measurements[t->row[k] + r] = moment->y[l * t->most + r];
    }
    mk_log_begin(&t->log, run, step, 13 + (positions > 0));
    mk_log_reals(&t->log, "measurements", t->measurements, 8, rows);
    mk_log_uint8(&t->log, "measurements_arrived", moment->have_y, (size_t)slots);
    mk_log_uint8(&t->log, "estimates_arrived", moment->have_psi, (size_t)slots);
    mk_log_reals(&t->log, "estimate", seen->estimate, size, (size_t)s->n);
    mk_log_reals(&t->log, "variance", seen->variance, size, (size_t)s->n);
    mk_log_reals(&t->log, "trace_covariance", seen->trace_covariance, size, 1);
    if (positions) mk_log_reals(&t->log, "position_covariance", seen->position_covariance, size, positions * (positions + 1) / 2);
    mk_log_reals(&t->log, "innovation", seen->innovation, size, (size_t)seen->own_first[1]);
    mk_log_reals(&t->log, "innovation_variance", seen->innovation_variance, size, (size_t)seen->own_first[1]);
    mk_log_reals(&t->log, "theta", seen->theta, size, 1);
    mk_log_reals(&t->log, "tolerance", seen->tolerance, size, 1);
    mk_log_reals(&t->log, "nis", seen->nis, size, 1);
    mk_log_uint32(&t->log, "nis_rows", seen->nis_rows, 1);
    mk_log_uint32(&t->log, "faults", seen->faults, 1);
    mk_log_end(&t->log);
    t->items++;
    put_item(t, 1);
}

int mk_telemetry_wait(const mk_telemetry_t *t, struct pollfd *polls) {
    int count = 0;
    if (t->listener >= 0) {
        polls[count].fd = t->listener;
        polls[count++].events = POLLIN;
    }
    for (int i = 0; i < MK_TELEMETRY_READERS; i++) {
        if (t->queue[i].fd < 0 || (t->queue[i].used == 0 && t->kind != MK_CHANNEL_UNIX)) continue;
        polls[count].fd = t->queue[i].fd;
        polls[count++].events = t->queue[i].used ? POLLOUT : 0; /* 0: to learn that the reader has gone */
    }
    return count;
}

static void accept_reader(mk_telemetry_t *t) {
    const int fd = accept(t->listener, NULL, NULL);
    if (fd < 0) return;
    int i = 0;
    while (i < MK_TELEMETRY_READERS && t->queue[i].fd >= 0) i++;
    if (i < MK_TELEMETRY_READERS && fcntl(fd, F_SETFL, O_NONBLOCK) == 0 && fcntl(fd, F_SETFD, FD_CLOEXEC) == 0) queue_open(t, &t->queue[i], fd);
    else (void)close(fd);
}

void mk_telemetry_serve(mk_telemetry_t *t, const struct pollfd *polls, int count) {
    for (int p = 0; p < count; p++) {
        if (!polls[p].revents) continue;
        if (polls[p].fd == t->listener) accept_reader(t);
        for (int i = 0; i < MK_TELEMETRY_READERS; i++) {
            mk_reader_queue_t *const q = &t->queue[i];
            if (q->fd != polls[p].fd || q->fd < 0) continue;
            if (polls[p].revents & POLLOUT) queue_write(t, q);
            else queue_drop(t, q, EPIPE);
            break;
        }
    }
}
