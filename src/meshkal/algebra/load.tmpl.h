/* SPDX-License-Identifier: MIT */
/* Blocks of memory to and from local arrays, of which straight-line code leaves nothing but registers. */

#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
/* One instruction for all, which gcc does not find by itself: on a Cortex-M4 a cycle less for each number but the first, and four bytes. Six
   numbers take registers that a function need not save, a packed matrix those above them, so that both fit; the compiler may move them. */

/* v[0 .. 6) := x[0 .. 6). Returns x + 6. */
MK_KERNEL const float *mk_load_six_f32(const float *x, float *v) {
    register float a __asm__("s0"), b __asm__("s1"), c __asm__("s2"), d __asm__("s3"), e __asm__("s4"), f __asm__("s5");
    const float *next = x;
    __asm__("vldmia %6!, {s0-s5}" : "=t"(a), "=t"(b), "=t"(c), "=t"(d), "=t"(e), "=t"(f), "+r"(next) : "m"(*(const float(*)[6])x));
    v[0] = a;
    v[1] = b;
    v[2] = c;
    v[3] = d;
    v[4] = e;
    v[5] = f;
    return next;
}

/* A packed 6 x 6 matrix. */
MK_KERNEL void mk_load_packed_six_f32(const float *x, float *v) {
    register float a __asm__("s8"), b __asm__("s9"), c __asm__("s10"), d __asm__("s11"), e __asm__("s12"),
                   f __asm__("s13"), g __asm__("s14"), h __asm__("s15"), i __asm__("s16"), j __asm__("s17"),
                   k __asm__("s18"), l __asm__("s19"), m __asm__("s20"), n __asm__("s21"), o __asm__("s22"),
                   p __asm__("s23"), q __asm__("s24"), r __asm__("s25"), s __asm__("s26"), t __asm__("s27"),
                   u __asm__("s28");
    __asm__("vldmia %21, {s8-s28}"
            : "=t"(a), "=t"(b), "=t"(c), "=t"(d), "=t"(e), "=t"(f), "=t"(g), "=t"(h), "=t"(i), "=t"(j), "=t"(k),
              "=t"(l), "=t"(m), "=t"(n), "=t"(o), "=t"(p), "=t"(q), "=t"(r), "=t"(s), "=t"(t), "=t"(u)
            : "r"(x), "m"(*(const float(*)[21])x));
    v[0] = a; v[1] = b; v[2] = c; v[3] = d; v[4] = e; v[5] = f; v[6] = g;
    v[7] = h; v[8] = i; v[9] = j; v[10] = k; v[11] = l; v[12] = m; v[13] = n;
    v[14] = o; v[15] = p; v[16] = q; v[17] = r; v[18] = s; v[19] = t; v[20] = u;
}

MK_KERNEL void mk_store_packed_six_f32(const float *v, float *y) {
    register float a __asm__("s8") = v[0], b __asm__("s9") = v[1], c __asm__("s10") = v[2], d __asm__("s11") = v[3], e __asm__("s12") = v[4],
                   f __asm__("s13") = v[5], g __asm__("s14") = v[6], h __asm__("s15") = v[7], i __asm__("s16") = v[8], j __asm__("s17") = v[9],
                   k __asm__("s18") = v[10], l __asm__("s19") = v[11], m __asm__("s20") = v[12], n __asm__("s21") = v[13], o __asm__("s22") = v[14],
                   p __asm__("s23") = v[15], q __asm__("s24") = v[16], r __asm__("s25") = v[17], s __asm__("s26") = v[18], t __asm__("s27") = v[19],
                   u __asm__("s28") = v[20];
    __asm__("vstmia %1, {s8-s28}"
            : "=m"(*(float(*)[21])y)
            : "r"(y), "t"(a), "t"(b), "t"(c), "t"(d), "t"(e), "t"(f), "t"(g), "t"(h), "t"(i), "t"(j), "t"(k),
              "t"(l), "t"(m), "t"(n), "t"(o), "t"(p), "t"(q), "t"(r), "t"(s), "t"(t), "t"(u));
}
#endif

/* v[0 .. n) := x[0 .. n) */
MK_KERNEL void MK_F(mk_load)(int n, const MK_REAL *x, MK_REAL *v) {
#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
    if (n == 6) {
        (void)mk_load_six_f32(x, v);
        return;
    }
#endif
    MK_UNROLL for (int i = 0; i < n; i++) v[i] = x[i];
}

/* Packed v := x */
MK_KERNEL void MK_F(mk_load_packed)(int n, const MK_REAL *x, MK_REAL *v) {
#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
    if (n == 6) {
        mk_load_packed_six_f32(x, v);
        return;
    }
#endif
    MK_UNROLL_ALL for (int i = 0; i < MK_AT(n, 0); i++) v[i] = x[i];
}

/* Packed y := v */
MK_KERNEL void MK_F(mk_store_packed)(int n, const MK_REAL *v, MK_REAL *y) {
#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
    if (n == 6) {
        mk_store_packed_six_f32(v, y);
        return;
    }
#endif
    MK_UNROLL_ALL for (int i = 0; i < MK_AT(n, 0); i++) y[i] = v[i];
}

/* Packed v += x */
MK_KERNEL void MK_F(mk_add_packed)(int n, const MK_REAL *x, MK_REAL *v) {
    int i = 0;
#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
    MK_UNROLL for (; i + 6 <= MK_AT(n, 0); i += 6) {
        float six[6];
        x = mk_load_six_f32(x, six);
        MK_UNROLL for (int j = 0; j < 6; j++) v[i + j] += six[j];
    }
    x -= i;
#endif
    MK_UNROLL_ALL for (; i < MK_AT(n, 0); i++) v[i] += x[i];
}

/* y[0 .. n) := x[0 .. n) in memory */
MK_KERNEL void MK_F(mk_move)(int n, const MK_REAL *x, MK_REAL *y) {
#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
    if (n == 6) {
        __asm__("vldmia %1, {s0-s5}\n\tvstmia %2, {s0-s5}"
                : "=m"(*(float(*)[6])y)
                : "r"(x), "r"(y), "m"(*(const float(*)[6])x)
                : "s0", "s1", "s2", "s3", "s4", "s5");
        return;
    }
#endif
    MK_UNROLL for (int i = 0; i < n; i++) y[i] = x[i];
}

/* y[0 .. n) += f x[0 .. n), y in registers where there are vectors, too, or multiple loads */
MK_KERNEL void MK_F(mk_load_add)(int n, MK_REAL f, const MK_REAL *x, MK_REAL *y) {
#if defined(MK_LOAD_MULTIPLE) && MK_BITS == 32
    if (n == 6) {
        float v[6];
        (void)mk_load_six_f32(x, v);
        MK_UNROLL for (int j = 0; j < 6; j++) y[j] += f * v[j];
        return;
    }
#endif
    MK_F(mk_row_add)(n, f, x, y);
}
