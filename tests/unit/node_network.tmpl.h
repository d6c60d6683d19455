/* SPDX-License-Identifier: MIT */

/* What a careful programmer would do with <meshkal/rkfd.h>: one place a neighbour for readings and one for estimates. */
typedef struct {
    UNIT(filter_t) filter;
    uint32_t step;
    int second; /* between incremental and diffuse */
    int left_behind;
    REAL y[SLOTS][M], psi[SLOTS][N];
    int have_y[SLOTS], have_psi[SLOTS], heard[SLOTS], is_ahead[SLOTS];
    uint32_t next[SLOTS]; /* step that a neighbour which is ahead begins after what it sent */
    uint32_t expected[MK_STATUS_COUNT];
} V(mirror_t);

typedef struct {
    double time;
    int node, length, sender, stage; /* length 0: the next stage of `node` begins */
    uint32_t step;
    uint8_t bytes[128];
    REAL values[N];
} V(event_t);

typedef struct {
    V(bench_t) bench[NODES];
    V(mirror_t) mirror[NODES];
    V(event_t) event[MOST_EVENTS];
    int events, stage_of[NODES], asleep[NODES], out_since[NODES], worst_way_back, early, jumps, over;
    double loss, offset[NODES];
    uint32_t base;
    generator_t g;
} V(net_t);

static void V(later)(V(net_t) * net, const V(event_t) * event) {
    assert_true(net->events < MOST_EVENTS);
    net->event[net->events++] = *event;
}

static void V(mirror_restart)(V(bench_t) * b, V(mirror_t) * mirror, uint32_t step) {
    assert_int_equal(UNIT(filter_start)(&mirror->filter, &b->config.filter), MK_OK);
    memset(mirror->have_y, 0, sizeof mirror->have_y);
    memset(mirror->have_psi, 0, sizeof mirror->have_psi);
    mirror->step = step;
    mirror->second = 0;
    mirror->left_behind = 0;
}

static void V(mirror_incremental)(V(mirror_t) * mirror) {
    for (int l = 0; l < SLOTS; l++) {
        if (mirror->have_y[l]) assert_int_equal(UNIT(filter_put_measurement)(&mirror->filter, l, mirror->y[l]), MK_OK);
        mirror->have_y[l] = 0;
    }
    assert_int_equal(UNIT(filter_incremental)(&mirror->filter, NULL), MK_OK);
    mirror->second = 1;
}

static void V(mirror_end)(V(mirror_t) * mirror) {
    for (int l = 1; l < SLOTS; l++) {
        if (mirror->have_psi[l]) assert_int_equal(UNIT(filter_put_estimate)(&mirror->filter, l, mirror->psi[l]), MK_OK);
        mirror->have_psi[l] = 0;
    }
    assert_int_equal(UNIT(filter_diffuse)(&mirror->filter), MK_OK);
    mirror->second = 0;
    mirror->step++;
}

static void V(mirror_diffuse)(V(net_t) * net, V(bench_t) * b, V(mirror_t) * mirror) {
    uint32_t least = 0;
    int heard = 0, ahead = 0;
    V(mirror_end)(mirror);
    for (int l = 1; l < SLOTS; l++) {
        const uint32_t lead = mirror->is_ahead[l] ? mirror->next[l] - mirror->step : 0;
        heard += mirror->heard[l];
        if (lead == 0 || lead >= 0x80000000u) continue;
        if (ahead++ == 0 || lead < least) least = lead;
    }
    memset(mirror->heard, 0, sizeof mirror->heard);
    memset(mirror->is_ahead, 0, sizeof mirror->is_ahead);
    if (ahead > 0) mirror->left_behind++;
    else if (heard > 0) mirror->left_behind = 0;
    if (ahead == 0 || (2 * ahead < heard && mirror->left_behind < MK_NODE_LEFT_BEHIND)) return;
    mirror->left_behind = 0;
    net->jumps++;
    if (least > b->config.catch_up) {
        const uint32_t step = mirror->step + least;
        V(mirror_restart)(b, mirror, step);
    } else {
        for (; least > 0; least--) {
            V(mirror_incremental)(mirror);
            V(mirror_end)(mirror);
        }
    }
}

