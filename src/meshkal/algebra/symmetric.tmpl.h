/* SPDX-License-Identifier: MIT */
/* Packed symmetric matrices: factorisation, solve, congruence, inverse. The source fixes the order of operations, so the
   unrolled and the shared build give the same bits. */

/* Row i of the factorisation S = L diag(d) L' in place, rows above done: the strict lower triangle becomes that of the unit
   lower L, the diagonal 1 / d. Returns 1, or 0 when the pivot is not above epsilon times its diagonal element: not positive
   definite in this precision, or NaN. */
MK_KERNEL int MK_F(mk_ldl_row)(int i, MK_REAL *MK_RESTRICT S) {
    MK_REAL pivot = S[MK_AT(i, i)];
    const MK_REAL least = MK_EPSILON * pivot;
    MK_UNROLL for (int j = 0; j < i; j++) {
        MK_REAL sum = S[MK_AT(i, j)];
        MK_UNROLL for (int k = 0; k < j; k++) sum -= S[MK_AT(i, k)] * S[MK_AT(j, k)];
        S[MK_AT(i, j)] = sum; /* L_ij d_j for now */
    }
    MK_UNROLL for (int k = 0; k < i; k++) {
        /* Squared first: the square need not wait for the division that is behind 1 / d. */
        pivot -= S[MK_AT(i, k)] * S[MK_AT(i, k)] * S[MK_AT(k, k)];
        S[MK_AT(i, k)] *= S[MK_AT(k, k)];
    }
    S[MK_AT(i, i)] = MK_R(1.0) / pivot;
    return (pivot > least) & (least > MK_R(0.0));
}

/* The whole factorisation. Returns 1, or 0 if S is not positive definite; S is spoilt then. n^3 / 3 operations, n divisions. */
MK_PART int MK_F(mk_ldl)(int n, MK_REAL *MK_RESTRICT S) {
    int good = 1;
    MK_UNROLL for (int i = 0; i < n; i++) good &= MK_F(mk_ldl_row)(i, S);
    return good;
}

/* X := L^-1 X for `columns` right-hand sides, X n x columns in row order, L from mk_ldl. */
MK_KERNEL void MK_F(mk_ldl_forward)(int n, int columns, const MK_REAL *MK_RESTRICT L, MK_REAL *MK_RESTRICT X) {
    MK_UNROLL for (int i = 1; i < n; i++) {
        MK_UNROLL for (int k = 0; k < i; k++) {
            const MK_REAL factor = L[MK_AT(i, k)];
            MK_F(mk_row_subtract)(columns, factor, X + k * columns, X + i * columns);
        }
    }
}

/* x := L'^-1 D^-1 x, so that after mk_ldl_forward x is S^-1 x. x: n numbers, each `step` behind the one before. */
MK_KERNEL void MK_F(mk_ldl_backward)(int n, int step, const MK_REAL *MK_RESTRICT L, MK_REAL *MK_RESTRICT x) {
    for (int i = n - 1; i >= 0; i--) {
        const MK_REAL *l = L + MK_AT(i, i), *known = x + i * step; /* down a column of L: a row further are as many numbers as it has */
        MK_REAL sum = *known * *l;
        for (int k = i + 1; k < n; k++) {
            l += k;
            known += step;
            sum -= *l * *known;
        }
        x[i * step] = sum;
    }
}

/* Row i of the inverse below, rows above done. Returns 1, or 0 if S is not positive definite. */
MK_KERNEL int MK_F(mk_inverse_row)(int i, MK_REAL *MK_RESTRICT S, MK_REAL *MK_RESTRICT K, MK_REAL *MK_RESTRICT Z) {
    MK_REAL *const MK_RESTRICT row = K + MK_AT(i, 0);
    const int good = MK_F(mk_ldl_row)(i, S);
    MK_UNROLL for (int j = 0; j < i; j++) {
        MK_REAL sum = S[MK_AT(i, j)];
        MK_UNROLL for (int k = j + 1; k < i; k++) sum += S[MK_AT(i, k)] * K[MK_AT(k, j)];
        row[j] = -sum;
    }
    MK_F(mk_row_join)(i, row);
    const MK_REAL d_inverse = S[MK_AT(i, i)];
    MK_UNROLL for (int j = 0; j < i; j++) MK_F(mk_row_add)(j + 1, d_inverse * row[j], row, Z + MK_AT(j, 0));
    MK_F(mk_row_scale)(i, d_inverse, row, Z + MK_AT(i, 0));
    Z[MK_AT(i, i)] = d_inverse;
    return good;
}

/* Z := S^-1; S becomes its factor, K (packed, strict lower triangle) L^-1. Returns 1, or 0 if S is not positive definite; Z is
   spoilt then. n^3 operations. Factor, its inverse and K' D^-1 K advance row by row together: the products fill the time that
   the chain of divisions takes. */
MK_KERNEL int MK_F(mk_inverse)(int n, MK_REAL *MK_RESTRICT S, MK_REAL *MK_RESTRICT K, MK_REAL *MK_RESTRICT Z) {
    int good = 1;
    MK_UNROLL for (int i = 0; i < n; i++) good &= MK_F(mk_inverse_row)(i, S, K, Z);
    return good;
}

/* Packed S, the factor that mk_ldl leaves, becomes the inverse: the operations of mk_inverse in the same order for each number, in place. */
MK_KERNEL void MK_F(mk_ldl_invert)(int n, MK_REAL *S) {
    /* K = L^-1, but for its diagonal of ones */
    MK_UNROLL for (int i = 1; i < n; i++) {
        MK_UNROLL for (int j = 0; j < i; j++) {
            MK_REAL sum = S[MK_AT(i, j)];
            MK_UNROLL for (int k = j + 1; k < i; k++) sum += S[MK_AT(i, k)] * S[MK_AT(k, j)];
            S[MK_AT(i, j)] = -sum;
        }
    }
    /* Element (j, k), k <= j: sum over i >= j of d_i K_ij K_ik */
    MK_UNROLL for (int j = 0; j < n; j++) {
        const MK_REAL d = S[MK_AT(j, j)];
        MK_UNROLL for (int k = 0; k < j; k++) S[MK_AT(j, k)] *= d;
        MK_UNROLL for (int i = j + 1; i < n; i++) {
            const MK_REAL f = S[MK_AT(i, i)] * S[MK_AT(i, j)];
            MK_F(mk_row_add)(j + 1, f, S + MK_AT(i, 0), S + MK_AT(j, 0));
        }
    }
}

/* Trace of packed S. */
MK_KERNEL MK_REAL MK_F(mk_trace)(int n, const MK_REAL *S) {
    MK_REAL sum = S[0];
    MK_UNROLL for (int i = 1; i < n; i++) sum += S[MK_AT(i, i)];
    return sum;
}

/* 1 if all `count` numbers are finite. A product with zero is zero for finite numbers and NaN for others. */
MK_KERNEL int MK_F(mk_all_finite)(int count, const MK_REAL *x) {
    MK_REAL probe = MK_R(0.0);
    for (int i = 0; i < count; i++) probe += x[i] * MK_R(0.0);
    return probe == MK_R(0.0);
}
