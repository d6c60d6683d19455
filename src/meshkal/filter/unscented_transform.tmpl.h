/* SPDX-License-Identifier: MIT */
/* The unscented transform in the form of meshkal/unscented.h, and the prediction. */

/* Results of a model at and around x: D and U (`rows` rows, `stride` apart, of n numbers each), mu, and epsilon, by which a mean callback differs
   from mu. */
typedef struct {
    MK_REAL *D, *U, *mu, *epsilon;
    int stride;
} MK_F_T(mk_linear);

/* What linearising needs for itself: points n (2 n + 1) numbers, results of as many with the most rows, two rows. */
typedef struct {
    MK_REAL *points, *results, *a, *b;
} MK_F_T(mk_linear_work);

MK_KERNEL void MK_F(mk_space_difference)(const MK_F_T(mk_space) * space, int rows, const MK_REAL *a, const MK_REAL *b, MK_REAL *d) {
    if (space && space->difference) space->difference(space->context, a, b, d);
    else
        for (int r = 0; r < rows; r++) d[r] = a[r] - b[r];
}

static mk_status_t MK_F(mk_call)(const MK_F_T(mk_model) * model, int n, int rows, int one_at_a_time, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    mk_status_t status = MK_OK;
    const int at_once = one_at_a_time ? 1 : count;
    for (int k = 0; k < count && status == MK_OK; k += at_once) status = model->function(model->context, dt, at_once, x + k * n, y + k * rows);
    if (status != MK_OK) return status;
    return MK_F(mk_all_finite)(count * rows, y) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* mean := y_0 + mu, or what the space says it is; fills the rest of *out. */
static mk_status_t MK_F(mk_linearise)(const MK_F_T(mk_unscented_config) * config, const MK_F_T(mk_model) * model, int n, int rows, MK_REAL dt, const MK_REAL *x,
                                      const MK_REAL *L, const MK_F_T(mk_linear_work) * work, const MK_F_T(mk_linear) * out, MK_REAL *mean) {
    MK_REAL *const X = work->points, *const Y = work->results;
    const MK_REAL spread = config->transform.spread, c = MK_F(mk_sqrt)(spread), w = MK_R(0.5) / spread;
    for (int k = 0; k <= 2 * n; k++)
        for (int i = 0; i < n; i++) X[k * n + i] = x[i];
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            const MK_REAL step = c * L[MK_AT(i, j)];
            X[(1 + j) * n + i] += step;
            X[(1 + n + j) * n + i] -= step;
        }
    const mk_status_t status = MK_F(mk_call)(model, n, rows, config->one_at_a_time, dt, 2 * n + 1, X, Y);
    if (status != MK_OK) return status;
    const MK_REAL scale = MK_R(0.5) / c;
    for (int r = 0; r < rows; r++) out->mu[r] = out->epsilon[r] = MK_R(0.0);
    for (int j = 0; j < n; j++) {
        MK_F(mk_space_difference)(model->space, rows, Y + (1 + j) * rows, Y, work->a);
        MK_F(mk_space_difference)(model->space, rows, Y + (1 + n + j) * rows, Y, work->b);
        for (int r = 0; r < rows; r++) {
            const MK_REAL u = work->a[r] + work->b[r];
            out->D[r * out->stride + j] = (work->a[r] - work->b[r]) * scale;
            out->U[r * out->stride + j] = u;
            out->mu[r] += u;
        }
    }
    for (int r = 0; r < rows; r++) {
        out->mu[r] *= w;
        mean[r] = Y[r] + out->mu[r];
    }
    if (model->space && model->space->mean) {
        X[0] = MK_R(1.0) - (MK_REAL)(2 * n) * w;
        for (int k = 1; k <= 2 * n; k++) X[k] = w;
        model->space->mean(model->space->context, 2 * n + 1, X, Y, mean);
        if (!MK_F(mk_all_finite)(rows, mean)) return MK_ERROR_NOT_FINITE;
        MK_F(mk_space_difference)(model->space, rows, mean, Y, work->a);
        for (int r = 0; r < rows; r++) out->epsilon[r] = work->a[r] - out->mu[r];
    }
    return MK_OK;
}

