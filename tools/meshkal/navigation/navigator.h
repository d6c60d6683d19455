/* SPDX-License-Identifier: MIT */
/*
 * GNSS/INS navigation, tightly coupled, closed loop (spec 3.4): strapdown navigation in float64 between epochs, and a filter of meshkal/unscented.h
 * over its error, in either precision: n = 17, one row a satellite, MK_UPDATE_EXTENDED.
 *
 * An epoch: the samples of the inertial unit move the estimate and make transition and noise of its error (strapdown.h); the filter predicts; it is
 * given pseudoranges less those that the estimate predicts, a few metres whatever the distance, so that float32 suffices; the monitor watches the
 * innovations and, with the scheme `exclude`, the readings of satellites held faulty are dropped; the filter updates; the estimate is corrected by its
 * state, clock and biases, too, and the state becomes 0. The filter's x is therefore always 0 before readings: its innovations are what it is given.
 *
 * What goes wrong does not end a run, it is counted: an update that fails leaves the prediction.
 */
#ifndef MESHKAL_NAVIGATION_NAVIGATOR_H
#define MESHKAL_NAVIGATION_NAVIGATOR_H

#include <meshkal/unscented.h>

#include "host_monitor.h"
#include "navigation/epochs.h"

enum { MK_NAV_PACKED = MK_PACKED(MK_NAV_STATES) };

/* A pseudorange that is farther off than this is no measurement: refused, MK_ERROR_DOMAIN. */
#define MK_NAV_ABSURD_M 1e9

/* What became of a reading. */
enum { MK_NAV_NONE, MK_NAV_USED, MK_NAV_REFUSED, MK_NAV_WEIGHTED };

/* Counts of a run: readings used as they were, of weight 0, of a weight between, left out by the monitor; updates in which all weights were 0, and those
   with readings, but fewer than four; then failures by status. */
enum {
    MK_NAV_COUNT_USED,
    MK_NAV_COUNT_REFUSED,
    MK_NAV_COUNT_WEIGHTED,
    MK_NAV_COUNT_EXCLUDED,
    MK_NAV_COUNT_UNUSED,
    MK_NAV_COUNT_FEW,
    MK_NAV_COUNT_FAILED,
    MK_NAV_COUNTS = MK_NAV_COUNT_FAILED + MK_STATUS_COUNT
};

typedef struct {
    const mk_scenario_t *scenario;
    int filter;                          /* MK_NAV_EKF, ... */
    const mk_monitor_settings_t *monitor;
} mk_nav_setting_t;

/* What an epoch left. Numbers of the filter are those of its precision, exactly. */
typedef struct {
    mk_nav_state_t estimate;
    double correction[MK_NAV_STATES];    /* the filter's state before it became 0 */
    double root[MK_NAV_PACKED];          /* P = root root' of the error */
    double nis;
    uint32_t nis_rows;
    double *innovation, *S;              /* nodes; packed nodes: NaN where there is no reading */
    double *weight, *statistic;          /* nodes: 0 where nothing was read; ekf: weights of 1 */
    double *azimuth, *elevation;         /* nodes: rad, as the estimate sees them; NaN where their position is not known */
    uint8_t *arrived, *decision;         /* nodes */
    mk_monitor_snapshot_t monitor;       /* its scheme MK_MONITOR_NONE: nothing in it */
    double count[MK_NAV_COUNTS];         /* since the start of the run */
} mk_nav_look_t;

/* What the filter of one precision is given in an epoch. */
typedef struct {
    double dt;
    const double *Phi, *Q;               /* 17 x 17, packed */
    const uint8_t *have;                 /* nodes */
    const double *z, *H;                 /* nodes; nodes x 17 */
} mk_nav_input_t;

typedef struct {
    size_t real_size;
    const char *name;
    /* One object a thread. Null and an error. */
    void *(*open)(const mk_nav_setting_t *setting, mk_error_t *error);
    void (*close)(void *filter);
    mk_status_t (*start)(void *filter);
    void (*step)(void *filter, const mk_nav_input_t *input, mk_nav_look_t *look);
} mk_nav_precision_t;

extern const mk_nav_precision_t mk_nav_f32, mk_nav_f64;

/* "ekf", "rekf-n", "rekf-t". */
const char *mk_nav_filter_name(int filter);
/* Its number, MK_NAV_FILTER_COUNT for "all". 1, or 0 and an error that lists the names. */
int mk_nav_filter_find(const char *name, int *filter, mk_error_t *error);

typedef struct mk_navigator mk_navigator_t;

/* Null and an error. setting stays the caller's. */
mk_navigator_t *mk_navigator_open(const mk_nav_setting_t *setting, const mk_nav_precision_t *precision, mk_error_t *error);
void mk_navigator_close(mk_navigator_t *navigator);
mk_status_t mk_navigator_start(mk_navigator_t *navigator, const mk_nav_state_t *estimate);
/* One epoch; the look is valid until the next one. */
const mk_nav_look_t *mk_navigator_step(mk_navigator_t *navigator, const mk_epoch_t *epoch);

#endif
