/* SPDX-License-Identifier: MIT */
/* <meshkal/angle.h> in one REAL against the C library's long double; test_angle.c includes this once for each. */

/* Distance of value from exact in units of the last place that exact has in this precision. */
static long double NAME(ulps)(REAL value, long double exact) {
    const int digits = sizeof(REAL) == sizeof(float) ? FLT_MANT_DIG : DBL_MANT_DIG;
    const int least = sizeof(REAL) == sizeof(float) ? FLT_MIN_EXP : DBL_MIN_EXP;
    int exponent;
    frexpl(exact, &exponent);
    if (exponent < least) exponent = least;
    return fabsl((long double)value - exact) / ldexpl(1.0L, exponent - digits);
}

static REAL NAME(neighbour)(REAL x, int steps) {
    const float end = steps > 0 ? INFINITY : -INFINITY;
    for (int i = 0; i < abs(steps); i++)
        x = sizeof(REAL) == sizeof(float) ? (REAL)nextafterf((float)x, end) : (REAL)nextafter((double)x, (double)end);
    return x;
}

/* Any magnitude up to `most`; every other one next to a multiple of pi / 2, where reduction is hardest. */
static REAL NAME(draw_angle)(generator_t *g, double most) {
    const double sign = draw_chance(g, 0.5) ? 1.0 : -1.0;
    if (draw_chance(g, 0.5)) return (REAL)(sign * draw_log_uniform(g, 1e-12, most));
    const long double quarters = floorl((long double)draw_log_uniform(g, 1.0, most / 1.6));
    return NAME(neighbour)((REAL)(sign * (double)(quarters * (M_PI_LONG / 2.0L))), draw_below(g, 5) - 2);
}

static void NAME(sincos_range)(void **unused) {
    (void)unused;
    generator_t g = {71};
    long double worst_sine = 0.0L, worst_cosine = 0.0L;
    for (int i = 0; i < POINTS; i++) {
        const REAL x = NAME(draw_angle)(&g, sizeof(REAL) == sizeof(float) ? 12000.0 : 2e8);
        REAL s, c;
        NAME(mk_sincos)(x, &s, &c);
        const long double sine = NAME(ulps)(s, sinl((long double)x)), cosine = NAME(ulps)(c, cosl((long double)x));
        if (!(sine < 1.0L && cosine < 1.0L)) fail_msg("x = %.17g: %.2Lf and %.2Lf ulp", (double)x, sine, cosine);
        if (sine > worst_sine) worst_sine = sine;
        if (cosine > worst_cosine) worst_cosine = cosine;
        REAL other_s, other_c;
        NAME(mk_sincos)(-x, &other_s, &other_c);
        assert_true(other_s == -s && other_c == c);
    }
    print_message("- " QUOTE(PRECISION) ": sine %.3Lf ulp, cosine %.3Lf ulp at most\n", worst_sine, worst_cosine);
}

static void NAME(sincos_beyond)(void **unused) {
    (void)unused;
    generator_t g = {72};
    const int single = sizeof(REAL) == sizeof(float);
    const double limit = single ? 6.49e6 : 3.49e15, epsilon = single ? (double)FLT_EPSILON : DBL_EPSILON;
    REAL s, c;
    for (int i = 0; i < POINTS / 10; i++) {
        const REAL x = (REAL)draw_log_uniform(&g, single ? 12000.0 : 2e8, limit);
        NAME(mk_sincos)(x, &s, &c);
        const double error = fmax(fabs((double)(s - (REAL)sinl((long double)x))), fabs((double)(c - (REAL)cosl((long double)x))));
        if (!(error <= fabs((double)x) * epsilon)) fail_msg("x = %.17g: error %g", (double)x, error);
    }
    const REAL refused[] = {(REAL)(limit * 1.01), -(REAL)(limit * 1.01), (REAL)1e30, (REAL)INFINITY, -(REAL)INFINITY, (REAL)NAN};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        NAME(mk_sincos)(refused[i], &s, &c);
        assert_true(isnan(s) && isnan(c) && isnan(NAME(mk_wrap)(refused[i])));
    }
    NAME(mk_sincos)((REAL)0.0, &s, &c);
    assert_true(s == (REAL)0.0 && c == (REAL)1.0);
}

