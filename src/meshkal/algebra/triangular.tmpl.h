/* SPDX-License-Identifier: MIT */
/* Lower triangular factors L of covariances P = L L', packed by rows: made, solved with, and multiplied from the right by what an update does to
   them, so that P is never formed and cannot lose its definiteness. */

/* Packed S := L with S = L L'. Returns 1, or 0 if S is not positive definite, as far as rounding lets that be told, or not finite; S is spoilt then. */
MK_KERNEL int MK_F(mk_cholesky)(int n, MK_REAL *S) {
    for (int i = 0; i < n; i++) {
        const MK_REAL diagonal = S[MK_AT(i, i)], slack = MK_R(8.0) * MK_EPSILON * (MK_REAL)n * diagonal;
        MK_REAL pivot = diagonal;
        for (int j = 0; j < i; j++) {
            MK_REAL sum = S[MK_AT(i, j)];
            for (int k = 0; k < j; k++) sum -= S[MK_AT(i, k)] * S[MK_AT(j, k)];
            S[MK_AT(i, j)] = sum / S[MK_AT(j, j)];
            pivot -= S[MK_AT(i, j)] * S[MK_AT(i, j)];
        }
        if (!(pivot > slack && diagonal <= MK_LARGEST)) return 0;
        S[MK_AT(i, i)] = MK_F(mk_sqrt)(pivot);
    }
    return 1;
}

/* G (n x n, rows `stride` apart) with G G' = S, packed and positive semidefinite. The pivot that is largest by its own diagonal element comes first,
   so that what is left at the end is rounding whatever the rank (in the order of rows, a small pivot that is rounding itself would spoil what
   follows). Returns 1, or 0 if S is indefinite or not finite. S and d, n numbers, are spoilt. */
static int MK_F(mk_semidefinite_root)(int n, MK_REAL *S, MK_REAL *d, MK_REAL *G, int stride) {
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
        for (int i = 0; i < n; i++) G[i * stride + k] = p < 0 ? MK_R(0.0) : S[MK_PLACE(i, p)] / root;
        for (int i = 0; i < n && p >= 0; i++)
            for (int j = 0; j <= i; j++) S[MK_AT(i, j)] = i == p || j == p ? MK_R(0.0) : S[MK_AT(i, j)] - G[i * stride + k] * G[j * stride + k];
    }
    for (int i = 0; i < n; i++) d[i] = MK_F(mk_sqrt)(d[i]);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            const MK_REAL bound = MK_R(2.0) * slack * d[i] * d[j];
            if (!(S[MK_AT(i, j)] >= -bound && S[MK_AT(i, j)] <= bound)) return 0;
        }
    return 1;
}

/* L L' := A A', A n x columns in row order, columns >= n: Householder reflections from the right. A is spoilt; the diagonal of L is not negative. */
MK_KERNEL void MK_F(mk_triangularise)(int n, int columns, MK_REAL *A, MK_REAL *L) {
    for (int i = 0; i < n; i++) {
        MK_REAL *const row = A + i * columns;
        MK_REAL square = MK_R(0.0);
        for (int k = i; k < columns; k++) square += row[k] * row[k];
        const MK_REAL norm = MK_F(mk_sqrt)(square);
        const MK_REAL sign = row[i] > MK_R(0.0) ? MK_R(-1.0) : MK_R(1.0); /* of what the reflection makes of row[i]: no cancellation */
        row[i] -= sign * norm;
        const MK_REAL half = norm * (row[i] < MK_R(0.0) ? -row[i] : row[i]); /* v'v / 2 */
        L[MK_AT(i, i)] = norm;
        for (int r = i + 1; r < n; r++) {
            MK_REAL *const other = A + r * columns;
            MK_REAL sum = MK_R(0.0);
            for (int k = i; k < columns; k++) sum += row[k] * other[k];
            const MK_REAL factor = half > MK_R(0.0) ? sum / half : MK_R(0.0);
            for (int k = i; k < columns; k++) other[k] -= factor * row[k];
            L[MK_AT(r, i)] = sign * other[i];
        }
    }
}

/* y L = v, in place: v' := L'^-1 v'. */
MK_KERNEL void MK_F(mk_solve_right)(int n, const MK_REAL *L, MK_REAL *v) {
    for (int j = n - 1; j >= 0; j--) {
        MK_REAL sum = v[j];
        for (int i = j + 1; i < n; i++) sum -= v[i] * L[MK_AT(i, j)];
        v[j] = sum / L[MK_AT(j, j)];
    }
}

