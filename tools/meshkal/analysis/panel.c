/* SPDX-License-Identifier: MIT */
#include "analysis/panel.h"

/* Lanes of four doubles: one register of AVX2, two of SSE2. Every element is computed by the same operations in the same order whatever the
   unit: no fused multiply-add. */
#define LANES 4
typedef double lanes_t __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));
#define LOAD(x) (*(const lanes_t *)(x))
#define STORE(y, lanes) (*(lanes_t *)(y) = (lanes))
#define INLINE static inline __attribute__((always_inline))
#if defined(__clang__)
#define UNROLL _Pragma("clang loop unroll(full)")
#else
#define UNROLL _Pragma("GCC unroll 8")
#endif

mk_panel_shape_t mk_panel_shape(int n, int estimators) {
    mk_panel_shape_t s = {n, estimators, 1, n, 0, 0};
    while (s.width % LANES != 0 || s.width < 8) {
        s.blocks++;
        s.width += n;
    }
    s.panels = (estimators + s.blocks - 1) / s.blocks;
    s.rows = (size_t)s.panels * (size_t)s.width;
    return s;
}

size_t mk_panel_size(const mk_panel_shape_t *s) { return s->rows * s->rows; }

size_t mk_panel_at(const mk_panel_shape_t *s, int row_block, int column_block) {
    const size_t panel = (size_t)(column_block / s->blocks) * s->rows * (size_t)s->width;
    return panel + (size_t)row_block * (size_t)(s->n * s->width) + (size_t)(column_block % s->blocks * s->n);
}

size_t mk_panel_scratch(const mk_panel_shape_t *s) { return (s->rows + (size_t)s->width) * (size_t)s->width; }

/* y (rows x width) = F (rows x inner) x, plus y itself where `onto`. rows: a literal, at most 6. */
INLINE void product_rows(int rows, int inner, int width, const double *F, const double *x, int onto, double *y) {
    for (int c = 0; c < width; c += LANES) {
        lanes_t sum[6];
        UNROLL for (int i = 0; i < rows; i++) sum[i] = onto ? LOAD(y + i * width + c) : (lanes_t){0.0, 0.0, 0.0, 0.0};
        for (int k = 0; k < inner; k++) {
            const lanes_t v = LOAD(x + k * width + c);
            UNROLL for (int i = 0; i < rows; i++) sum[i] += F[i * inner + k] * v;
        }
        UNROLL for (int i = 0; i < rows; i++) STORE(y + i * width + c, sum[i]);
    }
}

INLINE void product(int n, int inner, int width, const double *F, const double *x, int onto, double *y) {
    int i = 0;
    for (; i + 6 <= n; i += 6) product_rows(6, inner, width, F + i * inner, x, onto, y + i * width);
    for (; i + 4 <= n; i += 4) product_rows(4, inner, width, F + i * inner, x, onto, y + i * width);
    for (; i + 2 <= n; i += 2) product_rows(2, inner, width, F + i * inner, x, onto, y + i * width);
    if (i < n) product_rows(1, inner, width, F + i * inner, x, onto, y + i * width);
}

/* `pieces` (a literal, at most 6) lanes of a combined block; start may be null. */
INLINE void combine_lanes(int pieces, size_t size, int count, const int *slot, const double *weight, const double *from, const double *start, double *y) {
    lanes_t sum[6];
    UNROLL for (int i = 0; i < pieces; i++) sum[i] = start ? LOAD(start + i * LANES) : (lanes_t){0.0, 0.0, 0.0, 0.0};
    for (int l = 0; l < count; l++) {
        const double w = weight[l];
        const double *x = from + (size_t)slot[l] * size;
        UNROLL for (int i = 0; i < pieces; i++) sum[i] += w * LOAD(x + i * LANES);
    }
    UNROLL for (int i = 0; i < pieces; i++) STORE(y + i * LANES, sum[i]);
}

/* y (n x width) = sum over the slots of e of weight times block, plus start where it is not null. */
INLINE void combine(const mk_panel_step_t *s, int n, int width, int e, const double *from, const double *start, double *y) {
    const int begin = s->mixing.first[e], count = s->mixing.first[e + 1] - begin, size = n * width;
    const int *slot = s->mixing.slot + begin;
    const double *weight = s->mixing.weight + begin;
    int at = 0;
    for (; at + 6 * LANES <= size; at += 6 * LANES) combine_lanes(6, (size_t)size, count, slot, weight, from + at, start ? start + at : NULL, y + at);
    for (; at < size; at += LANES) combine_lanes(1, (size_t)size, count, slot, weight, from + at, start ? start + at : NULL, y + at);
}

/* to = from', both width x width. */
INLINE void transpose(int width, const double *from, double *to) {
    for (int j = 0; j < width; j++)
        for (int i = 0; i < width; i += LANES) {
            const double *x = from + i * width + j;
            const lanes_t column = {x[0], x[width], x[2 * width], x[3 * width]};
            STORE(to + j * width + i, column);
        }
}