/* What must become of a frame; it is kept in the mirror if it is to be used. */
static mk_status_t V(mirror_accept)(V(net_t) * net, V(mirror_t) * mirror, const V(event_t) * event, int slot, int rows) {
    const int32_t stages = 2 * (int32_t)(event->step - mirror->step) + (event->stage - 1) - mirror->second;
    mirror->heard[slot] = 1;
    if ((int32_t)(event->step - mirror->step) < 0 || stages < 0) return MK_ERROR_LATE;
    if (stages > 1) {
        const uint32_t next = event->step + (event->stage == 2 || !mirror->second);
        if (!mirror->is_ahead[slot] || (int32_t)(next - mirror->next[slot]) > 0) mirror->next[slot] = next;
        mirror->is_ahead[slot] = 1;
        return MK_ERROR_AHEAD;
    }
    int *const have = event->stage == 1 ? mirror->have_y : mirror->have_psi;
    if (have[slot]) return MK_ERROR_REPEATED;
    have[slot] = 1;
    net->early += stages == 1;
    if (event->stage == 1) memcpy(mirror->y[slot], event->values, (size_t)rows * sizeof(REAL));
    else memcpy(mirror->psi[slot], event->values, sizeof mirror->psi[slot]);
    return MK_OK;
}

static void V(send)(V(net_t) * net, int k, int stage, double now) {
    V(event_t) event;
    memset(&event, 0, sizeof event);
    event.length = (int)UNIT(frame)(&net->bench[k].node, stage, event.bytes);
    if (event.length == 0) return;
    event.sender = k;
    event.stage = stage;
    event.step = net->bench[k].node.node.step;
    memcpy(event.values, stage == 1 ? net->bench[k].node.filter.y : net->bench[k].node.filter.psi,
           (size_t)(stage == 1 ? net->bench[k].rows[0] : N) * sizeof(REAL));
    for (int l = 1; l < SLOTS; l++) {
        const int copies = draw_chance(&net->g, net->loss) ? 0 : draw_chance(&net->g, net->loss / 2) ? 2 : 1;
        event.node = net->bench[k].nodes[l] - 10;
        for (int i = 0; i < copies; i++) {
            event.time = now + draw_uniform(&net->g, 0.02, net->loss > 0.0 && draw_chance(&net->g, 0.03) ? 4.0 : 0.3);
            V(later)(net, &event);
        }
    }
}

static void V(same)(const V(net_t) * net, int k) {
    const V(bench_t) *const b = &net->bench[k];
    const V(mirror_t) *const mirror = &net->mirror[k];
    assert_int_equal(b->node.node.step, mirror->step);
    assert_memory_equal(b->node.filter.x, mirror->filter.x, sizeof mirror->filter.x);
    assert_memory_equal(b->node.filter.W, mirror->filter.W, sizeof mirror->filter.W);
    for (int i = 0; i < N; i++) assert_true(isfinite(b->node.filter.x[i]));
}

