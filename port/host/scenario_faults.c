/* SPDX-License-Identifier: MIT */
#include "scenario_faults.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static int read_fault(mk_reader_t *reader, json_t *value, const char *at, const mk_scenario_t *s, mk_sensor_fault_t *fault) {
    static const char *const keys[] = {"node", "row", "from_s", "to_s", "rate", "step", NULL};
    char place[64];
    if (!mk_read_keys(reader, value, at, keys) || !mk_read_member(reader, value, at, "node", 1) || !mk_read_member(reader, value, at, "from_s", 1) ||
        !mk_read_integer(reader, value, at, "node", 0, s->nodes - 1, &fault->node))
        return 0;
    const int rows = s->sensor[fault->node].rows;
    (void)snprintf(place, sizeof place, "%s.node", at);
    if (rows == 0) return mk_read_bad(reader, place, "node %d has no sensor", fault->node);
    fault->to_s = (double)INFINITY;
    if (!mk_read_integer(reader, value, at, "row", 0, rows - 1, &fault->row) ||
        !mk_read_between(reader, value, at, "from_s", -DBL_MAX, DBL_MAX, "a number of seconds", &fault->from_s) ||
        !mk_read_between(reader, value, at, "to_s", -DBL_MAX, DBL_MAX, "a number of seconds", &fault->to_s) ||
        !mk_read_between(reader, value, at, "rate", -DBL_MAX, DBL_MAX, "a number, in the unit of the row a second", &fault->rate) ||
        !mk_read_between(reader, value, at, "step", -DBL_MAX, DBL_MAX, "a number, in the unit of the row", &fault->step))
        return 0;
    (void)snprintf(place, sizeof place, "%s.to_s", at);
    if (!(fault->to_s > fault->from_s)) return mk_read_bad(reader, place, "must be after from_s, %g", fault->from_s);
    if (fault->rate == 0.0 && fault->step == 0.0) return mk_read_bad(reader, at, "adds nothing: give rate or step, other than 0");
    return 1;
}

int mk_read_faults(mk_reader_t *reader, json_t *root, mk_scenario_t *s) {
    json_t *list = json_object_get(root, "faults");
    if (!list) return 1;
    if (!json_is_array(list)) return mk_read_bad(reader, "faults", "must be an array of faults");
    const size_t count = json_array_size(list);
    if (count > 1000000) return mk_read_bad(reader, "faults", "has %zu entries; at most 1000000", count);
    s->fault = mk_allocate(count + 1, sizeof *s->fault);
    s->faults = (int)count;
    for (size_t i = 0; i < count; i++) {
        char at[40];
        (void)snprintf(at, sizeof at, "faults[%zu]", i);
        if (!read_fault(reader, json_array_get(list, i), at, s, &s->fault[i])) return 0;
    }
    return 1;
}

int mk_is_after(double a_s, double b_s) { return a_s - b_s > 1e-9 * (1.0 + fabs(b_s)); }

int mk_fault_is_on(const mk_sensor_fault_t *fault, double t_s) { return mk_is_after(t_s, fault->from_s) && !mk_is_after(t_s, fault->to_s); }

double mk_faults_begin(const mk_scenario_t *s) {
    double begin = (double)INFINITY;
    for (int i = 0; i < s->faults; i++) begin = fmin(begin, s->fault[i].from_s);
    return begin;
}

double mk_faults_end(const mk_scenario_t *s) {
    double end = s->faults ? -(double)INFINITY : (double)INFINITY;
    for (int i = 0; i < s->faults; i++) end = fmax(end, s->fault[i].to_s);
    return end;
}

static double value_at(const mk_sensor_fault_t *fault, double t_s) {
    return mk_fault_is_on(fault, t_s) ? fault->step + fault->rate * (t_s - fault->from_s) : 0.0;
}

void mk_faults_at(const mk_scenario_t *s, const int *row_first, double t_s, double *added) {
    memset(added, 0, (size_t)row_first[s->nodes] * sizeof *added);
    for (int i = 0; i < s->faults; i++) added[row_first[s->fault[i].node] + s->fault[i].row] += value_at(&s->fault[i], t_s);
}

int mk_faults_add(const mk_scenario_t *s, int k, double t_s, double *reading) {
    int on = 0;
    for (int i = 0; i < s->faults; i++) {
        if (s->fault[i].node != k) continue;
        reading[s->fault[i].row] += value_at(&s->fault[i], t_s);
        on |= mk_fault_is_on(&s->fault[i], t_s);
    }
    return on;
}
