/* SPDX-License-Identifier: MIT */
/* The long run's models, in one REAL: a damped oscillator of 1e4 whose range is read, and two small numbers that hang on it. Context: none but
   the sensor's number. */

static mk_status_t NAME(long_motion)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    (void)context;
    for (int k = 0; k < count; k++, x += 4, y += 4) {
        const REAL square = x[0] * x[0] * (REAL)1e-8;
        y[0] = x[0] + dt * x[1];
        y[1] = (REAL)0.99 * x[1] - dt * (REAL)0.01 * x[0] / ((REAL)1.0 + square);
        y[2] = (REAL)0.999 * x[2];
        y[3] = (REAL)0.99 * x[3] + (REAL)1e-9 * x[0];
    }
    return MK_OK;
}

static mk_status_t NAME(long_range)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    (void)context;
    (void)dt;
    for (int k = 0; k < count; k++) y[k] = (REAL)sqrt((double)((x[4 * k] + (REAL)3e4) * (x[4 * k] + (REAL)3e4) + (REAL)1e7));
    return MK_OK;
}

static mk_status_t NAME(long_speed)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    (void)context;
    (void)dt;
    for (int k = 0; k < count; k++) {
        y[2 * k] = x[4 * k + 1] + (REAL)100.0 * x[4 * k + 2];
        y[2 * k + 1] = x[4 * k + 2] + (REAL)0.5 * x[4 * k + 2] * x[4 * k + 2] + x[4 * k + 3];
    }
    return MK_OK;
}

static mk_status_t NAME(long_small)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    (void)context;
    (void)dt;
    for (int k = 0; k < count; k++) y[k] = (REAL)1e3 * x[4 * k + 3] * ((REAL)1.0 + (REAL)10.0 * x[4 * k + 3]);
    return MK_OK;
}

typedef struct {
    TYPE(mk_sensor) sensor[3];
    REAL Q[10], P0[10], x0[4], R[3][3];
    TYPE(mk_unscented_config) config;
} TYPE(long_model);

/* Diagonals of Q, P0 and R are squares of these standard deviations. */
static void NAME(long_prepare)(TYPE(long_model) * model, const double *q, const double *p, const double *r, const double *x0, int update) {
    memset(model, 0, sizeof *model);
    for (int i = 0; i < 4; i++) {
        model->Q[MK_PACKED(i + 1) - 1] = (REAL)(q[i] * q[i]);
        model->P0[MK_PACKED(i + 1) - 1] = (REAL)(p[i] * p[i]);
        model->x0[i] = (REAL)x0[i];
    }
    model->sensor[0].model.function = NAME(long_range);
    model->sensor[1].model.function = NAME(long_speed);
    model->sensor[2].model.function = NAME(long_small);
    for (int l = 0, k = 0; l < 3; l++) {
        model->sensor[l].rows = l == 1 ? 2 : 1;
        model->sensor[l].R = model->R[l];
        for (int i = 0; i < model->sensor[l].rows; i++, k++) model->R[l][MK_PACKED(i + 1) - 1] = (REAL)(r[k] * r[k]);
    }
    const TYPE(mk_transform) cubature = MK_TRANSFORM_CUBATURE(4);
    model->config.n = 4;
    model->config.m = 2;
    model->config.slots = 3;
    model->config.transition.model.function = NAME(long_motion);
    model->config.transition.Q = model->Q;
    model->config.sensor = model->sensor;
    model->config.x0 = model->x0;
    model->config.P0 = model->P0;
    model->config.transform = cubature;
    model->config.increments = 3;
    model->config.update = (uint8_t)update;
}