/* The next stage of a node begins; the one before ends. */
static void V(turn)(V(net_t) * net, int k, double now) {
    V(bench_t) *const b = &net->bench[k];
    V(mirror_t) *const mirror = &net->mirror[k];
    const int stage = net->stage_of[k]++;
    const uint32_t global = net->base + (uint32_t)stage / 2;
    V(event_t) event;
    memset(&event, 0, sizeof event);
    event.node = k;
    event.time = stage + 1 + net->offset[k] + draw_uniform(&net->g, 0.0, 0.2);
    if (net->stage_of[k] < STAGES) V(later)(net, &event);
    if (net->asleep[k] > 0 && stage % 2 == 0) net->asleep[k]--;
    if (net->asleep[k] > 0) return;
    if (stage % 2 == 1) {
        if (b->node.filter.core.stage != 1) return; /* woke up in stage 2 */
        assert_int_equal(UNIT(incremental)(&b->node), MK_OK);
        V(mirror_incremental)(mirror);
        assert_memory_equal(UNIT(intermediate)(&b->node), mirror->filter.psi, sizeof(REAL) * N);
        V(send)(net, k, 2, now);
        return;
    }
    if (b->node.filter.core.stage == 2) {
        assert_int_equal(UNIT(diffuse)(&b->node), MK_OK);
        V(mirror_diffuse)(net, b, mirror);
        V(same)(net, k);
    }
    if (b->node.node.step == global) {
        if (net->out_since[k] >= 0 && stage / 2 - net->out_since[k] > net->worst_way_back) net->worst_way_back = stage / 2 - net->out_since[k];
        net->out_since[k] = -1;
    } else {
        net->over++;
    }
    /* One node at a time is rebooted or falls asleep; all of it ends well before the run does. */
    if (net->loss > 0.0 && stage % 40 == 20 && stage < STAGES - 100 && (stage / 40) % NODES == k) {
        net->out_since[k] = stage / 2;
        if (net->base == 0 && draw_chance(&net->g, 0.5)) {
            assert_int_equal(UNIT(start)(&b->node, &b->config), MK_OK);
            V(mirror_restart)(b, mirror, 0);
            memset(mirror->heard, 0, sizeof mirror->heard);
            memset(mirror->is_ahead, 0, sizeof mirror->is_ahead);
            memset(mirror->expected, 0, sizeof mirror->expected);
        } else {
            net->asleep[k] = 1 + draw_below(&net->g, 10);
            net->out_since[k] += net->asleep[k];
            return;
        }
    }
    if (b->rows[0] > 0) {
        REAL y[M];
        for (int r = 0; r < M; r++) y[r] = (REAL)(5.0 * draw_normal(&net->g));
        assert_int_equal(UNIT(measure)(&b->node, y), MK_OK);
        memcpy(mirror->y[0], y, sizeof y);
        mirror->have_y[0] = 1;
        V(send)(net, k, 1, now);
    }
}

static void V(arrive)(V(net_t) * net, const V(event_t) * event) {
    V(bench_t) *const b = &net->bench[event->node];
    V(mirror_t) *const mirror = &net->mirror[event->node];
    int slot = 0;
    while (b->nodes[slot] != event->sender + 10) slot++;
    if (net->asleep[event->node] > 0) return;
    const mk_status_t expected = V(mirror_accept)(net, mirror, event, slot, b->rows[slot]), found = V(give)(b, event->bytes, (size_t)event->length);
    if (found != expected) fail_msg("%s, not %s", mk_status_name(found), mk_status_name(expected));
    mirror->expected[expected]++;
    assert_memory_equal(mirror->expected, b->node.node.counts, sizeof mirror->expected);
}

static V(net_t) * V(run)(double loss, uint32_t base, uint64_t seed) {
    V(net_t) *const net = calloc(1, sizeof *net);
    assert_non_null(net);
    net->g.state = seed;
    net->loss = loss;
    net->base = base;
    for (int k = 0; k < NODES; k++) {
        V(bench_start)(&net->bench[k], 10 + k, 10 + (k + 1) % NODES, 10 + (k + 5) % NODES, 10 + (k + 3) % NODES);
        if (base) {
            assert_int_equal(UNIT(advance)(&net->bench[k].node, base / 2), MK_OK);
            assert_int_equal(UNIT(advance)(&net->bench[k].node, base), MK_OK);
        }
        V(mirror_restart)(&net->bench[k], &net->mirror[k], base);
        net->out_since[k] = -1;
        net->offset[k] = loss > 0.0 ? draw_uniform(&net->g, 0.0, 0.3) : 0.0;
        V(event_t) event;
        memset(&event, 0, sizeof event);
        event.node = k;
        event.time = net->offset[k];
        V(later)(net, &event);
    }
    while (net->events > 0) {
        int next = 0;
        for (int i = 1; i < net->events; i++)
            if (net->event[i].time < net->event[next].time) next = i;
        const V(event_t) event = net->event[next];
        net->event[next] = net->event[--net->events];
        if (event.length) V(arrive)(net, &event);
        else V(turn)(net, event.node, event.time);
    }
    /* All are in step at the end. */
    for (int k = 0; k < NODES; k++) assert_int_equal(net->out_since[k], -1);
    return net;
}

