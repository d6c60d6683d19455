/* SPDX-License-Identifier: MIT */
/* What events.c and events_recorded.c share. */
#ifndef MESHKAL_TRACKING_EVENTS_PARTS_H
#define MESHKAL_TRACKING_EVENTS_PARTS_H

#include "tracking/events.h"

struct mk_events {
    const mk_models_f64_t *models;
    mk_events_facts_t facts;
    int *row_first; /* nodes + 1: where each node's rows begin among all */
    /* drawn */
    uint64_t seed;
    double *root_P0, *root_Q, *root_R; /* packed; root_R of node k from root_first[k] */
    size_t *root_first;
    /* recorded: instants, the readings of instant i from first[i] to first[i + 1], all their rows, truth of all instants or null */
    double *time, *z, *x;
    size_t *first;
    mk_reading_t *reading;
    char sha256[65];
};

/* Zeroed, but for models and row_first. */
mk_events_t *mk_events_open(const mk_models_f64_t *models);

#endif
