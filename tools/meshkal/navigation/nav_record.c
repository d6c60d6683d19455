/* SPDX-License-Identifier: MIT */
#include "navigation/nav_record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scenario_faults.h"
#include "scenario_monitor.h"
#include "simulation/statistics.h"

void mk_nav_record_open(mk_nav_record_t *r, long steps) {
    const size_t T = (size_t)steps;
    r->steps = steps;
    r->count = MK_NAV_SINGLE + 7 * T;
    r->value = r->single = mk_allocate(r->count, sizeof *r->value);
    r->time = r->single + MK_NAV_SINGLE;
    r->position = r->time + T;
    r->velocity = r->position + T;
    r->nees = r->velocity + T;
    r->innovation = r->nees + T;
    r->weight = r->innovation + T;
    r->alarm = r->weight + T;
}

void mk_nav_record_close(mk_nav_record_t *r) {
    free(r->value);
    memset(r, 0, sizeof *r);
}

/* --- what the monitor said -------------------------------------------------------------------------------------------------- */

mk_nav_fault_span_t mk_nav_fault_span(const mk_scenario_t *s) {
    mk_nav_fault_span_t span = {s->faults > 0, 0, mk_faults_begin(s), mk_faults_end(s)};
    for (int i = s->faults - 1; i >= 0; i--)
        if (s->fault[i].from_s == span.from_s) span.node = s->fault[i].node;
    return span;
}

void mk_nav_story_start(mk_nav_story_t *story) {
    memset(story, 0, sizeof *story);
    story->alarm_s = story->last_alarm_s = story->first_false_s = story->innovation_at_end = (double)NAN;
}

static void name_satellite(mk_nav_story_t *story, const mk_scenario_t *s, const mk_monitor_snapshot_t *monitor) {
    int suspect = -1;
    for (int k = 0; k < s->nodes; k++) {
        if (monitor->scheme == MK_MONITOR_EXCLUDE ? !monitor->excluded[k] : !(mk_monitor_isolation(monitor, k) > 0.0)) continue;
        if (suspect < 0 || (monitor->scheme != MK_MONITOR_EXCLUDE && mk_monitor_isolation(monitor, k) > mk_monitor_isolation(monitor, suspect))) suspect = k;
    }
    if (suspect >= 0) story->isolated = s->navigation->satellite[suspect].number;
}

void mk_nav_story_add(mk_nav_story_t *story, const mk_scenario_t *s, const mk_nav_fault_span_t *span, const mk_epoch_t *epoch,
                      const mk_nav_look_t *look) {
    const double t = epoch->t;
    const int before = !mk_is_after(t, span->from_s), after = mk_is_after(t, span->to_s);
    if (span->exists && !before && !after && epoch->have[span->node]) story->innovation_at_end = look->innovation[span->node];
    if (look->monitor.scheme == MK_MONITOR_NONE) return;
    const int alarm = look->monitor.alarm[0];
    story->clean += before;
    story->after += after;
    story->false_alarms += before && alarm;
    story->late_alarms += after && alarm;
    story->during += !before && !after && alarm;
    if (look->monitor.ended[0] && story->ends++ < MK_NAV_MOST_ENDS) story->end_s[story->ends - 1] = t;
    if (alarm && before && isnan(story->first_false_s)) story->first_false_s = t;
    if (alarm) story->last_alarm_s = t;
    if (alarm && (!before || !span->exists) && isnan(story->alarm_s)) story->alarm_s = t;
    if (!isnan(story->alarm_s) && !story->isolated) name_satellite(story, s, &look->monitor);
}

/* --- errors ----------------------------------------------------------------------------------------------------------------- */

static double square(const double *v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

mk_nav_errors_t mk_nav_judge(const mk_epoch_t *epoch, const mk_nav_look_t *look) {
    mk_nav_errors_t errors = {(double)NAN, (double)NAN, (double)NAN, (double)NAN};
    double e[MK_NAV_STATES], sum = 0.0;
    if (!epoch->truth) return errors;
    mk_nav_error(&look->estimate, epoch->truth, e);
    errors.attitude = square(e + MK_NAV_ATTITUDE);
    errors.velocity = square(e + MK_NAV_VELOCITY);
    errors.position = square(e + MK_NAV_POSITION);
    for (int i = 0; i < MK_NAV_STATES; i++) {
        for (int j = 0; j < i; j++) e[i] -= look->root[MK_PACKED(i) + j] * e[j];
        e[i] /= look->root[MK_PACKED(i) + i];
        sum += e[i] * e[i];
    }
    errors.nees = sum;
    return errors;
}

/* --- many runs -------------------------------------------------------------------------------------------------------------- */

void mk_nav_statistics_open(mk_nav_statistics_t *s, long steps) {
    s->runs = 0;
    mk_nav_record_open(&s->mean, steps);
    mk_nav_record_open(&s->squares, steps);
    mk_nav_record_open(&s->known, steps);
}

void mk_nav_statistics_close(mk_nav_statistics_t *s) {
    mk_nav_record_close(&s->mean);
    mk_nav_record_close(&s->squares);
    mk_nav_record_close(&s->known);
}

void mk_nav_statistics_add(mk_nav_statistics_t *s, const double *value) {
    s->runs++;
    for (size_t i = 0; i < s->mean.count; i++) {
        if (isnan(value[i])) continue;
        mk_welford(++s->known.value[i], 1, value + i, s->mean.value + i, s->squares.value + i);
    }
}
