/* SPDX-License-Identifier: MIT */
#include "navigation/strapdown.h"

#include <math.h>
#include <meshkal/angle.h>
#include <string.h>

/* --- rotations -------------------------------------------------------------------------------------------------------------- */

void mk_rotation_quaternion(const double vector[3], double q[4]) {
    const double angle = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    double sine, ratio = 0.5 - angle * angle / 48.0; /* sin(angle / 2) / angle */
    mk_sincos_f64(0.5 * angle, &sine, &q[0]);
    if (angle > 1e-4) ratio = sine / angle;
    for (int i = 0; i < 3; i++) q[1 + i] = ratio * vector[i];
}

void mk_rotation_vector(const double q[4], double vector[3]) {
    const double sign = q[0] < 0.0 ? -1.0 : 1.0, sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    /* angle / sin(angle / 2) */
    const double ratio = sine > 1e-5 ? 2.0 * mk_atan2_f64(sine, sign * q[0]) / sine : 2.0 + sine * sine / 3.0;
    for (int i = 0; i < 3; i++) vector[i] = sign * ratio * q[1 + i];
}

void mk_rotation_product(const double a[4], const double b[4], double r[4]) {
    const double c[4] = {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                         a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
    const double length = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2] + c[3] * c[3]);
    for (int i = 0; i < 4; i++) r[i] = c[i] / length;
}

void mk_rotation_inverse(const double q[4], double r[4]) {
    r[0] = q[0];
    for (int i = 1; i < 4; i++) r[i] = -q[i];
}

void mk_rotation_matrix(const double q[4], double C[9]) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    C[0] = w * w + x * x - y * y - z * z;
    C[1] = 2.0 * (x * y - w * z);
    C[2] = 2.0 * (x * z + w * y);
    C[3] = 2.0 * (x * y + w * z);
    C[4] = w * w - x * x + y * y - z * z;
    C[5] = 2.0 * (y * z - w * x);
    C[6] = 2.0 * (x * z - w * y);
    C[7] = 2.0 * (y * z + w * x);
    C[8] = w * w - x * x - y * y + z * z;
}

void mk_rotation_from_angles(const double angles[3], double q[4]) {
    double roll[4] = {0.0}, pitch[4] = {0.0}, heading[4] = {0.0};
    mk_sincos_f64(0.5 * angles[0], &roll[2], &roll[0]);
    mk_sincos_f64(0.5 * angles[1], &pitch[1], &pitch[0]);
    mk_sincos_f64(-0.5 * angles[2], &heading[3], &heading[0]);
    mk_rotation_product(heading, pitch, q);
    mk_rotation_product(q, roll, q);
}

/* Where the nose points straight up or down, the roll is 0. */
void mk_rotation_angles(const double q[4], double angles[3]) {
    double C[9];
    mk_rotation_matrix(q, C);
    const double level = sqrt(C[1] * C[1] + C[4] * C[4]);
    angles[1] = mk_atan2_f64(C[7], level);
    angles[0] = level > 1e-12 ? mk_atan2_f64(-C[6], C[8]) : 0.0;
    angles[2] = level > 1e-12 ? mk_atan2_f64(C[1], C[4]) : mk_atan2_f64(-C[3], C[0]);
}

/* --- states ----------------------------------------------------------------------------------------------------------------- */

void mk_nav_state_put(const mk_nav_state_t *s, double x[MK_NAV_STATES]) {
    mk_rotation_angles(s->q, x + MK_NAV_ATTITUDE);
    memcpy(x + MK_NAV_VELOCITY, s->v, sizeof s->v);
    memcpy(x + MK_NAV_POSITION, s->p, sizeof s->p);
    memcpy(x + MK_NAV_GYRO, s->gyro_bias, sizeof s->gyro_bias);
    memcpy(x + MK_NAV_ACCELEROMETER, s->accelerometer_bias, sizeof s->accelerometer_bias);
    x[MK_NAV_CLOCK] = s->clock_bias;
    x[MK_NAV_DRIFT] = s->clock_drift;
}

