/* SPDX-License-Identifier: MIT */
/* Curved models of any dimensions, in one REAL. Context: bent_t. */

static mk_status_t NAME(bent_motion)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    const int n = ((const bent_t *)context)->n;
    for (int k = 0; k < count * n; k++) {
        const REAL here = x[k], next = x[k - k % n + (k + 1) % n];
        y[k] = (REAL)0.9 * here + dt * (REAL)0.1 * next + (REAL)0.3 * here / ((REAL)1.0 + here * here);
    }
    return MK_OK;
}

static mk_status_t NAME(bent_motion_slope)(const void *context, REAL dt, const REAL *x, REAL *J) {
    const int n = ((const bent_t *)context)->n;
    for (int i = 0; i < n; i++) {
        const REAL square = x[i] * x[i], below = (REAL)1.0 + square;
        for (int j = 0; j < n; j++) J[i * n + j] = (REAL)0.0;
        J[i * n + i] = (REAL)0.9 + (REAL)0.3 * ((REAL)1.0 - square) / (below * below);
        J[i * n + (i + 1) % n] += dt * (REAL)0.1;
    }
    return MK_OK;
}

static mk_status_t NAME(bent_sensor)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    const bent_t *const bent = context;
    const int n = bent->n, rows = bent->rows;
    if (dt != (REAL)0.0) return MK_ERROR_DOMAIN;
    for (int k = 0; k < count; k++)
        for (int r = 0; r < rows; r++) {
            const REAL a = x[k * n + r % n], b = x[k * n + (r + bent->slot) % n];
            y[k * rows + r] = a + (REAL)0.5 * b + (REAL)0.05 * a * b + (REAL)0.1 * (REAL)r * x[k * n];
        }
    return MK_OK;
}

static mk_status_t NAME(bent_sensor_slope)(const void *context, REAL dt, const REAL *x, REAL *J) {
    const bent_t *const bent = context;
    const int n = bent->n;
    (void)dt;
    for (int r = 0; r < bent->rows; r++) {
        const int i = r % n, j = (r + bent->slot) % n;
        for (int k = 0; k < n; k++) J[r * n + k] = (REAL)0.0;
        J[r * n + i] += (REAL)1.0 + (REAL)0.05 * x[j];
        J[r * n + j] += (REAL)0.5 + (REAL)0.05 * x[i];
        J[r * n] += (REAL)0.1 * (REAL)r;
    }
    return MK_OK;
}
