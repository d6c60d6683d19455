/* SPDX-License-Identifier: MIT */
/* The schemes of meshkal/monitor.h: who alarms when, who is held faulty, and until when. */

static void NAME(alarms)(void **unused) {
    (void)unused;
    TYPE(stand) rctm, aime;
    NAME(stand_up)(&rctm, MK_MONITOR_RCTM);
    NAME(stand_up)(&aime, MK_MONITOR_AIME);
    /* 3.8 standard deviations in one sensor: too little for one epoch, enough for three. A single reading of 6 is too little among four. */
    const double values[] = {0, 3.8, 3.8, 3.8, 0, 0, 0, 0, 6, 0, 0, 0, 12, 0};
    const int by_rctm[] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0}, by_aime[] = {0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1};
    for (int t = 0; t < 14; t++) {
        assert_int_equal(NAME(tell)(&rctm, 7, values[t], 0, 0), MK_OK);
        assert_int_equal(NAME(tell)(&aime, 7, values[t], 0, 0), MK_OK);
        assert_int_equal(rctm.monitor.core.alarm, by_rctm[t]);
        assert_int_equal(aime.monitor.core.alarm, by_aime[t]);
        assert_true(aime.monitor.core.aime == rctm.monitor.core.aime && aime.monitor.core.rctm == rctm.monitor.core.rctm);
        assert_int_equal(aime.monitor.core.alarm, aime.monitor.core.aime_ratio >= 1);
        assert_int_equal(rctm.monitor.core.alarm, rctm.monitor.core.rctm_ratio >= 1);
    }
    assert_true(rctm.monitor.core.alarms == 2 && rctm.monitor.core.alarm_since == 13);
    assert_true(aime.monitor.core.alarms == 2 && aime.monitor.core.alarm_since == 13);
    assert_int_equal(aime.monitor.core.faulty, 0);
}

/* The published decision against its definition, epoch by epoch: rho from the statistics of a monitor that only tests, and their median. */
static void NAME(improved)(void **unused) {
    (void)unused;
    TYPE(stand) s, plain;
    NAME(stand_up)(&s, MK_MONITOR_IMPROVED);
    NAME(stand_up)(&plain, MK_MONITOR_AIME);
    double rhos[3] = {1, 1, 1};
    int ended = 0, since = 0;
    for (int t = 1; t <= 60; t++) {
        const double fault = t > 20 && t <= 34 ? 0.9 * (t - 20) : 0.0, noise = 0.3 * ((t * 7) % 5 - 2);
        assert_int_equal(NAME(tell)(&s, 7, fault + noise, -noise, 0.2), MK_OK);
        if (!ended) assert_int_equal(NAME(tell)(&plain, 7, fault + noise, -noise, 0.2), MK_OK);
        const TYPE(mk_monitor) *const core = &s.monitor.core;
        if (!ended) {
            since = plain.monitor.core.alarm ? since + 1 : 0;
            for (int i = 0; i < 2; i++) rhos[i] = rhos[i + 1];
            rhos[2] = since ? (double)plain.monitor.core.aime / fmax((double)plain.monitor.core.rctm, 0.1) : 1.0;
            const double low = fmin(rhos[0], rhos[1]), high = fmax(rhos[0], rhos[1]), median = fmax(low, fmin(high, rhos[2]));
            assert_close((double)core->rho, rhos[2], 1e-5);
            assert_close((double)core->median, median, 1e-5);
            const int over = since >= 3 && rhos[2] - median > 8;
            assert_int_equal(core->ended, over);
            assert_int_equal(core->alarm, since > 0 && !over);
            if (over) ended = t;
        } else {
            assert_int_equal(core->quiet, ended + 4 > t ? ended + 4 - t : 0);
            assert_int_equal(core->held, t <= ended + 4 ? 0 : t < ended + 8 ? t - ended - 4 : 4);
            assert_false(core->alarm);
            assert_true(core->rows == 3 && core->rctm > 0 && core->rho == 1);
        }
    }
    assert_int_equal(ended, 35);
    assert_true(s.monitor.core.ends == 1 && s.monitor.core.alarms == 1);
}

