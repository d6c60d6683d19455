/* SPDX-License-Identifier: MIT */
/* Operations on rows of matrices, element by element: each result depends on elements of its own column only, so it has the same
   bits whether lanes of a vector unit, an unrolled or a rolled loop compute it. Sums along a row never come here.

   Spelled out for vector units because compilers find these rows in straight-line code only sometimes. A row is always cut in
   the same way from its start, into wide pieces, a pair and a single: a load that finds all it wants in one earlier store is
   quick, one that has to collect it from two waits for both to reach the cache. */

#ifdef MK_VECTOR_BYTES
#undef MK_WIDE
#if MK_VECTOR_BYTES >= 4 * MK_BITS / 8
#define MK_WIDE 4
#else
#define MK_WIDE 2
#endif
typedef MK_REAL MK_F(mk_wide) __attribute__((vector_size(MK_WIDE * MK_BITS / 8)));
typedef MK_REAL MK_F(mk_pair) __attribute__((vector_size(2 * MK_BITS / 8)));

MK_KERNEL MK_F(mk_wide) MK_F(mk_load_wide)(const MK_REAL *x) {
    MK_F(mk_wide) lanes;
    memcpy(&lanes, x, sizeof lanes);
    return lanes;
}

MK_KERNEL MK_F(mk_pair) MK_F(mk_load_pair)(const MK_REAL *x) {
    MK_F(mk_pair) lanes;
    memcpy(&lanes, x, sizeof lanes);
    return lanes;
}

MK_KERNEL void MK_F(mk_store_wide)(MK_F(mk_wide) lanes, MK_REAL *y) { memcpy(y, &lanes, sizeof lanes); }

MK_KERNEL void MK_F(mk_store_pair)(MK_F(mk_pair) lanes, MK_REAL *y) { memcpy(y, &lanes, sizeof lanes); }
#endif

/* y[0 .. n) := x[0 .. n) */
MK_KERNEL void MK_F(mk_row_copy)(int n, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE) MK_F(mk_store_wide)(MK_F(mk_load_wide)(x + j), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2) MK_F(mk_store_pair)(MK_F(mk_load_pair)(x + j), y + j);
#endif
    for (; j < n; j++) y[j] = x[j];
}

/* y[j] := x[j stride]: a column becomes a row. */
MK_KERNEL void MK_F(mk_row_gather)(int n, int stride, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
#if MK_WIDE == 4
    MK_UNROLL for (; j + 4 <= n; j += 4) {
        const MK_F(mk_wide) lanes = {x[j * stride], x[(j + 1) * stride], x[(j + 2) * stride], x[(j + 3) * stride]};
        MK_F(mk_store_wide)(lanes, y + j);
    }
#endif
    MK_UNROLL for (; j + 2 <= n; j += 2) {
        const MK_F(mk_pair) lanes = {x[j * stride], x[(j + 1) * stride]};
        MK_F(mk_store_pair)(lanes, y + j);
    }
#endif
    MK_UNROLL for (; j < n; j++) y[j] = x[j * stride];
}

/* A row that was computed element by element becomes one to be read in pieces. Changes nothing but the time of the next read. */
MK_KERNEL void MK_F(mk_row_join)(int n, MK_REAL *y) {
#ifdef MK_VECTOR_BYTES
    MK_F(mk_row_gather)(n, 1, y, y);
#else
    (void)n;
    (void)y;
#endif
}

/* y[0 .. n) := f x[0 .. n) */
MK_KERNEL void MK_F(mk_row_scale)(int n, MK_REAL f, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE) MK_F(mk_store_wide)(f * MK_F(mk_load_wide)(x + j), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2) MK_F(mk_store_pair)(f * MK_F(mk_load_pair)(x + j), y + j);
#endif
    MK_UNROLL for (; j < n; j++) y[j] = f * x[j];
}

/* y[0 .. n) += x[0 .. n) */
MK_KERNEL void MK_F(mk_row_sum)(int n, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE)
        MK_F(mk_store_wide)(MK_F(mk_load_wide)(y + j) + MK_F(mk_load_wide)(x + j), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2)
        MK_F(mk_store_pair)(MK_F(mk_load_pair)(y + j) + MK_F(mk_load_pair)(x + j), y + j);
