/* SPDX-License-Identifier: MIT */
/* Everything of the filter object but its two hot steps: start, inputs, queries. Compiled once, with run-time dimensions. */

/* result := S^-1, packed, by way of work (MK_PACKED(n)); result is written on success only and may be S or work. */
static mk_status_t MK_F(mk_invert)(int n, const MK_REAL *S, MK_REAL *result, MK_REAL *work) {
    const int packed = MK_AT(n, 0);
    if (!MK_F(mk_all_finite)(packed, S)) return MK_ERROR_NOT_FINITE;
    if (!MK_F(mk_positive_definite)(n, S, work)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    MK_F(mk_ldl_invert)(n, work);
    if (!MK_F(mk_all_finite)(packed, work)) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < packed; i++) result[i] = work[i];
    return MK_OK;
}

/* Element (i, r) of C' R^-1. */
static MK_REAL MK_F(mk_rkfd_gain)(int n, int rows, const MK_REAL *C, const MK_REAL *R_inverse, int i, int r) {
    MK_REAL sum = MK_R(0.0);
    for (int s = 0; s < rows; s++) sum += C[s * n + i] * R_inverse[MK_PLACE(r, s)];
    return sum;
}

mk_status_t MK_F(mk_rkfd_sensor)(int n, int m, int rows, const MK_REAL *C, const MK_REAL *R, MK_REAL *F, MK_REAL *S,
                                 MK_REAL *R_inverse, MK_REAL *work) {
    if (!C || !R || !F || !S || !R_inverse || !work || n < 1 || rows < 0 || rows > m) return MK_ERROR_ARGUMENT;
    if (!MK_F(mk_all_finite)(m * n, C)) return MK_ERROR_NOT_FINITE;
    if (rows > 0) {
        const mk_status_t status = MK_F(mk_invert)(rows, R, work, work);
        if (status != MK_OK) return status;
    }
    /* The diagonal of S bounds the rest, and F by way of it: look before anything is written. */
    for (int i = 0; i < n; i++) {
        MK_REAL sum = MK_R(0.0);
        for (int r = 0; r < rows; r++) sum += MK_F(mk_rkfd_gain)(n, rows, C, work, i, r) * C[r * n + i];
        for (int r = 0; r < rows; r++) sum += MK_R(0.0) * MK_F(mk_rkfd_gain)(n, rows, C, work, i, r);
        if (!(sum * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    }
    for (int i = 0; i < MK_AT(m, 0); i++) R_inverse[i] = i < MK_AT(rows, 0) ? work[i] : MK_R(0.0);
    for (int i = 0; i < n; i++) {
        for (int r = 0; r < m; r++) F[r * n + i] = r < rows ? MK_F(mk_rkfd_gain)(n, rows, C, R_inverse, i, r) : MK_R(0.0);
        for (int j = 0; j <= i; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int r = 0; r < rows; r++) sum += F[r * n + i] * C[r * n + j];
            S[MK_AT(i, j)] = sum;
        }
    }
    return MK_OK;
}

MK_PART int MK_F(mk_is_tolerance)(MK_REAL c) { return c >= MK_R(0.0) && c * MK_R(0.0) == MK_R(0.0); }

mk_status_t MK_F(mk_rkfd_set_tolerance)(MK_F_T(mk_rkfd) * core, MK_REAL tolerance) {
    if (!MK_F(mk_is_tolerance)(tolerance)) return MK_ERROR_TOLERANCE;
    if (tolerance != core->tolerance) core->steady = 0;
    core->tolerance = tolerance;
    return MK_OK;
}

static mk_status_t MK_F(mk_rkfd_check)(int n, int m, int slots, const MK_F_T(mk_rkfd_config) * config) {
    if (!config || n < 1 || m < 1 || slots < 1) return MK_ERROR_ARGUMENT;
    if (config->n != n || config->m != m || config->slots != slots) return MK_ERROR_SHAPE;
    if (!config->x0 || !config->P0 || !config->rows) return MK_ERROR_ARGUMENT;
    const int packed = MK_AT(n, 0), rows = slots * m;
    const MK_REAL *const numbers[8] = {config->A, config->Q, config->input ? config->input : config->x0, config->weight,
                                       config->C, config->F, config->S, config->R_inverse};
    const int counts[8] = {n * n, packed, config->input ? n : 0, slots, rows * n, rows * n, slots * packed, slots * MK_AT(m, 0)};
    int finite = 1;
    for (int k = 0; k < 8; k++) {
        if (!numbers[k]) return MK_ERROR_ARGUMENT;
        finite &= MK_F(mk_all_finite)(counts[k], numbers[k]);
    }
    if (!finite) return MK_ERROR_NOT_FINITE;
    for (int l = 0; l < slots; l++)
        if (config->weight[l] < MK_R(0.0) || config->rows[l] > m) return MK_ERROR_ARGUMENT;
    return MK_OK;
}

static mk_status_t MK_F(mk_rkfd_check_steady)(int n, int m, int slots, const MK_F_T(mk_rkfd_steady) * steady, MK_REAL *work) {
    if (!steady) return MK_OK;
    if (!steady->Phi || !steady->G || !steady->W) return MK_ERROR_ARGUMENT;
    const MK_REAL numbers[3] = {steady->theta, steady->trace_P, steady->close};
    if (!MK_F(mk_all_finite)(n * n, steady->Phi) || !MK_F(mk_all_finite)(slots * m * n, steady->G) ||
        !MK_F(mk_all_finite)(MK_AT(n, 0), steady->W) || !MK_F(mk_all_finite)(3, numbers))
        return MK_ERROR_NOT_FINITE;
    if (!(steady->close > MK_R(0.0)) || steady->theta < MK_R(0.0) || steady->period < 1) return MK_ERROR_ARGUMENT;
    return MK_F(mk_positive_definite)(n, steady->W, work) ? MK_OK : MK_ERROR_NOT_POSITIVE_DEFINITE;
}

static mk_status_t MK_F(mk_rkfd_reset)(int n, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *x0, const MK_REAL *P0) {
    if (!x0 || !P0) return MK_ERROR_ARGUMENT;
    if (!MK_F(mk_all_finite)(n, x0)) return MK_ERROR_NOT_FINITE;
    const mk_status_t status = MK_F(mk_invert)(n, P0, view->W, view->work);
    if (status != MK_OK) return status;
    for (int i = 0; i < n; i++) view->x[i] = x0[i];
    for (int l = 0; l < slots; l++) view->have_y[l] = view->have_psi[l] = 0;
    return MK_OK;
}

mk_status_t MK_F(mk_rkfd_start)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view,
                                const MK_F_T(mk_rkfd_config) * config) {
    mk_status_t status = MK_F(mk_rkfd_check)(n, m, slots, config);
    if (status == MK_OK) status = MK_F(mk_rkfd_check_steady)(n, m, slots, config->steady, view->work);
    if (status != MK_OK) return status;
    if (!MK_F(mk_is_tolerance)(config->tolerance)) return MK_ERROR_TOLERANCE;
    status = MK_F(mk_rkfd_reset)(n, slots, view, config->x0, config->P0);
    if (status != MK_OK) return status;
    MK_F_T(mk_rkfd) *const core = view->core;
    memset(core, 0, sizeof *core);
    core->config = config;
    core->tolerance = config->tolerance;
    core->stage = 1;
    memset(view->y, 0, (size_t)(slots * m) * sizeof *view->y);
    memset(view->psi, 0, (size_t)(slots * n) * sizeof *view->psi);
    return MK_OK;
}

