/* SPDX-License-Identifier: MIT */
/* Vectors of meshkal/monitor.h: every scheme over streams of correlated innovations with faults that begin and end, rows that come and go and more
   sensors than places; what is refused; and a node of meshkal/node.h that watches its own and its neighbours' sensors and records what it drops.
   In the second pass the monitor is moved between calls, through kernels whose scratch memory is spoilt: that changes nothing. */
#include "vectors.h"

#include <math.h>
#include <string.h>

#include <meshkal/monitor.h>
#include <meshkal/node.h>

enum { N = 9, SENSORS = 10, ROWS = 12, EPOCHS = 44 };

static const MK_REAL not_a_number = (MK_REAL)NAN;

#if MK_BITS == 32
#define OF(macro, name, ...) macro(name, f32, __VA_ARGS__)
#else
#define OF(macro, name, ...) macro(name, f64, __VA_ARGS__)
#endif

/* --- monitors ------------------------------------------------------------------------------------------------------------- */

OF(MK_MONITOR, monitor0, 1, 8, 5);
OF(MK_MONITOR, monitor1, 2, 4, 6);
OF(MK_MONITOR, monitor2, 3, 3, 4);

typedef union {
    monitor0_t of0;
    monitor1_t of1;
    monitor2_t of2;
} object_t;
static object_t object;

typedef struct {
    int m, places, window, sensors; /* sensors that there are in all */
    MK_F_T(mk_monitor_view) (*view)(object_t *of, MK_REAL *work);
    mk_status_t (*start)(const MK_F_T(mk_monitor_config) * config);
    mk_status_t (*restart)(void);
    mk_status_t (*watch)(int sensors, const uint16_t *id, const uint8_t *rows, const MK_REAL *r, const MK_REAL *S);
    int (*faulty)(uint16_t id);
    mk_status_t (*clear)(uint16_t id);
} dimensions_t;

#define FACE(k)                                                                                                               \
    static MK_F_T(mk_monitor_view) view##k(object_t *of, MK_REAL *work) { return monitor##k##_view(&of->of##k, work); }       \
    static mk_status_t start##k(const MK_F_T(mk_monitor_config) * config) { return monitor##k##_start(&object.of##k, config); } \
    static mk_status_t restart##k(void) { return monitor##k##_restart(&object.of##k); }                                 \
    static mk_status_t watch##k(int sensors, const uint16_t *id, const uint8_t *rows, const MK_REAL *r, const MK_REAL *S) {   \
        return monitor##k##_watch(&object.of##k, sensors, id, rows, r, S);                                              \
    }                                                                                                                         \
    static int faulty##k(uint16_t id) { return monitor##k##_faulty(&object.of##k, id); }                                \
    static mk_status_t clear##k(uint16_t id) { return monitor##k##_clear(&object.of##k, id); }
FACE(0)
FACE(1)
FACE(2)
#define FUNCTIONS(k) view##k, start##k, restart##k, watch##k, faulty##k, clear##k
static const dimensions_t dimensions[] = {{1, 8, 5, 10, FUNCTIONS(0)}, {2, 4, 6, 6, FUNCTIONS(1)}, {3, 3, 4, 5, FUNCTIONS(2)}};

const char *const vectors_passes[2] = {"in its place", "moved, scratch memory spoilt"};
static vectors_kernels_t pass;
static const dimensions_t *now;
static MK_F_T(mk_monitor_config) config;
static uint32_t ends[MK_MONITOR_EXCLUDE + 1], most; /* of all runs: ends that a scheme found, sensors held faulty at a time */

/* Chi-square quantiles at 1e-4; of the end: 1e-3 and 0.1. */
static const MK_REAL threshold[N] = {MK_R(15.14), MK_R(18.42), MK_R(21.11), MK_R(23.51), MK_R(25.74), MK_R(27.86), MK_R(29.88), MK_R(31.83), MK_R(33.72)};
static const MK_REAL zero[] = {MK_R(10.83), MK_R(13.82), MK_R(16.27)}, back[] = {MK_R(2.706), MK_R(4.605), MK_R(6.251)};

