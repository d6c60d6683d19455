/* SPDX-License-Identifier: MIT */
/* The robust step in phases for processors without vector registers, n <= MK_NARROW_N: the operations of rkfd_step.tmpl.h in the
   same order for each number, so the same bits, but for in-order machines with 32 registers and little memory. Symmetric matrices are
   local arrays that become registers; loops over rows stay loops, so that code is small; X is kept by columns; the inverse is made in place. */

/* What the reading of one slot adds: b += F e, and e' R^-1 e, which is returned. */
MK_KERNEL MK_REAL MK_F(mk_narrow_innovation)(int n, int m, const MK_F_T(mk_rkfd_config) * config, int slot, int is_innovation,
                                             const MK_REAL *MK_RESTRICT x, const MK_REAL *MK_RESTRICT y, MK_REAL *MK_RESTRICT e,
                                             MK_REAL *MK_RESTRICT b) {
    const MK_REAL *const MK_RESTRICT C = config->C + slot * m * n, *const MK_RESTRICT F = config->F + slot * m * n;
    const MK_REAL *const MK_RESTRICT R_inverse = config->R_inverse + slot * MK_AT(m, 0);
    MK_REAL square = MK_R(0.0);
    MK_UNROLL for (int r = 0; r < m; r++) {
        MK_REAL predicted = C[r * n] * x[0];
        MK_UNROLL for (int j = 1; j < n; j++) predicted += C[r * n + j] * x[j];
        e[r] = is_innovation ? y[r] : y[r] - predicted;
    }
    MK_UNROLL for (int r = 0; r < m; r++) {
        MK_UNROLL for (int j = 0; j < n; j++) b[j] += e[r] * F[r * n + j];
    }
    MK_UNROLL for (int r = 0; r < m; r++) {
        MK_REAL below = MK_R(0.0);
        MK_UNROLL for (int s = 0; s < r; s++) below += R_inverse[MK_AT(r, s)] * e[s];
        square += e[r] * (below + below + R_inverse[MK_AT(r, r)] * e[r]);
    }
    return square;
}

/* What the phases find out for each other and for the object. */
typedef struct {
    MK_REAL nis, theta, trace_P;
    unsigned used, rows;
    int iterations; /* 0: theta is not known */
    int cancelled;  /* nis is to be had from mk_rkfd_exact_nis */
} MK_F_T(mk_narrow);

/* What mk_narrow_information says when only the exact search finds theta. Not one of mk_status_t. */
#define MK_NARROW_SEARCH (-1)

