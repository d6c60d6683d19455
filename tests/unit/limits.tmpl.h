/* SPDX-License-Identifier: MIT */
/* The ends of memory and of the number range, in one REAL; test_limits.c includes this once for each. */

enum { NAME(GUARD) = 64 };

/* Largest and smallest numbers whose square is out of range. */
static const REAL NAME(huge) = sizeof(REAL) == sizeof(float) ? (REAL)1e30 : (REAL)1e250;
static const REAL NAME(minute) = sizeof(REAL) == sizeof(float) ? (REAL)1e-30 : (REAL)1e-250;

static void NAME(guard)(int count, REAL *work) {
    for (int i = 0; i < count + NAME(GUARD); i++) work[i] = (REAL)12345.0;
}

/* How many of the numbers behind work[count - 1] were written. */
static int NAME(overrun)(int count, const REAL *work) {
    int last = 0;
    for (int i = 0; i < NAME(GUARD); i++)
        if (!(work[count + i] == (REAL)12345.0)) last = i + 1;
    return last;
}

/* work: 3 MK_PACKED(m) numbers, says the header. */
static void NAME(sensor_work)(void **unused) {
    (void)unused;
    int worst = 0, at = 0;
    for (int m = 1; m <= 4; m++) {
        REAL C[4] = {(REAL)1.0, (REAL)2.0, (REAL)3.0, (REAL)4.0}, R[10], F[4], S[1], R_inverse[10], work[30 + NAME(GUARD)];
        for (int i = 0; i < m; i++)
            for (int j = 0; j <= i; j++) R[MK_PACKED(i) + j] = i == j ? (REAL)2.0 : (REAL)0.5;
        NAME(guard)(3 * MK_PACKED(m), work);
        assert_int_equal(NAME(mk_rkfd_sensor)(1, m, m, C, R, F, S, R_inverse, work), MK_OK);
        if (NAME(overrun)(3 * MK_PACKED(m), work) > worst) {
            worst = NAME(overrun)(3 * MK_PACKED(m), work);
            at = m;
        }
    }
    if (worst) fail_msg("mk_rkfd_sensor wrote %d numbers beyond 3 MK_PACKED(m), m = %d", worst, at);
}

