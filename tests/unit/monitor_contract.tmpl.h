/* SPDX-License-Identifier: MIT */
/* What meshkal/monitor.h promises besides the statistics: statuses, untouched state, places. */

static void NAME(start_refused)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
#define SPOILT(member, value, status)                                                                                          \
    do {                                                                                                                       \
        TYPE(stand) bad;                                                                                                       \
        TYPE(small) before;                                                                                                    \
        memcpy(&bad, &s, sizeof bad);                                                                                          \
        bad.config.threshold = bad.threshold;                                                                                  \
        bad.config.zero = bad.zero;                                                                                            \
        bad.config.back = bad.back;                                                                                            \
        bad.member = (value);                                                                                                  \
        memcpy(&before, &bad.monitor, sizeof before);                                                                          \
        assert_int_equal(SMALL(start)(&bad.monitor, &bad.config), (status));                                                   \
        if ((status) != MK_OK) assert_memory_equal(&before, &bad.monitor, sizeof before);                                      \
    } while (0)
    SPOILT(config.m, 1, MK_ERROR_SHAPE);
    SPOILT(config.places, 4, MK_ERROR_SHAPE);
    SPOILT(config.window, 5, MK_ERROR_SHAPE);
    SPOILT(config.threshold, NULL, MK_ERROR_ARGUMENT);
    SPOILT(threshold[5], 0, MK_ERROR_ARGUMENT);
    SPOILT(threshold[0], (REAL)NAN, MK_ERROR_NOT_FINITE);
    SPOILT(config.scheme, MK_MONITOR_EXCLUDE + 1, MK_ERROR_ARGUMENT);
    SPOILT(config.separation, -1, MK_ERROR_ARGUMENT);
    SPOILT(config.separation, (REAL)INFINITY, MK_ERROR_NOT_FINITE);
    SPOILT(config.evidence, 0, MK_ERROR_ARGUMENT);
    SPOILT(config.level, -1, MK_ERROR_ARGUMENT);
    SPOILT(config.slope, (REAL)NAN, MK_ERROR_NOT_FINITE);
    SPOILT(config.zero, NULL, MK_ERROR_ARGUMENT);
    SPOILT(config.back, NULL, MK_ERROR_ARGUMENT);
    SPOILT(zero[1], 0, MK_ERROR_ARGUMENT);
    SPOILT(back[1], (REAL)NAN, MK_ERROR_NOT_FINITE);
    SPOILT(config.most, 0, MK_ERROR_ARGUMENT);
    SPOILT(config.jump, 0, MK_OK); /* of another scheme */
    s.config.scheme = MK_MONITOR_IMPROVED;
    SPOILT(config.jump, 0, MK_ERROR_ARGUMENT);
    SPOILT(config.jump, (REAL)NAN, MK_ERROR_NOT_FINITE);
    SPOILT(config.evidence, 0, MK_OK);
#undef SPOILT
    assert_int_equal(SMALL(start)(&s.monitor, NULL), MK_ERROR_ARGUMENT);
    const TYPE(mk_monitor_view) view = SMALL(view)(&s.monitor, NULL);
    assert_int_equal(NAME(mk_monitor_start)(11, 3, 4, &view, &s.config), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_monitor_start)(2, 3, 0, &view, &s.config), MK_ERROR_ARGUMENT);

    /* Thresholds, too, are refused where they have no meaning. */
    REAL values[2] = {7, 7};
    assert_int_equal(NAME(mk_gate_thresholds)(0.0, 2, values), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_gate_thresholds)(1.0, 2, values), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_monitor_evidence)(0.0, 1000.0, values), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_monitor_evidence)(1.0, 1000.0, values), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_monitor_evidence)(0.01, 0.5, values), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_monitor_evidence)(0.01, (double)NAN, values), MK_ERROR_ARGUMENT);
    assert_int_equal(NAME(mk_monitor_evidence)(0.01, 1000.0, NULL), MK_ERROR_ARGUMENT);
    assert_true(values[0] == 7 && values[1] == 7);
    assert_int_equal(NAME(mk_monitor_evidence)(0.01, 1000.0, values), MK_OK);
    assert_close((double)values[0], log(1e5), 1e-6);
}

static void NAME(not_started)(void **unused) {
    (void)unused;
    TYPE(small) monitor;
    memset(&monitor, 0, sizeof monitor);
    const uint16_t id[1] = {0};
    const uint8_t rows[1] = {1};
    const REAL r[1] = {0}, S[1] = {1};
    assert_int_equal(SMALL(watch)(&monitor, 1, id, rows, r, S), MK_ERROR_ORDER);
    assert_int_equal(SMALL(restart)(&monitor), MK_ERROR_ORDER);
    assert_int_equal(SMALL(clear)(&monitor, 0), MK_ERROR_ORDER);
    assert_false(SMALL(faulty)(&monitor, 0));
}

