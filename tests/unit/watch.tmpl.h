/* SPDX-License-Identifier: MIT */
#define OWN(name) JOIN(NAME(track), _##name)
#define NODE(name) JOIN(NAME(node), _##name)
MK_UNSCENTED_OF(NAME(track), PRECISION, N, 1, BEACONS);
MK_WATCH_OF(NAME(track), PRECISION, 1, BEACONS, WINDOW);
MK_DUIF_OF(NAME(node), PRECISION, N, 1, BEACONS);
MK_WATCH_OF(JOIN(NAME(node), _filter), PRECISION, 1, 1, WINDOW);

/* Everything that the filters point to. */
typedef struct {
    TYPE(mk_site) site[BEACONS];
    TYPE(mk_sensor) sensor[BEACONS];
    TYPE(mk_unscented_config) filter;
    TYPE(mk_monitor_config) monitor;
    REAL Q[MK_PACKED(N)], P0[MK_PACKED(N)], x0[N], R[1], threshold[BEACONS], zero[1], back[1];
} NAME(world_t);

static void NAME(make)(NAME(world_t) * w, int places) {
    const TYPE(mk_transform) transform = MK_TRANSFORM_CUBATURE(N);
    memset(w, 0, sizeof *w);
    for (int axis = 0; axis < 2; axis++) {
        const int p = 2 * axis, v = p + 1;
        w->Q[MK_PACKED(p) + p] = (REAL)1e-5;
        w->Q[MK_PACKED(v) + v] = (REAL)1e-5;
        w->P0[MK_PACKED(p) + p] = (REAL)1.0;
        w->P0[MK_PACKED(v) + v] = (REAL)0.01;
    }
    w->x0[0] = (REAL)40.0;
    w->x0[1] = (REAL)0.1;
    w->x0[2] = (REAL)20.0;
    w->x0[3] = (REAL)0.05;
    w->R[0] = (REAL)(SIGMA * SIGMA);
    for (int k = 0; k < BEACONS; k++) {
        w->site[k].motion = &motion;
        for (int i = 0; i < 2; i++) w->site[k].position[i] = (REAL)beacons[k][i];
        w->sensor[k].model.function = NAME(mk_range);
        w->sensor[k].model.context = &w->site[k];
        w->sensor[k].R = w->R;
        w->sensor[k].rows = 1;
    }
    w->filter.n = N;
    w->filter.m = 1;
    w->filter.slots = (uint16_t)places;
    w->filter.transition.model.function = NAME(mk_constant_velocity);
    w->filter.transition.model.context = &motion;
    w->filter.transition.Q = w->Q;
    w->filter.sensor = w->sensor;
    w->filter.x0 = w->x0;
    w->filter.P0 = w->P0;
    w->filter.transform = transform;
    w->filter.increments = 1;
    assert_int_equal(NAME(mk_gate_thresholds)(1e-8, places, w->threshold), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(1e-3, 1, w->zero), MK_OK);
    assert_int_equal(NAME(mk_gate_thresholds)(0.1, 1, w->back), MK_OK);
    assert_int_equal(NAME(mk_monitor_evidence)(0.01, 1000.0, &w->monitor.evidence), MK_OK);
    w->monitor.m = 1;
    w->monitor.places = (uint16_t)places;
    w->monitor.window = WINDOW;
    w->monitor.threshold = w->threshold;
    w->monitor.zero = w->zero;
    w->monitor.back = w->back;
    w->monitor.level = (REAL)0.01;
    w->monitor.slope = (REAL)1e-4;
    w->monitor.separation = (REAL)10.0;
    w->monitor.most = 1;
    w->monitor.scheme = MK_MONITOR_EXCLUDE;
}

/* Whether sensor k may and must be held at t: found within 60 steps (3 m of drift), let go at once after. */
static void NAME(judge)(int t, int k, int held) {
    if (held) assert_true(k == DRIFTS && t > FROM && t <= TO + 3);
    if (!held) assert_true(k != DRIFTS || t <= FROM + 60 || t > TO);
}

