/* SPDX-License-Identifier: MIT */
/* The monitor in one REAL beside the sums written out: every epoch of the window kept, inverted and added in double by LAPACKE. */

MK_MONITOR_OF(NAME(one), PRECISION, 2, 4, 1);
MK_MONITOR_OF(NAME(two), PRECISION, 2, 4, 2);
MK_MONITOR_OF(NAME(ten), PRECISION, 2, 4, 10);
MK_MONITOR_OF(NAME(drift), PRECISION, 1, 4, 10);

/* One epoch into the monitor, and its past. */
static mk_status_t NAME(feed)(const TYPE(mk_monitor_view) * view, past_t *past, int window, const epoch_t *epoch) {
    REAL r[MOST_ROWS], S[MK_PACKED(MOST_ROWS)];
    const int n = rows_of(epoch);
    for (int i = 0; i < n; i++) r[i] = (REAL)epoch->r[i];
    for (int i = 0; i < MK_PACKED(n); i++) S[i] = (REAL)epoch->S[i];
    past_push(past, window, epoch);
    return NAME(mk_monitor_watch)(view, epoch->sensors, epoch->id, epoch->rows, r, S);
}

/* Statistics of the last epoch and of the window, as the past says. */
static void NAME(compare)(const TYPE(mk_monitor_view) * view, const past_t *past, double tolerance) {
    const TYPE(mk_monitor) *const core = view->core;
    sums_t now, all;
    past_sum(past, past->count - 1, &now);
    past_sum(past, 0, &all);
    assert_int_equal(core->rows, now.n);
    assert_int_equal(core->window_rows, all.n);
    assert_int_equal(core->held, past->count);
    assert_close((double)core->rctm, statistic(&now), tolerance);
    assert_close((double)core->aime, statistic(&all), tolerance);
    const double rctm = now.n ? (double)core->rctm / (double)core->config->threshold[now.n - 1] : 0.0;
    const double aime = all.n ? (double)core->aime / (double)core->config->threshold[all.n - 1] : 0.0;
    assert_close((double)core->rctm_ratio, rctm, tolerance);
    assert_close((double)core->aime_ratio, aime, tolerance);
    for (int p = 0; p < core->config->places; p++) {
        if (!view->sensor[p].used) continue;
        const double w = statistic(&all) - without(&all, view->sensor[p].id);
        assert_true(fabs((double)view->sensor[p].w - w) <= tolerance * (1.0 + statistic(&all)));
    }
}

/* Sensors of one or two rows come and go, six of them at four places. */
static void NAME(stream)(const TYPE(mk_monitor_view) * view, int window, int epochs, double tolerance) {
    generator_t g = {(uint64_t)(77 + window)};
    static past_t past;
    past.count = 0;
    for (int t = 0; t < epochs; t++) {
        epoch_t epoch;
        const double presence = t / 40 % 2 ? 0.8 : 0.3; /* times with few readings, and some with none */
        epoch.sensors = 0;
        for (int k = 0; k < 6; k++) {
            const uint16_t id = (uint16_t)((t / 25 + k) % 6 * 1000); /* their order changes */
            int known = past_others(&past, window, &epoch, id);
            if (known > 3 || !draw_chance(&g, presence)) continue;
            epoch.id[epoch.sensors] = id;
            epoch.rows[epoch.sensors++] = (uint8_t)draw_below(&g, 3);
        }
        draw_epoch(&g, &epoch, 1.0);
        assert_int_equal(NAME(feed)(view, &past, window, &epoch), MK_OK);
        assert_int_equal(view->core->crowded, 0);
        NAME(compare)(view, &past, tolerance);
    }
    assert_int_equal(view->core->epoch, epochs);
}