static void configure(int scheme) {
    memset(&config, 0, sizeof config);
    config.m = (uint16_t)now->m;
    config.places = (uint16_t)now->places;
    config.window = (uint16_t)now->window;
    config.threshold = threshold;
    config.scheme = (uint8_t)scheme;
    config.jump = MK_R(4.0);
    config.separation = MK_R(4.0);
    config.evidence = MK_R(11.5);
    config.zero = zero;
    config.back = back;
    config.level = MK_R(0x1p-7);
    config.slope = MK_R(0x1p-13);
    config.most = 2;
    config.patience = 4;
}

/* A call of the second pass: the object moves away, and back. */
#define MOVED(call)                                                                                                           \
    MK_REAL work[MK_MONITOR_WORK(N)];                                                                                         \
    object_t away = object;                                                                                                   \
    memset(&object, 0xa5, sizeof object);                                                                                     \
    for (int i = 0; i < MK_MONITOR_WORK(N); i++) work[i] = not_a_number;                                                      \
    const MK_F_T(mk_monitor_view) view = now->view(&away, work);                                                              \
    const mk_status_t status = call;                                                                                          \
    object = away;                                                                                                            \
    return status

static mk_status_t start(void) {
    if (!pass) return now->start(&config);
    MOVED(MK_F(mk_monitor_start)(now->m, now->places, now->window, &view, &config));
}

static mk_status_t restart(void) {
    if (!pass) return now->restart();
    MOVED(MK_F(mk_monitor_restart)(&view));
}

static mk_status_t watch(int sensors, const uint16_t *of, const uint8_t *with, const MK_REAL *residual, const MK_REAL *variance) {
    if (!pass) return now->watch(sensors, of, with, residual, variance);
    MOVED(MK_F(mk_monitor_watch)(&view, sensors, of, with, residual, variance));
}

/* --- what a call leaves ----------------------------------------------------------------------------------------------------- */

static void tell_core(const MK_F_T(mk_monitor) * core) {
    const MK_REAL numbers[] = {core->rctm, core->aime, core->rctm_ratio, core->aime_ratio, core->rho, core->median};
    vector_numbers("statistics, ratios, rho, median", 6, numbers);
    vector_word("rows, window's, held", (uint32_t)core->rows << 16 | (uint32_t)core->window_rows << 8 | core->held);
    vector_word("faulty, alarm, ended, unresolved", (uint32_t)core->faulty << 16 | (uint32_t)core->alarm << 2 | (uint32_t)core->ended << 1 | core->unresolved);
    vector_word("failed, quiet, waited", (uint32_t)core->failed << 16 | (uint32_t)core->quiet << 8 | core->waited);
    vector_word("epoch, since", core->epoch << 16 | core->alarm_since);
    vector_word("alarms, ends", core->alarms << 16 | core->ends);
    vector_word("crowded, rejected", core->crowded << 16 | core->rejected);
    vector_word("front, back", (uint32_t)core->front << 16 | core->back);
}

static void tell_sensors(int m, int places, const MK_F_T(mk_watched) * sensor, const MK_F_T(mk_fault) * fault) {
    for (int p = 0; p < places; p++) {
        const MK_REAL numbers[] = {sensor[p].w, sensor[p].ratio};
        vector_word("place", (uint32_t)sensor[p].id << 16 | (uint32_t)sensor[p].rows << 8 | (uint32_t)sensor[p].used << 1 | sensor[p].faulty);
        vector_numbers("w, end ratio", 2, numbers);
        vector_word("since, until, faults", sensor[p].since << 16 | sensor[p].until << 8 | sensor[p].faults);
        for (int i = p * m; i < (p + 1) * m && sensor[p].faulty; i++) {
            const MK_REAL followed[] = {fault[i].level, fault[i].slope, fault[i].P[0], fault[i].P[1], fault[i].P[2], fault[i].sum, fault[i].all};
            vector_numbers("level, slope, P, sums", 7, followed);
        }
    }
}

static void tell(const char *what, mk_status_t status) {
    const MK_F_T(mk_monitor_view) view = now->view(&object, 0);
    vector_word(what, (uint32_t)status);
    tell_core(view.core);
    tell_sensors(now->m, now->places, view.sensor, view.fault);
    for (int l = 0; l < now->sensors; l++) vector_word("faulty", (uint32_t)now->faulty((uint16_t)(700 + l)));
}

