/* SPDX-License-Identifier: MIT */

MK_RKFD_OF(NAME(net), PRECISION, N, M, SLOTS);
MK_EXTENDED_OF(NAME(net), PRECISION, N, M, SLOTS);
MK_RKFD_OF(NAME(plain), PRECISION, N, M, SLOTS);
#define NET(function) JOIN(NAME(net), _##function)
#define PLAIN(function) JOIN(NAME(plain), _##function)

static const REAL NAME(A)[N * N] = {1, (REAL)0.5, (REAL)0.125, 0, 1, (REAL)0.5, 0, (REAL)-0.25, (REAL)0.75};
static const REAL NAME(C)[SLOTS * M * N] = {1, 0, 0, 0, (REAL)0.5, 1, (REAL)0.5, 1, 0, 0, 0, 0};
static const REAL NAME(R)[SLOTS][3] = {{(REAL)0.5, (REAL)0.125, (REAL)0.25}, {1, 0, 0}};
static const REAL NAME(Q)[6] = {(REAL)0.125, 0, (REAL)0.0625, 0, 0, (REAL)0.25}, NAME(x0)[N] = {1, -1, (REAL)0.5};
static const REAL NAME(P0)[6] = {2, 0, 1, 0, (REAL)0.25, 1};
static const REAL NAME(weight)[SLOTS] = {(REAL)0.625, (REAL)0.375};
static const uint8_t NAME(rows)[SLOTS] = {2, 1};

static mk_status_t NAME(refusal); /* what the models say */

static mk_status_t NAME(move)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    assert_ptr_equal(context, &NAME(rows));
    assert_true(dt == (REAL)0.25);
    for (int k = 0; k < count; k++)
        for (int i = 0; i < N; i++) {
            y[k * N + i] = i == 0 ? (REAL)0.25 : 0; /* an affine model: r */
            for (int j = 0; j < N; j++) y[k * N + i] += NAME(A)[i * N + j] * x[k * N + j];
        }
    return NAME(refusal);
}

static mk_status_t NAME(move_jacobian)(const void *context, REAL dt, const REAL *x, REAL *J) {
    (void)context;
    (void)dt;
    (void)x;
    memcpy(J, NAME(A), sizeof NAME(A));
    return MK_OK;
}

static mk_status_t NAME(see)(const void *context, REAL dt, int count, const REAL *x, REAL *y) {
    const int slot = *(const int *)context;
    assert_true(dt == 0 && count == 1);
    for (int r = 0; r < NAME(rows)[slot]; r++) {
        y[r] = 0;
        for (int j = 0; j < N; j++) y[r] += NAME(C)[(slot * M + r) * N + j] * x[j];
    }
    return MK_OK;
}

static mk_status_t NAME(see_jacobian)(const void *context, REAL dt, const REAL *x, REAL *J) {
    const int slot = *(const int *)context;
    (void)dt;
    (void)x;
    for (int i = 0; i < NAME(rows)[slot] * N; i++) J[i] = NAME(C)[slot * M * N + i];
    return NAME(refusal);
}

static const int NAME(slot)[SLOTS] = {0, 1};
static const OF(mk_transition, PRECISION) NAME(transition) = {{NAME(move), NAME(move_jacobian), &NAME(rows), 0}, 0, NAME(Q)};
static OF(mk_sensor, PRECISION) NAME(sensor)[SLOTS] = {{{NAME(see), NAME(see_jacobian), &NAME(slot)[0], 0}, NAME(R)[0], 2},
                                                        {{NAME(see), NAME(see_jacobian), &NAME(slot)[1], 0}, NAME(R)[1], 1}};

/* What the filter under test keeps in RAM. */
static REAL NAME(ram_A)[N * N], NAME(ram_Q)[6], NAME(ram_C)[SLOTS * M * N], NAME(ram_F)[SLOTS * M * N];
static REAL NAME(ram_S)[SLOTS * 6], NAME(ram_R)[SLOTS * 3];

static NET(extended_t) NAME(model)(void) {
    const NET(extended_t) model = {&NAME(transition), NAME(sensor), NAME(ram_A), NAME(ram_Q), NAME(ram_C), NAME(ram_F), NAME(ram_S), NAME(ram_R)};
    return model;
}

static NET(config_t) NAME(config)(REAL c) {
    const NET(config_t) config = {N,          M,           SLOTS,       NAME(ram_A), NAME(ram_Q), 0, NAME(x0), NAME(P0), NAME(weight),
                                  NAME(rows), NAME(ram_C), NAME(ram_F), NAME(ram_S), NAME(ram_R), c, 0};
    return config;
}