mk_status_t MK_F(mk_rkfd_restart)(int n, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *x0, const MK_REAL *P0) {
    if (view->core->stage == 0) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_rkfd_reset)(n, slots, view, x0, P0);
    if (status != MK_OK) return status;
    view->core->stage = 1;
    view->core->steady = 0;
    view->core->frozen = 0;
    return MK_OK;
}

/* Whether an input that arrived for a slot is taken. What is refused is counted, and seen in the faults of the step. */
static mk_status_t MK_F(mk_rkfd_take)(MK_F_T(mk_rkfd) * core, int stage, int slot, int first, int count, const MK_REAL *values,
                                      const uint8_t *have) {
    if (core->stage != stage) return MK_ERROR_ORDER;
    mk_status_t status = MK_OK;
    if (!values || slot < first || slot >= core->config->slots) status = MK_ERROR_ARGUMENT;
    else if (!MK_F(mk_all_finite)(count ? count : core->config->rows[slot], values)) status = MK_ERROR_NOT_FINITE;
    else if (have[slot]) status = MK_ERROR_REPEATED;
    if (status != MK_OK) {
        core->rejected++;
        core->rejected_now = 1;
    }
    return status;
}

mk_status_t MK_F(mk_rkfd_put)(int n, int m, const MK_F_T(mk_rkfd_view) * view, int slot, const MK_REAL *values,
                              int is_innovation) {
    (void)n;
    const mk_status_t status = MK_F(mk_rkfd_take)(view->core, 1, slot, 0, 0, values, view->have_y);
    if (status != MK_OK) return status;
    const int rows = view->core->config->rows[slot];
    for (int r = 0; r < m; r++) view->y[slot * m + r] = r < rows ? values[r] : MK_R(0.0);
    view->have_y[slot] = is_innovation ? 2 : 1;
    return MK_OK;
}

