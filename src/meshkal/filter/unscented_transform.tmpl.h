/* SPDX-License-Identifier: MIT */
/* The unscented transform in the form of meshkal/unscented.h, and the prediction. */

/* Results of a model at and around x: element (r, j) of D and U stands at r * row + j * column; mu; epsilon, by which a mean callback differs from mu. */
typedef struct {
    MK_REAL *D, *U, *mu, *epsilon;
    int row, column;
} MK_F_T(mk_linear);

/* Numbers that follow from the spread. */
typedef struct {
    MK_REAL c, w, scale; /* sqrt(spread), 1 / 2 spread, 1 / 2 c */
} MK_F_T(mk_weights);

MK_KERNEL MK_F_T(mk_weights) MK_F(mk_weigh)(const MK_F_T(mk_transform) * transform) {
    const MK_REAL c = MK_F(mk_sqrt)(transform->spread);
    const MK_F_T(mk_weights) weights = {c, MK_R(0.5) / transform->spread, MK_R(0.5) / c};
    return weights;
}

MK_KERNEL void MK_F(mk_space_difference)(const MK_F_T(mk_space) * space, int rows, const MK_REAL *a, const MK_REAL *b, MK_REAL *d) {
    if (space && space->difference) space->difference(space->context, a, b, d);
    else
        for (int r = 0; r < rows; r++) d[r] = a[r] - b[r];
}

/* X := x and the points around it, n numbers each. */
MK_KERNEL void MK_F(mk_draw)(int n, MK_REAL c, const MK_REAL *x, const MK_REAL *L, MK_REAL *X) {
    MK_UNROLL for (int i = 0; i < n; i++) X[i] = x[i];
    MK_UNROLL for (int j = 0; j < n; j++) {
        MK_REAL *const up = X + (1 + j) * n, *const down = up + n * n;
        MK_UNROLL for (int i = 0; i < n; i++) {
            const MK_REAL step = i < j ? MK_R(0.0) : c * L[MK_AT(i, j)];
            up[i] = x[i] + step;
            down[i] = x[i] - step;
        }
    }
}

/* Y := the function at `count` points. What is not finite is left to be found in what is made of it, but for differences, which may hide it. */
MK_KERNEL mk_status_t MK_F(mk_call)(const MK_F_T(mk_model) * model, int n, int rows, int one_at_a_time, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    mk_status_t status = MK_OK;
    const int at_once = one_at_a_time ? 1 : count;
    for (int k = 0; k < count && status == MK_OK; k += at_once) status = model->function(model->context, dt, at_once, x + k * n, y + k * rows);
    return status == MK_OK && model->space && !MK_F(mk_all_finite)(count * rows, y) ? MK_ERROR_NOT_FINITE : status;
}

/* X: what mk_draw made; spoilt if the model has a mean callback. Y: results, spoilt; *out may be in it, D in place of the points x + c L_j, U in place of
   those below. mean := y_0 + mu, or what the space says it is. one: rows numbers. */
