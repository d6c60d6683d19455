/* SPDX-License-Identifier: MIT */
/* y := r + sum_j z_j X_j + sum_k w_k Z_k in this order, the columns X_j and Z_k being n numbers each, one after another. r null: zero. */

#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
/* sum[0 .. rows) += columns, rows <= 6 from x on. A loop: unrolled, its loads would wait in memory for registers. */
MK_KERNEL void mk_columns_block_f32(int n, int rows, int count, const float *z, const float *x, float *sum) {
    for (int j = 0; j < count; j++) {
        float v[6];
        if (rows == 6) {
            x = mk_load_six_f32(x, v) + (n - 6);
        } else {
            MK_UNROLL for (int i = 0; i < rows; i++) v[i] = x[i];
            x += n;
        }
        MK_UNROLL for (int i = 0; i < rows; i++) sum[i] += z[j] * v[i];
    }
}

/* Up to six rows at a time stay in registers over all columns. */
MK_KERNEL void mk_columns_f32(int n, const float *r, int z_count, const float *z, const float *X, int w_count, const float *w, const float *Z,
                              float *y) {
    MK_UNROLL for (int done = 0; done < n; done += 6) {
        const int rows = n - done < 6 ? n - done : 6;
        float sum[6];
        MK_UNROLL for (int i = 0; i < rows; i++) sum[i] = r ? r[done + i] : 0.0f;
        mk_columns_block_f32(n, rows, z_count, z, X + done, sum);
        mk_columns_block_f32(n, rows, w_count, w, Z + done, sum);
        MK_UNROLL for (int i = 0; i < rows; i++) y[done + i] = sum[i];
    }
}
#else
MK_KERNEL void MK_F(mk_columns)(int n, const MK_REAL *r, int z_count, const MK_REAL *z, const MK_REAL *X, int w_count, const MK_REAL *w,
                                const MK_REAL *Z, MK_REAL *MK_RESTRICT y) {
    MK_UNROLL for (int i = 0; i < n; i++) y[i] = r ? r[i] : MK_R(0.0);
    MK_UNROLL for (int j = 0; j < z_count; j++) MK_F(mk_row_add)(n, z[j], X + j * n, y);
    MK_UNROLL for (int j = 0; j < w_count; j++) MK_F(mk_row_add)(n, w[j], Z + j * n, y);
}
#endif
