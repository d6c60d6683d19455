/* SPDX-License-Identifier: MIT */
/* Does the network of a tracking scenario work? Consensus on its graph, and observability from its sensors along a trajectory. */
#ifndef MESHKAL_TRACKING_DESIGN_H
#define MESHKAL_TRACKING_DESIGN_H

#include <stdio.h>

#include "tracking/consensus_rate.h"
#include "tracking/coverage.h"
#include "tracking/windows.h"

/* Of the disagreement that is left, for which iterations are counted. */
#define MK_ACCURACIES {1e-1, 1e-2, 1e-3, 1e-6, 1e-9}
enum { MK_ACCURACY_COUNT = 5 };

/* Cases of consensus (meshkal/consensus.h): the paper's protocol if all nodes with a sensor measure, if the worst of them does alone, if none
   does, with or without the scales of perron, which do not change its matrix; Metropolis; ratio, whose matrix is the transpose of the paper's with
   a self-loop at every node, and has the same eigenvalues. */
enum { MK_CASE_ALL, MK_CASE_ONE, MK_CASE_NONE, MK_CASE_METROPOLIS, MK_CASE_RATIO, MK_CASE_COUNT };

typedef struct {
    int exists;    /* 0: nobody has a sensor */
    int converges;
    int period;    /* the largest of the parts of the graph */
    int node;      /* MK_CASE_ONE: the worst */
    mk_rate_t rate; /* modulus 1 where it does not converge */
} mk_case_t;

typedef struct {
    const char *truth;      /* a file; null: the mean trajectory */
    long steps, window;
    double condition;       /* limit of the warning */
    long runs;              /* drawn for the coverage */
    int threads;
} mk_tracking_design_settings_t;

typedef struct {
    const mk_scenario_t *scenario;
    mk_tracking_design_settings_t settings;

    mk_links_t links;
    unsigned char *sensing; /* nodes with a sensor */
    int sensors;
    mk_convergence_t parts; /* with nobody measuring: sources are the parts of the graph, of period 2 if bipartite */
    mk_case_t consensus[MK_CASE_COUNT];
    int tried;              /* nodes of which MK_CASE_ONE is the worst */
    double *pi;             /* limit of MK_CASE_ALL; null where there is none */

    mk_trajectory_t trajectory;
    long length, windows;   /* of a window, in instants: settings.window or all there are; number of windows */
    mk_window_t *window;
    mk_windows_t network, *node;
    mk_coverage_t coverage;

    char **warning;
    int warnings;
    mk_error_t failure;     /* why the network cannot work; empty: it can */
    double seconds;
} mk_tracking_design_t;

/* The case of the scenario's protocol, all nodes with a sensor measuring. */
int mk_scenario_case(const mk_tracking_t *tracking);

/* 1, or 0 and an error: the truth file, a trajectory outside the models. Free the results by mk_tracking_design_free. */
int mk_tracking_design(mk_tracking_design_t *results, const mk_models_f64_t *models, const mk_tracking_design_settings_t *settings, mk_error_t *error);
void mk_tracking_design_free(mk_tracking_design_t *results);

/* Runs of instants for which chosen(context, instant) holds, from 1: "3-7, 9"; at most `room` bytes, "..." for what has no room. */
void mk_runs_text(const mk_tracking_design_t *results, long count, int (*chosen)(const mk_tracking_design_t *results, long instant), char *text,
                  unsigned long room);
/* "nodes 3, 4, ..." of those with flag[k] == value, ten at most. */
void mk_nodes_text(int nodes, const int *flag, int value, char *text, unsigned long room);
/* The choices: of instants, then of windows by their first instants. */
int mk_nobody_measures(const mk_tracking_design_t *results, long instant);
int mk_fewer_than_two_measure(const mk_tracking_design_t *results, long instant);
int mk_window_unseen(const mk_tracking_design_t *results, long window);
int mk_window_ill(const mk_tracking_design_t *results, long window);

/* Tables for people; one JSON object for programs. */
void mk_print_tracking_design(const mk_tracking_design_t *results);
void mk_write_tracking_design(FILE *stream, const mk_tracking_design_t *results);

#endif
