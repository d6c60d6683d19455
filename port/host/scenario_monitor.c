/* SPDX-License-Identifier: MIT */
#include "scenario_monitor.h"

#include <float.h>
#include <meshkal/monitor.h>
#include <string.h>

#include "host_monitor.h"

static const char *const names[] = {"none", "rctm", "aime", "aime-improved", "exclude", NULL};

const char *mk_monitor_name(int scheme) { return names[scheme + 1]; }

int mk_monitor_find(const char *name, int *scheme, mk_error_t *error) {
    for (int i = 0; names[i]; i++) {
        if (strcmp(name, names[i]) != 0) continue;
        *scheme = i - 1;
        return 1;
    }
    return mk_fail(error, "--monitor %s: must be none, rctm, aime, aime-improved or exclude", name);
}

int mk_read_monitor(mk_reader_t *reader, json_t *root, mk_scenario_t *s) {
    static const char key[] = "monitor";
    static const char *const keys[] = {"window", "false_alarm", "jump", "evidence", "level", "slope", "separation", "most", "patience", NULL};
    mk_monitor_settings_t *m = &s->monitor;
    json_t *settings = json_object_get(root, key);
    m->scheme = MK_MONITOR_NONE;
    m->window = 10;
    m->false_alarm = 8e-10;
    (void)mk_monitor_evidence_f64(0.01, 1000.0, &m->evidence);
    m->level = 0.01;
    m->slope = 1e-4;
    m->separation = 10.0;
    m->most = 2;
    m->patience = 5;
    if (settings && (!mk_read_keys(reader, settings, key, keys) ||
                     !mk_read_integer(reader, settings, key, "window", 1, MK_MONITOR_LONGEST, &m->window) ||
                     !mk_read_between(reader, settings, key, "false_alarm", DBL_MIN, 1.0 - DBL_EPSILON, "a probability, above 0 and below 1",
                                      &m->false_alarm) ||
                     !mk_read_between(reader, settings, key, "jump", DBL_MIN, DBL_MAX, "a number above 0", &m->jump) ||
                     !mk_read_between(reader, settings, key, "evidence", DBL_MIN, DBL_MAX, "a log likelihood ratio above 0", &m->evidence) ||
                     !mk_read_between(reader, settings, key, "level", 0.0, DBL_MAX, "a variance, 0 or above", &m->level) ||
                     !mk_read_between(reader, settings, key, "slope", 0.0, DBL_MAX, "a variance, 0 or above", &m->slope) ||
                     !mk_read_between(reader, settings, key, "separation", 0.0, DBL_MAX, "a number, 0 or above", &m->separation) ||
                     !mk_read_integer(reader, settings, key, "most", 1, MK_MONITOR_ROWS, &m->most) ||
                     !mk_read_integer(reader, settings, key, "patience", 0, 65535, &m->patience)))
        return 0;
    return 1;
}
