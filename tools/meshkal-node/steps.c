/* SPDX-License-Identifier: MIT */
#include "daemon.h"

/* Steps modulo 2^32 that are still ahead. */
#define HALF 0x80000000u

static void send_frame(mk_daemon_t *d, int stage) {
    const size_t length = d->kind->frame(d->object, stage, d->frame);
    if (length == 0) return;
    /* After a sleep what was due then is made up for, but nobody waits for it any more. */
    if (mk_clock_now() >= mk_clock_end(&d->clock, d->step, stage)) {
        d->tally.belated++;
        return;
    }
    mk_radio_send(&d->radio, d->frame, length);
    d->tally.sent++;
}

void mk_daemon_feed(mk_daemon_t *d) {
    if (d->kind->look(d->object).stage != 1) return;
    const double *const y = mk_readings_take(&d->readings, d->step);
    if (!y) return;
    if (d->kind->measure(d->object, y) != MK_OK) d->tally.reading_repeated++;
    else send_frame(d, MK_STAGE_MEASUREMENT);
}

/* The filter cannot go on: the way back is x0 and P0. */
static int start_again(mk_daemon_t *d, const char *what, mk_status_t status, mk_error_t *error) {
    if (d->tally.failures++ < 10)
        mk_daemon_say(d, "step %lld: %s: %s; starting again from x0 and P0", (long long)d->step, what, mk_status_name(status));
    const mk_status_t again = d->kind->restart(d->object);
    return again == MK_OK || mk_fail(error, "step %lld: cannot start again: %s", (long long)d->step, mk_status_name(again));
}

/* Where the object is, which counts modulo 2^32 and never goes back. */
static void follow(mk_daemon_t *d, uint32_t restarts_before) {
    const mk_object_look_t look = d->kind->look(d->object);
    d->step += (uint32_t)(look.step - (uint32_t)d->step);
    d->tally.restarts += look.restarts != restarts_before;
}

/* Forward by `steps` modulo 2^32, less than half of them. */
static int advance(mk_daemon_t *d, uint32_t steps, mk_error_t *error) {
    const uint32_t to = d->kind->look(d->object).step + steps;
    for (int attempt = 0; attempt < 2; attempt++) {
        const mk_status_t status = d->kind->advance(d->object, to);
        if (status == MK_OK || d->kind->look(d->object).step == to) return 1;
        if (!start_again(d, "making up for missed steps", status, error)) return 0;
    }
    return mk_fail(error, "step %lld: cannot make up for missed steps", (long long)d->step);
}

int mk_daemon_go(mk_daemon_t *d, int64_t step, mk_error_t *error) {
    const uint32_t restarts = d->kind->look(d->object).restarts;
    uint32_t left = (uint32_t)step - d->kind->look(d->object).step;
    /* The object knows half of the steps as ahead and half as past: backwards is twice far ahead. */
    for (; left >= HALF; left -= HALF - 1)
        if (!advance(d, HALF - 1, error)) return 0;
    if (left && !advance(d, left, error)) return 0;
    d->step = step;
    d->tally.restarts += d->kind->look(d->object).restarts != restarts;
    return 1;
}

static int end_readings(mk_daemon_t *d, mk_error_t *error) {
    mk_status_t status = d->kind->incremental(d->object);
    if (status != MK_OK) {
        if (!start_again(d, "incremental step", status, error)) return 0;
        status = d->kind->incremental(d->object);
    }
    if (status != MK_OK) return mk_fail(error, "step %lld: incremental step: %s", (long long)d->step, mk_status_name(status));
    const mk_moment_t *moment = d->kind->moment(d->object);
    for (int l = 0; l < d->slots; l++) d->tally.reading_missing[l] += !moment->have_y[l];
    send_frame(d, MK_STAGE_ESTIMATE);
    return 1;
}

static int end_step(mk_daemon_t *d, int64_t time, mk_error_t *error) {
    const int64_t step = d->step;
    const uint32_t restarts = d->kind->look(d->object).restarts;
    const mk_status_t status = d->kind->diffuse(d->object);
    if (status != MK_OK && !start_again(d, "diffusion", status, error)) return 0;
    const mk_moment_t *moment = d->kind->moment(d->object);
    for (int l = 0; l < d->slots; l++) d->tally.estimate_missing[l] += !moment->have_psi[l];
    mk_telemetry_step(&d->telemetry, (int)d->tally.put_back, step, moment, d->kind->real_size);
    d->tally.steps++;
    follow(d, restarts);
    if (d->step == step) return mk_daemon_go(d, step + 1, error); /* started again in the middle of a step */
    const int64_t lead = d->step - mk_clock_step(&d->clock, time);
    if (lead <= 0 || d->step == step + 1) return 1;
    /* Most neighbours are ahead of this clock, and the object has followed them. So does the clock, or the next steps would wait for it. */
    d->clock.epoch -= lead * d->clock.period;
    d->tally.pulled_steps += (uint64_t)lead;
    if (d->tally.pulled++ < 10)
        mk_daemon_say(d, "step %lld: the neighbours are %lld steps ahead of this clock: following them", (long long)step, (long long)lead);
    return 1;
}

int mk_daemon_until(mk_daemon_t *d, int64_t time, int now, mk_error_t *error) {
    for (;;) {
        const int64_t step = mk_clock_step(&d->clock, time), lead = step - d->step;
        const int stage = d->kind->look(d->object).stage;
        if (stage == 1 && lead > 1) {
            /* Asleep, or held up, for whole steps. */
            d->tally.jumps++;
            d->tally.jumped += (uint64_t)lead;
            if (!mk_daemon_go(d, d->step + lead, error)) return 0;
        } else if (now && step >= 0 && -lead > d->settings.catch_up + 1) {
            if (stage == 2) {
                if (!end_step(d, time, error)) return 0;
                continue;
            }
            if (d->tally.put_back++ < 10)
                mk_daemon_say(d, "step %lld: the clock has been put back by %lld steps: starting again there", (long long)d->step, (long long)-lead);
            if (!mk_daemon_go(d, d->step + lead, error)) return 0;
        } else if (time < mk_clock_end(&d->clock, d->step, stage)) {
            return 1;
        } else if (stage == 1) {
            if (!end_readings(d, error)) return 0;
            continue;
        } else if (!end_step(d, time, error)) {
            return 0;
        }
        mk_daemon_feed(d);
    }
}
