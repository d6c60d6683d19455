/* SPDX-License-Identifier: MIT */
/* LAPACKE behind the interface of the benchmark; which BLAS and LAPACK it gets is the linker's choice. */
#include <cblas.h>
#include <lapacke.h>
#include <math.h>

#include "bench.h"

#define REAL float
#define DATA f
#define CLOSE 3e-4f
#define L(name) LAPACKE_s##name
#define B(name) cblas_s##name
#define F(name) lapacke_f32_##name
#include "lapacke.tmpl.h"
#undef REAL
#undef DATA
#undef CLOSE
#undef L
#undef B
#undef F

#define REAL double
#define DATA d
#define CLOSE 1e-8
#define L(name) LAPACKE_d##name
#define B(name) cblas_d##name
#define F(name) lapacke_f64_##name
#include "lapacke.tmpl.h"

#define ROW(n, bits) {"LAPACKE", n, bits, lapacke_f##bits##_start, lapacke_f##bits##_run, lapacke_f##bits##_read}

const bench_engine *bench_lapacke(int *count) {
    static const bench_engine engines[] = {ROW(4, 32), ROW(6, 32), ROW(9, 32), ROW(17, 32),
                                           ROW(4, 64), ROW(6, 64), ROW(9, 64), ROW(17, 64)};
    *count = (int)(sizeof engines / sizeof *engines);
    return engines;
}