/* Nothing lost, one clock: everything arrives in its turn, and nobody is ever out of step. */
static void V(calm)(void **unused) {
    (void)unused;
    V(net_t) *const net = V(run)(0.0, 0, 1);
    for (int k = 0; k < NODES; k++) {
        assert_int_equal(net->bench[k].node.node.counts[MK_ERROR_LATE] + net->bench[k].node.node.counts[MK_ERROR_AHEAD], 0);
        assert_int_equal(net->bench[k].node.node.counts[MK_ERROR_REPEATED], 0);
    }
    assert_int_equal(net->over, 0);
    free(net);
}

static void V(stormy)(void **unused) {
    (void)unused;
    for (uint64_t seed = 1; seed <= 4; seed++) {
        V(net_t) *const net = V(run)(0.2, 0, seed);
        /* Or less would have been tested than is meant. */
        assert_true(net->early > 50 && net->jumps >= 12);
        assert_true(net->worst_way_back <= 10);
        free(net);
    }
}

/* Whichever nodes are rebooted together, all are in step again: a network cannot fall apart. */
static void V(rebooted_together)(void **unused) {
    (void)unused;
    static V(bench_t) b[NODES];
    for (unsigned set = 1; set < (1u << NODES) - 1; set++) {
        for (int k = 0; k < NODES; k++) V(bench_start)(&b[k], 10 + k, 10 + (k + 1) % NODES, 10 + (k + 5) % NODES, 10 + (k + 3) % NODES);
        for (int t = 0; t < 60; t++) {
            for (int k = 0; k < NODES && t == 20; k++)
                if (set >> k & 1u) assert_int_equal(UNIT(start)(&b[k].node, &b[k].config), MK_OK);
            for (int k = 0; k < NODES; k++) {
                const REAL y[M] = {(REAL)0.1, (REAL)0.2};
                assert_int_equal(UNIT(measure)(&b[k].node, y), MK_OK);
            }
            for (int stage = 1; stage <= 2; stage++) {
                uint8_t bytes[NODES][UNIT(frame_max)];
                size_t length[NODES];
                for (int k = 0; k < NODES; k++) length[k] = UNIT(frame)(&b[k].node, stage, bytes[k]);
                for (int k = 0; k < NODES; k++)
                    for (int l = 1; l < SLOTS; l++)
                        (void)UNIT(accept)(&b[k].node, bytes[b[k].nodes[l] - 10], length[b[k].nodes[l] - 10]);
                for (int k = 0; k < NODES; k++) assert_int_equal(stage == 1 ? UNIT(incremental)(&b[k].node) : UNIT(diffuse)(&b[k].node), MK_OK);
            }
        }
        for (int k = 0; k < NODES; k++) assert_int_equal(b[k].node.node.step, 60);
    }
}

/* Steps pass from 2^32 - 1 to 0 in the middle of the run; nodes sleep, before, after and across it. */
static void V(around_zero)(void **unused) {
    (void)unused;
    V(net_t) *const net = V(run)(0.2, UINT32_MAX - STAGES / 4, 7);
    for (int k = 0; k < NODES; k++) assert_true(net->bench[k].node.node.step < STAGES);
    assert_true(net->worst_way_back <= 10);
    free(net);
}