static void NAME(windows)(void **unused) {
    (void)unused;
    static TYPE(one) one;
    static TYPE(two) two;
    static TYPE(ten) ten;
    REAL threshold[8], work[MK_MONITOR_WORK(8)];
    assert_int_equal(NAME(mk_gate_thresholds)(1e-6, 8, threshold), MK_OK);
    TYPE(mk_monitor_config) config = {.m = 2, .places = 4, .window = 1, .threshold = threshold, .scheme = MK_MONITOR_AIME};
    const double tolerance = sizeof(REAL) == 4 ? 2e-4 : 1e-11;
    assert_int_equal(ONE(start)(&one, &config), MK_OK);
    const TYPE(mk_monitor_view) first = ONE(view)(&one, work);
    NAME(stream)(&first, 1, 400, tolerance);
    config.window = 2;
    assert_int_equal(TWO(start)(&two, &config), MK_OK);
    const TYPE(mk_monitor_view) second = TWO(view)(&two, work);
    NAME(stream)(&second, 2, 400, tolerance);
    config.window = 10;
    assert_int_equal(TEN(start)(&ten, &config), MK_OK);
    const TYPE(mk_monitor_view) third = TEN(view)(&ten, work);
    NAME(stream)(&third, 10, 800, tolerance);
}

/* After so many epochs the sums are those of the last ten, to the rounding of ten additions. Information grows and shrinks by 1e4 over the run: what a
   running sum with subtraction would have left behind of the large numbers is larger than that. */
static void NAME(no_drift)(void **unused) {
    (void)unused;
    static TYPE(drift) monitor;
    static past_t past;
    REAL threshold[4], work[MK_MONITOR_WORK(4)];
    assert_int_equal(NAME(mk_gate_thresholds)(1e-6, 4, threshold), MK_OK);
    const TYPE(mk_monitor_config) config = {.m = 1, .places = 4, .window = 10, .threshold = threshold, .scheme = MK_MONITOR_AIME};
    assert_int_equal(DRIFT(start)(&monitor, &config), MK_OK);
    const TYPE(mk_monitor_view) view = DRIFT(view)(&monitor, work);
    generator_t g = {5};
    past.count = 0;
    double worst = 0.0;
    for (int t = 0; t < LONG_RUN; t++) {
        epoch_t epoch = {.sensors = 4, .id = {1, 2, 3, 4}, .rows = {1, 1, 1, 1}};
        quick_epoch(&g, &epoch, t / 50 % 2 ? 1e-4 : 1.0);
        if (t < LONG_RUN - 2000) past_push(&past, 10, &epoch);
        if (t < LONG_RUN - 2000) {
            REAL r[4], S[10];
            for (int i = 0; i < 4; i++) r[i] = (REAL)epoch.r[i];
            for (int i = 0; i < 10; i++) S[i] = (REAL)epoch.S[i];
            assert_int_equal(DRIFT(watch)(&monitor, 4, epoch.id, epoch.rows, r, S), MK_OK);
            continue;
        }
        assert_int_equal(NAME(feed)(&view, &past, 10, &epoch), MK_OK);
        sums_t all;
        past_sum(&past, 0, &all);
        const int front = monitor.core.front; /* the oldest of a full window is in the sum with which it starts, but where that was just made */
        if (front == 10) continue;
        for (int i = 0; i < 4; i++)
            for (int j = 0; j <= i; j++) {
                const int at = MK_PACKED(i) + j;
                const double older = front ? (double)monitor.information[(10 - front) * 10 + at] : 0.0, newer = (double)monitor.information[100 + at];
                worst = fmax(worst, fabs(older + newer - all.J[i * 4 + j]) / sqrt(all.J[i * 5] * all.J[j * 5]));
            }
    }
    print_message("- %s: error of the sums after %d epochs, in units of rounding: %.1f\n", sizeof(REAL) == 4 ? "float" : "double", LONG_RUN,
                  worst / (sizeof(REAL) == 4 ? (double)FLT_EPSILON : DBL_EPSILON));
    assert_true(worst < 16.0 * (sizeof(REAL) == 4 ? (double)FLT_EPSILON : DBL_EPSILON));
}
