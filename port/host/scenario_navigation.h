/* SPDX-License-Identifier: MIT */
/* The navigation part of a scenario (model.navigation in scenario.schema.json): an inertial unit, satellites, and what is known of their errors. */
#ifndef MESHKAL_HOST_SCENARIO_NAVIGATION_H
#define MESHKAL_HOST_SCENARIO_NAVIGATION_H

#include "scenario.h"
#include "scenario_read.h"

/* States of the error model, spec 3.4; estimates and truth have the same order: roll, pitch and heading in place of the attitude error. */
enum { MK_NAV_ATTITUDE = 0, MK_NAV_VELOCITY = 3, MK_NAV_POSITION = 6, MK_NAV_GYRO = 9, MK_NAV_ACCELEROMETER = 12, MK_NAV_CLOCK = 15, MK_NAV_DRIFT = 16,
       MK_NAV_STATES = 17 };
/* Rows that a filter and its monitor take. */
enum { MK_NAV_SATELLITES = 32 };

#define MK_NAV_FILTERS {"ekf", "rekf-n", "rekf-t"}
enum { MK_NAV_EKF, MK_NAV_REKF_N, MK_NAV_REKF_T, MK_NAV_FILTER_COUNT };

/* heading or height changes by `amount` (rad, clockwise seen from above; m) as (amount / T) (1 - cos 2 pi tau / T) a second, tau = 0 .. T */
typedef struct {
    int climbs; /* 0: it turns */
    double amount, from_s, to_s;
} mk_maneuver_t;

typedef struct {
    int number;
    double elevation, azimuth; /* rad, azimuth clockwise from north */
} mk_satellite_t;

/* SI units; scenario.P0 is made of sd, scenario.x0 is 0: the error's mean. */
typedef struct mk_navigation {
    int samples;                         /* of the inertial unit in one dt_s */
    double imu_s;                        /* their interval */
    double start_s, speed, heading, gravity, position[3];
    int maneuvers;
    mk_maneuver_t *maneuver;
    double gyro_bias[3], accelerometer_bias[3]; /* rad/s, m/s^2 */
    double angle_walk, velocity_walk;    /* rad/sqrt(s), m/s/sqrt(s): white noise of gyros and accelerometers */
    double clock_sf, clock_sg;           /* m^2/s, m^2/s^3 */
    double sd[MK_NAV_STATES];            /* of the initial estimate's error */
    int biases_are_drawn;                /* 0: they are gyro_bias and accelerometer_bias in every run */
    int has_estimate;
    double estimate[MK_NAV_STATES];      /* initial, of all runs */
    double satellite_range;              /* m, from the origin */
    mk_satellite_t *satellite;           /* nodes */
    double k0, k1;                       /* rekf-n */
    double significance[2];              /* rekf-t */
} mk_navigation_t;

/* Parts of mk_scenario_load_any. The model of a scenario that has one with "navigation": fills n, Q (0), x0, P0, dt_s, position_states and navigation. */
int mk_read_navigation(mk_reader_t *reader, json_t *model, mk_scenario_t *scenario);
/* A node: its row's variance into *R. 1, or 0 and an error. */
int mk_read_satellite(mk_reader_t *reader, json_t *node, const char *at, mk_satellite_t *satellite, double *R);
/* Once all nodes are known: no number twice, no links. */
int mk_check_navigation(mk_reader_t *reader, const mk_scenario_t *scenario);
void mk_navigation_free(mk_navigation_t *navigation);

#endif
