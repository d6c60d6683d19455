/* SPDX-License-Identifier: MIT */
/* Items of the run log that tracking runs write, port/host/log-format.md. */
#ifndef MESHKAL_TRACKING_TRACK_LOG_H
#define MESHKAL_TRACKING_TRACK_LOG_H

#include "run_log.h"
#include "tracking/track_campaign.h"

void mk_track_log_header(mk_run_log_t *log, const mk_track_campaign_t *campaign, const mk_track_setting_t *setting);
/* work: room for mk_track_log_room numbers. */
size_t mk_track_log_room(const mk_track_setting_t *setting);
void mk_track_log_item(mk_run_log_t *log, const mk_track_campaign_t *campaign, const mk_track_setting_t *setting, int run, long step,
                       const mk_instant_t *instant, const mk_track_look_t *look, const mk_track_errors_t *errors, double *work);

#endif
