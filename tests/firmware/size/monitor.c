/* SPDX-License-Identifier: MIT */
/* Runs a monitor over fault-free epochs, then over faults of up to four sensors, for the instruction counter (count.c), and measures its stack: every
   sensor is read in every epoch, S is dense. Writes what size.py reads:  usual EPOCHS  those of the first kind,  found FAULTS ENDS,
   stack FUNCTION BYTES,  ram BYTES. */
#include <string.h>

#include "markers.h"
#include "monitor_node.h"
#include "semihost.h"
#include "stack.h"

enum { PLACES = SIZE_PLACES, M = SIZE_M, WINDOW = SIZE_WINDOW, N = PLACES * M, USUAL = 4 * WINDOW, FAULTY = 6 * WINDOW };

MARKER(size_begin_start)
MARKER(size_begin_watch)

enum { START, WATCH, FUNCTIONS };
static const char *const names[FUNCTIONS] = {"start", "watch"};
static uint32_t worst[FUNCTIONS];
static watcher_t monitor;
static watcher_config_t config;
static float threshold[N], L[MK_PACKED(N)], S[MK_PACKED(N)], r[N];
static const float zero[] = {10.83f, 13.82f}, back[] = {2.706f, 4.605f};
static uint16_t id[PLACES];
static uint8_t rows[PLACES];
static uint32_t seed = 1;

/* Uniform on [-1, 1). */
static float draw(void) {
    seed = seed * UINT32_C(1664525) + UINT32_C(1013904223);
    return (float)((int32_t)seed >> 8) * (1.0f / 8388608.0f);
}

/* Faults begin one after another and end together. */
static float fault_of(int sensor, int t) {
    const int from = USUAL + sensor * WINDOW / 2;
    return sensor < 4 && t > from && t < USUAL + 4 * WINDOW ? 8.0f + 0.5f * (float)(t - from) : 0.0f;
}

static void draw_epoch(int t) {
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < i; j++) L[MK_PACKED(i) + j] = 0.125f * draw();
        L[MK_PACKED(i) + i] = 1.25f + 0.25f * draw();
        r[i] = i % M == 0 ? fault_of(i / M, t) : 0.0f;
    }
    for (int i = 0; i < N; i++) {
        const float z = draw() + draw() + draw();
        for (int k = i; k < N; k++) r[k] += L[MK_PACKED(k) + i] * z;
        for (int j = 0; j <= i; j++) {
            float sum = 0.0f;
            for (int k = 0; k <= j; k++) sum += L[MK_PACKED(i) + k] * L[MK_PACKED(j) + k];
            S[MK_PACKED(i) + j] = sum;
        }
    }
}

int main(void) {
    mk_status_t status;
    int held = 0;
    size_loops();
    for (int i = 0; i < N; i++) threshold[i] = 15.0f + 3.0f * (float)i; /* about chi-square at 1e-4 */
    for (int p = 0; p < PLACES; p++) {
        id[p] = (uint16_t)(40 - p);
        rows[p] = M;
    }
    config.m = M;
    config.places = PLACES;
    config.window = WINDOW;
    config.threshold = threshold;
    config.separation = 4.0f;
    config.evidence = 11.5f;
    config.zero = zero;
    config.back = back;
    config.level = 0.01f;
    config.slope = 1e-4f;
    config.most = 4;
    config.patience = 5;
    config.scheme = MK_MONITOR_EXCLUDE;
    CALL(START, size_begin_start, monitor_start(&monitor, &config));
    for (int t = 0; t < USUAL + FAULTY && status == MK_OK; t++) {
        draw_epoch(t);
        CALL(WATCH, size_begin_watch, monitor_watch(&monitor, id, rows, r, S));
        int now = 0;
        for (int p = 0; p < PLACES; p++) now += monitor_faulty(&monitor, id[p]);
        if (now > held) held = now;
    }
    mk_write("usual ");
    mk_write_number(USUAL);
    mk_write("\nfound ");
    mk_write_number((uint32_t)held);
    mk_write(" ");
    mk_write_number(monitor.core.ends);
    mk_write("\n");
    size_tell(FUNCTIONS, names, worst, (uint32_t)sizeof monitor);
    return status != MK_OK || held < 2 || monitor.core.ends == 0;
}