/* In a state in which everything is in use: a full window in two stacks, one sensor held faulty and followed. */
static void NAME(refused_epochs)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_EXCLUDE);
    for (int t = 0; t < 11; t++) assert_int_equal(NAME(tell)(&s, 7, t < 3 ? 0.1 : 9.0, 0.2 * t - 1, 0.3), MK_OK);
    assert_true(SMALL(faulty)(&s.monitor, 1));
    assert_int_equal(s.monitor.core.front + s.monitor.core.back, 4);
    assert_true(s.monitor.core.back > 0 && s.monitor.fault[0].level > 5);

    const REAL good[] = {0, 0, 0}, r[] = {9, 0, 0}, S[] = {1, 0, 1, 0, 0, 1};
    const uint16_t id[] = {1, 2, 3}, twice[] = {2, 3, 2};
    const uint8_t rows[] = {1, 1, 1}, many[] = {1, 3, 1}, gap[] = {1, 1, 0};
    TYPE(small) *const m = &s.monitor;
    REFUSES(&s, SMALL(watch)(m, 3, NULL, rows, r, S), MK_ERROR_ARGUMENT, 0);
    REFUSES(&s, SMALL(watch)(m, 3, id, NULL, r, S), MK_ERROR_ARGUMENT, 0);
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, NULL, S), MK_ERROR_ARGUMENT, 0);
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, r, NULL), MK_ERROR_ARGUMENT, 0);
    REFUSES(&s, SMALL(watch)(m, -1, id, rows, r, S), MK_ERROR_ARGUMENT, 0);
    REFUSES(&s, SMALL(watch)(m, 16384, id, rows, r, S), MK_ERROR_ARGUMENT, 0);
    REFUSES(&s, SMALL(watch)(m, 3, id, many, r, S), MK_ERROR_ARGUMENT, 1);
    REFUSES(&s, SMALL(watch)(m, 3, twice, rows, r, S), MK_ERROR_ARGUMENT, 2);
    const REAL spoilt[] = {(REAL)NAN, (REAL)INFINITY, -(REAL)INFINITY};
    for (int k = 0; k < 3; k++) {
        REAL bad[6];
        for (int i = 0; i < 3; i++) {
            memcpy(bad, r, sizeof r);
            bad[i] = spoilt[k];
            REFUSES(&s, SMALL(watch)(m, 3, id, rows, bad, S), MK_ERROR_NOT_FINITE, (uint16_t)i);
        }
        static const uint16_t owner[] = {0, 1, 1, 2, 2, 2};
        for (int i = 0; i < 6; i++) {
            memcpy(bad, S, sizeof S);
            bad[i] = spoilt[k];
            REFUSES(&s, SMALL(watch)(m, 3, id, rows, r, bad), MK_ERROR_NOT_FINITE, owner[i]);
        }
    }
    /* Sensor 2 is the first, 3 the second that counts; 1 is held faulty and judged by itself. */
    const REAL faulty[] = {0, 0, 1, 0, 0, 1}, second[] = {1, 0, -1, 0, 0, 1}, third[] = {1, 0, 1, 0, 1, 1}, apart[] = {1, 2, 1, 0, 0, 1};
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, r, faulty), MK_ERROR_NOT_POSITIVE_DEFINITE, 0);
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, r, second), MK_ERROR_NOT_POSITIVE_DEFINITE, 1);
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, r, third), MK_ERROR_NOT_POSITIVE_DEFINITE, 2);
    const REAL large = sizeof(REAL) == 4 ? (REAL)1e30 : (REAL)1e200, overflow[] = {0, large, 0}, elsewhere[] = {large, 0, 0};
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, overflow, S), MK_ERROR_NOT_FINITE, 3);
    const REAL tiny[] = {1, 0, sizeof(REAL) == 4 ? (REAL)1e-44 : (REAL)1e-320, 0, 0, 1};
    REFUSES(&s, SMALL(watch)(m, 3, id, rows, good, tiny), MK_ERROR_NOT_POSITIVE_DEFINITE, 1);

    assert_int_equal(SMALL(watch)(m, 3, id, rows, r, apart), MK_OK); /* what lies between it and others is not used */
    assert_int_equal(m->core.failed, 3);
    assert_int_equal(SMALL(watch)(m, 3, twice, gap, good, S), MK_OK); /* who was not read may be there twice */
    assert_int_equal(SMALL(watch)(m, 3, id, rows, elsewhere, S), MK_OK); /* as far off as can be: the fault goes on */
    assert_true(SMALL(faulty)(m, 1) && m->fault[0].level < 100);
}

