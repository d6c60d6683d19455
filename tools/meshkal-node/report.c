/* SPDX-License-Identifier: MIT */
#include <inttypes.h>
#include <limits.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "daemon.h"

/* To standard error as far as somebody takes it: a reader that sleeps does not stop the node. */
static void put(const char *text, size_t length) {
    struct pollfd out = {STDERR_FILENO, POLLOUT, 0};
    while (length > 0 && poll(&out, 1, 0) == 1 && out.revents & POLLOUT) {
        const ssize_t done = write(STDERR_FILENO, text, length < PIPE_BUF ? length : PIPE_BUF);
        if (done <= 0) return;
        text += done;
        length -= (size_t)done;
    }
}

void mk_daemon_say(const mk_daemon_t *d, const char *format, ...) {
    char message[1100], text[1200];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    const int length = snprintf(text, sizeof text, "meshkal-node %d: %s\n", d->settings.node, message);
    put(text, (size_t)length);
}

void mk_daemon_report(const mk_daemon_t *d) {
    const mk_tally_t *t = &d->tally;
    const mk_object_look_t look = d->kind->look(d->object);
    const mk_readings_t *r = &d->readings;
    /* In one piece: reports of many nodes on one terminal stay apart. */
    char text[8192];
    size_t used = 0;
#define PUT(...) (used += used < sizeof text ? (size_t)snprintf(text + used, sizeof text - used, __VA_ARGS__) : 0)
    PUT("meshkal-node %d: step %" PRId64 "\n", d->settings.node, d->step);
    PUT("  steps done %" PRIu64 ", left out %" PRIu64 " in %" PRIu64 " jumps, ", t->steps, t->jumped, t->jumps);
    PUT("of the neighbours' clocks %" PRIu64 " in %" PRIu64 ", clock put back %" PRIu64 "\n", t->pulled_steps, t->pulled, t->put_back);
    PUT("  made up for %" PRIu32 ", started again after long silence %" PRIu64, look.caught_up - d->before.caught_up, t->restarts);
    PUT(", by the gate %" PRIu32 ", after failures %" PRIu64 "\n", look.reinitialised - d->before.reinitialised, t->failures);
    PUT("  frames sent %" PRIu64 ", belated %" PRIu64 ", not written %" PRIu32, t->sent, t->belated, look.unsent - d->before.unsent);
    PUT("; datagrams sent %" PRIu64 ", refused by the system %" PRIu64 "%s%s\n", d->radio.sent, d->radio.failed, d->radio.failed ? ": " : "",
        d->radio.failed ? strerror(d->radio.reason) : "");
    PUT("  datagrams received %" PRIu64 ", early %" PRIu32 ";", d->radio.received, look.early - d->before.early);
    for (int i = 0; i < MK_STATUS_COUNT; i++)
        if (look.counts[i] != d->counts_before[i]) PUT(" %s %" PRIu32, mk_status_name((mk_status_t)i), look.counts[i] - d->counts_before[i]);
    PUT("\n  own readings taken %" PRIu64 ", late %" PRIu64 ", too far ahead %" PRIu64, r->taken, r->late, r->ahead);
    PUT(", repeated %" PRIu64 ", refused %" PRIu64 "%s%s\n", r->repeated + t->reading_repeated, r->refused, r->refused ? ": " : "", r->complaint);
    PUT("  missing (readings, estimates):");
    for (int l = 0; l < d->slots; l++)
        PUT(" %d: %" PRIu64 ", %" PRIu64 "%s", d->scenario.slot[d->scenario.first[d->settings.node] + l], t->reading_missing[l],
            t->estimate_missing[l], l + 1 < d->slots ? ";" : "\n");
    PUT("  telemetry items %" PRIu64 ", dropped %" PRIu64 "%s%s\n", d->telemetry.items, d->telemetry.dropped, d->telemetry.reason ? ": " : "",
        d->telemetry.reason ? strerror(d->telemetry.reason) : "");
#undef PUT
    put(text, used < sizeof text ? used : sizeof text - 1);
}
