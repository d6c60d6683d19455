/* SPDX-License-Identifier: MIT */
/* meshkal/weights.h, and an update with such weights. */

mk_status_t MK_F(mk_weight_thresholds)(int kind, double significance, int count, MK_REAL *k) {
    if (!k || count < 1 || kind < MK_STATISTIC_NORMAL || kind > MK_STATISTIC_STUDENT || !(significance > 0.0 && significance < 1.0)) return MK_ERROR_ARGUMENT;
    for (int i = 0; i < count; i++) {
        const double rows = (double)(i + 1);
        const double quantile = kind == MK_STATISTIC_NORMAL ? mk_sqrt_f64(mk_chi2_quantile(significance, 1.0))
                                : i < 3                     ? 0.0
                                                            : mk_student_quantile(0.5 * significance, rows - 2.0);
        k[i] = quantile <= (double)MK_LARGEST ? (MK_REAL)quantile : MK_LARGEST;
    }
    return MK_OK;
}

MK_REAL MK_F(mk_igg3_weight)(MK_REAL u, MK_REAL k0, MK_REAL k1) {
    const MK_REAL size = u < MK_R(0.0) ? -u : u;
    if (size <= k0 || (k1 == MK_R(0.0) && size == size)) return MK_R(1.0);
    if (!(size < k1)) return MK_R(0.0);
    const MK_REAL rest = (k1 - size) / (k1 - k0);
    return k0 / size * (rest * rest);
}

/* Numbers so far: how many, their mean, the sum of their squared deviations from it. Only positive numbers are added to the sum. */
typedef struct {
    MK_REAL count, mean, squares;
} MK_F_T(mk_spread);

static void MK_F(mk_spread_add)(MK_F_T(mk_spread) * a, MK_REAL value) {
    const MK_REAL apart = value - a->mean, count = a->count + MK_R(1.0), share = MK_R(1.0) / count;
    a->mean += apart * share;
    a->squares += apart * apart * (a->count * share);
    a->count = count;
}

static MK_REAL MK_F(mk_limited)(MK_REAL value) { return value > MK_LARGEST ? MK_LARGEST : value < -MK_LARGEST ? -MK_LARGEST : value; }

void MK_F(mk_weight_statistics)(int kind, int rows, const MK_REAL *r, const MK_REAL *variance, MK_REAL *statistic) {
    const int student = kind == MK_STATISTIC_STUDENT;
    MK_REAL most = MK_R(0.0);
    for (int j = 0; j < rows; j++) {
        const MK_REAL u = MK_F(mk_limited)(r[j] / MK_F(mk_sqrt)(variance[j])), size = u < MK_R(0.0) ? -u : u;
        statistic[j] = student && rows < 4 ? MK_R(0.0) : u;
        if (size > most) most = size;
    }
    if (!student || rows < 4) return;
    /* t does not depend on the unit: another one where squares would leave the range. */
    const MK_REAL unit = most > MK_R(1e15) || (most < MK_R(1e-9) && most > MK_R(0.0)) ? most : MK_R(1.0);
    MK_F_T(mk_spread) before = {MK_R(0.0), MK_R(0.0), MK_R(0.0)};
    for (int j = 0; j < rows; j++) {
        const MK_REAL u = statistic[j] / unit, count = (MK_REAL)(rows - 1);
        MK_F_T(mk_spread) others = before;
        for (int i = j + 1; i < rows; i++) MK_F(mk_spread_add)(&others, statistic[i] / unit);
        const MK_REAL apart = u - others.mean, s = MK_F(mk_sqrt)(others.squares / (count - MK_R(1.0)) * (MK_R(1.0) + MK_R(1.0) / count));
        statistic[j] = apart == MK_R(0.0) ? MK_R(0.0) : MK_F(mk_limited)(apart / s);
        MK_F(mk_spread_add)(&before, u);
    }
}