mk_status_t MK_F(mk_rkfd_put_estimate)(int n, const MK_F_T(mk_rkfd_view) * view, int slot, const MK_REAL *psi) {
    const mk_status_t status = MK_F(mk_rkfd_take)(view->core, 2, slot, 1, n, psi, view->have_psi);
    if (status != MK_OK) return status;
    for (int i = 0; i < n; i++) view->psi[slot * n + i] = psi[i];
    view->have_psi[slot] = 1;
    return MK_OK;
}

mk_status_t MK_F(mk_rkfd_incremental)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *input) {
    return MK_F(mk_inline_rkfd_incremental)(n, m, slots, view, input);
}

void MK_F(mk_rkfd_settle)(int n, int complete, MK_F_T(mk_rkfd) * core, MK_REAL *W, MK_REAL *work) {
    const MK_F_T(mk_rkfd_steady) *const steady = core->config->steady;
    core->frozen = 0;
    core->steady = 0;
    /* Not without all readings, however little they weigh: a filter that lost one for good would be put back at every step. */
    if (!complete || core->tolerance != core->config->tolerance) return;
    const MK_REAL *limit = steady->W, *now = W;
    for (int i = 0; i < n; i++) {
        work[i] = MK_F(mk_sqrt)(limit[i]);
        for (int j = 0; j <= i; j++) {
            const MK_REAL apart = *now++ - *limit++, most = steady->close * work[i] * work[j];
            if (!(apart <= most && -apart <= most)) return;
        }
    }
    for (int i = 0; i < MK_AT(n, 0); i++) W[i] = steady->W[i];
    core->steady = steady->period;
}

mk_status_t MK_F(mk_rkfd_diffuse)(int n, int slots, const MK_F_T(mk_rkfd_view) * view) {
    return MK_F(mk_inline_rkfd_diffuse)(n, slots, view);
}

mk_status_t MK_F(mk_rkfd_covariance)(int n, const MK_F_T(mk_rkfd_view) * view, MK_REAL *V) {
    if (!V) return MK_ERROR_ARGUMENT;
    if (view->core->stage == 0) return MK_ERROR_ORDER;
    return MK_F(mk_invert)(n, view->W, V, view->work);
}

mk_status_t MK_F(mk_rkfd_drop)(const MK_F_T(mk_rkfd_view) * view, int slot) {
    if (view->core->stage != 1) return MK_ERROR_ORDER;
    if (slot < 0 || slot >= view->core->config->slots) return MK_ERROR_ARGUMENT;
    view->have_y[slot] = 0;
    return MK_OK;
}

/* Innovation e of a filled slot, and rows first .. of packed S from column first on: its variance, R + X' D^-1 X. L: what mk_ldl makes of W; X (n x m) becomes
   L^-1 C'. R: scratch, packed m. */
static mk_status_t MK_F(mk_rkfd_innovation)(int n, int m, const MK_F_T(mk_rkfd_view) * view, int slot, int first, const MK_REAL *L, MK_REAL *X, MK_REAL *R,
                                            MK_REAL *e, MK_REAL *S) {
    const MK_F_T(mk_rkfd_config) *const config = view->core->config;
    const MK_REAL *const C = config->C + slot * m * n;
    const int rows = config->rows[slot];
    if (rows > 0 && MK_F(mk_invert)(rows, config->R_inverse + slot * MK_AT(m, 0), R, R) != MK_OK) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    for (int i = 0; i < n; i++)
        for (int r = 0; r < m; r++) X[i * m + r] = C[r * n + i];
    MK_F(mk_ldl_forward)(n, m, L, X);
    for (int r = 0; r < rows; r++) {
        MK_REAL predicted = MK_R(0.0);
        for (int j = 0; j < n && view->have_y[slot] == 1; j++) predicted += C[r * n + j] * view->x[j];
        e[r] = view->y[slot * m + r] - predicted;
        for (int s = 0; s <= r; s++) {
            MK_REAL sum = R[MK_AT(r, s)];
            for (int k = 0; k < n; k++) sum += L[MK_AT(k, k)] * X[k * m + r] * X[k * m + s];
            S[MK_AT(first + r, first + s)] = sum;
        }
    }
    return MK_OK;
}

