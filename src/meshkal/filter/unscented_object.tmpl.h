/* SPDX-License-Identifier: MIT */
/* The object of meshkal/unscented.h: start, readings, queries, and the update from information. */

/* L := the factor of S, which must be positive definite. */
static mk_status_t MK_F(mk_factor)(int n, const MK_REAL *S, MK_REAL *L) {
    if (!MK_F(mk_all_finite)(MK_AT(n, 0), S)) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < MK_AT(n, 0); i++) L[i] = S[i];
    return MK_F(mk_cholesky)(n, L) ? MK_OK : MK_ERROR_NOT_POSITIVE_DEFINITE;
}

/* Columns G, n of n numbers, with G G' = S, packed and positive semidefinite. The pivot that is largest by its own diagonal element comes first,
   so that what is left at the end is rounding whatever the rank (in the order of rows, a small pivot that is rounding itself would spoil what
   follows). Returns 1, or 0 if S is indefinite or not finite. S and d, n numbers, are spoilt. */
int MK_F(mk_semidefinite_root)(int n, MK_REAL *S, MK_REAL *d, MK_REAL *G) {
    const MK_REAL slack = MK_R(8.0) * MK_EPSILON * (MK_REAL)n;
    for (int i = 0; i < n; i++) {
        d[i] = S[MK_AT(i, i)];
        if (!(d[i] >= MK_R(0.0) && d[i] <= MK_LARGEST)) return 0;
    }
    for (int k = 0; k < n; k++) {
        int p = -1;
        MK_REAL most = slack;
        for (int i = 0; i < n; i++) {
            const MK_REAL ratio = d[i] > MK_R(0.0) ? S[MK_AT(i, i)] / d[i] : MK_R(0.0);
            if (ratio > most) {
                most = ratio;
                p = i;
            }
        }
        const MK_REAL root = p < 0 ? MK_R(1.0) : MK_F(mk_sqrt)(S[MK_AT(p, p)]);
        for (int i = 0; i < n; i++) G[k * n + i] = p < 0 ? MK_R(0.0) : S[MK_PLACE(i, p)] / root;
        for (int i = 0; i < n && p >= 0; i++)
            for (int j = 0; j <= i; j++) S[MK_AT(i, j)] = i == p || j == p ? MK_R(0.0) : S[MK_AT(i, j)] - G[k * n + i] * G[k * n + j];
    }
    for (int i = 0; i < n; i++) d[i] = MK_F(mk_sqrt)(d[i]);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            const MK_REAL bound = MK_R(2.0) * slack * d[i] * d[j];
            if (!(S[MK_AT(i, j)] >= -bound && S[MK_AT(i, j)] <= bound)) return 0;
        }
    return 1;
}

