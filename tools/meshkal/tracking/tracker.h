/* SPDX-License-Identifier: MIT */
/*
 * The filters of a tracking scenario over one run: one estimator at a centre that hears all nodes, or one in each node. Runs the library's own
 * kernels, in either precision.
 *
 * A step is an instant of the run (events.h): every estimator predicts over the time since the last one, takes the readings that reach it
 * and updates. Its estimate then belongs to the instant. Nothing that goes wrong in it ends the run; it is counted:
 *   - a model that refuses a reading, or whose result is not finite: the update goes on without that reading;
 *   - an update that fails otherwise: the estimate is the prediction;
 *   - a prediction that fails: P := P0, x stays; if it fails again, the next prediction is over both intervals.
 *
 * Messages: a centre hears each reading over a link. In the distributed filters nodes hear their neighbours: readings, then estimates
 * (rekfd); contributions with estimates (kcf); consensus messages of each iteration (duif). Each message is lost with probability `loss`,
 * drawn from (seed, run, node that hears, instant).
 */
#ifndef MESHKAL_TRACKING_TRACKER_H
#define MESHKAL_TRACKING_TRACKER_H

#include "design/node_config.h"
#include "tracking/events.h"

typedef enum { MK_TRACK_CENTRAL, MK_TRACK_INFORMATION, MK_TRACK_CONSENSUS, MK_TRACK_EXTENDED } mk_track_kind_t;

typedef struct {
    const char *name;
    mk_track_kind_t kind;
} mk_tracking_filter_t;

extern const mk_tracking_filter_t mk_tracking_filters[MK_TRACKING_FILTER_COUNT];

/* The filter of that name, null for "all". 1, or 0 and an error that lists the names. */
int mk_tracking_filter_find(const char *name, const mk_tracking_filter_t **filter, mk_error_t *error);

/* Counts of a run: readings that were used as they were, refused by the gate, used with inflated noise, refused by a model, and lost on the
   way to the estimator; updates with readings, those that a rule ended, those with P := P0; node steps of duif and kcf in which no message
   came, nobody measured as far as was heard, or there was no average that makes a covariance; then failures by status. */
enum {
    MK_TRACK_ACCEPTED,
    MK_TRACK_REJECTED,
    MK_TRACK_INFLATED,
    MK_TRACK_REFUSED,
    MK_TRACK_LOST,
    MK_TRACK_UPDATES,
    MK_TRACK_RULE,
    MK_TRACK_REINITIALISED,
    MK_TRACK_ISOLATED,
    MK_TRACK_UNINFORMED,
    MK_TRACK_UNFUSED,
    MK_TRACK_FAILED,
    MK_TRACK_COUNTS = MK_TRACK_FAILED + MK_STATUS_COUNT
};

/* What became of a reading. */
enum { MK_READING_NONE, MK_READING_ACCEPTED, MK_READING_REJECTED, MK_READING_INFLATED, MK_READING_REFUSED };

/* What the estimators say after a step. Numbers are those of the precision that they compute in, exactly. */
typedef struct {
    double *estimate, *covariance; /* E x n; E x packed n */
    double *nis;                   /* E: normalised innovation squared of the readings used, its degrees of freedom in nis_rows */
    uint32_t *nis_rows;
    double *theta;                 /* E, rekfd: risk sensitivity of the prediction */
    uint8_t *decision;             /* slots: MK_READING_ of this instant */
    double *ratio;                 /* slots: test ratio of the reading, 0 where it was not judged singly */
    double *stacked_ratio;         /* E: of all readings together */
    uint8_t *arrived;              /* slots: 1: the reading reached the estimator */
    uint32_t *messages;            /* slots: messages of the neighbour that arrived, readings apart */
    double *disagreement;          /* duif, iterations + 1: after l iterations the largest distance of a node's consensus matrix from their
                                      mean, relative to it (Frobenius); only where asked for */
    double count[MK_TRACK_COUNTS]; /* since the start of the run */
} mk_track_look_t;

typedef struct {
    const mk_scenario_t *scenario;
    const mk_tracking_filter_t *filter;
    mk_topology_t topology; /* slots of the estimators */
    const mk_space_f64_t *space; /* of the states, for errors; null: ordinary numbers */
    uint64_t seed;
    double loss;
    int iterations;         /* of consensus, else 0 */
    int watch;              /* 1: disagreement is asked for */
    uint64_t known;         /* bit i: truth has state i */
} mk_track_setting_t;

/* One precision. */
typedef struct {
    size_t real_size;
    const char *name;
    /* Models of a scenario, shared by threads. Null and an error. */
    void *(*open_models)(const mk_scenario_t *scenario, const mk_plugin_t *plugin, mk_error_t *error);
    void (*close_models)(void *models);
    /* Estimators; one object a thread. Null and an error: the filter needs a Jacobian that there is not, or refuses its configuration. models and
       setting stay the caller's. */
    void *(*open)(const void *models, const mk_track_setting_t *setting, mk_error_t *error);
    void (*close)(void *tracker);
    /* All estimators to this estimate and P0, counts to 0. */
    mk_status_t (*start)(void *tracker, int run, const double *estimate);
    /* 1, or 0 and an error: the noise of this interval cannot be had. step: number of the instant, from 1. */
    int (*step)(void *tracker, long step, const mk_instant_t *instant, mk_error_t *error);
    /* What the last step left; valid until the next one. */
    const mk_track_look_t *(*look)(void *tracker);
} mk_tracker_t;

extern const mk_tracker_t mk_tracker_f32, mk_tracker_f64;

/* Room for a look at so many estimators and slots. */
void mk_track_look_open(mk_track_look_t *look, const mk_track_setting_t *setting);
void mk_track_look_close(mk_track_look_t *look);
/* The stream that says which messages to a node are lost. */
void mk_track_links(const mk_track_setting_t *setting, int run, int node, long step, mk_random_t *random);
/* One message on it. */
int mk_track_arrives(const mk_track_setting_t *setting, mk_random_t *random);

#endif