/* The same from the model's Jacobian at x. */
static mk_status_t MK_F(mk_extend)(const MK_F_T(mk_model) * model, int n, int rows, MK_REAL dt, const MK_REAL *x, const MK_REAL *L,
                                   const MK_F_T(mk_linear_work) * work, const MK_F_T(mk_linear) * out, MK_REAL *mean) {
    MK_REAL *const J = work->results;
    mk_status_t status = MK_F(mk_call)(model, n, rows, 1, dt, 1, x, mean);
    if (status == MK_OK) status = model->jacobian(model->context, dt, x, J);
    if (status != MK_OK) return status;
    if (!MK_F(mk_all_finite)(rows * n, J)) return MK_ERROR_NOT_FINITE;
    for (int r = 0; r < rows; r++) {
        out->mu[r] = out->epsilon[r] = MK_R(0.0);
        for (int j = 0; j < n; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int i = j; i < n; i++) sum += J[r * n + i] * L[MK_AT(i, j)];
            out->D[r * out->stride + j] = sum;
            out->U[r * out->stride + j] = MK_R(0.0);
        }
    }
    return MK_OK;
}

/* Element (r, s) of Omega: the residual of the linearisation. */
MK_KERNEL MK_REAL MK_F(mk_residual)(const MK_F_T(mk_transform) * transform, int n, const MK_F_T(mk_linear) * l, int r, int s) {
    const MK_REAL b = transform->correction, *const u = l->U + r * l->stride, *const v = l->U + s * l->stride;
    MK_REAL sum = MK_R(0.0);
    for (int j = 0; j < n; j++) sum += u[j] * v[j];
    return sum * (MK_R(0.25) / transform->spread) + b * l->mu[r] * l->mu[s] +
           (MK_R(1.0) + b) * (l->epsilon[r] * l->mu[s] + l->mu[r] * l->epsilon[s]) + (MK_R(2.0) + b) * l->epsilon[r] * l->epsilon[s];
}

/* The same as columns: U := V with V V' = Omega, and `extra`, a column more; returns 1 if it is to be added, -1 if extra extra' is to be subtracted, 0 if
   there is none. Where the weight of the centre is not negative, there is nothing to subtract. */
static int MK_F(mk_residual_columns)(const MK_F_T(mk_transform) * transform, int n, const MK_F_T(mk_linear) * l, int with_mean, MK_REAL *extra) {
    const MK_REAL w = MK_R(0.5) / transform->spread, b = transform->correction, root = MK_F(mk_sqrt)(MK_R(0.5) * w), count = (MK_REAL)n;
    MK_REAL weight, shift;
    if (with_mean) { /* w/2 sum (u_j - 2 delta)(u_j - 2 delta)' + weight delta delta' */
        weight = MK_R(2.0) + b - MK_R(2.0) * count * w;
        for (int i = 0; i < n; i++) {
            const MK_REAL delta = l->mu[i] + l->epsilon[i];
            for (int j = 0; j < n; j++) l->U[i * l->stride + j] = root * (l->U[i * l->stride + j] - MK_R(2.0) * delta);
            extra[i] = MK_F(mk_sqrt)(weight < MK_R(0.0) ? -weight : weight) * delta;
        }
        return weight > MK_R(0.0) ? 1 : weight < MK_R(0.0) ? -1 : 0;
    }
    /* w/2 U (I + 2 w b 1 1') U': the matrix of ones has one eigenvalue, n; its factor I + shift 1 1' takes it into the columns. */
    weight = MK_R(1.0) + MK_R(2.0) * w * b * count;
    shift = ((weight > MK_R(0.0) ? MK_F(mk_sqrt)(weight) : MK_R(0.0)) - MK_R(1.0)) / count;
    for (int i = 0; i < n; i++) {
        const MK_REAL sum = l->mu[i] / w;
        for (int j = 0; j < n; j++) l->U[i * l->stride + j] = root * (l->U[i * l->stride + j] + shift * sum);
        extra[i] = weight < MK_R(0.0) ? root * MK_F(mk_sqrt)(-weight / count) * sum : MK_R(0.0);
    }
    return weight < MK_R(0.0) ? -1 : 0;
}