/* MK_RKFD_WORK(n, m) is enough for every kernel at every shape, MK_RKFD_PREDICT_WORK(n, m) for predict, MK_GAMMA_WORK(n) for the root. */
static void NAME(filter_work)(void **unused) {
    (void)unused;
    static const char *const calls[] = {"start", "predict", "incremental", "diffuse", "covariance", "restart", "gamma_root"};
    enum { CALLS = 7, N = 8, M = 6, MOST = MK_RKFD_WORK(N, M) + MK_RKFD_PREDICT_WORK(N, M) };
    int worst[CALLS] = {0}, worst_n[CALLS] = {0}, worst_m[CALLS] = {0}, failed = 0;
    for (int n = 1; n <= N; n++) {
        for (int m = 1; m <= M; m++) {
            REAL A[N * N] = {(REAL)0.0}, P[MK_PACKED(N)] = {(REAL)0.0}, x0[N] = {(REAL)0.0}, C[M * N] = {(REAL)0.0}, F[M * N];
            REAL S[MK_PACKED(N)], R[MK_PACKED(M)], R_inverse[MK_PACKED(M)], sensor_work[3 * MK_PACKED(M)], weight = (REAL)1.0, y[M], e[M];
            REAL E[MK_PACKED(M)], V[MK_PACKED(N)], theta, work[MOST + NAME(GUARD)];
            const uint8_t rows = (uint8_t)m;
            for (int i = 0; i < n; i++)
                for (int j = 0; j <= i; j++) P[MK_PACKED(i) + j] = i == j ? (REAL)(2 + i) : (REAL)0.25;
            for (int i = 0; i < n; i++) A[i * n + i] = (REAL)0.75;
            for (int i = 0; i < m; i++) {
                for (int j = 0; j <= i; j++) R[MK_PACKED(i) + j] = i == j ? (REAL)2.0 : (REAL)0.25;
                C[i * n + i % n] = y[i] = (REAL)1.0;
            }
            assert_int_equal(NAME(mk_rkfd_sensor)(n, m, m, C, R, F, S, R_inverse, sensor_work), MK_OK);
            const TYPE(mk_rkfd_config) config = {(uint16_t)n, (uint16_t)m, 1,    A, P, NULL,      x0,        P,
                                                 &weight,     &rows,       C,    F, S, R_inverse, (REAL)0.02, NULL};
            TYPE(mk_rkfd) core;
            REAL x[N], W[MK_PACKED(N)], readings[M], psi[N];
            uint8_t have_y, have_psi;
            TYPE(mk_rkfd_view) view;
            view.core = &core;
            view.x = x;
            view.W = W;
            view.y = readings;
            view.psi = psi;
            view.have_y = &have_y;
            view.have_psi = &have_psi;
            view.work = work;
            for (int call = 0; call < CALLS; call++) {
                const int count = call == 6   ? MK_GAMMA_WORK(n)
                                  : call == 1 ? MK_RKFD_PREDICT_WORK(n, m)
                                  : call == 3 ? n /* what the typed function has */
                                              : MK_RKFD_WORK(n, m);
                mk_status_t status = MK_OK;
                NAME(guard)(count, work);
                switch (call) {
                case 0: status = NAME(mk_rkfd_start)(n, m, 1, &view, &config); break;
                case 1:
                    assert_int_equal(NAME(mk_rkfd_put)(n, m, &view, 0, y, 0), MK_OK);
                    status = NAME(mk_rkfd_predict)(n, m, &view, 0, e, E);
                    break;
                case 2: status = NAME(mk_rkfd_incremental)(n, m, 1, &view, NULL); break;
                case 3: status = NAME(mk_rkfd_diffuse)(n, 1, &view); break;
                case 4: status = NAME(mk_rkfd_covariance)(n, &view, V); break;
                case 5: status = NAME(mk_rkfd_restart)(n, 1, &view, x0, P); break;
                default: assert_true(NAME(mk_gamma_root)(n, P, (REAL)0.02, &theta, work) > 0); break;
                }
                assert_int_equal(status, MK_OK);
                if (NAME(overrun)(count, work) > worst[call]) {
                    worst[call] = NAME(overrun)(count, work);
                    worst_n[call] = n;
                    worst_m[call] = m;
                }
            }
        }
    }
    for (int call = 0; call < CALLS; call++) {
        if (!worst[call]) continue;
        print_error("%s wrote up to %d numbers beyond its work (n = %d, m = %d)\n", calls[call], worst[call], worst_n[call],
                    worst_m[call]);
        failed = 1;
    }
    assert_false(failed);
}

/* MK_OK and something that is not a number do not go together. */
static void NAME(sensor_overflow)(void **unused) {
    (void)unused;
    const REAL C[] = {NAME(huge)}, R[] = {NAME(minute)};
    REAL F[1], S[1], R_inverse[1], work[3];
    const mk_status_t status = NAME(mk_rkfd_sensor)(1, 1, 1, C, R, F, S, R_inverse, work);
    if (status == MK_OK && !(isfinite(F[0]) && isfinite(S[0])))
        fail_msg("mk_rkfd_sensor returned MK_OK with F %g, S %g", (double)F[0], (double)S[0]);
}

static void NAME(predict_overflow)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    REAL e[2], E[3];
    const REAL most = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MAX : (REAL)DBL_MAX;
    const REAL far[] = {-most, (REAL)0.0}, reading[] = {most, (REAL)0.0};
    NAME(bench_start)(&b);
    assert_int_equal(TINY(restart)(&b.filter, far, b.P0), MK_OK);
    assert_int_equal(TINY(put_measurement)(&b.filter, 1, reading), MK_OK);
    const mk_status_t status = TINY(predict)(&b.filter, 1, e, E);
    if (status == MK_OK && !isfinite(e[0])) fail_msg("predict returned MK_OK with the innovation %g", (double)e[0]);
}

/* A reading so far off that its square overflows: whatever the step does with it, nis must not say that all is well. */
static void NAME(huge_reading)(void **unused) {
    (void)unused;
    TYPE(bench) b;
    const REAL reading[] = {NAME(huge), (REAL)0.0};
    NAME(bench_start)(&b);
    assert_int_equal(TINY(put_measurement)(&b.filter, 1, reading), MK_OK);
    TYPE(tiny) before;
    memcpy(&before, &b.filter, sizeof before);
    const mk_status_t status = TINY(incremental)(&b.filter, NULL);
    if (status != MK_OK) assert_memory_equal(&before, &b.filter, sizeof before);
    else if (!(b.filter.core.nis > (REAL)1e6)) fail_msg("reading %g: MK_OK and nis %g", (double)reading[0], (double)b.filter.core.nis);
}