static void NAME(compare)(NET(t) * cut, PLAIN(t) * whole) {
    const REAL close = sizeof(REAL) == 4 ? (REAL)2e-5 : (REAL)1e-13;
    REAL V[6], wanted[6];
    assert_int_equal(NET(covariance)(cut, V), MK_OK);
    assert_int_equal(PLAIN(covariance)(whole, wanted), MK_OK);
    for (int i = 0; i < 6; i++) assert_true(fabs((double)(V[i] - wanted[i])) <= (double)close * 10);
    for (int i = 0; i < N; i++) assert_true(fabs((double)(NET(estimate)(cut)[i] - PLAIN(estimate)(whole)[i])) <= (double)close * 10);
}

static void NAME(both)(mk_status_t one, mk_status_t other) {
    assert_int_equal(one, MK_OK);
    assert_int_equal(other, MK_OK);
}

static void NAME(test_linear)(void **state) {
    static const REAL input[N] = {(REAL)0.25, 0, 0};
    (void)state;
    for (int robust = 0; robust < 2; robust++) {
        const REAL c = robust ? (REAL)0.05 : 0;
        REAL F[SLOTS * M * N], S[SLOTS * 6], R_inverse[SLOTS * 3], work[3 * 3];
        for (int l = 0; l < SLOTS; l++)
            assert_int_equal(NAME(mk_rkfd_sensor)(N, M, NAME(rows)[l], NAME(C) + l * M * N, NAME(R)[l], F + l * M * N, S + l * 6,
                                                  R_inverse + l * 3, work),
                             MK_OK);
        const PLAIN(config_t) ready = {N, M, SLOTS, NAME(A), NAME(Q), input, NAME(x0), NAME(P0), NAME(weight), NAME(rows), NAME(C),
                                       F, S, R_inverse, c, 0};
        const NET(extended_t) model = NAME(model)();
        const NET(config_t) config = NAME(config)(c);
        NET(t) cut;
        PLAIN(t) whole;
        assert_int_equal(NET(start)(&cut, &config), MK_OK);
        assert_int_equal(PLAIN(start)(&whole, &ready), MK_OK);
        for (int t = 0; t < STEPS; t++) {
            const REAL own[M] = {(REAL)(t % 7) - 3, (REAL)(t % 5) - 1}, heard[M] = {(REAL)(t % 4), 0};
            if (t % 3) NAME(both)(NET(observe)(&cut, &model, 0, own), PLAIN(put_measurement)(&whole, 0, own));
            if (t % 4) NAME(both)(NET(observe)(&cut, &model, 1, heard), PLAIN(put_measurement)(&whole, 1, heard));
            assert_int_equal(NET(correct)(&cut, &model), MK_OK);
            assert_int_equal(PLAIN(incremental)(&whole, 0), MK_OK);
            assert_int_equal(cut.core.nis_rows, whole.core.nis_rows);
            assert_true(fabs((double)(cut.core.nis - whole.core.nis)) <= 1e-4 * (1 + (double)whole.core.nis));
            if (t % 5) {
                /* The neighbour's estimate before its prediction, and after it. */
                const REAL psi[N] = {(REAL)0.5, 1, (REAL)(t % 3)};
                REAL moved[N];
                (void)NAME(move)(&NAME(rows), (REAL)0.25, 1, psi, moved);
                NAME(both)(NET(put_estimate)(&cut, 1, psi), PLAIN(put_estimate)(&whole, 1, moved));
            }
            NAME(both)(NET(diffuse)(&cut), PLAIN(diffuse)(&whole));
            const REAL nis = cut.core.nis;
            assert_int_equal(NET(propagate)(&cut, &model, (REAL)0.25, 0), MK_OK);
            assert_true(cut.core.nis == nis && cut.core.nis_rows == whole.core.nis_rows && cut.core.steps == (uint32_t)t + 1);
            assert_true(robust == (cut.core.theta > 0));
            assert_true(fabs((double)(cut.core.theta - whole.core.theta)) <= 1e-4);
            NAME(compare)(&cut, &whole);
        }
    }
}

/* The call fails with this status and leaves the filter as it was, but for what counts refusals. */
#define REFUSES(status, call)                                                                                                 \
    do {                                                                                                                      \
        NET(t) before_ = f;                                                                                                   \
        assert_int_equal(call, status);                                                                                       \
        before_.core.rejected = f.core.rejected;                                                                              \
        before_.core.rejected_now = f.core.rejected_now;                                                                      \
        assert_memory_equal(before_.x, f.x, sizeof f.x);                                                                      \
        assert_memory_equal(before_.W, f.W, sizeof f.W);                                                                      \
        assert_memory_equal(before_.have_y, f.have_y, sizeof f.have_y);                                                       \
        assert_memory_equal(&before_.core, &f.core, sizeof f.core);                                                           \
    } while (0)