/* First phase: psi, P (packed), nis, used and rows. Scratch: X n x n, D the larger of n and m. */
MK_KERNEL mk_status_t MK_F(mk_narrow_correct)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *input,
                                              MK_REAL *MK_RESTRICT X, MK_REAL *MK_RESTRICT D, MK_REAL *MK_RESTRICT psi,
                                              MK_REAL *MK_RESTRICT P_, MK_F_T(mk_narrow) * done) {
    const MK_F_T(mk_rkfd_config) *const config = view->core->config;
    const MK_REAL *const r = input ? input : config->input;
    const int packed = MK_AT(n, 0);
    MK_REAL b[MK_NARROW_N], x[MK_NARROW_N], L[MK_PACKED(MK_NARROW_N)], P[MK_PACKED(MK_NARROW_N)];
    MK_REAL nis = MK_R(0.0);
    unsigned used = 0, rows = 0;
    MK_UNROLL for (int i = 0; i < n; i++) x[i] = view->x[i];
    MK_UNROLL for (int i = 0; i < n; i++) b[i] = MK_R(0.0);
    for (int l = 0; l < slots; l++) {
        if (!view->have_y[l]) continue;
        nis += MK_F(mk_narrow_innovation)(n, m, config, l, view->have_y[l] == 2, x, view->y + l * m, D, b);
        used++;
        rows += config->rows[l];
    }
    done->used = used;
    done->rows = rows;
    MK_UNROLL_ALL for (int i = 0; i < packed; i++) L[i] = view->W[i];
    for (int l = 0; l < slots; l++) {
        if (!view->have_y[l]) continue;
        const MK_REAL *const S = config->S + l * packed;
        MK_UNROLL_ALL for (int i = 0; i < packed; i++) L[i] += S[i];
    }
    MK_UNROLL for (int i = 0; i < n; i++)
        if (!MK_F(mk_ldl_row)(i, L)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    MK_F(mk_ldl_forward)(n, 1, L, b);
    MK_REAL sum = nis;
    MK_UNROLL for (int k = 0; k < n; k++) {
        const MK_REAL scaled = L[MK_AT(k, k)] * b[k];
        sum -= scaled * b[k];
    }
    done->cancelled = !(sum >= MK_R(1000.0) * MK_EPSILON * nis);
    done->nis = sum;
    MK_UNROLL for (int k = 0; k < n; k++) {
        D[k] = L[MK_AT(k, k)];
        b[k] *= D[k];
    }
    for (int i = 0; i < n; i++) {
        const MK_REAL *const A = config->A + i * n;
        MK_REAL v[MK_NARROW_N];
        MK_UNROLL for (int j = 0; j < n; j++) v[j] = A[j];
        MK_REAL dot = v[0] * view->x[0];
        MK_UNROLL for (int j = 1; j < n; j++) dot += v[j] * view->x[j];
        if (r) dot += r[i];
        MK_UNROLL for (int j = 0; j < n; j++) {
            MK_UNROLL for (int k = 0; k < j; k++) v[j] -= L[MK_AT(j, k)] * v[k];
            X[i * n + j] = v[j];
        }
        MK_UNROLL for (int k = 0; k < n; k++) dot += b[k] * v[k];
        psi[i] = dot;
    }
    MK_UNROLL_ALL for (int i = 0; i < packed; i++) P[i] = config->Q[i];
    for (int k = 0; k < n; k++) {
        MK_REAL v[MK_NARROW_N];
        MK_UNROLL for (int j = 0; j < n; j++) v[j] = X[j * n + k];
        MK_UNROLL for (int i = 0; i < n; i++) {
            const MK_REAL f = D[k] * v[i];
            MK_UNROLL for (int j = 0; j <= i; j++) P[MK_AT(i, j)] += f * v[j];
        }
    }
    MK_UNROLL_ALL for (int i = 0; i < packed; i++) P_[i] = P[i];
    MK_REAL probe = psi[0] * MK_R(0.0);
    MK_UNROLL for (int i = 1; i < n; i++) probe += psi[i] * MK_R(0.0);
    return probe == MK_R(0.0) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* Second phase, as mk_robust_information: theta, its iterations and trace P, and Z to W on success. MK_NARROW_SEARCH: nothing is
   written, and to be called again with theta and iterations. P is spoilt otherwise. Scratch: Z packed. */
MK_KERNEL int MK_F(mk_narrow_information)(int n, MK_REAL *MK_RESTRICT P, MK_REAL c, MK_REAL *MK_RESTRICT Z, MK_REAL *MK_RESTRICT W,
                                          MK_F_T(mk_narrow) * done) {
    const int search = c > MK_R(0.0) && !done->iterations, packed = MK_AT(n, 0);
    MK_REAL L[MK_PACKED(MK_NARROW_N)], theta = done->theta;
    MK_F_T(mk_gamma_start) start = {MK_R(0.0), MK_R(0.0), MK_R(0.0), MK_R(0.0), MK_R(0.0), MK_R(0.0)};
    if (search) MK_F(mk_gamma_fast_start)(n, P, c, &start);
    MK_UNROLL_ALL for (int i = 0; i < packed; i++) L[i] = P[i];
    MK_UNROLL for (int i = 0; i < n; i++)
        if (!MK_F(mk_ldl_row)(i, L)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    const MK_REAL pivots = MK_F(mk_gamma_pivots)(n, L, start.trace);
    MK_F(mk_ldl_invert)(n, L);
    MK_UNROLL_ALL for (int i = 0; i < packed; i++) Z[i] = L[i];
    if (search) {
        const int count = MK_F(mk_gamma_fast_root)(n, &start, pivots, Z, c, &theta);
        if (count == 0) return MK_NARROW_SEARCH;
        done->iterations = count;
        done->theta = theta;
    }
    MK_UNROLL for (int i = 0; i < n; i++) Z[MK_AT(i, i)] -= theta;
    done->trace_P = MK_F(mk_trace)(n, P);
    const MK_REAL bound = done->trace_P * (MK_R(1.0) + c), inverse = MK_F(mk_trace)(n, Z) + (MK_REAL)n * theta;
    if (!(bound * inverse * (MK_REAL)n < MK_R(0.02) / MK_EPSILON && bound < MK_R(0.1) / MK_SMALLEST)) {
        if (!((bound + inverse) * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
        if (!MK_F(mk_positive_definite)(n, Z, P)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    }
    /* By rows: so short that compilers move several words at once instead of calling memcpy. */
    MK_UNROLL for (int i = 0; i < n; i++) memcpy(W + MK_AT(i, 0), Z + MK_AT(i, 0), (size_t)(i + 1) * sizeof *W);
    return MK_OK;
}