/* While it is alone, RCTM alarms. */
static void NAME(improved_quiet)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_IMPROVED);
    for (int t = 0; t < 4; t++) assert_int_equal(NAME(tell)(&s, 7, 8, 0, 0), MK_OK);
    assert_int_equal(NAME(tell)(&s, 7, 0.1, 0.1, 0), MK_OK);
    assert_true(s.monitor.core.ended && !s.monitor.core.alarm);
    assert_int_equal(NAME(tell)(&s, 7, 6, 0, 0), MK_OK);
    assert_true(s.monitor.core.alarm && s.monitor.core.alarm_since == 6 && s.monitor.core.window_rows == 0 && !s.monitor.core.ended);
    assert_int_equal(NAME(tell)(&s, 7, 0, 0, 0), MK_OK);
    assert_false(s.monitor.core.alarm);
    assert_int_equal(SMALL(restart)(&s.monitor), MK_OK);
    assert_true(s.monitor.core.quiet == 0 && s.monitor.core.epoch == 7 && s.monitor.core.alarms == 2);
}

static void NAME(exclude)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    TYPE(mk_monitor) *const core = &s.monitor.core;
    for (int t = 1; t <= 10; t++) assert_int_equal(NAME(tell)(&s, 7, 0.3, -0.5, 0.4), MK_OK);
    assert_int_equal(NAME(tell)(&s, 7, 0.3, 16, 0.4), MK_OK);
    assert_true(core->alarm && core->faulty == 1 && !core->unresolved && core->held == 0 && core->rows == 3);
    assert_true(SMALL(faulty)(&s.monitor, 2) && !SMALL(faulty)(&s.monitor, 1) && !SMALL(faulty)(&s.monitor, 9));
    assert_int_equal(NAME(sensor)(&s, 2)->since, 11);
    for (int t = 12; t <= 30; t++) {
        /* Also where it is not read, and where nothing is. */
        assert_int_equal(NAME(tell)(&s, t % 7 == 0 ? 0 : t % 3 ? 7 : 5, 0.3, 16 + 0.1 * (t - 11), 0.4), MK_OK);
        assert_true(core->faulty == 1 && !core->alarm && !core->ended);
        if (t > 21) assert_int_equal(core->window_rows, 2);
        assert_true(NAME(sensor)(&s, 2)->w == 0);
    }
    assert_true(fabs((double)s.monitor.fault[2].level - 17.9) < 3.0);
    assert_int_equal(NAME(tell)(&s, 7, 0.3, 0.2, 0.4), MK_OK);
    assert_true(core->ended && core->ends == 1 && core->faulty == 0 && !SMALL(faulty)(&s.monitor, 2));
    const TYPE(mk_watched) *const back = NAME(sensor)(&s, 2);
    assert_true(back->until == 31 && back->since == 11 && back->faults == 1 && back->ratio > 1);
    assert_int_equal(NAME(tell)(&s, 7, 0.3, 0.2, 0.4), MK_OK);
    assert_true(NAME(sensor)(&s, 2) == back && back->faults == 1 && back->ratio == 0 && core->window_rows == 3 && core->held == 4);
    assert_true(!core->ended && core->ends == 1);
}

/* A leap of one, where what the window holds beside it was known better: no offset of the window explains it, this epoch does. */
static void NAME(leap)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    s.config.most = 1;
    const uint16_t id[] = {1, 2, 3};
    const uint8_t rows[] = {1, 1, 1};
    const REAL quiet[] = {(REAL)0.1, 0, 0}, apart[] = {1, 0, 1, 0, 0, 1}, bound[] = {4, 3, 4, 3, 3, 4};
    const REAL leap[] = {0, 1000, 0}, many[] = {1000, 1000, -2000};
    for (int t = 0; t < 2; t++) assert_int_equal(SMALL(watch)(&s.monitor, 3, id, rows, quiet, apart), MK_OK);
    assert_int_equal(SMALL(watch)(&s.monitor, 3, id, rows, many, bound), MK_OK); /* the epoch explains it no better */
    assert_true(s.monitor.core.alarm && s.monitor.core.unresolved && s.monitor.core.faulty == 0);
    assert_int_equal(SMALL(restart)(&s.monitor), MK_OK);
    for (int t = 0; t < 2; t++) assert_int_equal(SMALL(watch)(&s.monitor, 3, id, rows, quiet, apart), MK_OK);
    assert_int_equal(SMALL(watch)(&s.monitor, 3, id, rows, leap, bound), MK_OK);
    const TYPE(mk_monitor) *const core = &s.monitor.core;
    assert_true(core->alarm && !core->unresolved && core->faulty == 1 && SMALL(faulty)(&s.monitor, 2) && core->held == 0);
    assert_close((double)s.monitor.fault[2].level, 500.0, 1e-5); /* of this epoch: 1000 / 2 */
}