/* 1 if this is the factor of a positive definite matrix. */
MK_KERNEL int MK_F(mk_is_factor)(int n, const MK_REAL *L) {
    for (int i = 0; i < n; i++)
        if (!(L[MK_AT(i, i)] > MK_R(0.0))) return 0;
    return 1;
}

/* D := A L, and mean := A x. */
static void MK_F(mk_apply)(int n, const MK_REAL *A, const MK_REAL *x, const MK_REAL *L, const MK_F_T(mk_linear) * out, MK_REAL *mean) {
    for (int r = 0; r < n; r++) {
        mean[r] = MK_R(0.0);
        for (int i = 0; i < n; i++) mean[r] += A[r * n + i] * x[i];
        for (int j = 0; j < n; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int i = j; i < n; i++) sum += A[r * n + i] * L[MK_AT(i, j)];
            out->D[r * out->stride + j] = sum;
        }
    }
}

/* The columns G = [D, V, root of Q, extra], or [D, root of Q] where the model is linear or taken as such, give L' by L' L'' = G G'. */
mk_status_t MK_F(mk_unscented_predict)(int n, const MK_F_T(mk_unscented_view) * view, MK_REAL dt, const MK_REAL *Q) {
    MK_F_T(mk_unscented) *const core = view->core;
    const MK_F_T(mk_unscented_config) *const config = core->config;
    if (!core->started) return MK_ERROR_ORDER;
    core->failed = config->slots;
    if (!Q) Q = config->transition.Q;
    if (!(dt * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    if (!Q || dt < MK_R(0.0)) return MK_ERROR_ARGUMENT;
    const MK_F_T(mk_model) *const model = &config->transition.model;
    const int packed = MK_AT(n, 0), extended = config->update == MK_UPDATE_EXTENDED, linear = config->transition.A != 0;
    const int columns = linear || extended ? 2 * n : 3 * n + 1, last = linear || extended ? n : 2 * n;
    MK_REAL *const G = view->work, *const L = G + n * (3 * n + 1), *const x = L + packed, *const extra = x + n, *const rest = extra + n;
    const MK_F_T(mk_linear) out = {G, G + n, rest, rest + n, columns};
    const MK_F_T(mk_linear_work) work = {rest + 4 * n, rest + 4 * n + n * (2 * n + 1), rest + 2 * n, rest + 3 * n};
    mk_status_t status = MK_OK;
    int sign = 0;
    if (linear) {
        MK_F(mk_apply)(n, config->transition.A, view->x, view->L, &out, x);
    } else if (extended) {
        status = MK_F(mk_extend)(model, n, n, dt, view->x, view->L, &work, &out, x);
    } else {
        status = MK_F(mk_linearise)(config, model, n, n, dt, view->x, view->L, &work, &out, x);
        if (status == MK_OK) sign = MK_F(mk_residual_columns)(&config->transform, n, &out, model->space && model->space->mean, extra);
    }
    if (status != MK_OK) return status;
    for (int i = 0; i < packed; i++) L[i] = Q[i];
    if (!MK_F(mk_all_finite)(packed, L)) return MK_ERROR_NOT_FINITE;
    if (!MK_F(mk_semidefinite_root)(n, L, work.a, G + last, columns)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    for (int i = 0; i < n && columns > 2 * n; i++) G[i * columns + 3 * n] = sign > 0 ? extra[i] : MK_R(0.0);
    MK_F(mk_triangularise)(n, columns, G, L);
    if (!MK_F(mk_all_finite)(packed, L) || !MK_F(mk_all_finite)(n, x)) return MK_ERROR_NOT_FINITE;
    if (!MK_F(mk_is_factor)(n, L) || (sign < 0 && !MK_F(mk_downdate)(n, L, extra, G))) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    for (int i = 0; i < packed; i++) view->L[i] = L[i];
    for (int i = 0; i < n; i++) view->x[i] = x[i];
    core->predictions++;
    return MK_OK;
}
