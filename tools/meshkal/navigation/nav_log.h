/* SPDX-License-Identifier: MIT */
/* Items of the run log that navigation runs write, port/host/log-format.md. */
#ifndef MESHKAL_NAVIGATION_NAV_LOG_H
#define MESHKAL_NAVIGATION_NAV_LOG_H

#include "navigation/nav_campaign.h"
#include "run_log.h"

void mk_nav_log_header(mk_run_log_t *log, const mk_nav_campaign_t *campaign);
/* work: room for mk_nav_log_room numbers. */
size_t mk_nav_log_room(const mk_nav_campaign_t *campaign);
void mk_nav_log_item(mk_run_log_t *log, const mk_nav_campaign_t *campaign, int run, long step, const mk_epoch_t *epoch, const mk_nav_look_t *look,
                     const mk_nav_errors_t *errors, double *work);

#endif