/* A sensor that went with an absurd slope and was away until its tracker had run out of range: once it is back it is not held for ever. */
static void NAME(run_away)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    assert_int_equal(NAME(tell)(&s, 7, 0.3, 30, 0.4), MK_OK);
    assert_true(SMALL(faulty)(&s.monitor, 2));
    s.monitor.fault[2].slope = sizeof(REAL) == 4 ? (REAL)1e18 : (REAL)1e154;
    for (int t = 0; t < 100; t++) assert_int_equal(NAME(tell)(&s, 5, 0.3, 0, 0.4), MK_OK);
    int t = 0;
    while (SMALL(faulty)(&s.monitor, 2) && t < 20) {
        assert_int_equal(NAME(tell)(&s, 7, 0.3, 0.2, 0.4), MK_OK);
        t++;
    }
    assert_in_range(t, 2, 10);
}

/* A wrong isolation, or a fault that went while nobody could see it, is taken back at the end of a window. */
static void NAME(taken_back)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    s.config.evidence = 1000;
    assert_int_equal(NAME(tell)(&s, 7, 0.3, 7, 0.4), MK_OK);
    assert_true(SMALL(faulty)(&s.monitor, 2));
    for (int t = 0; t < 8; t++) {
        assert_int_equal(NAME(tell)(&s, 7, 0.3, t < 4 ? 2 : t % 2 ? 0.5 : -0.9, 0.4), MK_OK);
        assert_int_equal(s.monitor.core.ended, t == 7); /* the sum of the first four is 8, of the others -0.8 */
    }
    assert_false(SMALL(faulty)(&s.monitor, 2));
}

/* The fault jumps to another value, near to none but not there: it is not over. */
static void NAME(another_value)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    for (int t = 0; t < 9; t++) assert_int_equal(NAME(tell)(&s, 7, 0.3, 14, 0.4), MK_OK);
    assert_int_equal(NAME(tell)(&s, 7, 0.3, 4.5, 0.4), MK_OK);
    assert_true(SMALL(faulty)(&s.monitor, 2) && s.monitor.sensor[1].ratio > 1 && s.monitor.sensor[1].evidence == 0);
    assert_close((double)s.monitor.fault[2].level, 4.5, 1e-6);
    for (int t = 0; t < 9; t++) assert_int_equal(NAME(tell)(&s, 7, 0.3, 4.5, 0.4), MK_OK);
    assert_true(SMALL(faulty)(&s.monitor, 2) && s.monitor.core.ends == 0);
    assert_int_equal(SMALL(clear)(&s.monitor, 1), MK_ERROR_ARGUMENT);
    assert_int_equal(SMALL(clear)(&s.monitor, 9), MK_ERROR_ARGUMENT);
    assert_int_equal(SMALL(clear)(&s.monitor, 2), MK_OK);
    assert_true(!SMALL(faulty)(&s.monitor, 2) && s.monitor.core.faulty == 0 && s.monitor.core.ends == 0);
    assert_int_equal(SMALL(clear)(&s.monitor, 2), MK_ERROR_ARGUMENT);
}

static void NAME(all_faulty)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    s.config.most = 3;
    TYPE(mk_monitor) *const core = &s.monitor.core;
    assert_int_equal(NAME(tell)(&s, 7, 0, 7, 0), MK_OK);
    assert_int_equal(NAME(tell)(&s, 7, 6, 7, 0), MK_OK);
    assert_int_equal(NAME(tell)(&s, 7, 6, 7, 6), MK_OK);
    assert_true(core->faulty == 3 && core->alarm);
    for (int t = 0; t < 9; t++) {
        assert_int_equal(NAME(tell)(&s, t % 2 ? 7 : 5, 6, 7, 6), MK_OK);
        assert_true(core->faulty == 3 && !core->alarm && core->rows == 0 && core->window_rows == 0 && core->rctm == 0 && core->aime == 0);
    }
    /* One is gone for long: its place is kept, and nobody has it. */
    for (int t = 0; t < 12; t++) assert_int_equal(NAME(tell)(&s, 5, 6, 7, 6), MK_OK);
    assert_true(NAME(sensor)(&s, 2) && SMALL(faulty)(&s.monitor, 2));
    const uint16_t stranger[] = {4};
    const uint8_t row[] = {1};
    const REAL r[] = {0}, S[] = {1};
    assert_int_equal(SMALL(watch)(&s.monitor, 1, stranger, row, r, S), MK_OK);
    assert_int_equal(core->crowded, 1);
    assert_int_equal(SMALL(restart)(&s.monitor), MK_OK);
    assert_true(core->faulty == 0 && core->crowded == 1 && !SMALL(faulty)(&s.monitor, 2));
    assert_int_equal(SMALL(watch)(&s.monitor, 1, stranger, row, r, S), MK_OK);
    assert_true(core->crowded == 1 && core->window_rows == 1);
}