mk_status_t MK_F(mk_rkfd_predict)(int n, int m, const MK_F_T(mk_rkfd_view) * view, int slot, MK_REAL *innovation,
                                  MK_REAL *variance) {
    if (view->core->stage != 1) return MK_ERROR_ORDER;
    if (!innovation || !variance || slot < 0 || slot >= view->core->config->slots || !view->have_y[slot]) return MK_ERROR_ARGUMENT;
    MK_REAL *const L = view->work, *const X = L + MK_AT(n, 0);
    for (int i = 0; i < MK_AT(n, 0); i++) L[i] = view->W[i];
    if (!MK_F(mk_ldl)(n, L)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    for (int r = 0; r < m; r++) innovation[r] = MK_R(0.0);
    for (int i = 0; i < MK_AT(m, 0); i++) variance[i] = MK_R(0.0);
    const mk_status_t status = MK_F(mk_rkfd_innovation)(n, m, view, slot, 0, L, X, X + n * m, innovation, variance);
    if (status != MK_OK) return status;
    return MK_F(mk_all_finite)(m, innovation) && MK_F(mk_all_finite)(MK_AT(m, 0), variance) ? MK_OK : MK_ERROR_NOT_FINITE;
}

mk_status_t MK_F(mk_rkfd_innovations)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, MK_REAL *r, MK_REAL *S, uint8_t *rows) {
    if (!r || !S || !rows) return MK_ERROR_ARGUMENT;
    if (view->core->stage != 1) return MK_ERROR_ORDER;
    const MK_F_T(mk_rkfd_config) *const config = view->core->config;
    MK_REAL *const L = view->work, *const X = L + MK_AT(n, 0);
    for (int i = 0; i < MK_AT(n, 0); i++) L[i] = view->W[i];
    if (!MK_F(mk_ldl)(n, L)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    int first = 0;
    for (int l = 0; l < slots; l++) {
        rows[l] = view->have_y[l] ? config->rows[l] : 0;
        if (rows[l] == 0) continue;
        const mk_status_t status = MK_F(mk_rkfd_innovation)(n, m, view, l, first, L, X, X + n * m, r + first, S);
        if (status != MK_OK) return status;
        /* X := V C_l', and with it the blocks to the left of this sensor's own. */
        for (int c = 0; c < m; c++) MK_F(mk_ldl_backward)(n, m, L, X + c);
        for (int k = 0, before = 0; k < l; before += rows[k++])
            for (int c = 0; c < rows[l]; c++)
                for (int s = 0; s < rows[k]; s++) {
                    MK_REAL sum = MK_R(0.0);
                    for (int i = 0; i < n; i++) sum += config->C[(k * m + s) * n + i] * X[i * m + c];
                    S[MK_AT(first + c, before + s)] = sum;
                }
        first += rows[l];
    }
    return MK_F(mk_all_finite)(first, r) && MK_F(mk_all_finite)(MK_AT(first, 0), S) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* sum + v' M v, M packed. */
static MK_REAL MK_F(mk_quadratic)(int n, const MK_REAL *M, const MK_REAL *v, MK_REAL sum) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) sum += v[i] * M[MK_PLACE(i, j)] * v[j];
    return sum;
}

MK_REAL MK_F(mk_rkfd_exact_nis)(const MK_F_T(mk_rkfd_config) * config, const MK_REAL *x, const MK_REAL *W, const MK_REAL *y,
                                const uint8_t *have_y, const MK_REAL *L, MK_REAL *b, MK_REAL *e) {
    const int n = config->n, m = config->m;
    const MK_REAL *C = config->C;
    MK_F(mk_ldl_backward)(n, 1, L, b); /* d */
    MK_REAL sum = MK_F(mk_quadratic)(n, W, b, MK_R(0.0));
    for (int l = 0; l < config->slots; l++) {
        /* e = (y - C x) - C d; without C x where the slot holds an innovation. */
        for (int r = 0; r < m; r++) {
            MK_REAL predicted = MK_R(0.0), corrected = MK_R(0.0);
            for (int j = 0; j < n; j++) {
                predicted += *C * x[j];
                corrected += *C++ * b[j];
            }
            e[r] = (have_y[l] == 2 ? *y : *y - predicted) - corrected;
            y++;
        }
        if (have_y[l]) sum = MK_F(mk_quadratic)(m, config->R_inverse + l * MK_AT(m, 0), e, sum);
    }
    return sum >= MK_R(0.0) && sum * MK_R(0.0) == MK_R(0.0) ? sum : MK_LARGEST;
}