#endif
    for (; j < n; j++) y[j] += x[j];
}

/* y[0 .. n) -= x[0 .. n) */
MK_KERNEL void MK_F(mk_row_difference)(int n, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE)
        MK_F(mk_store_wide)(MK_F(mk_load_wide)(y + j) - MK_F(mk_load_wide)(x + j), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2)
        MK_F(mk_store_pair)(MK_F(mk_load_pair)(y + j) - MK_F(mk_load_pair)(x + j), y + j);
#endif
    MK_UNROLL for (; j < n; j++) y[j] -= x[j];
}

/* y[0 .. n) := g (y[0 .. n) - f x[0 .. n)) */
MK_KERNEL void MK_F(mk_row_step)(int n, MK_REAL f, const MK_REAL *x, MK_REAL g, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE)
        MK_F(mk_store_wide)(g * (MK_F(mk_load_wide)(y + j) - f * MK_F(mk_load_wide)(x + j)), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2)
        MK_F(mk_store_pair)(g * (MK_F(mk_load_pair)(y + j) - f * MK_F(mk_load_pair)(x + j)), y + j);
#endif
    MK_UNROLL for (; j < n; j++) y[j] = g * (y[j] - f * x[j]);
}

/* y[0 .. n) := f (y[0 .. n) + x[0 .. n)) */
MK_KERNEL void MK_F(mk_row_sum_scaled)(int n, MK_REAL f, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE)
        MK_F(mk_store_wide)(f * (MK_F(mk_load_wide)(y + j) + MK_F(mk_load_wide)(x + j)), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2)
        MK_F(mk_store_pair)(f * (MK_F(mk_load_pair)(y + j) + MK_F(mk_load_pair)(x + j)), y + j);
#endif
    MK_UNROLL for (; j < n; j++) y[j] = f * (y[j] + x[j]);
}

/* y[0 .. n) += f x[0 .. n) */
MK_KERNEL void MK_F(mk_row_add)(int n, MK_REAL f, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE)
        MK_F(mk_store_wide)(MK_F(mk_load_wide)(y + j) + f * MK_F(mk_load_wide)(x + j), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2)
        MK_F(mk_store_pair)(MK_F(mk_load_pair)(y + j) + f * MK_F(mk_load_pair)(x + j), y + j);
#endif
    MK_UNROLL for (; j < n; j++) y[j] += f * x[j];
}

/* y[0 .. n) -= f x[0 .. n) */
MK_KERNEL void MK_F(mk_row_subtract)(int n, MK_REAL f, const MK_REAL *x, MK_REAL *y) {
    int j = 0;
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (; j + MK_WIDE <= n; j += MK_WIDE)
        MK_F(mk_store_wide)(MK_F(mk_load_wide)(y + j) - f * MK_F(mk_load_wide)(x + j), y + j);
    MK_UNROLL for (; j + 2 <= n; j += 2)
        MK_F(mk_store_pair)(MK_F(mk_load_pair)(y + j) - f * MK_F(mk_load_pair)(x + j), y + j);
#endif
    MK_UNROLL for (; j < n; j++) y[j] -= f * x[j];
}

/* Packed y := x, to be read by rows. Without vector registers a loop is enough, and small. */
MK_KERNEL void MK_F(mk_packed_copy)(int n, const MK_REAL *x, MK_REAL *y) {
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (int i = 0; i < n; i++) MK_F(mk_row_copy)(i + 1, x + MK_AT(i, 0), y + MK_AT(i, 0));
#else
    for (int i = 0; i < MK_AT(n, 0); i++) y[i] = x[i];
#endif
}

/* Packed y := x, to be read element by element: nothing is left of it in straight-line code. */
MK_KERNEL void MK_F(mk_packed_split)(int n, const MK_REAL *x, MK_REAL *y) {
#ifdef MK_VECTOR_BYTES
    MK_UNROLL for (int i = 0; i < n; i++) {
        MK_UNROLL for (int j = 0; j <= i; j++) y[MK_AT(i, j)] = x[MK_AT(i, j)];
    }
#else
    for (int i = 0; i < MK_AT(n, 0); i++) y[i] = x[i];
#endif
}