/* An alarm that no `most` sensors explain, or that two explain as well. */
static void NAME(unresolved)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    s.config.most = 1;
    assert_int_equal(NAME(tell)(&s, 7, 9, 9, -9), MK_OK);
    assert_true(s.monitor.core.alarm && s.monitor.core.unresolved && s.monitor.core.faulty == 0 && s.monitor.core.held == 1);
    /* Not for ever: the first suspect, without the others, is held in the end. */
    s.config.patience = 2;
    assert_int_equal(NAME(tell)(&s, 7, 9, 9, -9), MK_OK);
    assert_true(s.monitor.core.unresolved && s.monitor.core.waited == 2);
    assert_int_equal(NAME(tell)(&s, 7, 9, 9, -9), MK_OK);
    assert_true(s.monitor.core.alarm && !s.monitor.core.unresolved && s.monitor.core.faulty == 1 && s.monitor.core.waited == 0);
    assert_true(SMALL(faulty)(&s.monitor, 3)); /* all stand out, this one to the other side of what they have in common */
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    s.config.separation = 6;
    assert_int_equal(NAME(tell)(&s, 3, 5.0, -4.6, 0), MK_OK);
    assert_true(s.monitor.core.alarm && s.monitor.core.unresolved && s.monitor.core.faulty == 0);
    assert_true(fabs((double)(NAME(sensor)(&s, 1)->w - NAME(sensor)(&s, 2)->w)) < 6);
    s.config.separation = (REAL)3.5;
    assert_int_equal(SMALL(restart)(&s.monitor), MK_OK);
    assert_int_equal(NAME(tell)(&s, 3, 5.0, -4.6, 0), MK_OK);
    assert_true(!s.monitor.core.unresolved && SMALL(faulty)(&s.monitor, 1) && !SMALL(faulty)(&s.monitor, 2));
}

MK_MONITOR_OF(NAME(many), PRECISION, 1, 8, 10);
MK_MONITOR_OF(NAME(single), PRECISION, 2, 1, 3);

/* Sensors of one row, window of ten. */
#define MANY_CONFIG(sensors)                                                                                                   \
    {.m = 1, .places = 8, .window = 10, .threshold = threshold, .evidence = 12, .zero = zero, .back = back, .level = (REAL)0.01, \
     .slope = (REAL)1e-4, .most = (sensors), .scheme = MK_MONITOR_EXCLUDE}

/* One and two sensors of eight that are faulty, with innovations that are correlated throughout. */
static void NAME(isolation)(void **unused) {
    (void)unused;
    static TYPE(many) monitor;
    REAL threshold[8], zero[1], back[1];
    assert_int_equal(NAME(mk_gate_thresholds)(1e-8, 8, threshold), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-3, 1, zero), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(0.1, 1, back), MK_OK);
    const TYPE(mk_monitor_config) config = MANY_CONFIG(2);
    generator_t g = {9};
    int right = 0, trials = 200;
    for (int trial = 0; trial < trials; trial++) {
        const int a = draw_below(&g, 8), b = (a + 1 + draw_below(&g, 7)) % 8, both = trial % 2;
        assert_int_equal(MANY(start)(&monitor, &config), MK_OK);
        for (int t = 0; t < 24; t++) {
            REAL r[8], S[36];
            epoch_t epoch = {.sensors = 8, .id = {0, 1, 2, 3, 4, 5, 6, 7}, .rows = {1, 1, 1, 1, 1, 1, 1, 1}};
            draw_epoch(&g, &epoch, 1.0);
            for (int i = 0; i < 36; i++) S[i] = (REAL)epoch.S[i];
            for (int i = 0; i < 8; i++) r[i] = (REAL)(epoch.r[i] + (t >= 12) * ((i == a) * 6.0 - (both && i == b) * 6.5) * sqrt(epoch.S[MK_PACKED(i) + i]));
            assert_int_equal(MANY(watch)(&monitor, 8, epoch.id, epoch.rows, r, S), MK_OK);
        }
        right += monitor.sensor[a].faulty && monitor.sensor[b].faulty == both && monitor.core.faulty == 1 + both;
    }
    assert_true(right >= trials - 2);
}

