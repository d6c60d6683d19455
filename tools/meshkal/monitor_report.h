/* SPDX-License-Identifier: MIT */
/* What monitors found, for people and for programs. */
#ifndef MESHKAL_MONITOR_REPORT_H
#define MESHKAL_MONITOR_REPORT_H

#include <jansson.h>
#include <stdio.h>

#include "simulation/campaign.h"

/* Adds to the object of a filter: "phase_msd" of a scenario with faults, "monitor" of a campaign with one. */
void mk_report_alerts(json_t *object, const mk_campaign_t *c, const mk_result_t *result);
/* Tables of both, out of such objects; nothing where there are neither faults nor a monitor. */
void mk_report_alert_tables(FILE *out, const mk_campaign_t *c, json_t *filters);

#endif