void mk_nav_state_take(const double x[MK_NAV_STATES], mk_nav_state_t *s) {
    mk_rotation_from_angles(x + MK_NAV_ATTITUDE, s->q);
    memcpy(s->v, x + MK_NAV_VELOCITY, sizeof s->v);
    memcpy(s->p, x + MK_NAV_POSITION, sizeof s->p);
    memcpy(s->gyro_bias, x + MK_NAV_GYRO, sizeof s->gyro_bias);
    memcpy(s->accelerometer_bias, x + MK_NAV_ACCELEROMETER, sizeof s->accelerometer_bias);
    s->clock_bias = x[MK_NAV_CLOCK];
    s->clock_drift = x[MK_NAV_DRIFT];
}

void mk_nav_error(const mk_nav_state_t *estimate, const mk_nav_state_t *truth, double error[MK_NAV_STATES]) {
    double back[4], phi[4];
    mk_rotation_inverse(estimate->q, back);
    mk_rotation_product(truth->q, back, phi);
    mk_rotation_vector(phi, error + MK_NAV_ATTITUDE);
    for (int i = 0; i < 3; i++) {
        error[MK_NAV_VELOCITY + i] = estimate->v[i] - truth->v[i];
        error[MK_NAV_POSITION + i] = estimate->p[i] - truth->p[i];
        error[MK_NAV_GYRO + i] = truth->gyro_bias[i] - estimate->gyro_bias[i];
        error[MK_NAV_ACCELEROMETER + i] = truth->accelerometer_bias[i] - estimate->accelerometer_bias[i];
    }
    error[MK_NAV_CLOCK] = truth->clock_bias - estimate->clock_bias;
    error[MK_NAV_DRIFT] = truth->clock_drift - estimate->clock_drift;
}

void mk_nav_correct(mk_nav_state_t *s, const double error[MK_NAV_STATES]) {
    double q[4];
    mk_rotation_quaternion(error + MK_NAV_ATTITUDE, q);
    mk_rotation_product(q, s->q, s->q);
    for (int i = 0; i < 3; i++) {
        s->v[i] -= error[MK_NAV_VELOCITY + i];
        s->p[i] -= error[MK_NAV_POSITION + i];
        s->gyro_bias[i] += error[MK_NAV_GYRO + i];
        s->accelerometer_bias[i] += error[MK_NAV_ACCELEROMETER + i];
    }
    s->clock_bias += error[MK_NAV_CLOCK];
    s->clock_drift += error[MK_NAV_DRIFT];
}

/* --- an interval ------------------------------------------------------------------------------------------------------------ */

static void cross(const double a[3], const double b[3], double c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* s = sin(a / 2) / (a / 2) of the angle |turn|: a force across the axis of rotation has s times its size in the mean. f := f + factor across(f). */
static void scale_across(const double turn[3], int inverse, double f[3]) {
    const double square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2];
    double s = 1.0 - square / 24.0 * (1.0 - square / 80.0), less = (1.0 - square / 80.0) / 24.0, once[3], twice[3]; /* less: (1 - s) / square */
    if (square > 1e-4) {
        double cosine;
        const double half = 0.5 * sqrt(square);
        mk_sincos_f64(half, &s, &cosine);
        s /= half;
        less = (1.0 - s) / square;
    }
    const double factor = inverse ? -less / s : less;
    cross(turn, f, once);
    cross(turn, once, twice);
    for (int i = 0; i < 3; i++) f[i] += factor * twice[i];
}

static void turn_vector(const double C[9], const double b[3], double n[3]) {
    for (int i = 0; i < 3; i++) n[i] = C[3 * i] * b[0] + C[3 * i + 1] * b[1] + C[3 * i + 2] * b[2];
}