/* Where innovations are two offsets and nothing else, the offsets are found, together, whatever their correlation, and nothing is left. */
static void NAME(two_offsets)(void **unused) {
    (void)unused;
    static TYPE(many) monitor;
    REAL threshold[8], zero[1], back[1];
    assert_int_equal(NAME(mk_gate_thresholds)(1e-8, 8, threshold), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-3, 1, zero), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(0.1, 1, back), MK_OK);
    const TYPE(mk_monitor_config) config = MANY_CONFIG(4);
    generator_t g = {19};
    for (int trial = 0; trial < 100; trial++) {
        const int a = draw_below(&g, 8), b = (a + 1 + draw_below(&g, 7)) % 8;
        assert_int_equal(MANY(start)(&monitor, &config), MK_OK);
        REAL r[8], S[36];
        epoch_t epoch = {.sensors = 8, .id = {0, 1, 2, 3, 4, 5, 6, 7}, .rows = {1, 1, 1, 1, 1, 1, 1, 1}};
        draw_epoch(&g, &epoch, 1.0);
        for (int i = 0; i < 36; i++) S[i] = (REAL)epoch.S[i];
        for (int i = 0; i < 8; i++) r[i] = i == a ? (REAL)20 : i == b ? (REAL)25 : (REAL)0;
        assert_int_equal(MANY(watch)(&monitor, 8, epoch.id, epoch.rows, r, S), MK_OK);
        assert_true(monitor.core.alarm && !monitor.core.unresolved && monitor.sensor[a].faulty && monitor.sensor[b].faulty);
        for (int i = 0; i < 8; i++) assert_close((double)monitor.fault[i].level * sqrt(epoch.S[MK_PACKED(i) + i]), (double)r[i], sizeof(REAL) == 4 ? 1e-4 : 1e-12);
    }
}

/* A monitor of a sensor that is alone: nothing is left to compare it with but the filter's prediction. */
static void NAME(alone)(void **unused) {
    (void)unused;
    TYPE(single) monitor;
    REAL threshold[2], zero[2], back[2];
    assert_int_equal(NAME(mk_gate_thresholds)(1e-6, 2, threshold), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-3, 2, zero), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(0.1, 2, back), MK_OK);
    const TYPE(mk_monitor_config) config = {.m = 2, .places = 1, .window = 3, .threshold = threshold, .evidence = 12, .zero = zero, .back = back,
                                            .level = (REAL)0.01, .slope = (REAL)1e-4, .most = 1, .scheme = MK_MONITOR_EXCLUDE};
    assert_int_equal(SINGLE(start)(&monitor, &config), MK_OK);
    const uint16_t id[] = {65535};
    const uint8_t rows[] = {2};
    const REAL good[] = {1, 0}, bad[] = {9, 0}, S[] = {4, 1, 1};
    assert_int_equal(SINGLE(watch)(&monitor, 1, id, rows, good, S), MK_OK);
    assert_close((double)monitor.core.aime, 1.0 / 3, 1e-6); /* S^-1 = (1, -1; -1, 4) / 3 */
    assert_int_equal(monitor.core.window_rows, 2);
    for (int t = 0; t < 2; t++) assert_int_equal(SINGLE(watch)(&monitor, 1, id, rows, bad, S), MK_OK);
    assert_true(SINGLE(faulty)(&monitor, 65535) && monitor.core.rows == 2 && monitor.core.window_rows == 2);
    /* At the alarm: offset by the window, L = (2, 0; 1/2, sqrt(3)/2). */
    const double offset = (1.0 + 2 * 9.0) / 3, whitened[] = {offset / 2, -(offset / 4) / sqrt(0.75)};
    TYPE(single) again;
    assert_int_equal(SINGLE(start)(&again, &config), MK_OK);
    assert_int_equal(SINGLE(watch)(&again, 1, id, rows, good, S), MK_OK);
    for (int t = 0; t < 2; t++) {
        assert_int_equal(SINGLE(watch)(&again, 1, id, rows, bad, S), MK_OK);
        if (!again.core.alarm) continue;
        assert_int_equal(t, 1);
        for (int i = 0; i < 2; i++) assert_close((double)again.fault[i].level, whitened[i], 1e-5);
    }
    assert_true(again.core.alarm);
}
