/* SPDX-License-Identifier: MIT */
/* The figures of campaigns, for people and for programs. */
#ifndef MESHKAL_SIMULATE_REPORT_H
#define MESHKAL_SIMULATE_REPORT_H

#include <jansson.h>
#include <stdio.h>

#include "simulation/campaign.h"

/* Table: head, a row for each filter, foot. */
void mk_report_head(FILE *out, const mk_campaign_t *c, const mk_source_t *source, const mk_team_t *team);
void mk_report_row(FILE *out, const mk_campaign_t *c, const mk_result_t *result);
void mk_report_foot(FILE *out, const mk_campaign_t *c, const mk_source_t *source, const mk_team_t *team, const mk_result_t *last);

/* One filter, and the object of all of them (takes `filters`). */
json_t *mk_report_filter(const mk_campaign_t *c, const mk_result_t *result);
json_t *mk_report_summary(const mk_campaign_t *c, const mk_source_t *source, const mk_team_t *team, json_t *filters);

#endif
