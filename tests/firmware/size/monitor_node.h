/* SPDX-License-Identifier: MIT */
/* The monitor type that an image measures. Given from outside: SIZE_PLACES, SIZE_M, SIZE_WINDOW. */
#ifndef SIZE_MONITOR_NODE_H
#define SIZE_MONITOR_NODE_H

#include <meshkal/monitor.h>

MK_MONITOR(watcher, f32, SIZE_M, SIZE_PLACES, SIZE_WINDOW);

/* What firmware needs of the monitor, and nothing else of the library: size/monitor_node.c. */
mk_status_t monitor_start(watcher_t *monitor, const watcher_config_t *config);
mk_status_t monitor_watch(watcher_t *monitor, const uint16_t *id, const uint8_t *rows, const float *r, const float *S);
int monitor_faulty(watcher_t *monitor, uint16_t id);

#endif
