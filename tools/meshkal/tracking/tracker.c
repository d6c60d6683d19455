/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include "tracking/tracker.h"

#include <math.h>
#include <meshkal/duif.h>
#include <meshkal/extended.h>
#include <meshkal/kernels.h>
#include <stdlib.h>
#include <string.h>

const mk_tracking_filter_t mk_tracking_filters[MK_TRACKING_FILTER_COUNT] = {
    {"ekf", MK_TRACK_CENTRAL},          {"ukf", MK_TRACK_CENTRAL},  {"iukf", MK_TRACK_CENTRAL},
    {"iukf-literal", MK_TRACK_CENTRAL}, {"pukf", MK_TRACK_CENTRAL}, {"mpukf", MK_TRACK_CENTRAL},
    {"duif", MK_TRACK_INFORMATION},     {"kcf", MK_TRACK_CONSENSUS}, {"rekfd", MK_TRACK_EXTENDED}};

int mk_tracking_filter_find(const char *name, const mk_tracking_filter_t **filter, mk_error_t *error) {
    *filter = NULL;
    if (strcmp(name, "all") == 0) return 1;
    for (int i = 0; i < MK_TRACKING_FILTER_COUNT; i++)
        if (strcmp(name, mk_tracking_filters[i].name) == 0) *filter = &mk_tracking_filters[i];
    if (*filter) return 1;
    return mk_fail(error, "--filter %s: for a tracking scenario it must be one of ekf, ukf, iukf, iukf-literal, pukf, mpukf, duif, kcf, rekfd, all",
                   name);
}

void mk_track_look_open(mk_track_look_t *look, const mk_track_setting_t *setting) {
    const size_t E = (size_t)setting->topology.estimators, n = (size_t)setting->scenario->n, slots = (size_t)setting->topology.first[E];
    memset(look, 0, sizeof *look);
    look->estimate = mk_allocate(E * (n + (size_t)MK_PACKED(n) + 3) + slots + (size_t)setting->iterations + 1, sizeof *look->estimate);
    look->covariance = look->estimate + E * n;
    look->nis = look->covariance + E * (size_t)MK_PACKED(n);
    look->theta = look->nis + E;
    look->stacked_ratio = look->theta + E;
    look->ratio = look->stacked_ratio + E;
    look->disagreement = look->ratio + slots;
    look->nis_rows = mk_allocate(E + slots, sizeof *look->nis_rows);
    look->messages = look->nis_rows + E;
    look->decision = mk_allocate(2 * slots, 1);
    look->arrived = look->decision + slots;
}

void mk_track_look_close(mk_track_look_t *look) {
    free(look->estimate);
    free(look->nis_rows);
    free(look->decision);
}

void mk_track_links(const mk_track_setting_t *setting, int run, int node, long step, mk_random_t *random) {
    if (setting->loss > 0.0) mk_random_start(random, setting->seed, (uint32_t)run, (uint32_t)node, (uint32_t)step, MK_DRAW_LOSS);
}

int mk_track_arrives(const mk_track_setting_t *setting, mk_random_t *random) {
    return !(setting->loss > 0.0) || mk_random_uniform(random) >= setting->loss;
}

/* Distance of `count` packed matrices of order n, every `stride` numbers, from their mean: the largest, relative to the mean. */
static double disagreement(int n, int count, size_t stride, const double *matrix, double *mean) {
    double largest = 0.0, size = 0.0;
    memset(mean, 0, (size_t)MK_PACKED(n) * sizeof *mean);
    for (int e = 0; e < count; e++)
        for (int i = 0; i < MK_PACKED(n); i++) mean[i] += matrix[(size_t)e * stride + (size_t)i] / count;
    for (int e = -1; e < count; e++) {
        double sum = 0.0;
        for (int i = 0, place = 0; i < n; i++)
            for (int j = 0; j <= i; j++, place++) {
                const double d = e < 0 ? mean[place] : matrix[(size_t)e * stride + (size_t)place] - mean[place];
                sum += (i == j ? 1.0 : 2.0) * d * d;
            }
        if (e < 0) size = sum;
        else if (sum > largest) largest = sum;
    }
    return size > 0.0 ? sqrt(largest / size) : 0.0;
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "tracking/tracker.tmpl.h"
#include "tracking/central.tmpl.h"
#include "tracking/information.tmpl.h"
#include "tracking/extended.tmpl.h"
#include "tracking/tracker_table.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "tracking/tracker.tmpl.h"
#include "tracking/central.tmpl.h"
#include "tracking/information.tmpl.h"
#include "tracking/extended.tmpl.h"
#include "tracking/tracker_table.tmpl.h"
#undef MK_BITS
