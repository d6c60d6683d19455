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
    for (int r = 0; r < m; r++) {
        MK_REAL row[MK_NARROW_N];
        MK_F(mk_load)(n, C + r * n, row);
        MK_REAL predicted = row[0] * x[0];
        MK_UNROLL for (int j = 1; j < n; j++) predicted += row[j] * x[j];
        const MK_REAL e_r = is_innovation ? y[r] : y[r] - predicted;
        e[r] = e_r;
        MK_F(mk_load)(n, F + r * n, row);
        MK_UNROLL for (int j = 0; j < n; j++) b[j] += e_r * row[j];
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
    uint16_t used, rows;
    uint8_t iterations; /* 0: theta is not known */
    uint8_t exact;      /* nis is that of mk_rkfd_exact_nis */
} MK_F_T(mk_narrow);

/* What mk_narrow_phases wants from its caller, who can have it with less memory on the stack; then it is called again. Not of mk_status_t. */
#define MK_NARROW_SEARCH (-1) /* theta and iterations: mk_gamma_search for P */
#define MK_NARROW_NIS (-2)    /* nis, and exact set: mk_rkfd_exact_nis with L = P, b = psi */

/* First part: M^-1 to L, the sum of F e to b, used and rows. Returns the sum of e' R^-1 e. Scratch: e, m numbers. */
MK_KERNEL MK_REAL MK_F(mk_narrow_gather)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, MK_REAL *MK_RESTRICT e,
                                         MK_REAL *MK_RESTRICT b, MK_REAL *MK_RESTRICT L, MK_F_T(mk_narrow) * done) {
    const MK_F_T(mk_rkfd_config) *const config = view->core->config;
    const int packed = MK_AT(n, 0);
    MK_REAL x[MK_NARROW_N], nis = MK_R(0.0);
    MK_UNROLL for (int i = 0; i < n; i++) x[i] = view->x[i];
    for (int l = 0; l < slots; l++) {
        if (!view->have_y[l]) continue;
        nis += MK_F(mk_narrow_innovation)(n, m, config, l, view->have_y[l] == 2, x, view->y + l * m, e, b);
    }
    unsigned used = 0, rows = 0;
    MK_F(mk_load_packed)(n, view->W, L);
    for (int l = 0; l < slots; l++) {
        if (!view->have_y[l]) continue;
        const MK_REAL *const S = config->S + l * packed;
        MK_F(mk_add_packed)(n, S, L);
        used++;
        rows += config->rows[l];
    }
    done->used = (uint16_t)used;
    done->rows = (uint16_t)rows;
    return nis;
}

/* The whole step but its end: psi; theta, its iterations, trace P, nis, used and rows; on success the next W to W. P: packed, at least m numbers,
   for what the caller does when asked to, spoilt otherwise. Scratch: X n x n, which Z (packed) and start may share.

   What waits while registers hold a factor is in memory, by pointers: the compiler would keep it in registers and move others about. */
MK_KERNEL int MK_F(mk_narrow_phases)(int n, int m, int slots, const MK_F_T(mk_rkfd_view) * view, const MK_REAL *input,
                                     MK_REAL *X, MK_REAL *Z, MK_F_T(mk_gamma_start) * start, MK_REAL *MK_RESTRICT psi,
                                     MK_REAL *MK_RESTRICT P, MK_F_T(mk_narrow) * done) {
    const MK_F_T(mk_rkfd_config) *const config = view->core->config;
    const MK_REAL c = view->core->tolerance;
    const int search = c > MK_R(0.0) && !done->iterations;
    MK_REAL b[MK_NARROW_N], L[MK_PACKED(MK_NARROW_N)];
    MK_REAL *const MK_RESTRICT D = P; /* until P is known */
    int predicted = done->iterations;
    if (predicted) {
        MK_F(mk_load_packed)(n, P, L);
    } else {
        MK_UNROLL for (int i = 0; i < n; i++) b[i] = MK_R(0.0);
        X[0] = MK_F(mk_narrow_gather)(n, m, slots, view, D, b, L, done);
        MK_UNROLL for (int i = 0; i < n; i++) psi[i] = b[i];
    }
    /* Two turns, the first with M^-1, the second with P: large as it is, the factorisation is there once. */
    for (;; predicted = 1) {
        MK_UNROLL for (int i = 0; i < n; i++)
            if (!MK_F(mk_ldl_row)(i, L)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
        if (predicted) break;

        MK_UNROLL for (int i = 0; i < n; i++) b[i] = psi[i];
        MK_F(mk_ldl_forward)(n, 1, L, b);
        MK_REAL sum = X[0];
        MK_UNROLL for (int k = 0; k < n; k++) {
            const MK_REAL scaled = L[MK_AT(k, k)] * b[k];
            sum -= scaled * b[k];
        }
        if (!done->exact) {
            done->nis = sum;
            if (!(sum >= MK_R(1000.0) * MK_EPSILON * X[0])) {
                MK_F(mk_store_packed)(n, L, P);
                MK_UNROLL for (int i = 0; i < n; i++) psi[i] = b[i];
                return MK_NARROW_NIS;
            }
        }
        MK_UNROLL for (int k = 0; k < n; k++) {
            D[k] = L[MK_AT(k, k)];
            b[k] *= D[k];
        }
        const MK_REAL *const r = input ? input : config->input;
        for (int i = 0; i < n; i++) {
            const MK_REAL *const A = config->A + i * n;
            MK_REAL v[MK_NARROW_N];
            MK_F(mk_load)(n, A, v);
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
        MK_F(mk_load_packed)(n, config->Q, L);
        for (int k = 0; k < n; k++) {
            MK_REAL v[MK_NARROW_N];
            MK_UNROLL for (int j = 0; j < n; j++) v[j] = X[j * n + k];
            MK_UNROLL for (int i = 0; i < n; i++) {
                const MK_REAL f = D[k] * v[i];
                MK_UNROLL for (int j = 0; j <= i; j++) L[MK_AT(i, j)] += f * v[j];
            }
        }
        MK_F(mk_store_packed)(n, L, P);
        if (!MK_F(mk_all_finite)(n, psi)) return MK_ERROR_NOT_FINITE;
        done->trace_P = MK_F(mk_trace)(n, L);
        if (search) MK_F(mk_gamma_fast_start)(n, L, c, start);
    }
    const MK_REAL pivots = MK_F(mk_gamma_pivots)(n, L, start->trace);
    MK_F(mk_ldl_invert)(n, L);
    MK_REAL theta = done->theta;
    MK_F(mk_store_packed)(n, L, Z);
    if (search) {
        const int count = MK_F(mk_gamma_fast_root)(n, start, pivots, L, c, &theta);
        if (count == 0) return MK_NARROW_SEARCH;
        done->iterations = (uint8_t)count;
        done->theta = theta;
    }
    MK_F(mk_load_packed)(n, Z, L);
    MK_UNROLL for (int i = 0; i < n; i++) L[MK_AT(i, i)] -= theta;
    const MK_REAL bound = done->trace_P * (MK_R(1.0) + c), inverse = MK_F(mk_trace)(n, L) + (MK_REAL)n * theta;
    if (!(bound * inverse * (MK_REAL)n < MK_R(0.02) / MK_EPSILON && bound < MK_R(0.1) / MK_SMALLEST)) {
        if (!((bound + inverse) * MK_R(0.0) == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
        MK_F(mk_store_packed)(n, L, Z);
        if (!MK_F(mk_positive_definite)(n, Z, P)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
        MK_F(mk_load_packed)(n, Z, L);
    }
    MK_F(mk_store_packed)(n, L, view->W);
    return MK_OK;
}
