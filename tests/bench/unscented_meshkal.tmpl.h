/* SPDX-License-Identifier: MIT */
/* Once for each precision: REAL, TYPE(name), NAME(name), KIND (f32 or f64), SQRT, ATAN2. */

typedef struct {
    int n, sensors;
    REAL position[SCENE_ROWS][3];
} NAME(site);

static mk_status_t NAME(moves)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    const int n = ((const NAME(site) *)context)->n;
    for (int k = 0; k < count * n; k += 2) {
        y[k] = x[k] + dt * x[k + 1];
        y[k + 1] = x[k + 1];
    }
    return MK_OK;
}

static mk_status_t NAME(moves_jacobian)(const void *context, REAL dt, const REAL *x, REAL *J) {
    const int n = ((const NAME(site) *)context)->n;
    (void)x;
    for (int k = 0; k < n * n; k++) J[k] = k % (n + 1) == 0 ? (REAL)1 : (REAL)0;
    for (int i = 0; i < n; i += 2) J[i * n + i + 1] = dt;
    return MK_OK;
}

static mk_status_t NAME(range)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    const NAME(site) *const site = context;
    (void)dt;
    for (int k = 0; k < count; k++, x += site->n)
        for (int s = 0; s < site->sensors; s++) {
            REAL sum = 0;
            for (int d = 0; 2 * d < site->n; d++) sum += (x[2 * d] - site->position[s][d]) * (x[2 * d] - site->position[s][d]);
            *y++ = SQRT(sum);
        }
    return MK_OK;
}

static mk_status_t NAME(range_jacobian)(const void *context, REAL dt, const REAL *x, REAL *J) {
    const NAME(site) *const site = context;
    (void)dt;
    for (int s = 0; s < site->sensors; s++, J += site->n) {
        REAL sum = 0;
        for (int d = 0; 2 * d < site->n; d++) sum += (x[2 * d] - site->position[s][d]) * (x[2 * d] - site->position[s][d]);
        const REAL inverse = (REAL)1 / SQRT(sum);
        for (int d = 0; 2 * d < site->n; d++) {
            J[2 * d] = (x[2 * d] - site->position[s][d]) * inverse;
            J[2 * d + 1] = 0;
        }
    }
    return MK_OK;
}

static mk_status_t NAME(bearing)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    const NAME(site) *const site = context;
    (void)dt;
    for (int k = 0; k < count; k++, x += site->n)
        for (int s = 0; s < site->sensors; s++) *y++ = ATAN2(x[2] - site->position[s][1], x[0] - site->position[s][0]);
    return MK_OK;
}

static mk_status_t NAME(bearing_jacobian)(const void *context, REAL dt, const REAL *x, REAL *J) {
    const NAME(site) *const site = context;
    (void)dt;
    for (int s = 0; s < site->sensors; s++, J += site->n) {
        const REAL u = x[0] - site->position[s][0], v = x[2] - site->position[s][1], inverse = (REAL)1 / (u * u + v * v);
        J[0] = -v * inverse;
        J[2] = u * inverse;
        J[1] = J[3] = 0;
    }
    return MK_OK;
}

/* What a filter's configuration points to. */
typedef struct {
    NAME(site) target, sites[SCENE_ROWS];
    REAL Q[SCENE_PACKED(SCENE_N)], P0[SCENE_PACKED(SCENE_N)], x0[SCENE_N], R[SCENE_PACKED(SCENE_ROWS)], z[SCENE_STEPS][SCENE_ROWS], dt;
    TYPE(mk_sensor) sensors[SCENE_ROWS];
    TYPE(mk_unscented_config) config;
    int turn;
} NAME(given);

