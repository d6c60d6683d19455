/* SPDX-License-Identifier: MIT */
/* What the benchmark programs share: the workload, and the interface behind which every implementation of the step stands.

   The workload is one step of spec 1.4 at one node: five sensors of two rows each arrive, the incremental step, four
   intermediate estimates arrive, the diffusion step. F, S and R^-1 are given; everybody keeps what he likes prepared. */
#ifndef MESHKAL_BENCH_H
#define MESHKAL_BENCH_H

#ifdef __cplusplus
extern "C" {
#endif

#define BENCH_N 17 /* largest n */
#define BENCH_M 2
#define BENCH_SLOTS 5
#define BENCH_MESSAGES 64 /* different inputs, used in turn */
#define BENCH_PACKED(n) ((n) * ((n) + 1) / 2)

/* Model and inputs in one precision. Arrays are filled densely from the front for the n of the case: an n x n matrix has stride
   n. Nothing but arrays of `real`, so that one precision is copied to the other as a flat array. */
#define BENCH_DATA(real)                                                                  \
    typedef struct {                                                                      \
        real A[BENCH_N * BENCH_N]; /* row order */                                        \
        real Q[BENCH_PACKED(BENCH_N)], P0[BENCH_PACKED(BENCH_N)];                         \
        real x0[BENCH_N], weight[BENCH_SLOTS];                                            \
        real C[BENCH_SLOTS * BENCH_M * BENCH_N];        /* slots x m x n */               \
        real R[BENCH_SLOTS * BENCH_PACKED(BENCH_M)];                                      \
        real F[BENCH_SLOTS * BENCH_M * BENCH_N];        /* slots x m x n: C' R^-1 by columns */ \
        real S[BENCH_SLOTS * BENCH_PACKED(BENCH_N)];                                      \
        real R_inverse[BENCH_SLOTS * BENCH_PACKED(BENCH_M)];                              \
        real tolerance[1];                                                                \
        real y[BENCH_MESSAGES][BENCH_SLOTS][BENCH_M];                                     \
        real psi[BENCH_MESSAGES][BENCH_SLOTS][BENCH_N]; /* of neighbours, slots 1 .. */   \
    } bench_data_##real;

BENCH_DATA(float)
BENCH_DATA(double)

typedef struct {
    int n;
    const char *shape;
    bench_data_float f;
    bench_data_double d;
} bench_case;

/* One implementation for one n and one precision, with one filter inside. */
typedef struct {
    const char *name;
    int n, bits;
    int (*start)(const bench_case *c);           /* 1, or 0 on failure */
    int (*run)(const bench_case *c, int steps);  /* so many steps; 1, or 0 on failure */
    void (*read)(double *theta, double *x);      /* of the last step; x is what diffusion left */
} bench_engine;

const bench_engine *bench_meshkal(int *count);
const bench_engine *bench_eigen(int *count);
const bench_engine *bench_lapacke(int *count);

/* Evaluations of gamma in the last step of the filter that bench_meshkal runs unrolled. */
int bench_meshkal_evaluations(int n, int bits);

/* Runs about `count` scalar multiplications and additions, half each, as fast as the core can; returns their number. */
double bench_peak(int bits, int count);

/* One case from its description: data of every precision. 1, or 0 on failure. */
int bench_make_case(bench_case *c, int n, const char *shape, double tolerance);

/* + - * / and square roots of the step, counted from its formulas as Meshkal runs them. */
double bench_flops(int n, int robust, int evaluations);

#ifdef __cplusplus
}
#endif

#endif
