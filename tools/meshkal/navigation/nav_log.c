/* SPDX-License-Identifier: MIT */
#include "navigation/nav_log.h"

#include <math.h>
#include <meshkal/rkfd.h>

#include "scenario_monitor.h"

#define DEGREES_A_RADIAN 57.295779513082320877

/* Logs name the nodes in the order of the scenario; there is one estimator, which listens to all. */
void mk_nav_log_header(mk_run_log_t *log, const mk_nav_campaign_t *c) {
    int first[2] = {0, c->scenario->nodes}, slot[MK_NAV_SATELLITES];
    for (int k = 0; k < c->scenario->nodes; k++) slot[k] = k;
    const mk_run_facts_t facts = {.filter = mk_nav_filter_name(c->filter), .real = c->precision->name, .source = c->facts.drawn ? "drawn" : "recorded",
                                  .truth = c->facts.drawn ? "nominal" : "recorded", .seed = c->seed, .runs = c->runs, .steps = (int)c->facts.steps,
                                  .estimators = 1, .first = first, .slot = slot, .monitor = &c->monitor};
    mk_log_header_navigation(log, c->scenario, &facts, c->facts.start_s);
}

size_t mk_nav_log_room(const mk_nav_campaign_t *c) { return (size_t)(MK_PACKED(c->scenario->nodes) + MK_NAV_STATES + 2 * c->scenario->nodes); }

/* Numbers of the filter, in its own precision again. */
static void put(mk_run_log_t *log, const mk_nav_campaign_t *c, const char *key, const double *values, int count, double *work) {
    float *const single = (float *)(void *)work;
    if (c->precision->real_size == 4) {
        for (int i = 0; i < count; i++) single[i] = (float)values[i];
        mk_log_reals(log, key, single, 4, (size_t)count);
    } else {
        mk_log_reals(log, key, values, 8, (size_t)count);
    }
}

static double covariance(const mk_nav_look_t *look, int i, int j) {
    double sum = 0.0;
    for (int k = 0; k <= j; k++) sum += look->root[MK_PACKED(i) + k] * look->root[MK_PACKED(j) + k];
    return sum;
}

static void put_covariances(mk_run_log_t *log, const mk_nav_campaign_t *c, const mk_nav_look_t *look, double *work) {
    double trace = 0.0, variance[MK_NAV_STATES], position[6], *next = position;
    for (int i = 0; i < MK_NAV_STATES; i++) {
        variance[i] = covariance(look, i, i);
        trace += variance[i];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) *next++ = covariance(look, MK_NAV_POSITION + i, MK_NAV_POSITION + j);
    put(log, c, "variance", variance, MK_NAV_STATES, work);
    put(log, c, "trace_covariance", &trace, 1, work);
    put(log, c, "position_covariance", position, 6, work);
}

/* As seen from the estimate; a satellite without a position has none. */
static void put_sky(mk_run_log_t *log, const mk_nav_campaign_t *c, const mk_nav_look_t *look, double *work) {
    const int nodes = c->scenario->nodes;
    for (int k = 0; k < nodes; k++) work[k] = DEGREES_A_RADIAN * (look->azimuth[k] < 0.0 ? look->azimuth[k] + 6.28318530717958647692 : look->azimuth[k]);
    mk_log_reals(log, "azimuth_deg", work, 8, (size_t)nodes);
    for (int k = 0; k < nodes; k++) work[k] = DEGREES_A_RADIAN * look->elevation[k];
    mk_log_reals(log, "elevation_deg", work, 8, (size_t)nodes);
}

static uint32_t fault_bits(const mk_nav_look_t *look, int nodes) {
    uint32_t bits = 0;
    int used = 0;
    for (int k = 0; k < nodes; k++) {
        if (look->decision[k] == MK_NAV_REFUSED) bits |= MK_FAULT_REJECTED;
        used += look->decision[k] == MK_NAV_USED || look->decision[k] == MK_NAV_WEIGHTED;
    }
    return used ? bits : bits | MK_FAULT_NO_MEASUREMENT;
}

void mk_nav_log_item(mk_run_log_t *log, const mk_nav_campaign_t *c, int run, long step, const mk_epoch_t *epoch, const mk_nav_look_t *look,
                     const mk_nav_errors_t *errors, double *work) {
    const int nodes = c->scenario->nodes, truth = c->facts.has_truth, watched = c->monitor.scheme != MK_MONITOR_NONE;
    const int weighted = c->filter != MK_NAV_EKF, faults = c->facts.drawn || c->scenario->faults > 0;
    const uint32_t bits = fault_bits(look, nodes);
    mk_monitor_field_t field[MK_MONITOR_FIELDS];
    double x[MK_NAV_STATES];
    mk_log_begin(log, run, step, 16 + 3 * truth + 2 * weighted + faults + (watched ? mk_monitor_fields(&look->monitor, field) : 0));
    mk_log_reals(log, "time_s", &epoch->t, 8, 1);
    if (truth) {
        const double error = sqrt(errors->position);
        mk_nav_state_put(epoch->truth, x);
        mk_log_reals(log, "truth", x, 8, MK_NAV_STATES);
        mk_log_reals(log, "error", &error, 8, 1);
        mk_log_reals(log, "nees", &errors->nees, 8, 1);
    }
    mk_log_reals(log, "measurements", epoch->value, 8, (size_t)nodes);
    if (faults) mk_log_reals(log, "fault", epoch->fault, 8, (size_t)nodes);
    mk_log_uint8(log, "measurements_arrived", look->arrived, (size_t)nodes);
    mk_log_uint8(log, "decision", look->decision, (size_t)nodes);
    mk_nav_state_put(&look->estimate, x);
    mk_log_reals(log, "estimate", x, 8, MK_NAV_STATES);
    put(log, c, "correction", look->correction, MK_NAV_STATES, work);
    put_covariances(log, c, look, work);
    put(log, c, "nis", &look->nis, 1, work);
    mk_log_uint32(log, "nis_rows", &look->nis_rows, 1);
    put(log, c, "innovation", look->innovation, nodes, work);
    put(log, c, "innovation_covariance", look->S, MK_PACKED(nodes), work);
    if (weighted) {
        put(log, c, "weight", look->weight, nodes, work);
        put(log, c, "weight_statistic", look->statistic, nodes, work);
    }
    put_sky(log, c, look, work);
    mk_log_uint32(log, "faults", &bits, 1);
    if (watched) mk_log_monitor(log, &look->monitor, 1, (size_t)nodes);
    mk_log_end(log);
}