static mk_status_t MK_F(mk_unscented_check)(int n, int m, int slots, const MK_F_T(mk_unscented_config) * config, MK_REAL *work) {
    if (!config || n < 1 || m < 1 || slots < 1) return MK_ERROR_ARGUMENT;
    if (config->n != n || config->m != m || config->slots != slots) return MK_ERROR_SHAPE;
    const MK_F_T(mk_transition) *const g = &config->transition;
    const int extended = config->update == MK_UPDATE_EXTENDED;
    if (!config->sensor || !config->x0 || !config->P0 || config->increments < 1 || config->update > MK_UPDATE_ITERATED_LITERAL ||
        config->rule > MK_RULE_MAHALANOBIS || (!g->A && (!g->model.function || (extended && !g->model.jacobian))))
        return MK_ERROR_ARGUMENT;
    const MK_F_T(mk_transform) *const transform = &config->transform;
    if (!extended && (!(transform->spread > MK_R(0.0) && transform->spread <= MK_LARGEST) || !MK_F(mk_all_finite)(1, &transform->correction)))
        return MK_ERROR_ARGUMENT;
    if (g->A && !MK_F(mk_all_finite)(n * n, g->A)) return MK_ERROR_NOT_FINITE;
    if (g->Q) {
        if (!MK_F(mk_all_finite)(MK_AT(n, 0), g->Q)) return MK_ERROR_NOT_FINITE;
        MK_REAL *const d = work + MK_AT(n, 0);
        for (int i = 0; i < MK_AT(n, 0); i++) work[i] = g->Q[i];
        if (!MK_F(mk_semidefinite_root)(n, work, d, d + n)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    }
    for (int l = 0; l < slots; l++) {
        const MK_F_T(mk_sensor) *const sensor = config->sensor + l;
        if (!sensor->model.function || (extended && !sensor->model.jacobian) || !sensor->R || sensor->rows < 1 || sensor->rows > m)
            return MK_ERROR_ARGUMENT;
        const mk_status_t status = MK_F(mk_factor)(sensor->rows, sensor->R, work);
        if (status != MK_OK) return status;
    }
    const mk_status_t weights = config->weights ? MK_F(mk_row_weights_check)(config->weights, config->update, m * slots) : MK_OK;
    return weights == MK_OK && config->gate ? MK_F(mk_gate_check)(config->gate, m, m * slots) : weights;
}

static mk_status_t MK_F(mk_unscented_reset)(int n, int slots, const MK_F_T(mk_unscented_view) * view, const MK_REAL *x0, const MK_REAL *P0) {
    if (!x0 || !P0) return MK_ERROR_ARGUMENT;
    if (!MK_F(mk_all_finite)(n, x0)) return MK_ERROR_NOT_FINITE;
    const mk_status_t status = MK_F(mk_factor)(n, P0, view->work);
    if (status != MK_OK) return status;
    for (int i = 0; i < MK_AT(n, 0); i++) view->L[i] = view->work[i];
    for (int i = 0; i < n; i++) view->x[i] = x0[i];
    for (int l = 0; l < slots; l++) view->have[l] = 0;
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_start)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, const MK_F_T(mk_unscented_config) * config) {
    mk_status_t status = MK_F(mk_unscented_check)(n, m, slots, config, view->work);
    if (status == MK_OK) status = MK_F(mk_unscented_reset)(n, slots, view, config->x0, config->P0);
    if (status != MK_OK) return status;
    memset(view->core, 0, sizeof *view->core);
    memset(view->record, 0, (size_t)slots * sizeof *view->record);
    memset(view->z, 0, (size_t)(slots * m) * sizeof *view->z);
    view->core->config = config;
    view->core->failed = (uint16_t)slots;
    view->core->started = 1;
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_restart)(int n, int slots, const MK_F_T(mk_unscented_view) * view, const MK_REAL *x0, const MK_REAL *P0) {
    if (!view->core->started) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_unscented_reset)(n, slots, view, x0, P0);
    if (status == MK_OK) view->core->gated_updates = 0;
    return status;
}

mk_status_t MK_F(mk_unscented_put)(int m, int slots, const MK_F_T(mk_unscented_view) * view, int slot, const MK_REAL *z) {
    if (!view->core->started) return MK_ERROR_ORDER;
    if (!z || slot < 0 || slot >= slots) return MK_ERROR_ARGUMENT;
    const int rows = view->core->config->sensor[slot].rows;
    const mk_status_t status = view->have[slot] ? MK_ERROR_REPEATED : MK_F(mk_all_finite)(rows, z) ? MK_OK : MK_ERROR_NOT_FINITE;
    if (status != MK_OK) {
        view->core->rejected++;
        return status;
    }
    for (int r = 0; r < rows; r++) view->z[slot * m + r] = z[r];
    view->have[slot] = 1;
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_drop)(int slots, const MK_F_T(mk_unscented_view) * view, int slot) {
    if (!view->core->started) return MK_ERROR_ORDER;
    if (slot < 0 || slot >= slots) return MK_ERROR_ARGUMENT;
    view->have[slot] = 0;
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_move)(int n, const MK_F_T(mk_unscented_view) * view, const MK_REAL *dx) {
    if (!view->core->started) return MK_ERROR_ORDER;
    if (!dx) return MK_ERROR_ARGUMENT;
    MK_REAL probe = MK_R(0.0);
    for (int i = 0; i < n; i++) probe += (view->x[i] + dx[i]) * MK_R(0.0);
    if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < n; i++) view->x[i] += dx[i];
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_covariance)(int n, const MK_F_T(mk_unscented_view) * view, MK_REAL *P) {
    if (!P) return MK_ERROR_ARGUMENT;
    if (!view->core->started) return MK_ERROR_ORDER;
    const MK_REAL *const L = view->L;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            P[MK_AT(i, j)] = MK_R(0.0);
            for (int k = 0; k <= j; k++) P[MK_AT(i, j)] += L[MK_AT(i, k)] * L[MK_AT(j, k)];
        }
    return MK_OK;
}

