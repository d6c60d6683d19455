/* SPDX-License-Identifier: MIT */
/* Tables and JSON of navigation runs. */
#ifndef MESHKAL_NAVIGATION_NAV_REPORT_H
#define MESHKAL_NAVIGATION_NAV_REPORT_H

#include <jansson.h>
#include <stdio.h>

#include "navigation/nav_campaign.h"

void mk_nav_report_head(FILE *out, const mk_nav_campaign_t *campaign);
void mk_nav_report_row(FILE *out, const mk_nav_campaign_t *campaign, const mk_nav_result_t *result);
/* last: of the filter that ran last; notes are its caller's. */
void mk_nav_report_foot(FILE *out, const mk_nav_campaign_t *campaign, const mk_nav_result_t *last, json_t *notes);
json_t *mk_nav_report_filter(const mk_nav_campaign_t *campaign, const mk_nav_result_t *result);
/* filters and notes are given away. */
json_t *mk_nav_report_summary(const mk_nav_campaign_t *campaign, json_t *filters, json_t *notes);

#endif
