/* SPDX-License-Identifier: MIT */
#include "monitor_node.h"

mk_status_t monitor_start(watcher_t *monitor, const watcher_config_t *config) { return watcher_start(monitor, config); }
mk_status_t monitor_watch(watcher_t *monitor, const uint16_t *id, const uint8_t *rows, const float *r, const float *S) {
    return watcher_watch(monitor, SIZE_PLACES, id, rows, r, S);
}
int monitor_faulty(watcher_t *monitor, uint16_t id) { return watcher_faulty(monitor, id); }
