/* SPDX-License-Identifier: MIT */
/* The sensors of <meshkal/tracking.h>. */

/* From a place to the target: d, its length r, and the squares of its length in the x-y plane (level) and of all of it. */
typedef struct {
    MK_REAL d[3], level, square, r;
} MK_F_T(mk_sight);

/* apart: which distance must not be zero. */
static mk_status_t MK_F(mk_see)(const mk_motion_t *motion, const MK_REAL *place, const MK_REAL *x, MK_F_T(mk_sight) * sight,
                                mk_apart_t apart) {
    MK_REAL *const d = sight->d;
    d[2] = MK_R(0.0);
    for (int axis = 0; axis < motion->dimensions; axis++) d[axis] = x[motion->position[axis]] - place[axis];
    sight->level = d[0] * d[0] + d[1] * d[1];
    sight->square = sight->level + d[2] * d[2];
    sight->r = MK_F(mk_sqrt)(sight->square);
    if (!(sight->square * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    const MK_REAL least = apart == MK_ASIDE ? sight->level : sight->square;
    return apart != MK_ANYWHERE && least < MK_SMALLEST ? MK_ERROR_DOMAIN : MK_OK;
}

static void MK_F(mk_clear)(int count, MK_REAL *J) {
    for (int i = 0; i < count; i++) J[i] = MK_R(0.0);
}

/* --- range -------------------------------------------------------------------------------------------------------------- */

mk_status_t MK_F(mk_range)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const MK_F_T(mk_site) *const site = context;
    (void)dt;
    for (int point = 0; point < count; point++, x += site->motion->n) {
        MK_F_T(mk_sight) sight;
        const mk_status_t status = MK_F(mk_see)(site->motion, site->position, x, &sight, MK_ANYWHERE);
        if (status != MK_OK) return status;
        y[point] = sight.r;
    }
    return MK_OK;
}

/* Its row of a Jacobian that was cleared. */
static void MK_F(mk_range_slope)(const mk_motion_t *motion, const MK_F_T(mk_sight) * sight, MK_REAL *J) {
    for (int axis = 0; axis < motion->dimensions; axis++) J[motion->position[axis]] = sight->d[axis] / sight->r;
}

mk_status_t MK_F(mk_range_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const MK_F_T(mk_site) *const site = context;
    MK_F_T(mk_sight) sight;
    (void)dt;
    const mk_status_t status = MK_F(mk_see)(site->motion, site->position, x, &sight, MK_APART);
    if (status != MK_OK) return status;
    MK_F(mk_clear)(site->motion->n, J);
    MK_F(mk_range_slope)(site->motion, &sight, J);
    return MK_OK;
}

/* --- bearing ------------------------------------------------------------------------------------------------------------ */

/* With range or without: rows before those of bearing, 0 or 1. */
static mk_status_t MK_F(mk_bearings)(int before, const MK_F_T(mk_site) * site, int count, const MK_REAL *x, MK_REAL *y) {
    const mk_motion_t *const motion = site->motion;
    for (int point = 0; point < count; point++, x += motion->n) {
        MK_F_T(mk_sight) sight;
        const mk_status_t status = MK_F(mk_see)(motion, site->position, x, &sight, MK_ASIDE);
        if (status != MK_OK) return status;
        if (before) *y++ = sight.r;
        *y++ = MK_F(mk_atan2)(sight.d[1], sight.d[0]);
        if (motion->dimensions == 3) *y++ = MK_F(mk_atan2)(sight.d[2], MK_F(mk_sqrt)(sight.level));
    }
    return MK_OK;
}

static mk_status_t MK_F(mk_bearings_jacobian)(int before, const MK_F_T(mk_site) * site, const MK_REAL *x, MK_REAL *J) {
    const mk_motion_t *const motion = site->motion;
    const uint8_t *const p = motion->position;
    const int n = motion->n;
    MK_F_T(mk_sight) sight;
    const mk_status_t status = MK_F(mk_see)(motion, site->position, x, &sight, MK_ASIDE);
    if (status != MK_OK) return status;
    const MK_REAL *const d = sight.d;
    MK_F(mk_clear)((before + motion->dimensions - 1) * n, J);
    if (before) MK_F(mk_range_slope)(motion, &sight, J);
    J += before * n;
    J[p[0]] = -d[1] / sight.level;
    J[p[1]] = d[0] / sight.level;
    if (motion->dimensions == 3) {
        const MK_REAL rho = MK_F(mk_sqrt)(sight.level), rise = d[2] / sight.square;
        J += n;
        J[p[0]] = -(d[0] / rho * rise);
        J[p[1]] = -(d[1] / rho * rise);
        J[p[2]] = rho / sight.square;
    }
    return MK_OK;
}

mk_status_t MK_F(mk_bearing)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    (void)dt;
    return MK_F(mk_bearings)(0, context, count, x, y);
}

mk_status_t MK_F(mk_bearing_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    (void)dt;
    return MK_F(mk_bearings_jacobian)(0, context, x, J);
}

mk_status_t MK_F(mk_range_bearing)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    (void)dt;
    return MK_F(mk_bearings)(1, context, count, x, y);
}

