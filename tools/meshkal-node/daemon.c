/* SPDX-License-Identifier: MIT */
/* ppoll and signalfd are not POSIX. */
#define _GNU_SOURCE
#include "daemon.h"

#include <errno.h>
#include <jansson.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include "design/design.h"
#include "file.h"

/* Datagrams that are taken before the clock is looked at again. */
#define AT_ONCE 64

/* --- tolerance ------------------------------------------------------------------------------------------------------------- */

/* c of this node, out of what `meshkal design --json` has written. */
static int read_design(mk_daemon_t *d, mk_error_t *error) {
    const mk_settings_t *s = &d->settings;
    mk_error_t why;
    json_error_t place;
    size_t length;
    char *text = mk_read_file(s->design, &length, &why);
    if (!text) return mk_settings_bad(s, "design", error, "%s", why.text);
    json_t *root = json_loadb(text, length, JSON_REJECT_DUPLICATES, &place);
    free(text);
    if (!root) return mk_settings_bad(s, "design", error, "%s:%d:%d: %s", s->design, place.line, place.column, place.text);
    json_t *hash = json_object_get(root, "scenario_sha256"), *nodes = json_object_get(root, "nodes");
    json_t *tolerance = json_object_get(json_array_get(nodes, (size_t)s->node), "tolerance");
    int good = 1;
    if (!json_is_string(hash) || !json_is_number(tolerance)) {
        good = mk_settings_bad(s, "design", error, "%.200s: no result of meshkal design --json with node %d", s->design, s->node);
    } else if (strcmp(json_string_value(hash), d->scenario.sha256) != 0) {
        good = mk_settings_bad(s, "design", error, "%.200s: made from another scenario than %.200s: run meshkal design again", s->design,
                               s->scenario);
    } else {
        d->tolerance = json_number_value(tolerance);
    }
    json_decref(root);
    return good;
}

static int make_design(mk_daemon_t *d, mk_error_t *error) {
    mk_design_t design;
    if (d->settings.design) return read_design(d, error);
    if (!mk_design_central(&design, &d->scenario, d->scenario.tolerance, error)) return 0;
    const int good = mk_design_local(&design, &d->scenario, &d->settings.node, 1, 1, &d->tolerance, error);
    mk_design_free(&design);
    return good;
}

/* --- beginning and end ----------------------------------------------------------------------------------------------------- */

static int make_object(mk_daemon_t *d, mk_error_t *error) {
    const mk_settings_t *s = &d->settings;
    const mk_object_facts_t facts = {s->node, s->numbers, s->catch_up, d->tolerance, s->gate_reading, s->gate_estimate, s->patience};
    d->kind = s->bits == 32 ? &mk_object_f32 : &mk_object_f64;
    d->object = d->kind->open(&d->scenario, &facts);
    d->frame = mk_allocate(d->kind->frame_max(d->object), 1);
    d->blob = mk_allocate(d->kind->blob_max(d->object), 1);
    d->datagram = mk_allocate(MK_DATAGRAM, 1);
    d->slots = d->scenario.first[s->node + 1] - d->scenario.first[s->node];
    d->tally.reading_missing = mk_allocate(2 * (size_t)d->slots, sizeof *d->tally.reading_missing);
    d->tally.estimate_missing = d->tally.reading_missing + d->slots;
    d->clock.period = s->period_ns;
    d->clock.epoch = s->epoch_ns;
    d->clock.first = (int64_t)((double)s->period_ns * s->split);
    const mk_status_t status = d->kind->start(d->object);
    return status == MK_OK || mk_fail(error, "%s: node %d cannot start in float%d: %s", s->scenario, s->node, s->bits, mk_status_name(status));
}

/* The object's step as one that is not modulo 2^32, near that of the clock. */
static int join_in(mk_daemon_t *d, mk_error_t *error) {
    const int64_t clock = mk_clock_step(&d->clock, mk_clock_now()), at = clock > 0 ? clock : 0;
    const int restored = mk_daemon_restore(d);
    d->before = d->kind->look(d->object);
    memcpy(d->counts_before, d->before.counts, sizeof d->counts_before);
    if (restored) {
        const int64_t behind = (int32_t)(uint32_t)((uint32_t)at - d->kind->look(d->object).step);
        if (d->kind->look(d->object).stage == 2 && d->kind->diffuse(d->object) != MK_OK) (void)d->kind->restart(d->object);
        if (behind < 0 && -behind <= d->settings.catch_up) {
            d->step = at - behind; /* the clock was put back a little: wait for it */
            return 1;
        }
        mk_daemon_say(d, "the state is %lld steps old: %s", (long long)behind,
                      behind >= 0 && behind <= d->settings.catch_up ? "making up for them" : "starting again from x0 and P0");
    }
    const int good = mk_daemon_go(d, at, error);
    if (!restored) d->tally.restarts = 0; /* a start is none */
    return good;
}

/* Signals arrive as input, at no other place than the loop. */
static int catch_signals(mk_daemon_t *d, mk_error_t *error) {
    sigset_t set;
    (void)sigemptyset(&set);
    (void)sigaddset(&set, SIGINT);
    (void)sigaddset(&set, SIGTERM);
    (void)sigaddset(&set, SIGUSR1);
    (void)sigprocmask(SIG_BLOCK, &set, NULL);
    (void)signal(SIGPIPE, SIG_IGN);
    d->signals = signalfd(-1, &set, SFD_NONBLOCK | SFD_CLOEXEC);
    return d->signals >= 0 || mk_fail(error, "signals: %s", strerror(errno));
}