static void NAME(atan2_plane)(void **unused) {
    (void)unused;
    generator_t g = {73};
    long double worst = 0.0L;
    for (int i = 0; i < POINTS; i++) {
        const double spread = i % 2 ? 10.0 : 1e10;
        const REAL x = (REAL)(draw_log_uniform(&g, 1.0 / spread, spread) * (draw_chance(&g, 0.5) ? 1.0 : -1.0));
        const REAL y = (REAL)(draw_log_uniform(&g, 1.0 / spread, spread) * (draw_chance(&g, 0.5) ? 1.0 : -1.0));
        const long double error = NAME(ulps)(NAME(mk_atan2)(y, x), atan2l((long double)y, (long double)x));
        if (!(error < 2.0L)) fail_msg("atan2(%.17g, %.17g): %.2Lf ulp", (double)y, (double)x, error);
        if (error > worst) worst = error;
    }
    print_message("- " QUOTE(PRECISION) ": atan2 %.3Lf ulp at most\n", worst);
}

static void NAME(atan2_ends)(void **unused) {
    (void)unused;
    const REAL zero = (REAL)0.0, one = (REAL)1.0, large = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MAX : (REAL)DBL_MAX;
    const REAL least = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MIN : (REAL)DBL_MIN, pi = (REAL)M_PI_LONG, half = (REAL)(M_PI_LONG / 2.0L);
    assert_true(NAME(mk_atan2)(zero, one) == zero && NAME(mk_atan2)(one, zero) == half && NAME(mk_atan2)(-one, zero) == -half);
    assert_true(NAME(mk_atan2)(zero, -one) == pi && NAME(mk_atan2)(-zero, -one) == pi && NAME(mk_atan2)(-least, -one) == -pi);
    assert_true(NAME(mk_atan2)(one, one) == (REAL)(M_PI_LONG / 4.0L) && NAME(mk_atan2)(-one, -one) == (REAL)(-0.75L * M_PI_LONG));
    assert_true(NAME(mk_atan2)(least, large) == zero && NAME(mk_atan2)(large, least) == half);
    assert_true(NAME(mk_atan2)(least, least) == (REAL)(M_PI_LONG / 4.0L));
    const REAL nan = (REAL)NAN, infinite = (REAL)INFINITY;
    const REAL refused[][2] = {{zero, zero},     {-zero, -zero},   {nan, one},            {one, nan},     {nan, zero},
                               {infinite, one},  {one, infinite},  {-infinite, infinite}, {large, large}, {one, -infinite}};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) assert_true(isnan(NAME(mk_atan2)(refused[i][0], refused[i][1])));
}

static void NAME(wrap)(void **unused) {
    (void)unused;
    generator_t g = {74};
    /* The largest number below pi. */
    const REAL inside = sizeof(REAL) == sizeof(float) ? (REAL)3.14159250f : (REAL)3.141592653589793;
    assert_true((long double)inside < M_PI_LONG && (long double)NAME(neighbour)(inside, 1) > M_PI_LONG);
    assert_true(NAME(mk_wrap)(inside) == inside && NAME(mk_wrap)(-inside) == -inside);
    assert_true(NAME(mk_wrap)(NAME(neighbour)(inside, 1)) < (REAL)0.0 && NAME(mk_wrap)(NAME(neighbour)(-inside, -1)) > (REAL)0.0);
    for (int i = 0; i < POINTS; i++) {
        REAL x = NAME(draw_angle)(&g, sizeof(REAL) == sizeof(float) ? 12000.0 : 1e8);
        if (i < 5) x = NAME(neighbour)(inside, i);
        const REAL wrapped = NAME(mk_wrap)(x);
        if (fabsl((long double)x) < M_PI_LONG) {
            assert_true(wrapped == x);
            continue;
        }
        assert_true(wrapped >= -(REAL)M_PI_LONG && wrapped <= (REAL)M_PI_LONG);
        long double exact = atan2l(sinl((long double)x), cosl((long double)x));
        /* At the ends of the interval the other end is as near. */
        if (fabsl(exact) > 3.14159L && (exact > 0.0L) != (wrapped > (REAL)0.0))
            exact += exact > 0.0L ? -2.0L * M_PI_LONG : 2.0L * M_PI_LONG;
        const long double error = NAME(ulps)(wrapped, exact);
        if (!(error < 1.0L)) fail_msg("x = %.17g: %.17g, %.2Lf ulp", (double)x, (double)wrapped, error);
    }
}