mk_status_t MK_F(mk_range_bearing_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    (void)dt;
    return MK_F(mk_bearings_jacobian)(1, context, x, J);
}

void MK_F(mk_bearing_difference)(const void *context, const MK_REAL *a, const MK_REAL *b, MK_REAL *d) {
    const mk_motion_t *const motion = context;
    for (int row = 0; row < motion->dimensions - 1; row++) d[row] = MK_F(mk_wrap)(a[row] - b[row]);
}

void MK_F(mk_range_bearing_difference)(const void *context, const MK_REAL *a, const MK_REAL *b, MK_REAL *d) {
    d[0] = a[0] - b[0];
    MK_F(mk_bearing_difference)(context, a + 1, b + 1, d + 1);
}

/* --- range rate --------------------------------------------------------------------------------------------------------- */

/* The directions d / r replace d. */
static mk_status_t MK_F(mk_approach)(const MK_F_T(mk_site) * site, const MK_REAL *x, MK_F_T(mk_sight) * sight, MK_REAL *rate) {
    const mk_motion_t *const motion = site->motion;
    const mk_status_t status = MK_F(mk_see)(motion, site->position, x, sight, MK_APART);
    if (status != MK_OK) return status;
    *rate = MK_R(0.0);
    for (int axis = 0; axis < motion->dimensions; axis++) {
        sight->d[axis] /= sight->r;
        *rate += x[motion->velocity[axis]] * sight->d[axis];
    }
    return MK_OK;
}

mk_status_t MK_F(mk_range_rate)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const MK_F_T(mk_site) *const site = context;
    (void)dt;
    for (int point = 0; point < count; point++, x += site->motion->n) {
        MK_F_T(mk_sight) sight;
        const mk_status_t status = MK_F(mk_approach)(site, x, &sight, y + point);
        if (status != MK_OK) return status;
    }
    return MK_OK;
}

mk_status_t MK_F(mk_range_rate_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const MK_F_T(mk_site) *const site = context;
    const mk_motion_t *const motion = site->motion;
    MK_F_T(mk_sight) sight;
    MK_REAL rate;
    (void)dt;
    const mk_status_t status = MK_F(mk_approach)(site, x, &sight, &rate);
    if (status != MK_OK) return status;
    MK_F(mk_clear)(motion->n, J);
    for (int axis = 0; axis < motion->dimensions; axis++) {
        J[motion->position[axis]] = (x[motion->velocity[axis]] - rate * sight.d[axis]) / sight.r;
        J[motion->velocity[axis]] = sight.d[axis];
    }
    return MK_OK;
}

/* --- time difference of arrival ----------------------------------------------------------------------------------------- */

/* r - r' = (r^2 - r'^2) / (r + r'), and r^2 - r'^2 = b'(d + d'), where d - d' = b, the base from position to reference, is known without
   cancellation. */
static mk_status_t MK_F(mk_arrive)(const MK_F_T(mk_site) * site, const MK_REAL *x, MK_F_T(mk_sight) * first, MK_F_T(mk_sight) * second,
                                   mk_apart_t apart, MK_REAL *difference) {
    const mk_motion_t *const motion = site->motion;
    mk_status_t status = MK_F(mk_see)(motion, site->position, x, first, apart);
    if (status == MK_OK) status = MK_F(mk_see)(motion, site->reference, x, second, apart);
    if (status != MK_OK) return status;
    const MK_REAL sum = first->r + second->r;
    MK_REAL product = MK_R(0.0);
    for (int axis = 0; axis < motion->dimensions; axis++)
        product += (site->reference[axis] - site->position[axis]) * (first->d[axis] + second->d[axis]);
    *difference = sum > MK_R(0.0) ? product / sum : MK_R(0.0);
    return MK_OK;
}

mk_status_t MK_F(mk_tdoa)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const MK_F_T(mk_site) *const site = context;
    (void)dt;
    for (int point = 0; point < count; point++, x += site->motion->n) {
        MK_F_T(mk_sight) first, second;
        const mk_status_t status = MK_F(mk_arrive)(site, x, &first, &second, MK_ANYWHERE, y + point);
        if (status != MK_OK) return status;
    }
    return MK_OK;
}

/* d / r - d' / r' = (b - (r - r') d' / r') / r = (b - (r - r') d / r) / r'. Divided by the larger distance no digits are lost. */
mk_status_t MK_F(mk_tdoa_jacobian)(const void *context, MK_REAL dt, const MK_REAL *x, MK_REAL *J) {
    const MK_F_T(mk_site) *const site = context;
    const mk_motion_t *const motion = site->motion;
    MK_F_T(mk_sight) first, second;
    MK_REAL difference;
    (void)dt;
    const mk_status_t status = MK_F(mk_arrive)(site, x, &first, &second, MK_APART, &difference);
    if (status != MK_OK) return status;
    const MK_F_T(mk_sight) *const near = first.r < second.r ? &first : &second, *const far = first.r < second.r ? &second : &first;
    MK_F(mk_clear)(motion->n, J);
    for (int axis = 0; axis < motion->dimensions; axis++)
        J[motion->position[axis]] = (site->reference[axis] - site->position[axis] - difference * (near->d[axis] / near->r)) / far->r;
    return MK_OK;
}
