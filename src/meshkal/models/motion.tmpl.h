/* SPDX-License-Identifier: MIT */
/* The motions of <meshkal/tracking.h>. */

/* J := I. What a motion does not mention stays as it is. */
static void MK_F(mk_motion_identity)(int n, MK_REAL *J) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) J[i * n + j] = i == j ? MK_R(1.0) : MK_R(0.0);
}

mk_status_t MK_F(mk_constant_velocity)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const mk_motion_t *const motion = context;
    for (int point = 0; point < count; point++, x += motion->n, y += motion->n) {
        for (int i = 0; i < motion->n; i++) y[i] = x[i];
        for (int axis = 0; axis < motion->dimensions; axis++) y[motion->position[axis]] += dt * x[motion->velocity[axis]];
    }
    return MK_OK;
}

mk_status_t MK_F(mk_constant_velocity_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const mk_motion_t *const motion = context;
    (void)x;
    MK_F(mk_motion_identity)(motion->n, J);
    for (int axis = 0; axis < motion->dimensions; axis++) J[motion->position[axis] * motion->n + motion->velocity[axis]] = dt;
    return MK_OK;
}

/* Of a turn by a = omega dt: sin a and cos a, sin(h) / h and cos h of h = a / 2, and the arc's two sides for velocity 1:
   along = sin(a) / omega, across = (1 - cos a) / omega. By the half angle none of them is a difference of nearly equal numbers. */
typedef struct {
    MK_REAL h, sine, cosine, ratio, half_cosine, along, across;
} MK_F_T(mk_turn);

static MK_F_T(mk_turn) MK_F(mk_turn)(MK_REAL dt, MK_REAL omega) {
    MK_F_T(mk_turn) turn;
    MK_REAL s;
    turn.h = MK_R(0.5) * dt * omega;
    MK_F(mk_sincos)(turn.h, &s, &turn.half_cosine);
    turn.sine = MK_R(2.0) * s * turn.half_cosine;
    turn.cosine = MK_R(1.0) - MK_R(2.0) * s * s;
    turn.ratio = turn.h == MK_R(0.0) ? MK_R(1.0) : s / turn.h;
    turn.along = dt * turn.ratio * turn.half_cosine;
    turn.across = dt * turn.ratio * s;
    return turn;
}

mk_status_t MK_F(mk_constant_turn)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const mk_motion_t *const motion = context;
    const uint8_t *const p = motion->position, *const v = motion->velocity;
    for (int point = 0; point < count; point++, x += motion->n, y += motion->n) {
        const MK_F_T(mk_turn) turn = MK_F(mk_turn)(dt, x[motion->turn_rate]);
        const MK_REAL v0 = x[v[0]], v1 = x[v[1]];
        for (int i = 0; i < motion->n; i++) y[i] = x[i];
        y[p[0]] += turn.along * v0 - turn.across * v1;
        y[p[1]] += turn.across * v0 + turn.along * v1;
        y[v[0]] = turn.cosine * v0 - turn.sine * v1;
        y[v[1]] = turn.sine * v0 + turn.cosine * v1;
        if (motion->dimensions == 3) y[p[2]] += dt * x[v[2]];
    }
    return MK_OK;
}

/* (sin(a) / a - cos a) / a^2 for z = a^2 < 1, where the difference would lose digits. Minimax; relative error below 3e-8 (f32, that of
   the first coefficient), 6e-17 (f64). */
static MK_REAL MK_F(mk_turn_bend)(MK_REAL z) {
#if MK_BITS == 64
    return 0.33333333333333331 + z * (-0.033333333333331813 + z * (0.0011904761904556463 + z * (-2.2045855274930451e-05 + z * (
           2.5052083225202353e-07 + z * (-1.9267747042035063e-09 + z * 1.051700950287137e-11)))));
#else
    return 0.333333343f + z * (-0.0333334506f + z * (0.00119060825f + z * -2.18302175e-05f));
#endif
}

