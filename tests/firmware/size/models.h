/* SPDX-License-Identifier: MIT */
/* Models of the images that track: constant velocity on N / 2 axes, M ranges a sensor; N and M are the includer's. Their instructions and frames
   count, their flash does not. */
#ifndef SIZE_MODELS_H
#define SIZE_MODELS_H

/* The target of spec 2.5: it begins at 3 m and 0.05 m/s on each axis. */
static void put_motion(float *x0, float *P0, float *Q) {
    for (int i = 0; i < N; i += 2) {
        x0[i] = 3.0f;
        x0[i + 1] = 0.05f;
        P0[MK_PACKED(i) + i] = 0.1f;
        P0[MK_PACKED(i + 1) + i + 1] = 1e-3f;
        Q[MK_PACKED(i) + i] = 1e-5f / 3.0f;
        Q[MK_PACKED(i + 1) + i] = 5e-6f;
        Q[MK_PACKED(i + 1) + i + 1] = 1e-5f;
    }
}

typedef struct {
    float position[M][3];
} site_t;

MK_INLINE mk_status_t moves(const void *context, float dt, int count, const float *x, float *y) {
    (void)context;
    for (int k = 0; k < count * N; k += 2) {
        y[k] = x[k] + dt * x[k + 1];
        y[k + 1] = x[k + 1];
    }
    return MK_OK;
}

MK_INLINE mk_status_t moves_jacobian(const void *context, float dt, const float *x, float *J) {
    (void)context;
    (void)x;
    for (int k = 0; k < N * N; k++) J[k] = k % (N + 1) == 0 ? 1.0f : 0.0f;
    for (int i = 0; i < N; i += 2) J[i * N + i + 1] = dt;
    return MK_OK;
}

MK_INLINE float range(const site_t *site, int r, const float *x) {
    float sum = 0.0f;
    for (int d = 0; 2 * d < N; d++) sum += (x[2 * d] - site->position[r][d]) * (x[2 * d] - site->position[r][d]);
    return __builtin_sqrtf(sum);
}

MK_INLINE mk_status_t ranges(const void *context, float dt, int count, const float *x, float *y) {
    (void)dt;
    for (int k = 0; k < count; k++)
        for (int r = 0; r < M; r++) *y++ = range(context, r, x + k * N);
    return MK_OK;
}

MK_INLINE mk_status_t ranges_jacobian(const void *context, float dt, const float *x, float *J) {
    const site_t *const site = context;
    (void)dt;
    for (int r = 0; r < M; r++, J += N) {
        const float inverse = 1.0f / range(site, r, x);
        for (int d = 0; 2 * d < N; d++) {
            J[2 * d] = (x[2 * d] - site->position[r][d]) * inverse;
            J[2 * d + 1] = 0.0f;
        }
    }
    return MK_OK;
}

#endif