/* --- a stream --------------------------------------------------------------------------------------------------------------- */

static uint16_t id[SENSORS];
static uint8_t rows[SENSORS];
static MK_REAL r[ROWS], S[MK_PACKED(ROWS)];

/* Nearly normal, variance 1. */
static MK_REAL normal(void) {
    const MK_REAL a = draw(), b = draw(), c = draw();
    return a + b + c;
}

/* A ramp on one sensor, a step on another, and in the end both at once. */
static MK_REAL fault_of(int sensor, int t) {
    if (sensor == 1 && t > 8 && t <= 16) return MK_R(1.5) * (MK_REAL)(t - 8);
    if (sensor == 0 && t > 21 && t <= 29) return MK_R(-14.0);
    if (sensor < 2 && t > 36) return sensor ? MK_R(12.0) : MK_R(9.0);
    return MK_R(0.0);
}

/* One in four readings is missing, the third sensor for a while; who comes beyond the places finds none, or that of one who is gone. */
static int draw_epoch(int t) {
    int count = 0;
    MK_REAL L[MK_PACKED(ROWS)], z[ROWS], fault[ROWS];
    for (int l = 0; l < now->sensors; l++) {
        const int own = 1 + l % now->m, away = (l == 2 && t > 10 && t < 24) || (l >= now->places && t < 12);
        id[l] = (uint16_t)(700 + l);
        rows[l] = (uint8_t)(away || draw_below(4) == 0 || count + own > ROWS ? 0 : own);
        for (int i = 0; i < rows[l]; i++) fault[count++] = i ? MK_R(0.0) : fault_of(l, t);
    }
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < i; j++) L[MK_AT(i, j)] = MK_R(0.25) * draw();
        L[MK_AT(i, i)] = MK_R(1.25) + MK_R(0.5) * draw();
        z[i] = normal();
        r[i] = fault[i];
        for (int k = 0; k <= i; k++) r[i] += L[MK_AT(i, k)] * z[k];
        for (int j = 0; j <= i; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int k = 0; k <= j; k++) sum += L[MK_AT(i, k)] * L[MK_AT(j, k)];
            S[MK_AT(i, j)] = sum;
        }
    }
    vector_numbers("r", count, r);
    vector_numbers("S", MK_PACKED(count), S);
    return count;
}

static void run(int scheme) {
    vector_begin("monitor", scheme, now->m, now->places, now->window);
    configure(scheme);
    memset(&object, 0, sizeof object);
    vector_word("before start", (uint32_t)watch(0, id, rows, r, S));
    tell("start", start());
    for (int t = 0; t < EPOCHS; t++) {
        (void)draw_epoch(t);
        tell("watch", watch(now->sensors, id, rows, r, S));
        if (now->view(&object, 0).core->faulty > most) most = now->view(&object, 0).core->faulty;
        if (t == 33) tell("watch nothing", watch(0, 0, 0, 0, 0));
    }
    const MK_F_T(mk_monitor_view) view = now->view(&object, 0);
    vector_must("an alarm", view.core->alarms > 0);
    vector_must("a reading without a place", view.core->crowded > 0);
    ends[scheme] += view.core->ends;
    for (int l = 0; l < 3; l++) tell("clear", now->clear((uint16_t)(700 + l)));
    tell("restart", restart());
}

