/* SPDX-License-Identifier: MIT */
/* Figures of tracking runs as a table and as JSON. */
#ifndef MESHKAL_TRACKING_TRACK_REPORT_H
#define MESHKAL_TRACKING_TRACK_REPORT_H

#include <jansson.h>
#include <stdio.h>

#include "tracking/track_campaign.h"

void mk_track_report_head(FILE *out, const mk_track_campaign_t *campaign);
/* ukf_seconds: what a step of ukf took; NaN: unknown. */
void mk_track_report_row(FILE *out, const mk_track_campaign_t *campaign, const mk_track_result_t *result, double ukf_seconds);
void mk_track_report_foot(FILE *out, const mk_track_campaign_t *campaign, const mk_track_result_t *last, json_t *notes);
json_t *mk_track_report_filter(const mk_track_campaign_t *campaign, const mk_track_result_t *result, double ukf_seconds);
/* filters and notes are given away. */
json_t *mk_track_report_summary(const mk_track_campaign_t *campaign, json_t *filters, json_t *notes);

#endif
