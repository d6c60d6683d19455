/* SPDX-License-Identifier: MIT */
/* A monitor in one REAL of three sensors of up to two rows, window of four epochs, with its configuration in writable memory. */

MK_MONITOR_OF(NAME(small), PRECISION, 2, 3, 4);

typedef struct {
    REAL threshold[6], zero[2], back[2];
    TYPE(mk_monitor_config) config;
    TYPE(small) monitor;
} TYPE(stand);

static void NAME(stand_up)(TYPE(stand) * s, uint8_t scheme) {
    memset(s, 0, sizeof *s);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-6, 6, s->threshold), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-3, 2, s->zero), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(0.1, 2, s->back), MK_OK);
    s->config.m = 2;
    s->config.places = 3;
    s->config.window = 4;
    s->config.threshold = s->threshold;
    s->config.jump = 8;
    s->config.separation = 0;
    s->config.zero = s->zero;
    s->config.back = s->back;
    s->config.level = (REAL)0.01;
    s->config.slope = (REAL)1e-4;
    s->config.most = 2;
    s->config.scheme = scheme;
    assert_int_equal(NAME(mk_monitor_evidence)(0.01, 1000.0, &s->config.evidence), MK_OK);
    assert_int_equal(SMALL(start)(&s->monitor, &s->config), MK_OK);
}

/* An epoch of sensors 1, 2, 3 of one row, variance 1, correlation 1/4; rows in `read` bit by bit. */
static mk_status_t NAME(tell)(TYPE(stand) * s, unsigned read, double a, double b, double c) {
    static const uint16_t id[3] = {1, 2, 3};
    const double values[3] = {a, b, c};
    uint8_t rows[3];
    REAL r[3], S[6];
    int n = 0;
    for (int i = 0; i < 3; i++) {
        rows[i] = (uint8_t)(read >> i & 1u);
        if (rows[i]) r[n++] = (REAL)values[i];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) S[MK_PACKED(i) + j] = i == j ? (REAL)1.0 : (REAL)0.25;
    return SMALL(watch)(&s->monitor, 3, id, rows, r, S);
}

static const TYPE(mk_watched) * NAME(sensor)(const TYPE(stand) * s, uint16_t id) {
    const TYPE(mk_watched) *found = NULL;
    for (int p = 0; p < 3; p++)
        if (s->monitor.sensor[p].used && s->monitor.sensor[p].id == id) {
            assert_null(found);
            found = s->monitor.sensor + p;
        }
    return found;
}

/* The call must return `status` and leave every byte of the monitor but `failed`, which is that, and `rejected`, which counts. */
#define REFUSES(s, call, status, at)                                                                                           \
    do {                                                                                                                       \
        TYPE(small) before;                                                                                                    \
        memcpy(&before, &(s)->monitor, sizeof before);                                                                         \
        assert_int_equal((call), (status));                                                                                    \
        before.core.rejected++;                                                                                                \
        before.core.failed = (at);                                                                                             \
        assert_memory_equal(&before, &(s)->monitor, sizeof before);                                                            \
    } while (0)
