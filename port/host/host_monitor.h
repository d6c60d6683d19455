/* SPDX-License-Identifier: MIT */
/* Integrity monitors (meshkal/monitor.h) whose dimensions are known at run time only, and what a log says of them. */
#ifndef MESHKAL_HOST_MONITOR_H
#define MESHKAL_HOST_MONITOR_H

#include <meshkal/monitor.h>

#include "run_log.h"
#include "scenario.h"

/* What the monitors of E estimators say of an epoch, in their precision: the log's fields (log-format.md). Slots: of all of them, one after
   another. */
typedef struct {
    size_t real_size;
    int scheme;
    void *rctm, *aime, *threshold, *rho, *median; /* E */
    uint32_t *rctm_rows, *aime_rows;
    uint8_t *alarm, *ended;
    uint8_t *excluded; /* slots */
    void *isolation, *end_ratio;
} mk_monitor_snapshot_t;

mk_monitor_snapshot_t mk_monitor_snapshot_make(size_t real_size, int scheme, int estimators, size_t slots);
void mk_monitor_snapshot_free(mk_monitor_snapshot_t *snapshot);
double mk_monitor_isolation(const mk_monitor_snapshot_t *snapshot, int slot);

/* The arrays of a step item for this scheme, in their order: at most MK_MONITOR_FIELDS, how many is returned. width: bytes of an element. */
enum { MK_MONITOR_FIELDS = 12 };
typedef enum { MK_FIELD_REAL, MK_FIELD_UINT32, MK_FIELD_UINT8 } mk_field_type_t;
typedef struct {
    const char *key;
    mk_field_type_t type;
    size_t width;
    int per_slot; /* 0: one an estimator */
    const void *values;
} mk_monitor_field_t;
int mk_monitor_fields(const mk_monitor_snapshot_t *snapshot, mk_monitor_field_t *field);
/* One of them, of `count` elements, into a log: values are those of the field, or what was gathered in their place. */
void mk_log_field(mk_run_log_t *log, const mk_monitor_field_t *field, const void *values, size_t count);
/* All of them. */
void mk_log_monitor(mk_run_log_t *log, const mk_monitor_snapshot_t *snapshot, int estimators, size_t slots);

#define MK_DECLARE_HOST_MONITOR(real)                                                                                         \
    /* One block with all its arrays, not to be copied: mk_monitor_..._real(&h->view, ...) with scratch memory in `work`. */  \
    typedef struct {                                                                                                          \
        int m, places, window;                                                                                                \
        mk_monitor_config_##real##_t config;                                                                                  \
        mk_monitor_view_##real##_t view;                                                                                      \
    } mk_host_monitor_##real##_t;                                                                                             \
    /* Thresholds of the settings' false_alarm, and an empty window; m x places at most MK_MONITOR_ROWS. Free it. */          \
    mk_host_monitor_##real##_t *mk_host_monitor_open_##real(const mk_monitor_settings_t *settings, int m, int places);        \
    /* Back to how it was opened: counters and epoch, too. */                                                                 \
    void mk_host_monitor_start_##real(mk_host_monitor_##real##_t *h);                                                         \
    /* name_watch of meshkal/monitor.h. */                                                                                    \
    mk_status_t mk_host_monitor_watch_##real(mk_host_monitor_##real##_t *h, int sensors, const uint16_t *id,                  \
                                             const uint8_t *rows, const mk_##real##_t *r, const mk_##real##_t *S);            \
    /* What it says of the last epoch, as estimator e whose slots begin at `first`, with these identities. */                 \
    void mk_host_monitor_look_##real(const mk_host_monitor_##real##_t *h, const uint16_t *id, int slots, int e, size_t first, \
                                     mk_monitor_snapshot_t *snapshot);

MK_DECLARE_HOST_MONITOR(f32)
MK_DECLARE_HOST_MONITOR(f64)

#endif