static int open_rest(mk_daemon_t *d, mk_error_t *error) {
    const mk_settings_t *s = &d->settings;
    if (!make_design(d, error) || !make_object(d, error) || !mk_radio_open(&d->radio, s, error) ||
        !mk_readings_open(&d->readings, s, d->scenario.sensor[s->node].rows, error) || !mk_keys_open(&d->keys, s, error) ||
        !mk_telemetry_open(&d->telemetry, s, &d->scenario, d->kind->name, error) || !catch_signals(d, error) || !join_in(d, error))
        return 0;
    if (s->key && d->kind->secure(d->object, &d->keys.aead, d->keys.sequence) != MK_OK) return mk_fail(error, "cannot seal frames");
    d->save_at = mk_clock_now() + (int64_t)(s->state_every_s * 1e9);
    return 1;
}

int mk_daemon_open(mk_daemon_t *d, const char *path, mk_error_t *error) {
    memset(d, 0, sizeof *d);
    d->radio.fd = d->readings.fd = d->keys.boots = d->signals = -1;
    d->telemetry.listener = d->telemetry.udp = -1;
    if (!mk_settings_load(&d->settings, &d->scenario, path, error)) return 0;
    if (open_rest(d, error)) return 1;
    mk_daemon_close(d);
    return 0;
}

void mk_daemon_close(mk_daemon_t *d) {
    mk_telemetry_close(&d->telemetry);
    mk_readings_close(&d->readings);
    mk_radio_close(&d->radio);
    mk_keys_close(&d->keys);
    if (d->signals >= 0) (void)close(d->signals);
    if (d->object) d->kind->close(d->object);
    free(d->frame);
    free(d->blob);
    free(d->datagram);
    free(d->tally.reading_missing);
    mk_scenario_free(&d->scenario);
    mk_settings_free(&d->settings);
}

/* --- work ------------------------------------------------------------------------------------------------------------------ */

static int take_frames(mk_daemon_t *d, mk_error_t *error) {
    for (int i = 0; i < AT_ONCE; i++) {
        int64_t arrived;
        const long length = mk_radio_receive(&d->radio, d->datagram, &arrived);
        if (length < 0) return 1;
        /* A stage that ended before the frame came ends before it is looked at, and no other. */
        const int64_t now = mk_clock_now();
        if (arrived > 0 && arrived <= now && !mk_daemon_until(d, arrived, 0, error)) return 0;
        (void)d->kind->accept(d->object, d->datagram, (size_t)length);
    }
    return 1;
}

static void take_readings(mk_daemon_t *d) {
    const int64_t first = d->step + (d->kind->look(d->object).stage == 2), time = mk_clock_now(), step = mk_clock_step(&d->clock, time);
    /* Frames and the clock are looked at after this: a reading for a step may still come first, one for "now" knows the time. */
    const int64_t now = step + (time >= mk_clock_end(&d->clock, step, 1));
    mk_readings_read(&d->readings, first, now > first ? now : first);
    mk_daemon_feed(d);
}

/* 1 once the end has been asked for. */
static int take_signals(mk_daemon_t *d) {
    struct signalfd_siginfo info;
    while (read(d->signals, &info, sizeof info) == (ssize_t)sizeof info) {
        if (info.ssi_signo != SIGUSR1) return 1;
        mk_daemon_report(d);
    }
    return 0;
}

static void wait_for(const mk_daemon_t *d, struct pollfd *polls, int count, int64_t until) {
    const int64_t left = until - mk_clock_now();
    struct timespec span = {0, 0};
    if (left > 0) {
        span.tv_sec = (time_t)(left / 1000000000);
        span.tv_nsec = (long)(left % 1000000000);
    }
    (void)d;
    if (ppoll(polls, (nfds_t)count, &span, NULL) < 0)
        for (int i = 0; i < count; i++) polls[i].revents = 0;
}

int mk_daemon_run(mk_daemon_t *d, mk_error_t *error) {
    enum { SIGNALS, RADIO, READINGS, OWN };
    struct pollfd polls[OWN + MK_TELEMETRY_READERS + 1];
    for (;;) {
        const int stage = d->kind->look(d->object).stage;
        polls[SIGNALS].fd = d->signals;
        polls[RADIO].fd = d->radio.fd;
        polls[READINGS].fd = d->readings.fd; /* negative: left out */
        for (int i = 0; i < OWN; i++) polls[i].events = POLLIN;
        const int others = mk_telemetry_wait(&d->telemetry, polls + OWN);
        /* No longer than a step: the clock may be put back meanwhile. */
        int64_t until = mk_clock_end(&d->clock, d->step, stage);
        if (until > mk_clock_now() + d->clock.period) until = mk_clock_now() + d->clock.period;
        if (d->settings.state && d->save_at < until) until = d->save_at;
        wait_for(d, polls, OWN + others, until);
        if (polls[SIGNALS].revents && take_signals(d)) return 1;
        if (polls[READINGS].revents) take_readings(d);
        if (polls[RADIO].revents && !take_frames(d, error)) return 0;
        if (!mk_daemon_until(d, mk_clock_now(), 1, error)) return 0;
        mk_telemetry_serve(&d->telemetry, polls + OWN, others);
        if (d->settings.state && mk_clock_now() >= d->save_at) {
            mk_daemon_save(d);
            d->save_at = mk_clock_now() + (int64_t)(d->settings.state_every_s * 1e9);
        }
    }
}
