/* SPDX-License-Identifier: MIT */
/* MK_WATCH on a filter that is nothing but what it needs of one. */

typedef struct {
    REAL value[3];
    uint8_t have[3];
    mk_status_t fails;
} TYPE(toy);

static mk_status_t NAME2(toy, innovations)(TYPE(toy) * f, REAL *r, REAL *S, uint8_t *rows) {
    int n = 0;
    for (int l = 0; l < 3; l++) {
        rows[l] = f->have[l];
        if (!rows[l]) continue;
        r[n] = f->value[l];
        for (int j = 0; j <= n; j++) S[MK_PACKED(n) + j] = j == n;
        n++;
    }
    return f->fails;
}

static mk_status_t NAME2(toy, drop)(TYPE(toy) * f, int slot) {
    f->have[slot] = 0;
    return MK_OK;
}

MK_WATCH_OF(NAME(toy), PRECISION, 1, 3, 4);

static void NAME(watching)(void **unused) {
    (void)unused;
    REAL threshold[3], zero[1], back[1];
    assert_int_equal(NAME(mk_gate_thresholds)(1e-6, 3, threshold), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-3, 1, zero), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(0.1, 1, back), MK_OK);
    const NAME2_T(toy, monitor_config) config = {.m = 1, .places = 3, .window = 4, .threshold = threshold, .evidence = 12, .zero = zero, .back = back,
                                                 .level = (REAL)0.01, .slope = (REAL)1e-4, .most = 1, .scheme = MK_MONITOR_EXCLUDE};
    NAME2_T(toy, monitor) monitor;
    assert_int_equal(NAME2(toy, monitor_start)(&monitor, &config), MK_OK);
    static const uint16_t id[3] = {30, 20, 10};
    for (int t = 0; t < 20; t++) {
        TYPE(toy) f = {{0, t >= 5 && t < 12 ? (REAL)12 : (REAL)0, 0}, {1, 1, 1}, MK_OK};
        assert_int_equal(NAME2(toy, watch)(&f, &monitor, id), MK_OK);
        const int faulty = t >= 5 && t < 12; /* left out in the epoch of the alarm, and back in that of the end */
        assert_true(f.have[0] && f.have[1] == !faulty && f.have[2]);
        assert_int_equal(monitor.core.ended, t == 12);
    }
    /* Where innovations cannot be had, what was faulty is left out all the same. */
    TYPE(toy) f = {{0, 12, 0}, {1, 1, 1}, MK_OK};
    assert_int_equal(NAME2(toy, watch)(&f, &monitor, id), MK_OK);
    f.have[1] = 1;
    f.fails = MK_ERROR_NOT_FINITE;
    const uint32_t epoch = monitor.core.epoch;
    assert_int_equal(NAME2(toy, watch)(&f, &monitor, id), MK_ERROR_NOT_FINITE);
    assert_true(f.have[0] && !f.have[1] && monitor.core.epoch == epoch);
}