/* What is refused leaves all as it was; then an epoch shows that. */
static void failure(int number) {
    vector_begin("monitor, failing", MK_MONITOR_EXCLUDE, now->m, now->places, number);
    configure(MK_MONITOR_EXCLUDE);
    memset(&object, 0, sizeof object);
    if (number == 0) config.scheme = 4;
    if (number == 1) config.window = 0;
    if (number == 2) config.evidence = not_a_number;
    if (number == 3) config.most = 0;
    vector_word("start", (uint32_t)start());
    if (number < 4) return;
    int count = 0;
    for (int t = 0; t < 16; t++) {
        count = draw_epoch(t);
        tell("watch", watch(now->sensors, id, rows, r, S));
    }
    while (count < 3) count = draw_epoch(15);
    const int last = count - 1;
    const uint8_t many = rows[0];
    if (number == 4) r[last] = not_a_number;
    if (number == 5) S[MK_AT(last, 0)] = -(MK_REAL)INFINITY;
    if (number == 6) S[MK_AT(last, last)] = MK_R(-1.0);
    if (number == 7) S[MK_AT(last, 0)] = MK_R(50.0);
    if (number == 8) id[now->sensors - 1] = id[0], rows[0] = rows[now->sensors - 1] = 1;
    if (number == 9) rows[0] = (uint8_t)(now->m + 1);
    if (number == 10) r[last] = MK_BITS == 32 ? MK_R(1e30) : MK_R(1e30) * MK_R(1e30) * MK_R(1e30) * MK_R(1e30) * MK_R(1e30) * MK_R(1e30);
    if (number == 11)
        for (int i = 0; i < MK_PACKED(count); i++) S[i] *= power(MK_BITS == 32 ? -100 : -900);
    tell("watch", watch(now->sensors, id, rows, r, S));
    rows[0] = many;
    (void)draw_epoch(16);
    tell("watch again", watch(now->sensors, id, rows, r, S));
}

/* --- a node that watches ---------------------------------------------------------------------------------------------------- */

enum { STATES = 3, SLOTS = 4, STEPS = 40 };
OF(MK_NODE, node, STATES, 1, SLOTS);
OF(MK_WATCH, node, 1, SLOTS, 6);

static const MK_REAL A[] = {MK_R(0.9375), MK_R(0.25), MK_R(0.0), MK_R(-0.25), MK_R(0.875), MK_R(0.125), MK_R(0.0), MK_R(0.0), MK_R(0.96875)};
static const MK_REAL Q[] = {MK_R(0.03125), MK_R(0.0078125), MK_R(0.0625), MK_R(0.0), MK_R(0.015625), MK_R(0.046875)};
static const MK_REAL P0[] = {MK_R(2.0), MK_R(0.5), MK_R(1.5), MK_R(0.0), MK_R(0.25), MK_R(1.0)}, x0[] = {MK_R(1.0), MK_R(0.0), MK_R(-0.5)};
static const MK_REAL C[SLOTS][STATES] = {{MK_R(1.0)}, {MK_R(0.5), MK_R(1.0)}, {MK_R(0.0), MK_R(-0.5), MK_R(1.0)}, {MK_R(1.0), MK_R(1.0), MK_R(1.0)}};
static const MK_REAL weight[SLOTS] = {MK_R(0.4375), MK_R(0.1875), MK_R(0.1875), MK_R(0.1875)};
static const uint16_t nodes[SLOTS] = {4, 2, 9, 7};
static const uint8_t one_row[SLOTS] = {1, 1, 1, 1};
static node_t node;
static node_monitor_t monitor;

static void node_step(int t, MK_REAL *truth) {
    MK_REAL next[STATES], psi[STATES];
    for (int i = 0; i < STATES; i++) {
        next[i] = MK_R(0.125) * normal();
        for (int j = 0; j < STATES; j++) next[i] += A[i * STATES + j] * truth[j];
    }
    memcpy(truth, next, sizeof next);
    for (int l = 0; l < SLOTS; l++) {
        MK_REAL y = MK_R(0.5) * normal();
        for (int i = 0; i < STATES; i++) y += C[l][i] * truth[i];
        if (l == 2 && t > 10 && t <= 20) y += MK_R(0.75) * (MK_REAL)(t - 10);
        vector_numbers("y", 1, &y);
        if (draw_below(6) == 0) continue;
        vector_word("put", (uint32_t)(l ? node_filter_put_measurement(&node.filter, l, &y) : node_measure(&node, &y)));
    }
    vector_word("watch", (uint32_t)node_watch(&node, &monitor, nodes));
    tell_core(&monitor.core);
    tell_sensors(1, SLOTS, monitor.sensor, monitor.fault);
    for (int l = 0; l < SLOTS; l++) vector_word("has a reading", node.filter.have_y[l]);
    vector_word("incremental", (uint32_t)node_incremental(&node));
    vector_numbers("psi", STATES, node_intermediate(&node));
    for (int l = 1; l < SLOTS; l++) {
        for (int i = 0; i < STATES; i++) psi[i] = node.filter.psi[i] + MK_R(0.125) * draw();
        vector_word("estimate", (uint32_t)node_filter_put_estimate(&node.filter, l, psi));
    }
    vector_word("diffuse", (uint32_t)node_diffuse(&node));
    vector_numbers("x", STATES, node_estimate(&node));
    vector_numbers("W", MK_PACKED(STATES), node.filter.W);
}