mk_status_t MK_F(mk_constant_turn_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const mk_motion_t *const motion = context;
    const uint8_t *const p = motion->position, *const v = motion->velocity;
    const int n = motion->n, omega = motion->turn_rate;
    const MK_F_T(mk_turn) turn = MK_F(mk_turn)(dt, x[omega]);
    const MK_REAL v0 = x[v[0]], v1 = x[v[1]], a = MK_R(2.0) * turn.h, z = a * a, sinc = turn.ratio * turn.half_cosine;
    const MK_REAL bend = z < MK_R(1.0) ? MK_F(mk_turn_bend)(z) : (sinc - turn.cosine) / z;
    /* Derivatives of along and across by omega. */
    const MK_REAL along = -(dt * dt * a * bend), across = dt * dt * (sinc - MK_R(0.5) * turn.ratio * turn.ratio);
    MK_F(mk_motion_identity)(n, J);
    J[p[0] * n + v[0]] = J[p[1] * n + v[1]] = turn.along;
    J[p[0] * n + v[1]] = -turn.across;
    J[p[1] * n + v[0]] = turn.across;
    J[v[0] * n + v[0]] = J[v[1] * n + v[1]] = turn.cosine;
    J[v[0] * n + v[1]] = -turn.sine;
    J[v[1] * n + v[0]] = turn.sine;
    J[p[0] * n + omega] = along * v0 - across * v1;
    J[p[1] * n + omega] = across * v0 + along * v1;
    J[v[0] * n + omega] = -(dt * (turn.sine * v0 + turn.cosine * v1));
    J[v[1] * n + omega] = dt * (turn.cosine * v0 - turn.sine * v1);
    if (motion->dimensions == 3) J[p[2] * n + v[2]] = dt;
    return MK_OK;
}

/* q_turn: null where there is no turn rate. */
static mk_status_t MK_F(mk_motion_noise)(const mk_motion_t *motion, MK_REAL dt, const MK_REAL *q, const MK_REAL *q_turn, MK_REAL *Q) {
    if (!motion || !q || !Q) return MK_ERROR_ARGUMENT;
    const MK_REAL half = MK_R(0.5) * dt * dt, third = dt * dt * dt / MK_R(3.0);
    const MK_REAL turn = q_turn ? *q_turn : MK_R(0.0);
    MK_REAL probe = MK_R(0.0) * turn + MK_R(0.0) * (dt * turn);
    int negative = dt < MK_R(0.0) || turn < MK_R(0.0);
    for (int axis = 0; axis < motion->dimensions; axis++) {
        probe += MK_R(0.0) * (q[axis] * third) + MK_R(0.0) * (q[axis] * half) + MK_R(0.0) * (q[axis] * dt);
        negative |= q[axis] < MK_R(0.0);
    }
    if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    if (negative) return MK_ERROR_ARGUMENT;
    for (int i = 0; i < MK_PACKED(motion->n); i++) Q[i] = MK_R(0.0);
    for (int axis = 0; axis < motion->dimensions; axis++) {
        const int p = motion->position[axis], v = motion->velocity[axis];
        Q[MK_AT(p, p)] = q[axis] * third;
        Q[MK_PLACE(p, v)] = q[axis] * half;
        Q[MK_AT(v, v)] = q[axis] * dt;
    }
    if (q_turn) Q[MK_AT(motion->turn_rate, motion->turn_rate)] = turn * dt;
    return MK_OK;
}

mk_status_t MK_F(mk_constant_velocity_noise)(const mk_motion_t *motion, MK_REAL dt, const MK_REAL *q, MK_REAL *Q) {
    return MK_F(mk_motion_noise)(motion, dt, q, 0, Q);
}

mk_status_t MK_F(mk_constant_turn_noise)(const mk_motion_t *motion, MK_REAL dt, const MK_REAL *q, MK_REAL q_turn, MK_REAL *Q) {
    return MK_F(mk_motion_noise)(motion, dt, q, &q_turn, Q);
}
