/* SPDX-License-Identifier: MIT */
/* Angles, motions and sensors: everything in them but + - * / and square roots is the library's own, so they agree bit by bit. */
#include <meshkal/angle.h>
#include <meshkal/tracking.h>

#include "vectors.h"

enum { STATES = 8, POINTS = 3, ANGLES = 64 };

static const mk_motion_t motions[] = {{5, 2, {0, 2, 0}, {1, 3, 0}, 4}, {8, 3, {7, 2, 5}, {0, 6, 3}, 4}};

static void angle_vectors(void) {
    vector_begin("angles", 0, 0, 0, 0);
    for (int i = 0; i < ANGLES; i++) {
        /* To 1e-4, 1, 1e4 and beyond where reduction is exact. */
        static const MK_REAL sizes[] = {MK_R(1e-4), MK_R(2.0), MK_R(40.0), MK_R(1e4), MK_R(6e6)};
        MK_REAL result[4];
        const MK_REAL x = sizes[i % 5] * draw(), y = sizes[i % 3] * draw();
        MK_F(mk_sincos)(x, result, result + 1);
        result[2] = MK_F(mk_wrap)(x);
        result[3] = MK_F(mk_atan2)(y, x);
        vector_numbers("sine, cosine, wrapped, arc tangent", 4, result);
    }
}

static void motion_vectors(const mk_motion_t *motion, int number) {
    static const MK_REAL rates[] = {MK_R(0.0), MK_R(1e-6), MK_R(0.5), MK_R(3.0)};
    MK_REAL x[STATES * POINTS], y[STATES * POINTS], J[STATES * STATES], q[3];
    const int n = motion->n;
    const MK_REAL dt = MK_R(1.0) + MK_R(0.5) * draw();
    vector_begin("motion", n, motion->dimensions, 0, number);
    for (int i = 0; i < n * POINTS; i++) x[i] = MK_R(20.0) * draw();
    for (int i = 0; i < POINTS; i++) x[i * n + motion->turn_rate] = rates[number % 4] * draw();
    for (int i = 0; i < 3; i++) q[i] = MK_R(1.0) + draw();
    vector_word("constant velocity", (uint32_t)MK_F(mk_constant_velocity)(motion, dt, POINTS, x, y));
    vector_numbers("states", n * POINTS, y);
    vector_word("its Jacobian", (uint32_t)MK_F(mk_constant_velocity_jacobian)(motion, dt, x, J));
    vector_numbers("J", n * n, J);
    vector_word("constant turn", (uint32_t)MK_F(mk_constant_turn)(motion, dt, POINTS, x, y));
    vector_numbers("states", n * POINTS, y);
    vector_word("its Jacobian", (uint32_t)MK_F(mk_constant_turn_jacobian)(motion, dt, x, J));
    vector_numbers("J", n * n, J);
    vector_word("noise", (uint32_t)MK_F(mk_constant_turn_noise)(motion, dt, q, q[0], J));
    vector_numbers("Q", MK_PACKED(n), J);
}

/* The last number of each motion has its first target at the sensor. */
static void sensor_vectors(const mk_motion_t *motion, int number) {
    static const MK_F_T(mk_function) functions[] = {MK_F(mk_range), MK_F(mk_bearing), MK_F(mk_range_bearing), MK_F(mk_range_rate),
                                                    MK_F(mk_tdoa)};
    static const MK_F_T(mk_jacobian) jacobians[] = {MK_F(mk_range_jacobian), MK_F(mk_bearing_jacobian), MK_F(mk_range_bearing_jacobian),
                                                    MK_F(mk_range_rate_jacobian), MK_F(mk_tdoa_jacobian)};
    MK_REAL x[STATES * POINTS], y[3 * POINTS], J[3 * STATES];
    MK_F_T(mk_site) site;
    site.motion = motion;
    for (int axis = 0; axis < 3; axis++) {
        site.position[axis] = MK_R(50.0) * draw();
        site.reference[axis] = MK_R(50.0) * draw();
    }
    for (int i = 0; i < motion->n * POINTS; i++) x[i] = MK_R(20.0) * draw();
    if (number == 7)
        for (int axis = 0; axis < motion->dimensions; axis++) x[motion->position[axis]] = site.position[axis];
    for (int kind = 0; kind < 5; kind++) {
        const int rows = kind == 1 ? motion->dimensions - 1 : kind == 2 ? motion->dimensions : 1;
        vector_begin("sensor", motion->n, rows, 0, 10 * number + kind);
        mk_status_t status = functions[kind](&site, MK_R(0.0), POINTS, x, y);
        vector_word("function", (uint32_t)status);
        if (status == MK_OK) vector_numbers("y", rows * POINTS, y);
        status = jacobians[kind](&site, MK_R(0.0), x, J);
        vector_word("Jacobian", (uint32_t)status);
        if (status == MK_OK) vector_numbers("J", rows * motion->n, J);
    }
}

void vectors_models(void) {
    angle_vectors();
    for (int number = 0; number < 16; number++) {
        motion_vectors(&motions[number / 8], number % 8);
        sensor_vectors(&motions[number / 8], number % 8);
    }
}
