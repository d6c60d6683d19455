/* SPDX-License-Identifier: MIT */
#include "navigation/navigator.h"

#include <math.h>
#include <meshkal/angle.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_monitor.h"

static const char *const names[] = MK_NAV_FILTERS;

const char *mk_nav_filter_name(int filter) { return names[filter]; }

int mk_nav_filter_find(const char *name, int *filter, mk_error_t *error) {
    *filter = MK_NAV_FILTER_COUNT;
    if (strcmp(name, "all") == 0) return 1;
    for (int i = 0; i < MK_NAV_FILTER_COUNT; i++)
        if (strcmp(name, names[i]) == 0) *filter = i;
    return *filter < MK_NAV_FILTER_COUNT || mk_fail(error, "--filter %s: for a navigation scenario it must be one of ekf, rekf-n, rekf-t, all", name);
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "navigation/navigator.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "navigation/navigator.tmpl.h"
#undef MK_BITS

struct mk_navigator {
    const mk_nav_setting_t *setting;
    const mk_nav_precision_t *precision;
    void *filter;
    double Phi[MK_NAV_STATES * MK_NAV_STATES], Q[MK_NAV_PACKED];
    double *z, *H;
    mk_nav_look_t look;
};

static void open_look(mk_nav_look_t *look, const mk_nav_setting_t *setting, size_t real_size) {
    const size_t nodes = (size_t)setting->scenario->nodes;
    look->innovation = mk_allocate(5 * nodes + (size_t)MK_PACKED(nodes), sizeof *look->innovation);
    look->weight = look->innovation + nodes;
    look->statistic = look->weight + nodes;
    look->azimuth = look->statistic + nodes;
    look->elevation = look->azimuth + nodes;
    look->S = look->elevation + nodes;
    look->arrived = mk_allocate(2 * nodes, 1);
    look->decision = look->arrived + nodes;
    look->monitor.scheme = MK_MONITOR_NONE;
    if (setting->monitor->scheme != MK_MONITOR_NONE) look->monitor = mk_monitor_snapshot_make(real_size, setting->monitor->scheme, 1, nodes);
}

mk_navigator_t *mk_navigator_open(const mk_nav_setting_t *setting, const mk_nav_precision_t *precision, mk_error_t *error) {
    const size_t nodes = (size_t)setting->scenario->nodes;
    void *const filter = precision->open(setting, error);
    if (!filter) return NULL;
    mk_navigator_t *const n = mk_allocate(1, sizeof *n);
    n->setting = setting;
    n->precision = precision;
    n->filter = filter;
    n->z = mk_allocate(nodes * (1 + MK_NAV_STATES), sizeof *n->z);
    n->H = n->z + nodes;
    open_look(&n->look, setting, precision->real_size);
    return n;
}

void mk_navigator_close(mk_navigator_t *n) {
    if (!n) return;
    n->precision->close(n->filter);
    free(n->z);
    free(n->look.innovation);
    free(n->look.arrived);
    if (n->look.monitor.scheme != MK_MONITOR_NONE) mk_monitor_snapshot_free(&n->look.monitor);
    free(n);
}

mk_status_t mk_navigator_start(mk_navigator_t *n, const mk_nav_state_t *estimate) {
    n->look.estimate = *estimate;
    memset(n->look.count, 0, sizeof n->look.count);
    return n->precision->start(n->filter);
}

/* The estimate over the samples, with transition and noise of its error. */
static void advance(mk_navigator_t *n, const mk_epoch_t *epoch) {
    const mk_navigation_t *const nav = n->setting->scenario->navigation;
    const double gyro = nav->angle_walk * nav->angle_walk, accelerometer = nav->velocity_walk * nav->velocity_walk;
    mk_nav_transition_t transition;
    double C[9], force[3];
    mk_nav_transition_start(&transition);
    for (long j = 0; j < epoch->samples; j++) {
        mk_nav_step(&n->look.estimate, &epoch->inertial[j], nav->gravity, C, force);
        mk_nav_transition_add(&transition, epoch->inertial[j].h, C, force, gyro, accelerometer);
    }
    mk_nav_transition_put(&transition, nav->clock_sf, nav->clock_sg, n->Phi, n->Q);
}

/* Readings less what the estimate predicts, and their rows: line of sight on the position's error, 1 on the clock's. */
static void compare_ranges(mk_navigator_t *n, const mk_epoch_t *epoch) {
    const mk_nav_state_t *const estimate = &n->look.estimate;
    memset(n->H, 0, (size_t)n->setting->scenario->nodes * MK_NAV_STATES * sizeof *n->H);
    for (int k = 0; k < n->setting->scenario->nodes; k++) {
        double d[3], *const row = n->H + k * MK_NAV_STATES;
        for (int i = 0; i < 3; i++) d[i] = epoch->satellite[k][i] - estimate->p[i];
        const double level = sqrt(d[0] * d[0] + d[1] * d[1]), range = sqrt(level * level + d[2] * d[2]);
        n->look.azimuth[k] = mk_atan2_f64(d[0], d[1]);
        n->look.elevation[k] = mk_atan2_f64(d[2], level);
        n->z[k] = epoch->value[k] - (range + estimate->clock_bias);
        if (!epoch->have[k]) continue;
        for (int i = 0; i < 3; i++) row[MK_NAV_POSITION + i] = d[i] / range;
        row[MK_NAV_CLOCK] = 1.0;
    }
}

static void count_readings(mk_nav_look_t *look, int nodes) {
    int there = 0;
    for (int k = 0; k < nodes; k++) {
        const uint8_t decision = look->decision[k];
        there += look->arrived[k];
        if (decision == MK_NAV_USED) look->count[MK_NAV_COUNT_USED]++;
        else if (decision == MK_NAV_WEIGHTED) look->count[MK_NAV_COUNT_WEIGHTED]++;
        else if (decision == MK_NAV_REFUSED && look->monitor.scheme != MK_MONITOR_NONE && look->monitor.excluded[k]) look->count[MK_NAV_COUNT_EXCLUDED]++;
        else if (decision == MK_NAV_REFUSED) look->count[MK_NAV_COUNT_REFUSED]++;
    }
    look->count[MK_NAV_COUNT_FEW] += there > 0 && there < 4;
}

const mk_nav_look_t *mk_navigator_step(mk_navigator_t *n, const mk_epoch_t *epoch) {
    mk_nav_look_t *const look = &n->look;
    const int nodes = n->setting->scenario->nodes;
    advance(n, epoch);
    compare_ranges(n, epoch);
    for (int k = 0; k < nodes; k++) {
        look->innovation[k] = (double)NAN;
        look->weight[k] = look->statistic[k] = 0.0;
        look->arrived[k] = epoch->have[k];
        look->decision[k] = MK_NAV_NONE;
    }
    for (int i = 0; i < MK_PACKED(nodes); i++) look->S[i] = (double)NAN;
    memset(look->correction, 0, sizeof look->correction);
    const mk_nav_input_t input = {epoch->dt, n->Phi, n->Q, epoch->have, n->z, n->H};
    n->precision->step(n->filter, &input, look);
    mk_nav_correct(&look->estimate, look->correction);
    count_readings(look, nodes);
    return look;
}
