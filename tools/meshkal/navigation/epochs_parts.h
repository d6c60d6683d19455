/* SPDX-License-Identifier: MIT */
/* What drawing and reading of epochs share. */
#ifndef MESHKAL_NAVIGATION_EPOCHS_PARTS_H
#define MESHKAL_NAVIGATION_EPOCHS_PARTS_H

#include "navigation/epochs.h"
#include "navigation/flight.h"

struct mk_epochs {
    const mk_scenario_t *scenario;
    mk_epochs_facts_t facts;
    char sha256[65];
    long most_samples;    /* of an epoch */
    /* drawn */
    uint64_t seed;
    mk_flown_t *flown;
    double (*place)[3];   /* nodes */
    /* recorded */
    long rows;            /* samples: rows of 7 numbers, those after start_s */
    double *sample;
    double *time;         /* epochs */
    size_t *first;        /* epochs + 1, into the three below */
    int *node;
    double *value, (*from)[3];
    mk_nav_state_t *truth; /* epochs */
};

void mk_recorded_epoch(mk_run_epochs_t *stream, mk_epoch_t *epoch);

#endif
