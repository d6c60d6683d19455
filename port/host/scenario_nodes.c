/* SPDX-License-Identifier: MIT */
#include "scenario_nodes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "first_error.h"
#include "parallel.h"
#include "scenario_navigation.h"
#include "scenario_tracking.h"

/* Nodes whose C and R share a block. */
enum { TOGETHER = 1024 };
/* Rows and slots of all nodes are counted in 31 bits. */
enum { LARGEST = 100000000 };

static const char *const node_keys[] = {"C", "R", "position_m", NULL};

typedef struct {
    const mk_reader_t *reader;
    const mk_elements_t *elements;
    mk_scenario_t *scenario;
    mk_first_error_t first;
} nodes_t;

/* Rows of a linear sensor, C and R as they stand; -1 and an error. */
static int read_linear(mk_reader_t *reader, json_t *node, const char *at, mk_sensor_t *sensor, json_t **C, json_t **R) {
    char place[80];
    if (!mk_read_keys(reader, node, at, node_keys)) return -1;
    *C = mk_read_member(reader, node, at, "C", 1);
    *R = *C ? mk_read_member(reader, node, at, "R", 1) : NULL;
    if (!*R) return -1;
    (void)snprintf(place, sizeof place, "%s.C", at);
    if (!json_is_array(*C) || json_array_size(*C) == 0) return mk_read_bad(reader, place, "must be an array of rows") - 1;
    if (json_array_size(*C) > MK_LARGEST_STATE)
        return mk_read_bad(reader, place, "has %zu rows; at most %d", json_array_size(*C), MK_LARGEST_STATE) - 1;
    json_t *position = json_object_get(node, "position_m");
    if (position && !mk_read_position(reader, position, at, 0, sensor->position_m, &sensor->position_count)) return -1;
    return (int)json_array_size(*C);
}

/* room: what the block holds, in numbers; used: by nodes so far. C and R are places in the block, not yet addresses. */
static int read_node(mk_reader_t *reader, json_t *node, const char *at, const mk_scenario_t *s, long k, double **block, size_t *room, size_t *used) {
    char place[80];
    mk_sensor_t *sensor = &s->sensor[k];
    json_t *C = NULL, *R = NULL;
    double variance = 0.0;
    const int rows = s->tracking     ? mk_read_tracking_node(reader, node, at, s->tracking, sensor, &s->tracking->node[k], &R)
                     : s->navigation ? 2 * mk_read_satellite(reader, node, at, &s->navigation->satellite[k], &variance) - 1
                                     : read_linear(reader, node, at, sensor, &C, &R);
    if (rows < 0) return 0;
    sensor->rows = rows;
    const int width = C ? rows * s->n : 0;
    const size_t needed = *used + (size_t)(width + rows * (rows + 1) / 2);
    if (needed > *room) {
        double *larger = realloc(*block, (*room = 2 * needed) * sizeof *larger);
        if (!larger) return mk_fail(reader->error, "%s: too large for memory", reader->path);
        *block = larger;
    }
    (void)snprintf(place, sizeof place, "%s.C", at);
    if (C && !mk_read_matrix(reader, C, place, rows, s->n, *block + *used)) return 0;
    place[strlen(place) - 1] = 'R';
    if (R && !mk_read_symmetric(reader, R, place, rows, 1, *block + *used + width)) return 0;
    if (s->navigation) (*block)[*used] = variance;
    *used = needed;
    return 1;
}

static void read_some(void *context, int worker, long index) {
    nodes_t *nodes = context;
    mk_scenario_t *s = nodes->scenario;
    mk_error_t error = {""};
    mk_reader_t reader = *nodes->reader;
    size_t room = 0, used = 0;
    double *block = NULL;
    const long begin = index * TOGETHER, end = begin + TOGETHER < s->nodes ? begin + TOGETHER : s->nodes;
    (void)worker;
    reader.error = &error;
    for (long k = begin; k < end && !mk_first_error_before(&nodes->first, k); k++) {
        char at[64];
        (void)snprintf(at, sizeof at, "nodes[%ld]", k);
        json_t *node = mk_element(nodes->elements, (size_t)k);
        const int good = node && read_node(&reader, node, at, s, k, &block, &room, &used);
        json_decref(node);
        if (good) continue;
        mk_first_error_put(&nodes->first, k, &error);
        break;
    }
    double *smaller = used ? realloc(block, used * sizeof *block) : NULL;
    s->block[index] = block = smaller ? smaller : block;
    for (long k = begin; k < end && block; k++) {
        mk_sensor_t *sensor = &s->sensor[k];
        sensor->C = s->tracking || s->navigation ? NULL : block;
        sensor->R = block + (sensor->C ? sensor->rows * s->n : 0);
        block = sensor->R + sensor->rows * (sensor->rows + 1) / 2;
    }
}

int mk_read_nodes(mk_reader_t *reader, json_t *root, const mk_elements_t *elements, mk_scenario_t *s) {
    if (!mk_read_member(reader, root, "", "nodes", 1)) return 0;
    if (!json_is_array(elements->array) || elements->count == 0) return mk_read_bad(reader, "nodes", "must be an array with at least one node");
    if (elements->count > LARGEST) return mk_read_bad(reader, "nodes", "has %zu nodes; at most %d", elements->count, LARGEST);
    s->nodes = (int)elements->count;
    s->sensor = mk_allocate((size_t)s->nodes, sizeof *s->sensor);
    if (s->tracking) s->tracking->node = mk_allocate((size_t)s->nodes, sizeof *s->tracking->node);
    if (s->navigation) s->navigation->satellite = mk_allocate((size_t)s->nodes, sizeof *s->navigation->satellite);
    s->blocks = (s->nodes + TOGETHER - 1) / TOGETHER;
    s->block = mk_allocate((size_t)s->blocks, sizeof *s->block);
    nodes_t nodes = {.reader = reader, .elements = elements, .scenario = s};
    mk_first_error_open(&nodes.first);
    mk_parallel(mk_cores(), s->blocks, read_some, &nodes);
    if (nodes.first.index >= 0) {
        json_t *node = mk_element(elements, (size_t)nodes.first.index);
        reader->no_json = !node;
        json_decref(node);
    }
    return mk_first_error_close(&nodes.first, reader->error);
}
