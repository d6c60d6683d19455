/* SPDX-License-Identifier: MIT */
/* The robust step of spec 1.4 in information form. W = V^-1 is carried from step to step instead of V: with it a step inverts
   one matrix, not three. */

/* Row k of the prediction below, rows above done: of the factor in Y, of X, and what it adds to P. Returns 1, or 0 if Y is not
   positive definite. All three in one row: the products for X and P fill the time that the chain of divisions in Y takes. */
MK_KERNEL int MK_F(mk_robust_predict_row)(int k, int n, const MK_REAL *MK_RESTRICT A, MK_REAL *MK_RESTRICT Y,
                                          MK_REAL *MK_RESTRICT X, MK_REAL *MK_RESTRICT P) {
    const int good = MK_F(mk_ldl_row)(k, Y);
    MK_F(mk_row_gather)(n, n, A + k, X + k * n);
    MK_UNROLL for (int i = 0; i < k; i++) MK_F(mk_row_subtract)(n, Y[MK_AT(k, i)], X + i * n, X + k * n);
    MK_UNROLL for (int i = 0; i < n; i++)
        MK_F(mk_row_add)(i + 1, Y[MK_AT(k, k)] * X[k * n + i], X + k * n, P + MK_AT(i, 0));
    return good;
}

/* Y = W + sum of S_l, packed, becomes its factor L; X (n x n) becomes L^-1 A'; P := A Y^-1 A' + Q = X' D^-1 X + Q.
   MK_ERROR_NOT_POSITIVE_DEFINITE if Y is not. */
MK_KERNEL mk_status_t MK_F(mk_robust_predict)(int n, const MK_REAL *MK_RESTRICT A, const MK_REAL *MK_RESTRICT Q,
                                              MK_REAL *MK_RESTRICT Y, MK_REAL *MK_RESTRICT X, MK_REAL *MK_RESTRICT P) {
    MK_F(mk_packed_copy)(n, Q, P);
    int good = 1;
    MK_UNROLL for (int k = 0; k < n; k++) good &= MK_F(mk_robust_predict_row)(k, n, A, Y, X, P);
    return good ? MK_OK : MK_ERROR_NOT_POSITIVE_DEFINITE;
}

/* theta with gamma(P, theta) = c, 0 for c = 0, and Z := P^-1 - theta I, the next W. work: MK_ROBUST_WORK(n) numbers.
   *iterations counts evaluations of gamma. NOT_POSITIVE_DEFINITE (P), TOLERANCE (no root), NOT_FINITE (overflow of Z). */