/* M = U U' with U upper triangular, in place of packed M: element (i, j) of U, i <= j, at the place of (j, i). 1, or 0 if M is not positive definite. */
static int MK_F(mk_cholesky_upper)(int n, MK_REAL *M) {
    for (int j = n - 1; j >= 0; j--) {
        const MK_REAL diagonal = M[MK_AT(j, j)];
        MK_REAL pivot = diagonal;
        for (int k = j + 1; k < n; k++) pivot -= M[MK_AT(k, j)] * M[MK_AT(k, j)];
        if (!(pivot > MK_EPSILON * diagonal && diagonal <= MK_LARGEST)) return 0;
        M[MK_AT(j, j)] = MK_F(mk_sqrt)(pivot);
        for (int i = 0; i < j; i++) {
            MK_REAL sum = M[MK_AT(j, i)];
            for (int k = j + 1; k < n; k++) sum -= M[MK_AT(k, i)] * M[MK_AT(k, j)];
            M[MK_AT(j, i)] = sum / M[MK_AT(j, j)];
        }
    }
    return 1;
}

/* With P = L L': P^-1 + scale S = L^-T (I + scale L' S L) L^-1 = L^-T U U' L^-1, so the new factor is L U^-T, lower triangular again. */
mk_status_t MK_F(mk_unscented_inform)(int n, const MK_F_T(mk_unscented_view) * view, MK_REAL scale, const MK_REAL *s, const MK_REAL *S) {
    if (!s || !S) return MK_ERROR_ARGUMENT;
    if (!view->core->started) return MK_ERROR_ORDER;
    const int packed = MK_AT(n, 0);
    const MK_REAL *const L = view->L;
    if (!MK_F(mk_all_finite)(1, &scale) || !MK_F(mk_all_finite)(n, s) || !MK_F(mk_all_finite)(packed, S)) return MK_ERROR_NOT_FINITE;
    MK_REAL *const SL = view->work, *const U = SL + n * n, *const next = U + packed, *const x = next + packed, *const g = x + n;
    for (int i = 0; i < n; i++) {
        g[i] = s[i];
        for (int j = 0; j < n; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int k = j; k < n; k++) sum += S[MK_PLACE(i, k)] * L[MK_AT(k, j)];
            SL[i * n + j] = sum;
            g[i] -= S[MK_PLACE(i, j)] * view->x[j];
        }
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int k = i; k < n; k++) sum += L[MK_AT(k, i)] * SL[k * n + j];
            U[MK_AT(i, j)] = (i == j ? MK_R(1.0) : MK_R(0.0)) + scale * sum;
        }
    if (!MK_F(mk_all_finite)(packed, U)) return MK_ERROR_NOT_FINITE;
    if (!MK_F(mk_cholesky_upper)(n, U)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    /* Row i of the new factor: U v' = row' */
    for (int i = 0; i < n; i++)
        for (int k = i; k >= 0; k--) {
            MK_REAL sum = L[MK_AT(i, k)];
            for (int j = k + 1; j <= i; j++) sum -= U[MK_AT(j, k)] * next[MK_AT(i, j)];
            next[MK_AT(i, k)] = sum / U[MK_AT(k, k)];
        }
    /* x + P scale (s - S x) */
    for (int i = 0; i < n; i++) x[i] = view->x[i];
    for (int k = 0; k < n; k++) {
        MK_REAL sum = MK_R(0.0);
        for (int i = k; i < n; i++) sum += next[MK_AT(i, k)] * g[i];
        for (int i = k; i < n; i++) x[i] += next[MK_AT(i, k)] * scale * sum;
    }
    if (!MK_F(mk_all_finite)(packed, next) || !MK_F(mk_all_finite)(n, x) || !MK_F(mk_is_factor)(n, next)) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < packed; i++) view->L[i] = next[i];
    for (int i = 0; i < n; i++) view->x[i] = x[i];
    return MK_OK;
}