/* v := L^-1 v. */
MK_KERNEL void MK_F(mk_solve_left)(int n, const MK_REAL *L, MK_REAL *v) {
    for (int i = 0; i < n; i++) {
        MK_REAL sum = v[i];
        for (int j = 0; j < i; j++) sum -= L[MK_AT(i, j)] * v[j];
        v[i] = sum / L[MK_AT(i, i)];
    }
}

/* The lower triangular T with T T' = (I + f f')^-1 (Carlson 1973), as keep and mix: T_jj = keep_j, T_ij = -f_i mix_j for i > j. Only positive
   numbers are added. Returns 1 + f'f. */
MK_KERNEL MK_REAL MK_F(mk_shrink_prepare)(int n, const MK_REAL *f, MK_REAL *keep, MK_REAL *mix) {
    MK_REAL alpha = MK_R(1.0), root = MK_R(1.0);
    for (int j = n - 1; j >= 0; j--) {
        alpha += f[j] * f[j];
        const MK_REAL next = MK_F(mk_sqrt)(alpha), inverse = MK_R(1.0) / next;
        keep[j] = root * inverse;
        mix[j] = f[j] * inverse / root;
        root = next;
    }
    return alpha;
}

/* v := v T for a row of which the first `count` numbers are not zero. Returns v f of the old v. */
MK_KERNEL MK_REAL MK_F(mk_shrink_row)(int count, const MK_REAL *f, const MK_REAL *keep, const MK_REAL *mix, MK_REAL *v) {
    MK_REAL sum = MK_R(0.0);
    for (int j = count - 1; j >= 0; j--) {
        const MK_REAL old = v[j];
        v[j] = old * keep[j] - mix[j] * sum;
        sum += old * f[j];
    }
    return sum;
}

/* Update with `rows` readings of unit variance whose derivatives in the coordinates of L are the rows of B (rows x n) and whose innovations are e, one
   after another: L L' := L (I + B'B)^-1 L', dx += what is added to x. L null: neither. B and e are spoilt. work: 2 n numbers. Returns e' (I + B B')^-1 e. */
MK_KERNEL MK_REAL MK_F(mk_shrink)(int n, int rows, MK_REAL *B, MK_REAL *e, MK_REAL *L, MK_REAL *dx, MK_REAL *work) {
    MK_REAL *const keep = work, *const mix = work + n;
    MK_REAL nis = MK_R(0.0);
    for (int r = 0; r < rows; r++) {
        const MK_REAL *const f = B + r * n;
        const MK_REAL g = e[r] / MK_F(mk_shrink_prepare)(n, f, keep, mix);
        nis += e[r] * g;
        for (int i = 0; L && i < n; i++) dx[i] += g * MK_F(mk_shrink_row)(i + 1, f, keep, mix, L + MK_AT(i, 0));
        for (int s = r + 1; s < rows; s++) e[s] -= g * MK_F(mk_shrink_row)(n, f, keep, mix, B + s * n);
    }
    return nis;
}

/* L L' := L L' - d d'. d is spoilt; work: 2 n numbers. Returns 1, or 0 if that is not positive definite; L is as before then. */
MK_KERNEL int MK_F(mk_downdate)(int n, MK_REAL *L, MK_REAL *d, MK_REAL *work) {
    MK_REAL rest = MK_R(1.0);
    MK_F(mk_solve_left)(n, L, d);
    for (int i = 0; i < n; i++) rest -= d[i] * d[i];
    if (!(rest > MK_EPSILON * (MK_REAL)n)) return 0;
    /* I - d d' = (I + f f')^-1 with f = d / sqrt(1 - d'd) */
    const MK_REAL scale = MK_R(1.0) / MK_F(mk_sqrt)(rest);
    for (int i = 0; i < n; i++) d[i] *= scale;
    (void)MK_F(mk_shrink_prepare)(n, d, work, work + n);
    for (int i = 0; i < n; i++) (void)MK_F(mk_shrink_row)(i + 1, d, work, work + n, L + MK_AT(i, 0));
    return 1;
}

/* D and e of `rows` readings with variance S (packed) := those of readings with unit variance, S^-1/2 D and S^-1/2 e; D null: e alone. S is spoilt.
   Returns 1, or 0 if S is not positive definite. */
MK_KERNEL int MK_F(mk_whiten)(int n, int rows, MK_REAL *S, MK_REAL *D, MK_REAL *e) {
    if (!MK_F(mk_ldl)(rows, S)) return 0;
    MK_F(mk_ldl_forward)(rows, 1, S, e);
    if (D) MK_F(mk_ldl_forward)(rows, n, S, D);
    for (int r = 0; r < rows; r++) {
        const MK_REAL scale = MK_F(mk_sqrt)(S[MK_AT(r, r)]);
        e[r] *= scale;
        for (int i = 0; D && i < n; i++) D[r * n + i] *= scale;
    }
    return 1;
}
