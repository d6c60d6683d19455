/* SPDX-License-Identifier: MIT */
#include "host_monitor.h"

#include <stdlib.h>
#include <string.h>

#define MK_BITS 32
#include <meshkal/real.h>
#include "host_monitor.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "host_monitor.tmpl.h"
#undef MK_BITS

mk_monitor_snapshot_t mk_monitor_snapshot_make(size_t real_size, int scheme, int estimators, size_t slots) {
    const size_t E = (size_t)estimators;
    mk_monitor_snapshot_t snapshot;
    snapshot.real_size = real_size;
    snapshot.scheme = scheme;
    snapshot.rctm = mk_allocate(E, real_size);
    snapshot.aime = mk_allocate(E, real_size);
    snapshot.threshold = mk_allocate(E, real_size);
    snapshot.rho = mk_allocate(E, real_size);
    snapshot.median = mk_allocate(E, real_size);
    snapshot.rctm_rows = mk_allocate(E, sizeof *snapshot.rctm_rows);
    snapshot.aime_rows = mk_allocate(E, sizeof *snapshot.aime_rows);
    snapshot.alarm = mk_allocate(E, 1);
    snapshot.ended = mk_allocate(E, 1);
    snapshot.excluded = mk_allocate(slots, 1);
    snapshot.isolation = mk_allocate(slots, real_size);
    snapshot.end_ratio = mk_allocate(slots, real_size);
    return snapshot;
}

void mk_monitor_snapshot_free(mk_monitor_snapshot_t *snapshot) {
    free(snapshot->rctm);
    free(snapshot->aime);
    free(snapshot->threshold);
    free(snapshot->rho);
    free(snapshot->median);
    free(snapshot->rctm_rows);
    free(snapshot->aime_rows);
    free(snapshot->alarm);
    free(snapshot->ended);
    free(snapshot->excluded);
    free(snapshot->isolation);
    free(snapshot->end_ratio);
}

double mk_monitor_isolation(const mk_monitor_snapshot_t *s, int slot) {
    return s->real_size == sizeof(float) ? (double)((const float *)s->isolation)[slot] : ((const double *)s->isolation)[slot];
}

int mk_monitor_fields(const mk_monitor_snapshot_t *s, mk_monitor_field_t *field) {
    const mk_monitor_field_t all[MK_MONITOR_FIELDS] = {{"monitor_rctm", MK_FIELD_REAL, s->real_size, 0, s->rctm},
                                                       {"monitor_rctm_rows", MK_FIELD_UINT32, 4, 0, s->rctm_rows},
                                                       {"monitor_aime", MK_FIELD_REAL, s->real_size, 0, s->aime},
                                                       {"monitor_aime_rows", MK_FIELD_UINT32, 4, 0, s->aime_rows},
                                                       {"monitor_threshold", MK_FIELD_REAL, s->real_size, 0, s->threshold},
                                                       {"monitor_alarm", MK_FIELD_UINT8, 1, 0, s->alarm},
                                                       {"monitor_ended", MK_FIELD_UINT8, 1, 0, s->ended},
                                                       {"excluded", MK_FIELD_UINT8, 1, 1, s->excluded},
                                                       {"isolation", MK_FIELD_REAL, s->real_size, 1, s->isolation},
                                                       {"monitor_rho", MK_FIELD_REAL, s->real_size, 0, s->rho},
                                                       {"monitor_median", MK_FIELD_REAL, s->real_size, 0, s->median},
                                                       {"end_ratio", MK_FIELD_REAL, s->real_size, 1, s->end_ratio}};
    int count = 0;
    for (int i = 0; i < MK_MONITOR_FIELDS; i++) {
        if (i >= 9 && s->scheme != (i == 11 ? MK_MONITOR_EXCLUDE : MK_MONITOR_IMPROVED)) continue;
        field[count++] = all[i];
    }
    return count;
}

void mk_log_field(mk_run_log_t *log, const mk_monitor_field_t *field, const void *values, size_t count) {
    if (field->type == MK_FIELD_REAL) mk_log_reals(log, field->key, values, field->width, count);
    else if (field->type == MK_FIELD_UINT32) mk_log_uint32(log, field->key, values, count);
    else mk_log_uint8(log, field->key, values, count);
}

void mk_log_monitor(mk_run_log_t *log, const mk_monitor_snapshot_t *snapshot, int estimators, size_t slots) {
    mk_monitor_field_t field[MK_MONITOR_FIELDS];
    const int count = mk_monitor_fields(snapshot, field);
    for (int i = 0; i < count; i++) mk_log_field(log, &field[i], field[i].values, field[i].per_slot ? slots : (size_t)estimators);
}