static void node_vectors(void) {
    static MK_REAL F[SLOTS * STATES], S_of[SLOTS * MK_PACKED(STATES)], R_inverse[SLOTS];
    static const MK_REAL R = MK_R(0.25);
    static uint8_t room[768];
    mk_recorder_t recorder = {room, sizeof room, 0, 0, 0};
    MK_F_T(mk_node_config) settings;
    MK_REAL work[3], truth[STATES];
    uint32_t crc = 0, drops = 0;
    vector_begin("node that watches", STATES, 1, SLOTS, 0);
    for (int l = 0; l < SLOTS; l++)
        vector_word("sensor", (uint32_t)MK_F(mk_rkfd_sensor)(STATES, 1, 1, C[l], &R, F + l * STATES, S_of + l * MK_PACKED(STATES), R_inverse + l, work));
    memset(&settings, 0, sizeof settings);
    const MK_F_T(mk_rkfd_config) filter = {STATES, 1, SLOTS, A, Q, 0, x0, P0, weight, one_row, C[0], F, S_of, R_inverse, MK_R(0.02), 0};
    settings.filter = filter;
    settings.nodes = nodes;
    settings.catch_up = 5;
    settings.numbers = MK_BITS == 64 ? MK_NUMBERS_F64 : MK_NUMBERS_F32;
    memset(&config, 0, sizeof config);
    now = dimensions;
    configure(MK_MONITOR_EXCLUDE);
    config.places = SLOTS;
    config.window = 6;
    memcpy(truth, x0, sizeof truth);
    vector_word("start", (uint32_t)node_start(&node, &settings));
    vector_word("start of the monitor", (uint32_t)node_monitor_start(&monitor, &config));
    vector_word("record", (uint32_t)node_record(&node, &recorder));
    for (int t = 0; t < STEPS; t++) {
        node_step(t, truth);
        for (size_t at = 0, length; at < recorder.used; at += length) {
            mk_item_t item;
            int damaged;
            length = mk_item_read(room + at, recorder.used - at, &item, &damaged);
            drops += item.kind == MK_ITEM_DROP;
            if (length == 0) break;
        }
        crc = mk_crc32(crc, room, recorder.used);
        vector_word("record", crc);
        vector_must("room for the record", recorder.lost == 0);
        recorder.used = 0;
    }
    vector_word("drops", drops);
    vector_must("a recorded drop", drops > 2);
    vector_must("an end", monitor.core.ends > 0);
    vector_word("restart of the monitor", (uint32_t)node_monitor_restart(&monitor));
    tell_core(&monitor.core);
}

void vectors_run(vectors_kernels_t chosen) {
    pass = chosen;
    memset(ends, 0, sizeof ends);
    most = 0;
    draw_seed(20251123);
    for (int i = 0; i < (int)(sizeof dimensions / sizeof dimensions[0]); i++) {
        now = dimensions + i;
        for (int scheme = MK_MONITOR_RCTM; scheme <= MK_MONITOR_EXCLUDE; scheme++) run(scheme);
        for (int number = 0; number < 12; number++) failure(number);
    }
    vector_must("ends", ends[MK_MONITOR_IMPROVED] > 2 && ends[MK_MONITOR_EXCLUDE] > 2);
    vector_must("two faults at once", most == 2);
    node_vectors();
#if MK_BITS == 64
    /* In double alone: the image that promises single precision has none. */
    MK_REAL made[N];
    vector_begin("thresholds", 0, 0, 0, 0);
    vector_word("status", (uint32_t)mk_gate_thresholds_f64(8e-10, N, made));
    vector_numbers("thresholds", N, made);
    vector_word("status", (uint32_t)mk_monitor_evidence_f64(1e-3, 1e4, made));
    vector_numbers("evidence", 1, made);
#endif
}
