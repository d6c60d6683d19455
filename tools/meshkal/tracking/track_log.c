/* SPDX-License-Identifier: MIT */
#include "tracking/track_log.h"

#include <math.h>
#include <meshkal/rkfd.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_faults.h"

static int distributed(const mk_track_setting_t *setting) { return setting->filter->kind != MK_TRACK_CENTRAL; }
static int informs(const mk_track_setting_t *setting) { return setting->filter->kind == MK_TRACK_INFORMATION; }
static int robust(const mk_track_setting_t *setting) { return setting->filter->kind == MK_TRACK_EXTENDED; }

void mk_track_log_header(mk_run_log_t *log, const mk_track_campaign_t *c, const mk_track_setting_t *setting) {
    const mk_run_facts_t facts = {c->filter->name, c->tracker->name, c->facts.drawn ? "drawn" : "recorded", c->facts.drawn ? "nominal" : "recorded",
                                  c->seed,         c->runs,          (int)c->facts.steps,                   setting->topology.estimators,
                                  c->loss,         setting->topology.first, setting->topology.slot,         NULL, NULL};
    mk_log_header_tracking(log, c->scenario, &facts, c->facts.start_s, setting->iterations);
}

static int all_rows(const mk_scenario_t *s) {
    int rows = 0;
    for (int k = 0; k < s->nodes; k++) rows += s->sensor[k].rows;
    return rows;
}

/* Of numbers on their way, and as much behind it for the same in float32. */
static size_t half_room(const mk_track_setting_t *setting) {
    const mk_scenario_t *const s = setting->scenario;
    const size_t E = (size_t)setting->topology.estimators, n = (size_t)s->n, wide = n > 6 ? n : 6, slots = (size_t)setting->topology.first[E];
    return (size_t)all_rows(s) + E * wide + slots + (size_t)s->nodes;
}

size_t mk_track_log_room(const mk_track_setting_t *setting) { return 2 * half_room(setting); }

/* float64 numbers of the filter, in its own precision again. */
static void put(mk_run_log_t *log, const mk_track_campaign_t *c, const char *key, const double *values, size_t count, float *single) {
    if (c->tracker->real_size == 4) {
        for (size_t i = 0; i < count; i++) single[i] = (float)values[i];
        mk_log_reals(log, key, single, 4, count);
    } else {
        mk_log_reals(log, key, values, 8, count);
    }
}

static void put_covariances(mk_run_log_t *log, const mk_track_campaign_t *c, const mk_track_setting_t *setting, const mk_track_look_t *look, double *work,
                            float *single) {
    const mk_scenario_t *const s = c->scenario;
    const int E = setting->topology.estimators, n = s->n, p = s->position_count, packed = MK_PACKED(n);
    for (int e = 0; e < E; e++)
        for (int i = 0; i < n; i++) work[e * n + i] = look->covariance[e * packed + MK_PACKED(i) + i];
    put(log, c, "variance", work, (size_t)(E * n), single);
    for (int e = 0; e < E; e++) {
        work[e] = 0.0;
        for (int i = 0; i < n; i++) work[e] += look->covariance[e * packed + MK_PACKED(i) + i];
    }
    put(log, c, "trace_covariance", work, (size_t)E, single);
    double *next = work;
    for (int e = 0; e < E; e++)
        for (int a = 0; a < p; a++)
            for (int b = 0; b <= a; b++) {
                const int i = s->position_states[a], j = s->position_states[b], high = i > j ? i : j, low = i > j ? j : i;
                *next++ = look->covariance[e * packed + MK_PACKED(high) + low];
            }
    if (p > 0) put(log, c, "position_covariance", work, (size_t)(E * MK_PACKED(p)), single);
}

static void put_readings(mk_run_log_t *log, const mk_scenario_t *s, const mk_instant_t *instant, double *work) {
    const int rows = all_rows(s);
    uint8_t *const flags = (uint8_t *)(work + rows), *const faults = flags + s->nodes;
    const mk_reading_t *reading = instant->reading, *const end = reading + instant->count;
    memset(flags, 0, (size_t)(2 * s->nodes));
    double *next = work;
    for (int k = 0; k < s->nodes; k++) {
        const int there = reading < end && reading->node == k;
        for (int r = 0; r < s->sensor[k].rows; r++) *next++ = there ? reading->z[r] : (double)NAN;
        flags[k] = (uint8_t)there;
        if (!there) continue;
        faults[k] = (uint8_t)(reading->faulty != 0);
        reading++;
    }
    mk_log_reals(log, "measurements", work, 8, (size_t)rows);
    mk_log_uint8(log, "measuring", flags, (size_t)s->nodes);
    mk_log_uint8(log, "faulty", faults, (size_t)s->nodes);
    if (!s->faults) return;
    memset(work, 0, (size_t)rows * sizeof *work);
    next = work;
    for (int k = 0; k < s->nodes; next += s->sensor[k++].rows) (void)mk_faults_add(s, k, instant->t, next);
    mk_log_reals(log, "fault", work, 8, (size_t)rows);
}