static void NAME(test_contract)(void **state) {
    const NET(extended_t) model = NAME(model)();
    const NET(config_t) config = NAME(config)(0);
    const REAL z[M] = {1, 2}, bad[M] = {1, (REAL)NAN};
    NET(t) f;
    (void)state;
    memset(&f, 0, sizeof f);
    REFUSES(MK_ERROR_ORDER, NET(observe)(&f, &model, 0, z));
    REFUSES(MK_ERROR_ORDER, NET(correct)(&f, &model));
    REFUSES(MK_ERROR_ORDER, NET(propagate)(&f, &model, 1, 0));
    assert_int_equal(NET(start)(&f, &config), MK_OK);
    REFUSES(MK_ERROR_ARGUMENT, NET(observe)(&f, &model, SLOTS, z));
    REFUSES(MK_ERROR_ARGUMENT, NET(observe)(&f, &model, -1, z));
    REFUSES(MK_ERROR_ARGUMENT, NET(observe)(&f, &model, 0, 0));
    REFUSES(MK_ERROR_ARGUMENT, NET(observe)(&f, 0, 0, z));
    REFUSES(MK_ERROR_NOT_FINITE, NET(observe)(&f, &model, 0, bad));
    assert_int_equal(f.core.rejected, 1);
    assert_int_equal(NET(observe)(&f, &model, 0, z), MK_OK);
    REFUSES(MK_ERROR_REPEATED, NET(observe)(&f, &model, 0, z));
    REFUSES(MK_ERROR_ORDER, NET(propagate)(&f, &model, (REAL)0.25, 0));
    REFUSES(MK_ERROR_ARGUMENT, NET(correct)(&f, 0));
    assert_int_equal(NET(correct)(&f, &model), MK_OK);
    REFUSES(MK_ERROR_ORDER, NET(correct)(&f, &model));
    REFUSES(MK_ERROR_ORDER, NET(observe)(&f, &model, 1, z));
    REFUSES(MK_ERROR_ORDER, NET(propagate)(&f, &model, (REAL)0.25, 0));
    assert_int_equal(NET(diffuse)(&f), MK_OK);
    REFUSES(MK_ERROR_ARGUMENT, NET(propagate)(&f, &model, (REAL)-0.25, 0));
    REFUSES(MK_ERROR_ARGUMENT, NET(propagate)(&f, &model, (REAL)NAN, 0));
    REFUSES(MK_ERROR_ARGUMENT, NET(propagate)(&f, 0, (REAL)0.25, 0));
    assert_int_equal(NET(propagate)(&f, &model, (REAL)0.25, 0), MK_OK);
}

static void NAME(test_failures)(void **state) {
    NET(extended_t) model = NAME(model)();
    const NET(config_t) config = NAME(config)(0);
    const REAL z[M] = {1, 2}, singular[3] = {1, 1, 1}, nan_Q[6] = {(REAL)NAN, 0, 1, 0, 0, 1}, negative[6] = {-100, 0, 1, 0, 0, 1};
    NET(t) f;
    (void)state;
    assert_int_equal(NET(start)(&f, &config), MK_OK);
    NAME(refusal) = MK_ERROR_DOMAIN;
    REFUSES(MK_ERROR_DOMAIN, NET(observe)(&f, &model, 0, z));
    REFUSES(MK_ERROR_DOMAIN, NET(propagate)(&f, &model, (REAL)0.25, 0));
    NAME(refusal) = MK_OK;
    NAME(sensor)[0].R = singular;
    REFUSES(MK_ERROR_NOT_POSITIVE_DEFINITE, NET(observe)(&f, &model, 0, z));
    NAME(sensor)[0].R = NAME(R)[0];
    REFUSES(MK_ERROR_NOT_FINITE, NET(propagate)(&f, &model, (REAL)0.25, nan_Q));
    REFUSES(MK_ERROR_NOT_POSITIVE_DEFINITE, NET(propagate)(&f, &model, (REAL)0.25, negative));
    const OF(mk_jacobian, PRECISION) jacobian = NAME(sensor)[0].model.jacobian;
    NAME(sensor)[0].model.jacobian = 0;
    REFUSES(MK_ERROR_ARGUMENT, NET(observe)(&f, &model, 0, z));
    NAME(sensor)[0].model.jacobian = jacobian;
    assert_int_equal(NET(observe)(&f, &model, 0, z), MK_OK);
}
#undef REFUSES
#undef NET
#undef PLAIN