/* P = size I, with c = 0, where no root search speaks up. */
static void NAME(covariance_of_size)(REAL size) {
    TYPE(bench) b;
    NAME(bench_start)(&b);
    memset(b.A, 0, sizeof b.A);
    b.Q[0] = b.Q[2] = size;
    b.Q[1] = (REAL)0.0;
    assert_int_equal(TINY(set_tolerance)(&b.filter, (REAL)0.0), MK_OK);
    TYPE(tiny) before;
    memcpy(&before, &b.filter, sizeof before);
    const mk_status_t status = TINY(incremental)(&b.filter, NULL);
    if (status != MK_OK) assert_memory_equal(&before, &b.filter, sizeof before);
    else if (!isfinite(b.filter.core.trace_P) || !isfinite(b.filter.W[0]) || !(b.filter.W[0] > (REAL)0.0))
        fail_msg("P = %g I: MK_OK with trace_P %g, W %g", (double)size, (double)b.filter.core.trace_P, (double)b.filter.W[0]);
}

/* The largest has a trace that overflows. */
static void NAME(large_covariance)(void **unused) {
    (void)unused;
    const REAL most = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MAX : (REAL)DBL_MAX;
    NAME(covariance_of_size)(NAME(huge));
    NAME(covariance_of_size)((REAL)0.25 * most);
    NAME(covariance_of_size)((REAL)0.99 * most);
}

/* The smallest has an inverse that overflows. */
static void NAME(small_covariance)(void **unused) {
    (void)unused;
    const REAL least = sizeof(REAL) == sizeof(float) ? (REAL)FLT_MIN : (REAL)DBL_MIN;
    NAME(covariance_of_size)(NAME(minute));
    NAME(covariance_of_size)(least);
    NAME(covariance_of_size)((REAL)0.125 * least);
}

/* One node without neighbours and without a reading for 1e4 steps: finite numbers or a status, and no change after one. */
static void NAME(silence)(void **unused) {
    (void)unused;
    static const double factors[] = {0.5, 0.999, 1.0, 1.5, -1.5, 1e10};
    static const double tolerances[] = {0.0, 0.02, 1.0};
    for (int k = 0; k < 18; k++) {
        const REAL A = (REAL)factors[k % 6], Q = (REAL)0.5, x0 = (REAL)1.0, P0 = (REAL)2.0, weight = (REAL)1.0;
        const REAL C = (REAL)1.0, F = (REAL)1.0, S = (REAL)1.0;
        const uint8_t rows = 1;
        const TYPE(mk_rkfd_config) config = {1, 1, 1, &A, &Q, NULL, &x0, &P0, &weight, &rows, &C, &F, &S, &S, (REAL)tolerances[k / 6], NULL};
        TYPE(lone) f;
        int failed = 0;
        memset(&f, 0, sizeof f);
        assert_int_equal(LONE(start)(&f, &config), MK_OK);
        for (int step = 0; step < 10000; step++) {
            TYPE(lone) before;
            memcpy(&before, &f, sizeof f);
            const mk_status_t status = LONE(incremental)(&f, NULL);
            if (status != MK_OK) assert_memory_equal(&before, &f, sizeof f);
            else assert_int_equal(LONE(diffuse)(&f), MK_OK);
            failed |= status != MK_OK;
            if (failed) assert_true(status != MK_OK);
            assert_true(isfinite(f.x[0]) && isfinite(f.W[0]) && f.W[0] > (REAL)0.0);
            assert_true(isfinite(f.core.theta) && isfinite(f.core.trace_P) && f.core.nis == (REAL)0.0);
        }
        if (k % 6 == 0) assert_int_equal(failed, 0);
        if (k % 6 >= 3) assert_int_equal(failed, 1);
        if (!failed) assert_true(f.core.steps == 10000 && f.core.steps_since_measurement == 10000);
        if (k == 0) assert_true(fabs((double)f.W[0] * (0.5 / 0.75) - 1.0) < 1e-5); /* P = A P A + Q */
        /* The way back, to a step that any of these can do. */
        assert_int_equal(LONE(restart)(&f, &x0, &P0), MK_OK);
        assert_int_equal(LONE(incremental)(&f, NULL), MK_OK);
    }
}