static void NAME(unscented)(void **unused) {
    (void)unused;
    static NAME(world_t) w;
    static const uint16_t id[BEACONS] = {30, 31, 32, 33, 34};
    static OWN(t) f;
    static OWN(monitor_t) monitor;
    generator_t g = {3};
    NAME(make)(&w, BEACONS);
    assert_int_equal(OWN(start)(&f, &w.filter), MK_OK);
    assert_int_equal(OWN(monitor_start)(&monitor, &w.monitor), MK_OK);
    for (int t = 1; t <= STEPS; t++) {
        double range[BEACONS];
        draw_ranges(&g, t, range);
        assert_int_equal(OWN(predict)(&f, (REAL)1.0, NULL), MK_OK);
        for (int k = 0; k < BEACONS; k++) {
            const REAL z = (REAL)range[k];
            if ((t + k) % 7) assert_int_equal(OWN(put)(&f, k, &z), MK_OK);
        }
        assert_int_equal(OWN(watch)(&f, &monitor, id), MK_OK);
        for (int k = 0; k < BEACONS; k++) {
            const int held = OWN(monitor_faulty)(&monitor, id[k]);
            NAME(judge)(t, k, held);
            assert_int_equal(f.have[k], (t + k) % 7 && !held);
        }
        assert_int_equal(OWN(update)(&f), MK_OK);
        assert_true(fabs((double)f.x[0] - 40.0 - 0.1 * t) < 1.0 && fabs((double)f.x[2] - 20.0 - 0.05 * t) < 1.0);
    }
    assert_int_equal(monitor.core.ends, 1);
}

/* Five nodes that all hear each other; each watches its own sensor, by what all know together. */
static void NAME(information)(void **unused) {
    (void)unused;
    static NAME(world_t) w[BEACONS];
    static const uint16_t degree[BEACONS] = {4, 4, 4, 4, 4};
    static NODE(config_t) config[BEACONS];
    static NODE(t) node[BEACONS];
    static NODE(filter_monitor_t) monitor[BEACONS];
    static uint16_t nodes[BEACONS][BEACONS];
    generator_t g = {4};
    for (int k = 0; k < BEACONS; k++) {
        NAME(make)(&w[k], 1);
        memset(&config[k], 0, sizeof config[k]);
        config[k].filter = w[k].filter;
        config[k].filter.sensor = &w[k].sensor[k];
        config[k].consensus.values = N + MK_PACKED(N);
        config[k].consensus.slots = BEACONS;
        config[k].consensus.iterations = 10;
        config[k].consensus.network = BEACONS;
        config[k].consensus.protocol = MK_CONSENSUS_METROPOLIS;
        config[k].consensus.degree = degree;
        for (int l = 0; l < BEACONS; l++) nodes[k][l] = (uint16_t)((k + l) % BEACONS);
        config[k].nodes = nodes[k];
        config[k].numbers = sizeof(REAL) == 8 ? MK_NUMBERS_F64 : MK_NUMBERS_F32;
        assert_int_equal(NODE(start)(&node[k], &config[k]), MK_OK);
        assert_int_equal(NODE(filter_monitor_start)(&monitor[k], &w[k].monitor), MK_OK);
    }
    for (int t = 1; t <= STEPS; t++) {
        double range[BEACONS];
        draw_ranges(&g, t, range);
        for (int k = 0; k < BEACONS; k++) {
            const REAL z = (REAL)range[k];
            assert_int_equal(NODE(predict)(&node[k], (REAL)1.0, NULL), MK_OK);
            assert_int_equal(NODE(measure)(&node[k], &z), MK_OK);
            assert_int_equal(NODE(filter_watch)(&node[k].filter, &monitor[k], nodes[k]), MK_OK);
            NAME(judge)(t, k, NODE(filter_monitor_faulty)(&monitor[k], (uint16_t)k));
            assert_int_equal(node[k].filter.have[0], !NODE(filter_monitor_faulty)(&monitor[k], (uint16_t)k));
            assert_int_equal(NODE(contribute)(&node[k]), MK_OK);
        }
        for (int i = 0; i < 10; i++) {
            uint8_t frame[BEACONS][NODE(frame_max)];
            size_t length[BEACONS];
            for (int k = 0; k < BEACONS; k++) length[k] = NODE(frame)(&node[k], frame[k]);
            for (int k = 0; k < BEACONS; k++)
                for (int l = 0; l < BEACONS; l++)
                    if (l != k) assert_int_equal(NODE(accept)(&node[k], frame[l], length[l]), MK_OK);
            for (int k = 0; k < BEACONS; k++) assert_int_equal(NODE(iterate)(&node[k]), MK_OK);
        }
        for (int k = 0; k < BEACONS; k++) {
            assert_int_equal(NODE(fuse)(&node[k]), MK_OK);
            assert_true(fabs((double)NODE(estimate)(&node[k])[0] - 40.0 - 0.1 * t) < 1.0);
        }
    }
    assert_int_equal(monitor[DRIFTS].core.ends, 1);
}

#undef OWN
#undef NODE