MK_KERNEL mk_status_t MK_F(mk_linearise)(int n, int rows, const MK_F_T(mk_model) * model, int one_at_a_time, const MK_F_T(mk_weights) * weights, MK_REAL dt,
                                         MK_REAL *X, MK_REAL *Y, MK_REAL *one, const MK_F_T(mk_linear) * out, MK_REAL *mean) {
    const MK_F_T(mk_space) *const space = model->space;
    const MK_REAL w = weights->w, scale = weights->scale;
    const mk_status_t status = MK_F(mk_call)(model, n, rows, one_at_a_time, dt, 2 * n + 1, X, Y);
    if (status != MK_OK) return status;
    if (space && space->mean) {
        X[0] = MK_R(1.0) - (MK_REAL)(2 * n) * w;
        for (int k = 1; k <= 2 * n; k++) X[k] = w;
        space->mean(space->context, 2 * n + 1, X, Y, mean);
        if (!MK_F(mk_all_finite)(rows, mean)) return MK_ERROR_NOT_FINITE;
    }
    if (space && space->difference)
        for (int k = 1; k <= 2 * n; k++) {
            space->difference(space->context, Y + k * rows, Y, one);
            for (int r = 0; r < rows; r++) Y[k * rows + r] = one[r];
        }
    else
        MK_UNROLL_ALL for (int k = 1; k <= 2 * n; k++) MK_F(mk_row_difference)(rows, Y, Y + k * rows);
    MK_UNROLL for (int r = 0; r < rows; r++) out->mu[r] = out->epsilon[r] = MK_R(0.0);
    MK_UNROLL for (int j = 0; j < n; j++) {
        MK_UNROLL for (int r = 0; r < rows; r++) {
            const MK_REAL a = Y[(1 + j) * rows + r], b = Y[(1 + n + j) * rows + r], u = a + b;
            out->D[r * out->row + j * out->column] = (a - b) * scale;
            out->U[r * out->row + j * out->column] = u;
            out->mu[r] += u;
        }
    }
    MK_UNROLL for (int r = 0; r < rows; r++) out->mu[r] *= w;
    if (space && space->mean) {
        MK_F(mk_space_difference)(space, rows, mean, Y, one);
        for (int r = 0; r < rows; r++) out->epsilon[r] = one[r] - out->mu[r];
        return MK_OK;
    }
    MK_UNROLL for (int r = 0; r < rows; r++) mean[r] = Y[r] + out->mu[r];
    return MK_F(mk_all_finite)(rows, mean) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* y := the function at x, J (rows x n) its derivative there; finite, or a status. */
MK_KERNEL mk_status_t MK_F(mk_derive)(int n, int rows, const MK_F_T(mk_model) * model, MK_REAL dt, const MK_REAL *x, MK_REAL *y, MK_REAL *J) {
    mk_status_t status = model->function(model->context, dt, 1, x, y);
    if (status == MK_OK) status = model->jacobian(model->context, dt, x, J);
    if (status != MK_OK) return status;
    return MK_F(mk_all_finite)(rows, y) && MK_F(mk_all_finite)(rows * n, J) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* The same as linearising from the model's Jacobian at x. J: rows x n. */
MK_KERNEL mk_status_t MK_F(mk_extend)(int n, int rows, const MK_F_T(mk_model) * model, MK_REAL dt, const MK_REAL *x, const MK_REAL *L, MK_REAL *J,
                                      const MK_F_T(mk_linear) * out, MK_REAL *mean) {
    const mk_status_t status = MK_F(mk_derive)(n, rows, model, dt, x, mean, J);
    if (status != MK_OK) return status;
    for (int r = 0; r < rows; r++) {
        out->mu[r] = out->epsilon[r] = MK_R(0.0);
        MK_UNROLL for (int j = 0; j < n; j++) {
            MK_REAL sum = MK_R(0.0);
            MK_UNROLL for (int i = j; i < n; i++) sum += J[r * n + i] * L[MK_AT(i, j)];
            out->D[r * out->row + j * out->column] = sum;
            out->U[r * out->row + j * out->column] = MK_R(0.0);
        }
    }
    return MK_OK;
}

/* The same as columns: U := V with V V' = Omega, and `extra`, a column more; returns 1 if it is to be added, -1 if extra extra' is to be subtracted, 0 if
   there is none. Where the weight of the centre is not negative, there is nothing to subtract. U by columns of n numbers. */
MK_KERNEL int MK_F(mk_residual_columns)(int n, const MK_F_T(mk_transform) * transform, const MK_F_T(mk_linear) * l, int with_mean, MK_REAL *extra) {
    const MK_REAL w = MK_R(0.5) / transform->spread, b = transform->correction, root = MK_F(mk_sqrt)(MK_R(0.5) * w), count = (MK_REAL)n;
    MK_REAL weight, factor;
    int sign;
    if (with_mean) { /* w/2 sum (u_j - 2 delta)(u_j - 2 delta)' + weight delta delta' */
        weight = MK_R(2.0) + b - MK_R(2.0) * count * w;
        sign = weight > MK_R(0.0) ? 1 : weight < MK_R(0.0) ? -1 : 0;
        factor = MK_F(mk_sqrt)(weight < MK_R(0.0) ? -weight : weight);
        for (int i = 0; i < n; i++) extra[i] = MK_R(-2.0) * (l->mu[i] + l->epsilon[i]);
        factor *= MK_R(-0.5);
    } else { /* w/2 U (I + 2 w b 1 1') U': the matrix of ones has one eigenvalue, n; its factor I + shift 1 1' takes it into the columns */
        weight = MK_R(1.0) + MK_R(2.0) * w * b * count;
        sign = weight < MK_R(0.0) ? -1 : 0;
        const MK_REAL shift = ((sign == 0 ? MK_F(mk_sqrt)(weight) : MK_R(0.0)) - MK_R(1.0)) / (count * w);
        MK_UNROLL for (int i = 0; i < n; i++) extra[i] = shift * l->mu[i];
        factor = sign == 0 ? MK_R(0.0) : -root * MK_F(mk_sqrt)(-weight * count);
    }
    MK_UNROLL_ALL for (int j = 0; j < n; j++) MK_F(mk_row_sum_scaled)(n, root, extra, l->U + j * n);
    if (sign != 0)
        for (int i = 0; i < n; i++) extra[i] *= factor;
    return sign;
}

/* 1 if this is the factor of a positive definite matrix. */
MK_KERNEL int MK_F(mk_is_factor)(int n, const MK_REAL *L) {
    for (int i = 0; i < n; i++)
        if (!(L[MK_AT(i, i)] > MK_R(0.0))) return 0;
    return 1;
}

/* D := A L, and mean := A x. */
MK_KERNEL void MK_F(mk_apply)(int n, const MK_REAL *A, const MK_REAL *x, const MK_REAL *L, const MK_F_T(mk_linear) * out, MK_REAL *mean) {
    for (int r = 0; r < n; r++) {
        mean[r] = MK_R(0.0);
        MK_UNROLL for (int i = 0; i < n; i++) mean[r] += A[r * n + i] * x[i];
        MK_UNROLL for (int j = 0; j < n; j++) {
            MK_REAL sum = MK_R(0.0);
            MK_UNROLL for (int i = j; i < n; i++) sum += A[r * n + i] * L[MK_AT(i, j)];
            out->D[r * out->row + j * out->column] = sum;
        }
    }
}

/* S := Q and, where sigma points were rounded, what rounding has added to them: without it P collapses where a state is known to the last digits. */
MK_KERNEL void MK_F(mk_put_noise)(int n, const MK_REAL *Q, const MK_REAL *x, MK_REAL *S) {
    MK_F(mk_packed_copy)(n, Q, S);
    for (int i = 0; x && i < n; i++) S[MK_AT(i, i)] += MK_EPSILON * x[i] * (MK_EPSILON * x[i]);
}

/* The columns G = [extra, D, V, root of Q], without extra where there is none to add, or [D, root of Q] where the model is linear or taken as such, give L'
   by L' L'' = G G'. The model's results at its 2 n + 1 points become [extra, D, V] in place. rest: 4 n numbers. */
MK_KERNEL mk_status_t MK_F(mk_inline_unscented_predict)(int n, const MK_F_T(mk_unscented_view) * view, MK_REAL *rest, MK_REAL dt, const MK_REAL *Q) {
    MK_F_T(mk_unscented) *const core = view->core;
    const MK_F_T(mk_unscented_config) *const config = core->config;
    if (!core->started) return MK_ERROR_ORDER;
    core->failed = config->slots;
    if (!Q) Q = config->transition.Q;
    if (!(dt * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    if (!Q || dt < MK_R(0.0)) return MK_ERROR_ARGUMENT;
    const MK_F_T(mk_model) *const model = &config->transition.model;
    const int packed = MK_AT(n, 0), extended = config->update == MK_UPDATE_EXTENDED, linear = config->transition.A != 0;
    MK_REAL *const extra = view->work, *const D = extra + n, *const V = D + n * n, *const points = V + n * n, *const L = points + n * n, *const x = rest + 3 * n;
    const MK_F_T(mk_linear) out = {D, V, rest, rest + n, 1, n};
    mk_status_t status = MK_OK;
    MK_REAL *G = D;
    int sign = 0, full = 2 * n, total;
    if (linear || extended) {
        G = V;
        full = n;
        const MK_F_T(mk_linear) straight = {V, D, rest, rest + n, 1, n};
        if (linear) MK_F(mk_apply)(n, config->transition.A, view->x, view->L, &straight, x);
        else status = MK_F(mk_extend)(n, n, model, dt, view->x, view->L, points, &straight, x);
    } else {
        const MK_F_T(mk_weights) weights = MK_F(mk_weigh)(&config->transform);
        MK_F(mk_draw)(n, weights.c, view->x, view->L, points);
        status = MK_F(mk_linearise)(n, n, model, config->one_at_a_time, &weights, dt, points, extra, rest + 2 * n, &out, x);
        if (status == MK_OK) sign = MK_F(mk_residual_columns)(n, &config->transform, &out, model->space && model->space->mean, extra);
        if (sign > 0) {
            G = extra;
            full++;
        }
    }
    if (status != MK_OK) return status;
    if (!MK_F(mk_all_finite)(packed, Q)) return MK_ERROR_NOT_FINITE;
    MK_F(mk_put_noise)(n, Q, linear || extended ? 0 : x, L);
    total = full + n;
    if (MK_F(mk_cholesky)(n, L)) { /* the usual case, and the quick one */
        MK_UNROLL for (int j = 0; j < n; j++) {
            MK_UNROLL for (int i = 0; i < n; i++) points[j * n + i] = i < j ? MK_R(0.0) : L[MK_AT(i, j)];
        }
    } else {
        MK_F(mk_put_noise)(n, Q, linear || extended ? 0 : x, L);
        if (!MK_F(mk_semidefinite_root)(n, L, rest, points)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
        full = total;
    }
    MK_F(mk_triangularise)(n, full, total, G, L, rest);
    if (!MK_F(mk_all_finite)(packed, L) || !MK_F(mk_all_finite)(n, x)) return MK_ERROR_NOT_FINITE;
    if (!MK_F(mk_is_factor)(n, L) || (sign < 0 && !MK_F(mk_downdate)(n, L, extra, rest))) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    MK_F(mk_packed_copy)(n, L, view->L);
    MK_UNROLL for (int i = 0; i < n; i++) view->x[i] = x[i];
    core->predictions++;
    return MK_OK;
}
