/* SPDX-License-Identifier: MIT */
#include "navigation/flight.h"

#include <math.h>
#include <meshkal/angle.h>
#include <string.h>

#define TURN 6.28318530717958647692 /* a whole one, rad */

/* Done of a maneuver's amount at time t, and the rate of it. */
static double progress(const mk_maneuver_t *m, double t, double *rate) {
    const double T = m->to_s - m->from_s, share = (t - m->from_s) / T;
    double sine, cosine;
    *rate = 0.0;
    if (!(share > 0.0)) return 0.0;
    if (!(share < 1.0)) return m->amount;
    mk_sincos_f64(TURN * share, &sine, &cosine);
    *rate = m->amount / T * (1.0 - cosine);
    return m->amount * (share - sine / TURN);
}

/* Attitude and velocity. */
static void look_up(const mk_navigation_t *nav, double t, double q[4], double v[3]) {
    double heading = nav->heading, turn_rate = 0.0, climb = 0.0, rate, sine, cosine;
    for (int i = 0; i < nav->maneuvers; i++) {
        const double done = progress(&nav->maneuver[i], t, &rate);
        if (nav->maneuver[i].climbs) climb += rate;
        else {
            heading += done;
            turn_rate += rate;
        }
    }
    const double level = sqrt(nav->speed * nav->speed - climb * climb);
    const double angles[3] = {mk_atan2_f64(level * turn_rate, nav->gravity), mk_atan2_f64(climb, level), heading};
    mk_rotation_from_angles(angles, q);
    mk_sincos_f64(heading, &sine, &cosine);
    v[0] = level * sine;
    v[1] = level * cosine;
    v[2] = climb;
}

mk_flown_t *mk_fly(const mk_navigation_t *nav, long intervals) {
    mk_flown_t *const flown = mk_allocate((size_t)intervals + 1, sizeof *flown);
    const double h = nav->imu_s;
    look_up(nav, nav->start_s, flown->q, flown->v);
    memcpy(flown->p, nav->position, sizeof flown->p);
    for (long k = 1; k <= intervals; k++) {
        mk_flown_t *const now = &flown[k], *const before = now - 1;
        mk_nav_state_t from, to;
        double q[4], v[3];
        look_up(nav, nav->start_s + ((double)k - 0.5) * h, q, v);
        look_up(nav, nav->start_s + (double)k * h, now->q, now->v);
        for (int i = 0; i < 3; i++) now->p[i] = before->p[i] + h / 6.0 * (before->v[i] + 4.0 * v[i] + now->v[i]);
        memcpy(from.q, before->q, sizeof from.q);
        memcpy(from.v, before->v, sizeof from.v);
        memcpy(to.q, now->q, sizeof to.q);
        memcpy(to.v, now->v, sizeof to.v);
        mk_nav_sample(&from, &to, h, nav->gravity, &now->sample);
    }
    return flown;
}
