/* SPDX-License-Identifier: MIT */
/* The sum that does not depend on the order of its terms, against another exact algorithm (Shewchuk's expansions, as in Python's math.fsum) and
   against sums known beforehand. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "exact_sum.h"
#include "random.h"

#define TERMS 5000

static uint64_t bits(double x) {
    uint64_t word;
    memcpy(&word, &x, sizeof word);
    return word;
}

/* x as its bits: 0.0 and -0.0 differ, and NaN is itself. */
#define assert_same(x, y) assert_int_equal(bits(x), bits(y))

static double total(const double *term, int count) {
    mk_exact_t sum = {{0}};
    for (int i = 0; i < count; i++) mk_exact_add(&sum, term[i]);
    const double value = mk_exact_value(&sum);
    assert_same(mk_exact_value(&sum), value); /* asking changes nothing */
    return value;
}

/* Correctly rounded sum of numbers whose partial sums stay far from overflow: the parts do not overlap and add up to the sum exactly. */
static double expansion(const double *term, int count) {
    double *part = malloc(((size_t)count + 1) * sizeof *part);
    int parts = 0;
    assert_non_null(part);
    for (int i = 0; i < count; i++) {
        double x = term[i];
        int kept = 0;
        for (int j = 0; j < parts; j++) {
            double y = part[j];
            if (fabs(x) < fabs(y)) {
                const double swap = x;
                x = y;
                y = swap;
            }
            const volatile double high = x + y, back = high - x;
            const double low = y - back;
            if (low != 0.0) part[kept++] = low;
            x = high;
        }
        part[kept++] = x;
        parts = kept;
    }
    double high = 0.0, low = 0.0;
    while (parts > 0 && low == 0.0) {
        const double x = high, y = part[--parts];
        const volatile double sum = x + y, back = sum - x;
        low = y - back;
        high = sum;
    }
    /* Half way between two numbers: the parts that are left say which is nearer. */
    if (parts > 0 && ((low < 0.0 && part[parts - 1] < 0.0) || (low > 0.0 && part[parts - 1] > 0.0))) {
        const volatile double twice = 2.0 * low, sum = high + twice, back = sum - high;
        if (twice == back) high = sum;
    }
    free(part);
    return high;
}

/* Exponents from -spread to spread; later terms cancel earlier ones but for a little, if they should. */
static void draw(double *term, int count, int spread, int cancels, uint32_t seed) {
    mk_random_t random;
    mk_random_start(&random, 7, seed, 0, 0, MK_DRAW_INITIAL);
    for (int i = 0; i < count; i++) {
        const double exponent = floor((2.0 * mk_random_uniform(&random) - 1.0) * spread);
        term[i] = ldexp(2.0 * mk_random_uniform(&random) - 1.0, (int)exponent);
        if (cancels && i % 2) term[i] = -term[i - 1] * (mk_random_uniform(&random) < 0.5 ? 1.0 : 1.0 + DBL_EPSILON);
    }
}

static void shuffle(double *term, int count, uint32_t seed) {
    mk_random_t random;
    mk_random_start(&random, 8, seed, 0, 0, MK_DRAW_INITIAL);
    for (int i = count - 1; i > 0; i--) {
        const int j = (int)(mk_random_uniform(&random) * (i + 1)) % (i + 1);
        const double swap = term[i];
        term[i] = term[j];
        term[j] = swap;
    }
}

static void another_algorithm(void **unused) {
    static double term[TERMS];
    int naive_differs = 0;
    (void)unused;
    for (uint32_t trial = 0; trial < 120; trial++) {
        const int count = trial < 60 ? 1 + (int)trial : TERMS >> trial % 4, spread = (const int[]){2, 30, 300, 1000}[trial % 4];
        draw(term, count, spread, trial % 3 == 0, trial);
        double naive = 0.0;
        for (int i = 0; i < count; i++) naive += term[i];
        const double sum = total(term, count);
        assert_same(sum, expansion(term, count));
        naive_differs += bits(naive) != bits(sum);
    }
    assert_true(naive_differs > 60); /* or the terms were too easy */
}

static void any_order(void **unused) {
    static double term[TERMS];
    (void)unused;
    for (uint32_t trial = 0; trial < 20; trial++) {
        draw(term, TERMS, 40, trial % 2, 1000 + trial);
        const double sum = total(term, TERMS);
        shuffle(term, TERMS, trial);
        assert_same(total(term, TERMS), sum);
        /* In parts, which are merged. */
        mk_exact_t part[7], all = {{0}};
        memset(part, 0, sizeof part);
        for (int i = 0; i < TERMS; i++) mk_exact_add(&part[(uint32_t)i * 2654435761U % 7], term[i]);
        for (int p = 6; p >= 0; p--) {
            mk_exact_move(&all, &part[p]);
            assert_same(mk_exact_value(&part[p]), 0.0);
        }
        assert_same(mk_exact_value(&all), sum);
    }
}