void mk_nav_step(mk_nav_state_t *s, const mk_inertial_t *sample, double gravity, double C[9], double force[3]) {
    const double h = sample->h;
    double half[3], turn[3], f[3], q[4];
    for (int i = 0; i < 3; i++) {
        turn[i] = (sample->w[i] - s->gyro_bias[i]) * h;
        half[i] = 0.5 * turn[i];
        f[i] = sample->f[i] - s->accelerometer_bias[i];
    }
    mk_rotation_quaternion(half, q);
    mk_rotation_product(s->q, q, s->q);
    mk_rotation_matrix(s->q, C);
    mk_rotation_product(s->q, q, s->q);
    scale_across(turn, 0, f);
    turn_vector(C, f, force);
    for (int i = 0; i < 3; i++) {
        const double change = h * (force[i] - (i == 2 ? gravity : 0.0));
        s->p[i] += h * (s->v[i] + 0.5 * change);
        s->v[i] += change;
    }
    s->clock_bias += h * s->clock_drift;
}

void mk_nav_sample(const mk_nav_state_t *from, const mk_nav_state_t *to, double h, double gravity, mk_inertial_t *sample) {
    double back[4], turned[4], middle[4], turn[3], half[3], C[9], mean[3];
    mk_rotation_inverse(from->q, back);
    mk_rotation_product(back, to->q, turned);
    mk_rotation_vector(turned, turn);
    for (int i = 0; i < 3; i++) {
        half[i] = 0.5 * turn[i];
        sample->w[i] = turn[i] / h;
        mean[i] = (to->v[i] - from->v[i]) / h + (i == 2 ? gravity : 0.0);
    }
    mk_rotation_quaternion(half, middle);
    mk_rotation_product(from->q, middle, middle);
    mk_rotation_matrix(middle, C);
    for (int i = 0; i < 3; i++) sample->f[i] = C[i] * mean[0] + C[3 + i] * mean[1] + C[6 + i] * mean[2];
    scale_across(turn, 1, sample->f);
    sample->h = h;
}

/* --- transition -------------------------------------------------------------------------------------------------------------- */

static void add(double *a, double factor, const double *b) {
    for (int i = 0; i < 9; i++) a[i] += factor * b[i];
}

static void multiply(const double *a, const double *b, double *c) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) c[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

static void transpose(const double *a, double *b) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) b[3 * i + j] = a[3 * j + i];
}

void mk_nav_transition_start(mk_nav_transition_t *t) { memset(t, 0, sizeof *t); }

/* What was there before the interval, dv := dv + S phi, dp := dp + h dv + S phi h / 2 with S = [f x] h; then what comes in during it. */
static void add_noise(mk_nav_transition_t *t, double h, const double *S, double gyro, double accelerometer) {
    double St[9], SS[9], XS[9], SX[9], YS[9], SY[9], Wt[9];
    transpose(S, St);
    multiply(S, St, SS);
    multiply(t->X, St, XS);
    transpose(XS, SX);
    multiply(t->Y, St, YS);
    transpose(YS, SY);
    transpose(t->W, Wt);
    for (int i = 0; i < 9; i++) {
        const double one = i % 4 == 0 ? accelerometer * h : 0.0;
        t->P[i] += h * (t->W[i] + Wt[i] + h * (t->V[i] + 0.5 * (XS[i] + SX[i]) + 0.25 * t->phi * SS[i]) + 0.5 * (YS[i] + SY[i])) +
                   h * h * (one / 3.0 + gyro * h / 20.0 * SS[i]);
        t->W[i] += YS[i] + h * (t->V[i] + XS[i] + 0.5 * SX[i] + 0.5 * t->phi * SS[i] + 0.5 * one + gyro * h / 8.0 * SS[i]);
        t->V[i] += XS[i] + SX[i] + (t->phi + gyro * h / 3.0) * SS[i] + one;
        t->Y[i] += h * (t->X[i] + (0.5 * t->phi + gyro * h / 6.0) * S[i]);
        t->X[i] += (t->phi + 0.5 * gyro * h) * S[i];
    }
    t->phi += gyro * h;
}

