/* SPDX-License-Identifier: MIT */
/*
 * Strapdown navigation in a local level frame: east, north, up; flat, gravity constant, no rotation of the Earth. The body's axes are right, forward,
 * up. Float64.
 *
 * A sample of the inertial unit is the mean angular rate w and the mean specific force f of an interval, in body axes, as from the increments that
 * such units give out. Over an interval both are taken as constant: attitude and velocity are then exact, position is by the trapezoid rule.
 */
#ifndef MESHKAL_NAVIGATION_STRAPDOWN_H
#define MESHKAL_NAVIGATION_STRAPDOWN_H

#include "scenario_navigation.h"

typedef struct {
    double h;          /* s: length of the interval */
    double w[3], f[3]; /* rad/s, m/s^2 */
} mk_inertial_t;

typedef struct {
    double q[4];       /* attitude, body to level: unit quaternion, scalar first */
    double v[3], p[3]; /* m/s, m */
    double gyro_bias[3], accelerometer_bias[3]; /* rad/s, m/s^2 */
    double clock_bias, clock_drift;             /* m, m/s */
} mk_nav_state_t;

/* q := that of the rotation vector. */
void mk_rotation_quaternion(const double vector[3], double q[4]);
/* The shortest rotation vector of q. */
void mk_rotation_vector(const double q[4], double vector[3]);
/* r := a b, of unit length; r may be a or b. */
void mk_rotation_product(const double a[4], const double b[4], double r[4]);
/* r := the inverse of q. */
void mk_rotation_inverse(const double q[4], double r[4]);
/* C, 3 x 3 in row order: vector in the level frame = C vector in the body's. */
void mk_rotation_matrix(const double q[4], double C[9]);
/* Roll (right side down), pitch (nose up), heading (clockwise from north), rad; body to level is Rz(-heading) Rx(pitch) Ry(roll). */
void mk_rotation_from_angles(const double angles[3], double q[4]);
void mk_rotation_angles(const double q[4], double angles[3]);

/* State numbers in the order of MK_NAV_, attitude as roll, pitch, heading. */
void mk_nav_state_put(const mk_nav_state_t *state, double x[MK_NAV_STATES]);
void mk_nav_state_take(const double x[MK_NAV_STATES], mk_nav_state_t *state);
/* The error of an estimate as the error model of spec 3.4 has it: attitude phi with C_estimate = (I - [phi x]) C, estimate less truth of velocity and
   position, truth less estimate of biases and clock. */
void mk_nav_error(const mk_nav_state_t *estimate, const mk_nav_state_t *truth, double error[MK_NAV_STATES]);
/* The estimate whose error was `error` is put right. */
void mk_nav_correct(mk_nav_state_t *estimate, const double error[MK_NAV_STATES]);

/* One interval, with the state's biases taken off; the clock, too. Out: C and the specific force in level axes at its middle. */
void mk_nav_step(mk_nav_state_t *state, const mk_inertial_t *sample, double gravity, double C[9], double force[3]);
/* The sample that takes attitude and velocity of one state, which has no biases, to those of the other in h seconds. */
void mk_nav_sample(const mk_nav_state_t *from, const mk_nav_state_t *to, double h, double gravity, mk_inertial_t *sample);

/*
 * Transition and noise of the error over an epoch, interval by interval: phi' = -C eps, dv' = [f x] phi + C nab, dp' = dv, b' = d, C and f
 * constant in an interval. Each is the exact product of the exponentials, kept as 3 x 3 blocks.
 */
typedef struct {
    double T;                                           /* seconds */
    double A[9], AA[9], F[9], FF[9], G[9], GG[9];       /* of C, [f x] and [f x] A: integrals, and the integrals of these but for A */
    double phi, X[9], Y[9], V[9], W[9], P[9];           /* noise: of phi, one number; (dv, phi), (dp, phi), (dv, dv), (dp, dv), (dp, dp) */
} mk_nav_transition_t;

void mk_nav_transition_start(mk_nav_transition_t *t);
/* gyro, accelerometer: densities of their noise, (rad/s)^2/Hz and (m/s^2)^2/Hz. */
void mk_nav_transition_add(mk_nav_transition_t *t, double h, const double C[9], const double force[3], double gyro, double accelerometer);
/* Phi 17 x 17 in row order, Q packed; with the clock's densities. */
void mk_nav_transition_put(const mk_nav_transition_t *t, double sf, double sg, double *Phi, double *Q);

#endif