/* MK_FAULT_ bits, as the linear filters have them. */
static void put_faults(mk_run_log_t *log, const mk_track_setting_t *setting, const mk_instant_t *instant, const mk_track_look_t *look, double *work) {
    const mk_topology_t *const topology = &setting->topology;
    uint32_t *const faults = (uint32_t *)(void *)work;
    uint8_t *const measures = (uint8_t *)(work + topology->estimators);
    const uint32_t due = !distributed(setting) ? 0 : informs(setting) ? (uint32_t)setting->iterations : 1; /* messages of each neighbour */
    memset(measures, 0, (size_t)setting->scenario->nodes);
    for (int i = 0; i < instant->count; i++) measures[instant->reading[i].node] = 1;
    for (int e = 0; e < topology->estimators; e++) {
        const int first = topology->first[e], slots = topology->first[e + 1] - first;
        const int heard = distributed(setting) && !robust(setting) ? 1 : slots; /* slots whose readings come here */
        int used = 0;
        faults[e] = 0;
        for (int l = 0; l < slots; l++) {
            const uint8_t decision = look->decision[first + l];
            if (l < heard && measures[topology->slot[first + l]] && !look->arrived[first + l]) faults[e] |= MK_FAULT_MEASUREMENT_MISSING;
            if (l > 0 && look->messages[first + l] < due) faults[e] |= MK_FAULT_ESTIMATE_MISSING;
            if (decision == MK_READING_REFUSED) faults[e] |= MK_FAULT_REJECTED;
            used += decision == MK_READING_ACCEPTED || decision == MK_READING_INFLATED;
        }
        if (!used) faults[e] |= MK_FAULT_NO_MEASUREMENT;
    }
    mk_log_uint32(log, "faults", faults, (size_t)topology->estimators);
}

static void put_exchange(mk_run_log_t *log, const mk_track_setting_t *setting, const mk_track_look_t *look, const mk_track_errors_t *errors,
                         double *work) {
    const size_t slots = (size_t)setting->topology.first[setting->topology.estimators];
    uint8_t *const heard = (uint8_t *)work;
    for (int e = 0; e < setting->topology.estimators; e++)
        for (int first = setting->topology.first[e], i = first; i < setting->topology.first[e + 1]; i++) heard[i] = i == first || look->messages[i] > 0;
    mk_log_uint8(log, "estimates_arrived", heard, slots);
    mk_log_uint32(log, "messages_arrived", look->messages, slots);
    mk_log_reals(log, "disagreement", &errors->apart, 8, 1);
    if (informs(setting)) mk_log_reals(log, "consensus_disagreement", look->disagreement, 8, (size_t)setting->iterations + 1);
}

void mk_track_log_item(mk_run_log_t *log, const mk_track_campaign_t *c, const mk_track_setting_t *setting, int run, long step,
                       const mk_instant_t *instant, const mk_track_look_t *look, const mk_track_errors_t *errors, double *work) {
    const mk_scenario_t *const s = c->scenario;
    const size_t E = (size_t)setting->topology.estimators, slots = (size_t)setting->topology.first[E];
    const int truth = c->facts.has_truth;
    float *const single = (float *)(void *)(work + half_room(setting));
    mk_log_begin(log, run, step, 14 + 3 * truth + (s->position_count > 0) + 3 * distributed(setting) + informs(setting) + 2 * robust(setting) +
                               (s->faults > 0));
    mk_log_reals(log, "time_s", &instant->t, 8, 1);
    if (truth) mk_log_reals(log, "truth", instant->x, 8, (size_t)s->n);
    put_readings(log, s, instant, work);
    mk_log_uint8(log, "measurements_arrived", look->arrived, slots);
    mk_log_uint8(log, "decision", look->decision, slots);
    put(log, c, "gate_ratio", look->ratio, slots, single);
    put(log, c, "gate_stacked_ratio", look->stacked_ratio, E, single);
    if (distributed(setting)) put_exchange(log, setting, look, errors, work);
    put(log, c, "estimate", look->estimate, E * (size_t)s->n, single);
    if (truth) {
        mk_log_reals(log, "error", errors->error, 8, E);
        mk_log_reals(log, "nees", errors->node_nees, 8, E);
    }
    put_covariances(log, c, setting, look, work, single);
    if (robust(setting)) {
        put(log, c, "theta", look->theta, E, single);
        for (size_t e = 0; e < E; e++) work[e] = s->tolerance;
        put(log, c, "tolerance", work, E, single);
    }
    put(log, c, "nis", look->nis, E, single);
    mk_log_uint32(log, "nis_rows", look->nis_rows, E);
    put_faults(log, setting, instant, look, work);
    mk_log_end(log);
}