void mk_nav_transition_add(mk_nav_transition_t *t, double h, const double C[9], const double force[3], double gyro, double accelerometer) {
    const double S[9] = {0.0,           -h * force[2], h * force[1],  h * force[2], 0.0, -h * force[0],
                         -h * force[1], h * force[0],  0.0};
    double SA[9], SC[9];
    multiply(S, t->A, SA);
    multiply(S, C, SC);
    /* G' = [f x] A, and A' = C, in the interval; sums of sums first. */
    add(t->GG, h, t->G);
    add(t->GG, 0.5 * h, SA);
    add(t->GG, h * h / 6.0, SC);
    add(t->G, 1.0, SA);
    add(t->G, 0.5 * h, SC);
    add(t->FF, h, t->F);
    add(t->FF, 0.5 * h, S);
    add(t->F, 1.0, S);
    add(t->AA, h, t->A);
    add(t->AA, 0.5 * h * h, C);
    add(t->A, h, C);
    t->T += h;
    add_noise(t, h, S, gyro, accelerometer);
}

static void put_block(double *Phi, int row, int column, double factor, const double *block) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) Phi[MK_NAV_STATES * (row + i) + column + j] = factor * block[3 * i + j];
}

static double *entry(double *Q, int i, int j) { return Q + i * (i + 1) / 2 + j; }

void mk_nav_transition_put(const mk_nav_transition_t *t, double sf, double sg, double *Phi, double *Q) {
    const double T = t->T, one[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
    memset(Phi, 0, sizeof *Phi * MK_NAV_STATES * MK_NAV_STATES);
    memset(Q, 0, sizeof *Q * (MK_NAV_STATES * (MK_NAV_STATES + 1) / 2));
    for (int i = 0; i < MK_NAV_STATES; i++) Phi[(MK_NAV_STATES + 1) * i] = 1.0;
    put_block(Phi, MK_NAV_ATTITUDE, MK_NAV_GYRO, -1.0, t->A);
    put_block(Phi, MK_NAV_VELOCITY, MK_NAV_ATTITUDE, 1.0, t->F);
    put_block(Phi, MK_NAV_VELOCITY, MK_NAV_GYRO, -1.0, t->G);
    put_block(Phi, MK_NAV_VELOCITY, MK_NAV_ACCELEROMETER, 1.0, t->A);
    put_block(Phi, MK_NAV_POSITION, MK_NAV_ATTITUDE, 1.0, t->FF);
    put_block(Phi, MK_NAV_POSITION, MK_NAV_VELOCITY, T, one);
    put_block(Phi, MK_NAV_POSITION, MK_NAV_GYRO, -1.0, t->GG);
    put_block(Phi, MK_NAV_POSITION, MK_NAV_ACCELEROMETER, 1.0, t->AA);
    Phi[MK_NAV_STATES * MK_NAV_CLOCK + MK_NAV_DRIFT] = T;
    for (int i = 0; i < 3; i++) {
        *entry(Q, MK_NAV_ATTITUDE + i, MK_NAV_ATTITUDE + i) = t->phi;
        for (int j = 0; j < 3; j++) {
            *entry(Q, MK_NAV_VELOCITY + i, MK_NAV_ATTITUDE + j) = t->X[3 * i + j];
            *entry(Q, MK_NAV_POSITION + i, MK_NAV_ATTITUDE + j) = t->Y[3 * i + j];
            *entry(Q, MK_NAV_POSITION + i, MK_NAV_VELOCITY + j) = t->W[3 * i + j];
            if (j > i) continue;
            *entry(Q, MK_NAV_VELOCITY + i, MK_NAV_VELOCITY + j) = t->V[3 * i + j];
            *entry(Q, MK_NAV_POSITION + i, MK_NAV_POSITION + j) = t->P[3 * i + j];
        }
    }
    *entry(Q, MK_NAV_CLOCK, MK_NAV_CLOCK) = T * (sf + sg * T * T / 3.0);
    *entry(Q, MK_NAV_DRIFT, MK_NAV_CLOCK) = sg * T * T / 2.0;
    *entry(Q, MK_NAV_DRIFT, MK_NAV_DRIFT) = sg * T;
}