/* A filter with `slots` sensors, which share the rows. */
static void NAME(give)(const scene_t *scene, int filter, int slots, NAME(given) *g) {
    static const uint8_t update[FILTERS] = {MK_UPDATE_UNSCENTED,   MK_UPDATE_UNSCENTED,   MK_UPDATE_EXTENDED,
                                            MK_UPDATE_PROGRESSIVE, MK_UPDATE_PROGRESSIVE, MK_UPDATE_ITERATED};
    static const uint8_t increments[FILTERS] = {1, 1, 1, 5, 30, 5};
    const int n = scene->n, rows = SCENE_ROWS / slots;
    TYPE(mk_unscented_config) *const c = &g->config;
    memset(g, 0, sizeof *g);
    g->dt = (REAL)scene->dt;
    for (int i = 0; i < SCENE_PACKED(n); i++) g->Q[i] = (REAL)scene->Q[i], g->P0[i] = (REAL)scene->P0[i];
    for (int i = 0; i < n; i++) g->x0[i] = (REAL)scene->x0[i];
    for (int t = 0; t < SCENE_STEPS; t++)
        for (int r = 0; r < SCENE_ROWS; r++) g->z[t][r] = (REAL)scene->z[t][r];
    g->target.n = n;
    for (int r = 0; r < SCENE_ROWS; r++) {
        NAME(site) *const site = g->sites + r / rows;
        site->n = n;
        site->sensors = rows;
        g->R[SCENE_PACKED(r) + r] = (REAL)scene->variance;
        for (int d = 0; d < 3; d++) site->position[r % rows][d] = (REAL)scene->position[r][d];
    }
    for (int l = 0; l < slots; l++) {
        g->sensors[l].model.function = scene->bearings ? NAME(bearing) : NAME(range);
        g->sensors[l].model.jacobian = scene->bearings ? NAME(bearing_jacobian) : NAME(range_jacobian);
        g->sensors[l].model.context = g->sites + l;
        g->sensors[l].R = g->R;
        g->sensors[l].rows = (uint8_t)rows;
    }
    const TYPE(mk_transform) julier = MK_TRANSFORM_JULIER((REAL)n, (REAL)(3 - n));
    const TYPE(mk_transform) scaled = MK_TRANSFORM_SCALED((REAL)n, (REAL)SCENE_ALPHA, (REAL)SCENE_BETA, (REAL)(3 - n));
    c->n = (uint16_t)n;
    c->m = (uint16_t)rows;
    c->slots = (uint16_t)slots;
    c->transition.model.function = NAME(moves);
    c->transition.model.jacobian = NAME(moves_jacobian);
    c->transition.model.context = &g->target;
    c->transition.Q = g->Q;
    c->sensor = g->sensors;
    c->x0 = g->x0;
    c->P0 = g->P0;
    c->transform = filter == FILTER_SCALED ? scaled : julier;
    c->increments = increments[filter];
    c->update = update[filter];
    c->rule = update[filter] == MK_UPDATE_PROGRESSIVE ? MK_RULE_INNOVATION : MK_RULE_NONE;
}

#define FILTER_(declare, name, real, states, rows, slots)                                                    \
    declare(name, real, states, rows, slots);                                                                \
    static name##_t name##_one;                                                                              \
    static NAME(given) name##_given;                                                                         \
    static int name##_begin(const scene_t *scene, int filter) {                                              \
        NAME(give)(scene, filter, slots, &name##_given);                                                      \
        return name##_start(&name##_one, &name##_given.config) == MK_OK;                                      \
    }                                                                                                        \
    static int name##_run(int steps) {                                                                       \
        int bad = 0;                                                                                         \
        for (int t = 0; t < steps; t++) {                                                                    \
            const int turn = name##_given.turn++ % SCENE_STEPS;                                                     \
            if (turn == 0) bad |= (int)name##_restart(&name##_one, name##_given.x0, name##_given.P0);                      \
            bad |= (int)name##_predict(&name##_one, name##_given.dt, 0);                                            \
            for (int l = 0; l < (slots); l++) bad |= (int)name##_put(&name##_one, l, name##_given.z[turn] + l * (rows)); \
            bad |= (int)name##_update(&name##_one);                                                          \
        }                                                                                                    \
        return bad == 0;                                                                                     \
    }                                                                                                        \
    static void name##_read(double *x, double *P) {                                                          \
        REAL packed[MK_PACKED(states)];                                                                      \
        (void)name##_covariance(&name##_one, packed);                                                        \
        for (int i = 0; i < (states); i++) x[i] = (double)name##_one.x[i];                                   \
        for (int i = 0; i < MK_PACKED(states); i++) P[i] = (double)packed[i];                                \
    }
#undef FILTER
#define FILTER(declare, name, real, states, rows, slots) FILTER_(declare, name, real, states, rows, slots)
FILTER(MK_UNSCENTED_UNROLLED, NAME(unrolled4), KIND, 4, 1, 3)
FILTER(MK_UNSCENTED_UNROLLED, NAME(unrolled_joint4), KIND, 4, 3, 1)
FILTER(MK_UNSCENTED, NAME(split4), KIND, 4, 1, 3)
FILTER(MK_UNSCENTED, NAME(joint4), KIND, 4, 3, 1)
FILTER(MK_UNSCENTED_UNROLLED, NAME(unrolled6), KIND, 6, 1, 3)
FILTER(MK_UNSCENTED_UNROLLED, NAME(unrolled_joint6), KIND, 6, 3, 1)
FILTER(MK_UNSCENTED, NAME(split6), KIND, 6, 1, 3)
FILTER(MK_UNSCENTED, NAME(joint6), KIND, 6, 3, 1)
#undef FILTER_