/* What an update says of weights for up to `most` rows. */
static mk_status_t MK_F(mk_row_weights_check)(const MK_F_T(mk_row_weights) * weights, int update, int most) {
    if (!weights || !weights->k0 || !weights->k1 || weights->kind > MK_STATISTIC_STUDENT || (update != MK_UPDATE_UNSCENTED && update != MK_UPDATE_EXTENDED))
        return MK_ERROR_ARGUMENT;
    if (!MK_F(mk_all_finite)(most, weights->k0) || !MK_F(mk_all_finite)(most, weights->k1)) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < most; i++)
        if (!(weights->k0[i] > MK_R(0.0) && weights->k0[i] < weights->k1[i]) && !(weights->k0[i] == MK_R(0.0) && weights->k1[i] == MK_R(0.0)))
            return MK_ERROR_ARGUMENT;
    return MK_OK;
}

/* Of stacked row r, whose statistic is in b. */
static MK_REAL MK_F(mk_weight_of)(const MK_F_T(mk_updating) * u, int r) {
    const MK_F_T(mk_row_weights) *const weights = u->weights;
    return MK_F(mk_igg3_weight)(u->b[r], weights->k0[u->rows - 1], weights->k1[u->rows - 1]);
}

/* out := K v, n numbers, with the gain K = P H' N^-1 of the posterior P = L L', N = R + Omega, H = D L0^-1: that of S = D D' + N would need the factor of S,
   which float32 does not have where the prior is much wider than the noise. v is spoilt. S of the update: what mk_ldl makes of N. */
static void MK_F(mk_gain_times)(const MK_F_T(mk_updating) * u, MK_REAL *v, MK_REAL *out) {
    const int n = u->n;
    MK_F(mk_ldl_forward)(u->rows, 1, u->S, v);
    MK_F(mk_ldl_backward)(u->rows, u->S, v);
    for (int i = 0; i < n; i++) {
        out[i] = MK_R(0.0);
        for (int r = 0; r < u->rows; r++) out[i] += u->linear.D[r * n + i] * v[r];
    }
    MK_F(mk_solve_right)(n, u->L0, out);
    for (int j = 0; j < n; j++) {
        MK_REAL sum = MK_R(0.0);
        for (int i = j; i < n; i++) sum += u->L[MK_AT(i, j)] * out[i];
        out[j] = sum;
    }
    for (int i = n - 1; i >= 0; i--) {
        MK_REAL sum = MK_R(0.0);
        for (int j = 0; j <= i; j++) sum += u->L[MK_AT(i, j)] * out[j];
        out[i] = sum;
    }
}

/* x and L, which absorb has made with the optimal gain, with Kw = K W instead: x := prior x + K W e, and, S being the innovations' covariance,
       (I - Kw H) P0 (I - Kw H)' + Kw N Kw' = P + K (I - W) S (I - W) K'
   without the difference on the left: the columns of K (I - W) root(S), of the rows with a weight below 1 alone, are added to L L' = P one after another.
   Their root is that of N, to which the columns of D are added likewise. Leaves the statistics in b. */