static void NAME(nothing_read)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_AIME);
    assert_int_equal(SMALL(watch)(&s.monitor, 0, NULL, NULL, NULL, NULL), MK_OK);
    assert_int_equal(NAME(tell)(&s, 0, 0, 0, 0), MK_OK);
    assert_int_equal(s.monitor.core.held, 2);
    assert_int_equal(s.monitor.core.window_rows, 0);
    assert_true(s.monitor.core.aime == 0 && s.monitor.core.aime_ratio == 0 && !s.monitor.core.alarm);
    assert_int_equal(NAME(tell)(&s, 2, 0, 9, 0), MK_OK);
    assert_true(s.monitor.core.alarm && s.monitor.core.alarm_since == 3);
    for (int t = 0; t < 3; t++) {
        assert_int_equal(NAME(tell)(&s, 0, 0, 0, 0), MK_OK); /* what was read is in the window still */
        assert_close((double)s.monitor.core.aime, 81.0, 1e-6);
        assert_true(s.monitor.core.rows == 0 && s.monitor.core.rctm == 0 && s.monitor.core.window_rows == 1 && s.monitor.core.alarm);
    }
    assert_int_equal(NAME(tell)(&s, 0, 0, 0, 0), MK_OK);
    assert_true(s.monitor.core.window_rows == 0 && !s.monitor.core.alarm && s.monitor.core.alarms == 1 && s.monitor.core.alarm_since == 3);
    assert_int_equal(NAME(tell)(&s, 0, 0, 0, 0), MK_OK);
    assert_null(NAME(sensor)(&s, 2));
}

/* Sensors 10, 11, .. of one row each. */
static mk_status_t NAME(crowd)(TYPE(stand) * s, int sensors, const uint16_t *id, double value) {
    uint8_t rows[5];
    REAL r[5], S[15];
    for (int i = 0; i < sensors; i++) {
        rows[i] = 1;
        r[i] = (REAL)(value + id[i]);
        for (int j = 0; j <= i; j++) S[MK_PACKED(i) + j] = i == j;
    }
    return SMALL(watch)(&s->monitor, sensors, id, rows, r, S);
}

static void NAME(places)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_AIME);
    const uint16_t five[] = {10, 11, 12, 13, 14}, two[] = {13, 11}, swapped[] = {12, 11, 10};
    assert_int_equal(NAME(crowd)(&s, 5, five, 0), MK_OK);
    assert_int_equal(s.monitor.core.crowded, 2);
    assert_int_equal(s.monitor.core.rows, 3);
    assert_close((double)s.monitor.core.rctm, 100.0 + 121.0 + 144.0, 1e-6);
    /* 13 comes in when 10 or 12 has left, not before: they were last read four epochs ago then. */
    for (int t = 0; t < 3; t++) assert_int_equal(NAME(crowd)(&s, 2, two, 0), MK_OK);
    assert_int_equal(s.monitor.core.crowded, 5);
    assert_null(NAME(sensor)(&s, 13));
    assert_int_equal(NAME(crowd)(&s, 2, two, 0), MK_OK);
    assert_int_equal(s.monitor.core.crowded, 5);
    assert_non_null(NAME(sensor)(&s, 13));
    assert_non_null(NAME(sensor)(&s, 11));
    assert_int_equal(s.monitor.core.window_rows, 2);
    assert_close((double)s.monitor.core.aime, 4 * 121.0 + 169.0, 1e-6);
    /* All leave, and three come back in another order: each finds its own. */
    for (int t = 0; t < 5; t++) assert_int_equal(NAME(crowd)(&s, 0, NULL, 0), MK_OK);
    for (int p = 0; p < 3; p++) assert_false(s.monitor.sensor[p].used);
    for (int t = 0; t < 3; t++) assert_int_equal(NAME(crowd)(&s, 3, t % 2 ? swapped : five, 0), MK_OK);
    for (uint16_t id = 10; id < 13; id++) {
        assert_non_null(NAME(sensor)(&s, id));
        assert_close((double)NAME(sensor)(&s, id)->w, 3.0 * id * id, 1e-6);
    }
}

/* With two rows a sensor, one of which is missing now and then. */
static void NAME(rows_vary)(void **unused) {
    (void)unused;
    TYPE(stand) s;
    NAME(stand_up)(&s, MK_MONITOR_AIME);
    const uint16_t id[] = {5};
    const REAL r[] = {1, 2}, S[] = {1, 0, 4};
    const uint8_t two[] = {2}, one[] = {1}, three[] = {3};
    assert_int_equal(SMALL(watch)(&s.monitor, 1, id, two, r, S), MK_OK);
    assert_close((double)s.monitor.core.aime, 1.0 + 1.0, 1e-6);
    for (int t = 0; t < 3; t++) assert_int_equal(SMALL(watch)(&s.monitor, 1, id, one, r, S), MK_OK);
    assert_int_equal(s.monitor.core.window_rows, 2);
    assert_close((double)s.monitor.core.aime, 4.0 + 1.0, 1e-6);
    assert_int_equal(SMALL(watch)(&s.monitor, 1, id, one, r, S), MK_OK);
    assert_int_equal(s.monitor.core.window_rows, 1);
    REFUSES(&s, SMALL(watch)(&s.monitor, 1, id, three, r, S), MK_ERROR_ARGUMENT, 0);
}
