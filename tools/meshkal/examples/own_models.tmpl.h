/* SPDX-License-Identifier: MIT */
/* Both models in one precision. The context is mk_plugin_context_<real>_t; its first member suits the library's own sensors. */

static mk_status_t MK_F(strength)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const MK_F_T(mk_plugin_context) *const c = context;
    const mk_status_t status = MK_F(mk_range)(&c->site, dt, count, x, y);
    for (int i = 0; i < count && status == MK_OK; i++) {
        if (!(y[i] > MK_R(0.0))) return MK_ERROR_DOMAIN;
        y[i] = c->parameter[0] - MK_R(10.0) * c->parameter[1] * (MK_REAL)log10((double)y[i]);
    }
    return status;
}

/* dz/dp = -10 eta / (ln 10 r) dr/dp */
static mk_status_t MK_F(strength_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const MK_F_T(mk_plugin_context) *const c = context;
    MK_REAL r;
    mk_status_t status = MK_F(mk_range)(&c->site, dt, 1, x, &r);
    if (status == MK_OK) status = MK_F(mk_range_jacobian)(&c->site, dt, x, J);
    for (int i = 0; i < c->n && status == MK_OK; i++) J[i] *= -MK_R(10.0) * c->parameter[1] / (MK_R(2.302585092994046) * r);
    return status;
}

/* s = sin(h) / h and its derivative: an arc that turns by 2 h has a chord of s times its length. */
static void MK_F(sinc)(MK_REAL h, MK_REAL *s, MK_REAL *slope) {
    MK_REAL sine, cosine;
    if (h < MK_R(1e-3) && h > -MK_R(1e-3)) {
        *s = MK_R(1.0) - h * h / MK_R(6.0);
        *slope = -h / MK_R(3.0) * (MK_R(1.0) - h * h / MK_R(10.0));
        return;
    }
    MK_F(mk_sincos)(h, &sine, &cosine);
    *s = sine / h;
    *slope = (cosine - *s) / h;
}

static mk_status_t MK_F(vehicle)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    (void)context;
    for (int i = 0; i < count; i++, x += STATES, y += STATES) {
        const MK_REAL length = x[SPEED] * dt, h = MK_R(0.5) * length * x[CURVATURE];
        MK_REAL s, slope, sine, cosine;
        MK_F(sinc)(h, &s, &slope);
        MK_F(mk_sincos)(x[HEADING] + h, &sine, &cosine);
        y[PX] = x[PX] + length * s * cosine;
        y[PY] = x[PY] + length * s * sine;
        y[HEADING] = MK_F(mk_wrap)(x[HEADING] + MK_R(2.0) * h);
        y[SPEED] = x[SPEED];
        y[CURVATURE] = x[CURVATURE];
    }
    return MK_OK;
}

static mk_status_t MK_F(vehicle_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const MK_REAL length = x[SPEED] * dt, h_speed = MK_R(0.5) * dt * x[CURVATURE], h_curvature = MK_R(0.5) * length;
    MK_REAL s, slope, sine, cosine;
    (void)context;
    MK_F(sinc)(x[SPEED] * h_speed, &s, &slope);
    MK_F(mk_sincos)(x[HEADING] + x[SPEED] * h_speed, &sine, &cosine);
    const MK_REAL along[2] = {cosine, sine}, across[2] = {-sine, cosine};
    for (int i = 0; i < STATES * STATES; i++) J[i] = i % (STATES + 1) ? MK_R(0.0) : MK_R(1.0);
    for (int axis = 0; axis < 2; axis++) {
        const MK_REAL per_h = length * (slope * along[axis] + s * across[axis]);
        J[axis * STATES + HEADING] = length * s * across[axis];
        J[axis * STATES + SPEED] = dt * s * along[axis] + per_h * h_speed;
        J[axis * STATES + CURVATURE] = per_h * h_curvature;
    }
    J[HEADING * STATES + SPEED] = MK_R(2.0) * h_speed;
    J[HEADING * STATES + CURVATURE] = MK_R(2.0) * h_curvature;
    return MK_OK;
}

static void MK_F(vehicle_difference)(const void *context, const MK_REAL *a, const MK_REAL *b, MK_REAL *d) {
    (void)context;
    for (int i = 0; i < STATES; i++) d[i] = i == HEADING ? MK_F(mk_wrap)(a[i] - b[i]) : a[i] - b[i];
}

static mk_status_t MK_F(vehicle_noise)(const void *context, MK_REAL dt, MK_REAL *Q) {
    const MK_F_T(mk_plugin_context) *const c = context;
    for (int i = 0; i < MK_PACKED(STATES); i++) Q[i] = MK_R(0.0);
    Q[MK_PACKED(SPEED + 1) - 1] = c->parameter[0] * dt;
    Q[MK_PACKED(CURVATURE + 1) - 1] = c->parameter[1] * dt;
    return MK_OK;
}
