/* SPDX-License-Identifier: MIT */
/* Lower triangular factors L of covariances P = L L', packed by rows: made, solved with, and multiplied from the right by what an update does to
   them, so that P is never formed and cannot lose its definiteness. */

/* Packed S := L with S = L L'. Returns 1, or 0 if S is not positive definite, as far as rounding lets that be told, or not finite; S is spoilt then. */
MK_KERNEL int MK_F(mk_cholesky)(int n, MK_REAL *S) {
    MK_UNROLL for (int i = 0; i < n; i++) {
        const MK_REAL diagonal = S[MK_AT(i, i)], slack = MK_R(8.0) * MK_EPSILON * (MK_REAL)n * diagonal;
        MK_REAL pivot = diagonal;
        MK_UNROLL for (int j = 0; j < i; j++) {
            MK_REAL sum = S[MK_AT(i, j)];
            MK_UNROLL for (int k = 0; k < j; k++) sum -= S[MK_AT(i, k)] * S[MK_AT(j, k)];
            S[MK_AT(i, j)] = sum / S[MK_AT(j, j)];
            pivot -= S[MK_AT(i, j)] * S[MK_AT(i, j)];
        }
        if (!(pivot > slack && diagonal <= MK_LARGEST)) return 0;
        S[MK_AT(i, i)] = MK_F(mk_sqrt)(pivot);
    }
    return 1;
}

/* L L' := sum over `total` columns a of a a'; A holds them one after another, n numbers each: `full` ones, at least 1, then those of a lower triangular matrix, of
   which the first i are not zero in row i and above. Householder reflections mix the columns; each number of w = sum a_i a, from which norm and factors
   follow, is a sum of its own, so that vector units may take them together. A is spoilt; the diagonal of L is not negative. work: n numbers. */
MK_KERNEL void MK_F(mk_triangularise)(int n, int full, int total, MK_REAL *MK_RESTRICT A, MK_REAL *MK_RESTRICT L, MK_REAL *MK_RESTRICT work) {
    MK_UNROLL for (int i = 0; i < n; i++) {
        MK_REAL *const head = A + i * n;
        const int from = MK_LANES_FROM(i), count = n - from, columns = full + i + 1 < total ? full + i + 1 : total;
        MK_F(mk_row_scale)(count, head[i], head + from, work + from);
        for (int k = i + 1; k < columns; k++) MK_F(mk_row_add)(count, A[k * n + i], A + k * n + from, work + from);
        const MK_REAL norm = MK_F(mk_sqrt)(work[i]);
        const MK_REAL sign = head[i] > MK_R(0.0) ? MK_R(-1.0) : MK_R(1.0); /* of what the reflection makes of head[i]: no cancellation */
        const MK_REAL v = head[i] - sign * norm, half = norm * (v < MK_R(0.0) ? -v : v); /* v'v / 2 */
        const MK_REAL inverse = half >= MK_SMALLEST ? MK_R(1.0) / half : MK_R(0.0);
        MK_F(mk_row_step)(count, sign * norm, head + from, inverse, work + from);
        L[MK_AT(i, i)] = norm;
        MK_UNROLL for (int r = i + 1; r < n; r++) L[MK_AT(r, i)] = sign * (head[r] - work[r] * v);
        if (i + 1 < n) {
            const int next = MK_LANES_FROM(i + 1);
            for (int k = i + 1; k < columns; k++) MK_F(mk_row_subtract)(n - next, A[k * n + i], work + next, A + k * n + next);
        }
    }
}

/* y L = v, in place: v' := L'^-1 v'. */
MK_KERNEL void MK_F(mk_solve_right)(int n, const MK_REAL *L, MK_REAL *v) {
    MK_UNROLL for (int j = n - 1; j >= 0; j--) {
        MK_REAL sum = v[j];
        MK_UNROLL for (int i = j + 1; i < n; i++) sum -= v[i] * L[MK_AT(i, j)];
        v[j] = sum / L[MK_AT(j, j)];
    }
}

/* v := L^-1 v. */
MK_KERNEL void MK_F(mk_solve_left)(int n, const MK_REAL *L, MK_REAL *v) {
    MK_UNROLL for (int i = 0; i < n; i++) {
        MK_REAL sum = v[i];
        MK_UNROLL for (int j = 0; j < i; j++) sum -= L[MK_AT(i, j)] * v[j];
        v[i] = sum / L[MK_AT(i, i)];
    }
}

/* The lower triangular T with T T' = (I + f f')^-1 (Carlson 1973), as keep and mix: T_jj = keep_j, T_ij = -f_i mix_j for i > j. Only positive
   numbers are added. Returns 1 + f'f. */
MK_KERNEL MK_REAL MK_F(mk_shrink_prepare)(int n, const MK_REAL *f, MK_REAL *keep, MK_REAL *mix) {
    MK_REAL alpha = MK_R(1.0), root = MK_R(1.0), inverse = MK_R(1.0);
    MK_UNROLL for (int j = n - 1; j >= 0; j--) {
        alpha += f[j] * f[j];
        const MK_REAL next = MK_F(mk_sqrt)(alpha), next_inverse = MK_R(1.0) / next;
        keep[j] = root * next_inverse;
        mix[j] = f[j] * next_inverse * inverse;
        root = next;
        inverse = next_inverse;
    }
    return alpha;
}

/* v := v T for a row of which the first `count` numbers are not zero. Returns v f of the old v. */
MK_KERNEL MK_REAL MK_F(mk_shrink_row)(int count, const MK_REAL *f, const MK_REAL *keep, const MK_REAL *mix, MK_REAL *v) {
    MK_REAL sum = MK_R(0.0);
    MK_UNROLL for (int j = count - 1; j >= 0; j--) {
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

/* L L' := L L' + a a'. a is spoilt. Rotations: the diagonal of L only grows, whatever the scales of both. */
MK_KERNEL void MK_F(mk_root_add)(int n, MK_REAL *L, MK_REAL *a) {
    for (int k = 0; k < n; k++) {
        const MK_REAL d = L[MK_AT(k, k)], size = a[k] < MK_R(0.0) ? -a[k] : a[k];
        if (size == MK_R(0.0)) continue;
        const MK_REAL most = size > d ? size : d, ratio = size > d ? d / size : size / d, root = most * MK_F(mk_sqrt)(MK_R(1.0) + ratio * ratio);
        const MK_REAL c = d / root, s = a[k] / root;
        L[MK_AT(k, k)] = root;
        for (int i = k + 1; i < n; i++) {
            const MK_REAL old = L[MK_AT(i, k)];
            L[MK_AT(i, k)] = c * old + s * a[i];
            a[i] = c * a[i] - s * old;
        }
    }
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