static mk_status_t MK_F(mk_reweigh)(MK_F_T(mk_updating) * u) {
    const int n = u->n, rows = u->rows;
    MK_REAL *const C = u->noise, *const v = u->e, *const columns = u->B;
    for (int r = 0; r < rows; r++) u->b[r] = u->noise[MK_AT(r, r)] + MK_F(mk_stack_spread)(n, u, r, r);
    MK_F(mk_weight_statistics)(u->weights->kind, rows, u->e, u->b, u->b);
    for (int r = 0; r < rows; r++) {
        const MK_REAL w = MK_F(mk_weight_of)(u, r);
        u->weighted_rows = (uint16_t)(u->weighted_rows + (w < MK_R(1.0)));
        u->unused_rows = (uint16_t)(u->unused_rows + (w == MK_R(0.0)));
        u->e[r] *= w;
    }
    if (u->weighted_rows == 0) return MK_OK;
    if (u->unused_rows == rows) { /* exactly the prediction */
        for (int i = 0; i < n; i++) u->x[i] = u->view->x[i];
        for (int i = 0; i < MK_AT(n, 0); i++) u->L[i] = u->L0[i];
        return MK_OK;
    }
    MK_F(mk_gain_times)(u, v, u->scratch);
    for (int i = 0; i < n; i++) u->x[i] = u->view->x[i] + u->scratch[i];
    /* In place: an element moves to the front or stays. */
    int q = 0;
    for (int r = 0; r < rows; r++) {
        if (!(MK_F(mk_weight_of)(u, r) < MK_R(1.0))) continue;
        int p = 0;
        for (int s = 0; s <= r; s++)
            if (MK_F(mk_weight_of)(u, s) < MK_R(1.0)) C[MK_AT(q, p++)] = u->noise[MK_AT(r, s)] + MK_F(mk_stack_residual)(n, u, r, s);
        q++;
    }
    if (!MK_F(mk_cholesky)(q, C)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    for (int k = 0; k < n; k++) {
        int p = 0;
        for (int r = 0; r < rows; r++)
            if (MK_F(mk_weight_of)(u, r) < MK_R(1.0)) v[p++] = u->linear.D[r * n + k];
        MK_F(mk_root_add)(q, C, v);
    }
    for (int c = 0; c < q; c++) {
        int p = 0;
        for (int r = 0; r < rows; r++) {
            const MK_REAL rest = MK_R(1.0) - MK_F(mk_weight_of)(u, r);
            v[r] = rest > MK_R(0.0) ? (p >= c ? rest * C[MK_AT(p, c)] : MK_R(0.0)) : MK_R(0.0);
            p += rest > MK_R(0.0);
        }
        MK_F(mk_gain_times)(u, v, columns + c * n);
    }
    for (int c = 0; c < q; c++) MK_F(mk_root_add)(n, u->L, columns + c * n);
    return MK_OK;
}

/* What an update leaves of its weights. */
static void MK_F(mk_weights_commit)(const MK_F_T(mk_updating) * u) {
    const MK_F_T(mk_row_weights) *const weights = u->weights;
    int first = 0;
    for (int l = 0; l < u->slots; l++) {
        const int used = u->factor[l] > MK_R(0.0);
        for (int r = 0; r < u->m; r++) {
            const int read = used && r < u->config->sensor[l].rows;
            if (weights->weight) weights->weight[l * u->m + r] = read ? MK_F(mk_weight_of)(u, first + r) : MK_R(0.0);
            if (weights->statistic) weights->statistic[l * u->m + r] = read ? u->b[first + r] : MK_R(0.0);
        }
        first += used ? u->config->sensor[l].rows : 0;
    }
}

mk_status_t MK_F(mk_unscented_update_weighted_with)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, const MK_F_T(mk_row_weights) * weights,
                                                    const MK_F_T(mk_unscented_kernels) * kernels) {
    MK_F_T(mk_updating) u;
    if (!view->core->started) return MK_ERROR_ORDER;
    mk_status_t status = MK_F(mk_row_weights_check)(weights, view->core->config->update, m * slots);
    if (status != MK_OK) return status;
    MK_F(mk_updating_open)(n, m, slots, view, kernels, &u);
    u.weights = weights;
    status = MK_F(mk_prepare)(&u);
    if (status == MK_OK && u.rows > 0) {
        status = MK_F(mk_absorb)(&u, MK_R(1.0));
        if (status == MK_OK) status = MK_F(mk_reweigh)(&u);
        if (status == MK_OK) status = MK_F(mk_look)(&u);
        if (!(u.nis <= MK_LARGEST)) u.nis = MK_LARGEST; /* of a reading that is not used */
    }
    if (status != MK_OK) return status;
    MK_F(mk_weights_commit)(&u);
    MK_F(mk_unscented_commit)(&u, u.rows > 0, 0);
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_update_weighted)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, const MK_F_T(mk_row_weights) * weights) {
    const MK_F_T(mk_unscented_kernels) kernels = MK_F(mk_shared_kernels)();
    return MK_F(mk_unscented_update_weighted_with)(n, m, slots, view, weights, &kernels);
}