INLINE void map(const mk_panel_step_t *s, int n, int width, int p, const double *X, double *scratch) {
    const size_t size = (size_t)(n * width);
    X += (size_t)p * s->shape.rows * (size_t)width;
    for (int e = 0; e < s->shape.estimators; e++) product(n, n, width, s->F + e * n * n, X + (size_t)e * size, 0, scratch + (size_t)e * size);
}

INLINE void first(const mk_panel_step_t *s, int n, int width, int p, const double *X, double *T, double *scratch) {
    const size_t panel = s->shape.rows * (size_t)width, tile = (size_t)(width * width);
    double *const mixed = scratch + panel;
    map(s, n, width, p, X, scratch);
    for (int q = 0, e = 0; q < s->shape.panels; q++) {
        int b = 0;
        for (; b < s->shape.blocks && e < s->shape.estimators; b++, e++) combine(s, n, width, e, scratch, NULL, mixed + b * n * width);
        for (double *rest = mixed + b * n * width; rest < mixed + tile; rest++) *rest = 0.0;
        transpose(width, mixed, T + (size_t)q * panel + (size_t)p * tile);
    }
}

INLINE void second(const mk_panel_step_t *s, int n, int width, int p, double *X, double *scratch) {
    const size_t panel = s->shape.rows * (size_t)width, tile = (size_t)(width * width);
    const double *H = s->H + (size_t)p * (size_t)(s->rank * width);
    for (int q = 0, e = 0; q <= p; q++) {
        double *const here = X + (size_t)p * panel + (size_t)q * tile;
        for (int b = 0; b < s->shape.blocks && e < s->shape.estimators; b++, e++) {
            double *const y = here + b * n * width;
            combine(s, n, width, e, scratch, s->Q, y);
            if (s->rank) product(n, s->rank, width, s->L + (size_t)e * (size_t)(n * s->rank), H, 1, y);
        }
        if (q < p) transpose(width, here, X + (size_t)q * panel + (size_t)p * tile);
        else
            for (int i = 0; i < width; i++)
                for (int j = 0; j < i; j++) here[i * width + j] = here[j * width + i];
    }
}

/* Common dimensions compiled in, for the plain instruction set and for AVX2. */
#define SIZED(shape, body)                                  \
    switch ((shape)->width << 8 | (shape)->n) {             \
    case 8 << 8 | 2: body(2, 8); break;                     \
    case 8 << 8 | 4: body(4, 8); break;                     \
    case 12 << 8 | 6: body(6, 12); break;                   \
    default: body((shape)->n, (shape)->width); break;       \
    }
#define PRODUCT(n, width) product(n, n, width, F, x, onto, y)
#define FIRST(n, width) first(step, n, width, p, X, T, scratch)
#define MAP(n, width) map(step, n, width, p, T, scratch)
#define SECOND(n, width) second(step, n, width, p, X, scratch)

#define VERSIONS(name, attribute)                                                                                           \
    attribute static void product_##name(const mk_panel_shape_t *shape, const double *F, const double *x, int onto, double *y) { \
        SIZED(shape, PRODUCT)                                                                                               \
    }                                                                                                                       \
    attribute static void first_##name(const mk_panel_step_t *step, int p, const double *X, double *T, double *scratch) {   \
        SIZED(&step->shape, FIRST)                                                                                          \
    }                                                                                                                       \
    attribute static void map_##name(const mk_panel_step_t *step, int p, const double *T, double *scratch) {                \
        SIZED(&step->shape, MAP)                                                                                            \
    }                                                                                                                       \
    attribute static void second_##name(const mk_panel_step_t *step, int p, double *X, double *scratch) {                   \
        SIZED(&step->shape, SECOND)                                                                                         \
    }

VERSIONS(plain, )
#if defined(__x86_64__)
VERSIONS(avx2, __attribute__((target("avx2"))))
#define CALL(name, arguments)                                    \
    if (__builtin_cpu_supports("avx2")) name##_avx2 arguments;   \
    else name##_plain arguments
#else
#define CALL(name, arguments) name##_plain arguments
#endif

void mk_panel_product(const mk_panel_shape_t *shape, const double *F, const double *x, int onto, double *y) {
    CALL(product, (shape, F, x, onto, y));
}
void mk_panel_first(const mk_panel_step_t *step, int p, const double *X, double *T, double *scratch) { CALL(first, (step, p, X, T, scratch)); }
void mk_panel_map(const mk_panel_step_t *step, int p, const double *T, double *scratch) { CALL(map, (step, p, T, scratch)); }
void mk_panel_second(const mk_panel_step_t *step, int p, double *X, double *scratch) { CALL(second, (step, p, X, scratch)); }