MK_KERNEL mk_status_t MK_F(mk_robust_information)(int n, const MK_REAL *MK_RESTRICT P, MK_REAL c, MK_REAL *MK_RESTRICT Z,
                                                  MK_REAL *theta, int *iterations, MK_REAL *MK_RESTRICT work) {
    const int robust = c > MK_R(0.0);
    MK_REAL *const MK_RESTRICT L = work, *const MK_RESTRICT K = work + MK_AT(n, 0);
    MK_F_T(mk_gamma_start) start = {MK_R(0.0), MK_R(0.0), MK_R(0.0), MK_R(0.0), MK_R(0.0), MK_R(0.0)}; /* not read for c = 0, which compilers do not see */
    /* Before the inverse, which it does not need: the two overlap. */
    MK_F(mk_packed_split)(n, P, L);
    int good = 1;
    MK_UNROLL for (int i = 0; i < n; i++) {
        if (n <= MK_FAST_LARGEST_N && i == n / 2 && robust) MK_F(mk_gamma_fast_start)(n, P, c, &start);
        good &= MK_F(mk_inverse_row)(i, L, K, Z);
    }
    if (!good) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    *theta = MK_R(0.0);
    *iterations = 0;
    if (robust) {
        int count;
        if (n <= MK_FAST_LARGEST_N) {
            count = MK_F(mk_gamma_fast_root)(n, &start, MK_F(mk_gamma_pivots)(n, L, start.trace), Z, c, theta);
            /* Rarely taken, so out of line and shared by all filters. */
            if (count == 0) count = MK_F(mk_gamma_search)(n, P, c, theta, work);
        } else {
            count = MK_F(mk_inline_gamma_root)(n, P, c, theta, work);
        }
        if (count == 0) return MK_ERROR_TOLERANCE;
        *iterations = count;
        MK_UNROLL for (int i = 0; i < n; i++) Z[MK_AT(i, i)] -= *theta;
    }
    /* The smallest eigenvalue of Z is at least 1 / lambda_max(P) / (2 + 2 c), its rounding error about n epsilon |P^-1|. Where
       the condition number brings the two together, or the range ends, only a factorisation tells: rare, so out of line. */
    const MK_REAL bound = MK_F(mk_trace)(n, P) * (MK_R(1.0) + c), inverse = MK_F(mk_trace)(n, Z) + (MK_REAL)n * *theta;
    if (bound * inverse * (MK_REAL)n < MK_R(0.02) / MK_EPSILON && bound < MK_R(0.1) / MK_SMALLEST) return MK_OK;
    /* A positive definite matrix has its largest elements on the diagonal, so the traces speak for all of P and Z. */
    if (!((bound + inverse) * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    return MK_F(mk_positive_definite)(n, Z, work) ? MK_OK : MK_ERROR_NOT_POSITIVE_DEFINITE;
}

/* What the reading of one slot adds: innovation e, Y += S, b += F e, and e' R^-1 e, which is returned. */
MK_KERNEL MK_REAL MK_F(mk_rkfd_gather)(int n, int m, const MK_F_T(mk_rkfd_config) * config, int slot, int is_innovation,
                                       const MK_REAL *MK_RESTRICT x, const MK_REAL *MK_RESTRICT y, MK_REAL *MK_RESTRICT e,
                                       MK_REAL *MK_RESTRICT Y, MK_REAL *MK_RESTRICT b) {
    const MK_REAL *const MK_RESTRICT C = config->C + slot * m * n, *const MK_RESTRICT F = config->F + slot * m * n;
    const MK_REAL *const MK_RESTRICT S = config->S + slot * MK_AT(n, 0);
    const MK_REAL *const MK_RESTRICT R_inverse = config->R_inverse + slot * MK_AT(m, 0);
    MK_REAL square = MK_R(0.0);
    MK_UNROLL for (int r = 0; r < m; r++) {
        MK_REAL predicted = C[r * n] * x[0];
        MK_UNROLL for (int j = 1; j < n; j++) predicted += C[r * n + j] * x[j];
        e[r] = is_innovation ? y[r] : y[r] - predicted;
    }
    MK_F(mk_row_sum)(MK_AT(n, 0), S, Y);
    MK_UNROLL for (int r = 0; r < m; r++) {
        MK_F(mk_row_add)(n, e[r], F + r * n, b);
    }
    MK_UNROLL for (int r = 0; r < m; r++) {
        MK_REAL below = MK_R(0.0);
        MK_UNROLL for (int s = 0; s < r; s++) below += R_inverse[MK_AT(r, s)] * e[s];
        square += e[r] * (below + below + R_inverse[MK_AT(r, r)] * e[r]);
    }
    return square;
}

/* The end of a step that has succeeded. */
MK_KERNEL void MK_F(mk_rkfd_commit)(int n, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *psi, MK_REAL theta,
                                    MK_REAL trace_P, int iterations, MK_REAL nis, unsigned used, unsigned rows) {
    MK_F_T(mk_rkfd) *const core = view->core;
    core->theta = theta;
    core->trace_P = trace_P;
    core->nis = nis;
    core->iterations = (uint16_t)iterations;
    MK_F(mk_move)(n, psi, view->psi);
    view->have_psi[0] = 1;
    for (int l = 0; l < slots; l++) view->have_y[l] = 0;
    core->nis_rows = (uint16_t)rows;
    core->measurements = (uint16_t)used;
    core->steps_since_measurement = used ? 0 : core->steps_since_measurement + 1;
    core->faults = (uint16_t)((used < (unsigned)slots ? MK_FAULT_MEASUREMENT_MISSING : 0u) |
                              (used ? 0u : MK_FAULT_NO_MEASUREMENT) | (core->rejected_now ? MK_FAULT_REJECTED : 0u));
    core->rejected_now = 0;
    core->stage = 2;
}

MK_KERNEL mk_status_t MK_F(mk_rkfd_robust)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *input) {
    MK_F_T(mk_rkfd) *const core = view->core;
    const MK_F_T(mk_rkfd_config) *const config = core->config;
    if (core->stage != 1) return MK_ERROR_ORDER;
    const int packed = MK_AT(n, 0);
    MK_REAL *const MK_RESTRICT P = view->work, *const MK_RESTRICT Z = P + packed, *const MK_RESTRICT psi = Z + packed;
    MK_REAL *const MK_RESTRICT b = psi + n, *const MK_RESTRICT e = b + n;
    /* Y and X are used up when the root is sought, and lend their room. */
    MK_REAL *const MK_RESTRICT Y = e + m, *const MK_RESTRICT X = Y + packed;

    MK_F(mk_row_copy)(packed, view->W, Y);
    MK_UNROLL for (int i = 0; i < n; i++) b[i] = MK_R(0.0);
    MK_REAL nis = MK_R(0.0);
    unsigned used = 0, rows = 0;
    for (int l = 0; l < slots; l++) {
        if (!view->have_y[l]) continue;
        nis += MK_F(mk_rkfd_gather)(n, m, config, l, view->have_y[l] == 2, view->x, view->y + l * m, e, Y, b);
        used++;
        rows += config->rows[l];
    }
    const MK_REAL *const r = input ? input : config->input;
    MK_UNROLL for (int i = 0; i < n; i++) {
        MK_REAL sum = config->A[i * n] * view->x[0];
        MK_UNROLL for (int j = 1; j < n; j++) sum += config->A[i * n + j] * view->x[j];
        psi[i] = sum;
    }
    if (r) MK_F(mk_row_sum)(n, r, psi);
    mk_status_t status = MK_F(mk_robust_predict)(n, config->A, config->Q, Y, X, P);
    if (status != MK_OK) return status;
    /* A M b = X' D^-1 L^-1 b; the innovations' square in the metric of C V C' + R is e' R^-1 e - b' M b. */
    MK_F(mk_ldl_forward)(n, 1, Y, b);
    MK_REAL square = nis;
    MK_UNROLL for (int k = 0; k < n; k++) {
        const MK_REAL scaled = Y[MK_AT(k, k)] * b[k];
        square -= scaled * b[k];
        MK_UNROLL for (int i = 0; i < n; i++) psi[i] += scaled * X[k * n + i];
    }
    /* A prior much wider than the sensors' noise cancels nearly all of it, overflow makes it NaN: then the long way. */
    if (!(square >= MK_R(1000.0) * MK_EPSILON * nis)) square = MK_F(mk_rkfd_exact_nis)(config, view->x, view->W, view->y, view->have_y, Y, b, e);
    MK_REAL probe = psi[0] * MK_R(0.0);
    MK_UNROLL for (int i = 1; i < n; i++) probe += psi[i] * MK_R(0.0);
    if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;

    MK_REAL theta;
    int iterations;
    status = MK_F(mk_robust_information)(n, P, core->tolerance, Z, &theta, &iterations, Y);
    if (status != MK_OK) return status;

    MK_F(mk_packed_copy)(n, Z, view->W);
    MK_F(mk_rkfd_commit)(n, slots, view, psi, theta, MK_F(mk_trace)(n, P), iterations, square, used, rows);
    return MK_OK;
}