static void known_sums(void **unused) {
    static const struct {
        double term[5], sum;
    } known[] = {
        {{0}, 0.0},
        {{-0.0, -0.0}, 0.0},
        {{1.0, -1.0}, 0.0},
        {{1e308, 1.0, -1e308}, 1.0},
        {{1e16, 1.0, -1e16}, 1.0},
        {{0.1, 0.2, -0.3}, 0x1p-55}, /* what the three decimals lack, exactly */
        {{-1e308, 5e-324, 1e308}, 5e-324},
        /* to nearest, ties to even, and a bit a thousand places away decides */
        {{1.0, 0x1p-53}, 1.0},
        {{1.0, 0x1p-53, 5e-324}, 1.0 + DBL_EPSILON},
        {{1.0, 0x1p-53, -5e-324}, 1.0},
        {{1.0 + DBL_EPSILON, 0x1p-53}, 1.0 + 2.0 * DBL_EPSILON},
        {{1.0 + DBL_EPSILON, 0x1p-53, -5e-324}, 1.0 + DBL_EPSILON},
        {{-1.0, -0x1p-53, -5e-324}, -1.0 - DBL_EPSILON},
        {{-1.0, -0x1p-53}, -1.0},
        /* the smallest: all sums below the normal numbers are exact */
        {{5e-324, 5e-324}, 1e-323},
        {{DBL_MIN, -5e-324}, DBL_MIN - 5e-324},
        {{-DBL_MIN, 5e-324}, -(DBL_MIN - 5e-324)},
        {{0x1.8p-1023, 0x1.8p-1023, -0x1p-1074}, 0x1.7ffffffffffffp-1022},
        /* the largest: partial sums may pass the end, sums may not */
        {{DBL_MAX, DBL_MAX, -DBL_MAX}, DBL_MAX},
        {{DBL_MAX, DBL_MAX, -DBL_MAX, -DBL_MAX, 3.0}, 3.0},
        {{DBL_MAX, 0x1p969}, DBL_MAX},
        {{DBL_MAX, 0x1p970, -5e-324}, DBL_MAX},
        {{DBL_MAX, 0x1p970}, HUGE_VAL},
        {{-DBL_MAX, -DBL_MAX}, -HUGE_VAL},
    };
    (void)unused;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) assert_same(total(known[i].term, 5), known[i].sum);
}

static void subnormal_terms(void **unused) {
    static double term[TERMS];
    mk_random_t random;
    int64_t sum = 0; /* in units of the smallest number */
    (void)unused;
    mk_random_start(&random, 9, 0, 0, 0, MK_DRAW_INITIAL);
    for (int i = 0; i < TERMS; i++) {
        const int64_t units = (int64_t)((2.0 * mk_random_uniform(&random) - 1.0) * 0x1p52);
        term[i] = ldexp((double)units, -1074);
        sum += units;
        if (i < 40 || i + 1 == TERMS) assert_same(total(term, i + 1), ldexp((double)sum, -1074));
    }
}

static void not_finite(void **unused) {
    (void)unused;
    assert_true(isnan(total((const double[]){1.0, (double)NAN, 2.0}, 3)));
    assert_true(isnan(total((const double[]){HUGE_VAL, 2.0}, 2)));
    assert_true(isnan(total((const double[]){HUGE_VAL, -HUGE_VAL}, 2)));
    /* It passes on when parts are merged. */
    mk_exact_t a = {{0}}, b = {{0}};
    mk_exact_add(&a, (double)NAN);
    mk_exact_add(&b, 1.0);
    for (int d = 0; d < MK_EXACT_DIGITS; d++) b.digit[d] += a.digit[d];
    assert_true(isnan(mk_exact_value(&b)));
}

/* 2^30 equal terms, the most that are allowed, for every place of a term's bits among the digits: by doubling the sum thirty times. */
static void most_terms(void **unused) {
    (void)unused;
    for (int sign = -1; sign <= 1; sign += 2)
        for (int exponent = -1074 + 53; exponent <= 1024 - 31; exponent++) {
            const double term = sign * ldexp(1.0 - DBL_EPSILON / 2.0, exponent);
            mk_exact_t sum = {{0}};
            mk_exact_add(&sum, term);
            for (int twice = 0; twice < 30; twice++)
                for (int d = 0; d < MK_EXACT_DIGITS; d++) sum.digit[d] += sum.digit[d];
            assert_same(mk_exact_value(&sum), ldexp(term, 30));
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(another_algorithm), cmocka_unit_test(any_order),  cmocka_unit_test(known_sums),
        cmocka_unit_test(subnormal_terms),   cmocka_unit_test(not_finite), cmocka_unit_test(most_terms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
