/* SPDX-License-Identifier: MIT */
/* "faults" of a scenario, of any kind: what is added to the readings of some sensors, of which filters know nothing. */
#ifndef MESHKAL_HOST_SCENARIO_FAULTS_H
#define MESHKAL_HOST_SCENARIO_FAULTS_H

#include "scenario.h"
#include "scenario_read.h"

/* Part of mk_scenario_load_any, once nodes and their rows are known. 1, or 0 and an error. */
int mk_read_faults(mk_reader_t *reader, json_t *root, mk_scenario_t *scenario);

/* Whether the fault is there at time t_s, up to rounding: one of 1e-9 of the time decides nothing. */
int mk_fault_is_on(const mk_sensor_fault_t *fault, double t_s);
/* Whether a is after b, as closely as mk_fault_is_on looks. */
int mk_is_after(double a_s, double b_s);
/* When the first fault begins and the last is over; infinite without faults. */
double mk_faults_begin(const mk_scenario_t *scenario);
double mk_faults_end(const mk_scenario_t *scenario);
/* Fills what faults add at time t_s to the rows of all nodes, those of node k from row_first[k]: 0 where nothing. */
void mk_faults_at(const mk_scenario_t *scenario, const int *row_first, double t_s, double *added);
/* Adds it to the reading of one node. Returns whether a fault of it is on. */
int mk_faults_add(const mk_scenario_t *scenario, int k, double t_s, double *reading);

#endif
