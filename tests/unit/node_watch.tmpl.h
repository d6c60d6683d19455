/* SPDX-License-Identifier: MIT */
#include "node_replay.tmpl.h"

MK_WATCH_OF(V(unit), PRECISION, M, SLOTS, WINDOW);

typedef struct {
    V(bench_t) bench[NODES];
    UNIT(monitor_t) monitor[NODES];
    UNIT(monitor_config_t) config;
    REAL threshold[SLOTS * M], zero[M], back[M];
    int watched;
    double x[N];
    generator_t g;
} V(watched_t);

static void V(watched_make)(V(watched_t) * net, int watched, uint64_t seed) {
    memset(net, 0, sizeof *net);
    net->g.state = seed;
    net->watched = watched;
    assert_int_equal(MK(mk_gate_thresholds)(1e-8, SLOTS * M, net->threshold), MK_OK);
    assert_int_equal(MK(mk_gate_thresholds)(1e-3, M, net->zero), MK_OK);
    assert_int_equal(MK(mk_gate_thresholds)(0.1, M, net->back), MK_OK);
    net->config.m = M;
    net->config.places = SLOTS;
    net->config.window = WINDOW;
    net->config.threshold = net->threshold;
    net->config.zero = net->zero;
    net->config.back = net->back;
    net->config.level = (REAL)0.01;
    net->config.slope = (REAL)1e-4;
    net->config.separation = (REAL)10.0;
    net->config.most = 2;
    net->config.scheme = MK_MONITOR_EXCLUDE;
    assert_int_equal(MK(mk_monitor_evidence)(0.01, 1000.0, &net->config.evidence), MK_OK);
    for (int k = 0; k < NODES; k++) {
        V(bench_start)(&net->bench[k], 10 + k, 10 + (k + 1) % NODES, 10 + (k + 5) % NODES, 10 + (k + 3) % NODES);
        assert_int_equal(UNIT(monitor_start)(&net->monitor[k], &net->config), MK_OK);
    }
    for (int i = 0; i < N; i++) net->x[i] = (double)net->bench[0].x0[i];
}

/* sum += root v, v standard normal, root that of a packed covariance of n rows. */
static void V(add_noise)(generator_t *g, int n, const REAL *covariance, double *sum) {
    double root[N][N], v[N];
    for (int i = 0; i < n; i++) {
        v[i] = draw_normal(g);
        for (int j = 0; j <= i; j++) {
            double left = (double)covariance[i * (i + 1) / 2 + j];
            for (int k = 0; k < j; k++) left -= root[i][k] * root[j][k];
            root[i][j] = i == j ? sqrt(left) : left / root[j][j];
        }
        for (int j = 0; j <= i; j++) sum[i] += root[i][j] * v[j];
    }
}

static void V(move_truth)(V(watched_t) * net) {
    const V(bench_t) *const b = &net->bench[0];
    double next[N];
    for (int i = 0; i < N; i++) {
        next[i] = (double)b->r[i];
        for (int j = 0; j < N; j++) next[i] += (double)b->A[i * N + j] * net->x[j];
    }
    V(add_noise)(&net->g, N, b->Q, next);
    memcpy(net->x, next, sizeof next);
}

/* A frame in five is lost, and all of the faulty sensor's for a while, in which nobody can tell whether it is over. */
static int V(is_lost)(V(watched_t) * net, int t, int sender) {
    const int silent = 10 + sender == DRIFTS && t >= SILENT_FROM && t < SILENT_TO, lost = draw_chance(&net->g, 0.2);
    return silent || lost;
}

static void V(exchange)(V(watched_t) * net, int t, int stage) {
    uint8_t bytes[NODES][UNIT(frame_max)];
    size_t length[NODES];
    for (int k = 0; k < NODES; k++) length[k] = UNIT(frame)(&net->bench[k].node, stage, bytes[k]);
    for (int k = 0; k < NODES; k++)
        for (int l = 1; l < SLOTS; l++) {
            const int sender = net->bench[k].nodes[l] - 10;
            if (V(is_lost)(net, t, sender) || length[sender] == 0) continue; /* node 14 only relays */
            assert_int_equal(UNIT(accept)(&net->bench[k].node, bytes[sender], length[sender]), MK_OK);
        }
}

/* One step of the network. */
static void V(watched_step)(V(watched_t) * net, int t) {
    V(move_truth)(net);
    for (int k = 0; k < NODES; k++) {
        V(bench_t) *const b = &net->bench[k];
        REAL C[M * N], R[3], y[M];
        double value[N] = {0.0};
        const int rows = V(sensor)(10 + k, C, R);
        for (int r = 0; r < rows; r++)
            for (int i = 0; i < N; i++) value[r] += (double)C[r * N + i] * net->x[i];
        V(add_noise)(&net->g, rows, R, value);
        if (10 + k == DRIFTS && t > FROM && t <= TO) value[0] += RATE * (t - FROM);
        for (int r = 0; r < M; r++) y[r] = (REAL)value[r];
        if (rows) assert_int_equal(UNIT(measure)(&b->node, y), MK_OK);
    }
    V(exchange)(net, t, MK_STAGE_MEASUREMENT);
    for (int k = 0; k < NODES; k++) {
        V(bench_t) *const b = &net->bench[k];
        if (net->watched) {
            assert_int_equal(UNIT(watch)(&b->node, &net->monitor[k], b->nodes), MK_OK);
            for (int l = 0; l < SLOTS; l++)
                if (UNIT(monitor_faulty)(&net->monitor[k], b->nodes[l])) assert_int_equal(b->node.filter.have_y[l], 0);
        }
        assert_int_equal(UNIT(incremental)(&b->node), MK_OK);
    }
    V(exchange)(net, t, MK_STAGE_ESTIMATE);
    for (int k = 0; k < NODES; k++) assert_int_equal(UNIT(diffuse)(&net->bench[k].node), MK_OK);
}

static int V(hears)(const V(watched_t) * net, int k, int number) {
    for (int l = 0; l < SLOTS; l++)
        if (net->bench[k].nodes[l] == number) return 1;
    return 0;
}

/* Squared errors of all estimates, which are of the step that comes next. */
static double V(errors)(V(watched_t) * net) {
    const V(bench_t) *const b = &net->bench[0];
    double sum = 0.0;
    for (int i = 0; i < N; i++) {
        double mean = (double)b->r[i];
        for (int j = 0; j < N; j++) mean += (double)b->A[i * N + j] * net->x[j];
        for (int k = 0; k < NODES; k++) {
            const double d = (double)net->bench[k].node.filter.x[i] - mean;
            sum += d * d;
        }
    }
    return sum;
}

static void V(add_to_hash)(unsigned long long *hash, const void *bytes, size_t length) {
    for (size_t i = 0; i < length; i++) *hash = (*hash ^ ((const unsigned char *)bytes)[i]) * 1099511628211ull;
}

/* Every node that hears the sensor leaves it out, and nobody else, until it is good again; errors stay near those without a fault; the record of a
   node runs again without a monitor; unrolled and shared are the same. */
static void V(drift)(void **unused) {
    (void)unused;
    static V(watched_t) net, bare;
    static V(bench_t) again;
    static uint8_t memory[1 << 20];
    mk_recorder_t recorder = {memory, sizeof memory, 0, 0, 1};
    unsigned long long hash = 14695981039346656037ull;
    double during[2] = {0.0, 0.0}, before = 0.0;
    V(watched_make)(&net, 1, 5);
    V(watched_make)(&bare, 0, 5);
    assert_int_equal(UNIT(record)(&net.bench[0].node, &recorder), MK_OK);
    assert_true(V(hears)(&net, 0, DRIFTS));
    for (int t = 0; t < STEPS; t++) {
        V(watched_step)(&net, t);
        V(watched_step)(&bare, t);
        for (int k = 0; k < NODES; k++) {
            const UNIT(monitor_t) *const monitor = &net.monitor[k];
            V(add_to_hash)(&hash, net.bench[k].node.filter.x, sizeof net.bench[k].node.filter.x);
            V(add_to_hash)(&hash, &monitor->core.rctm, sizeof monitor->core.rctm);
            V(add_to_hash)(&hash, &monitor->core.aime, sizeof monitor->core.aime);
            for (int p = 0; p < SLOTS; p++)
                if (monitor->sensor[p].faulty) assert_int_equal(monitor->sensor[p].id, DRIFTS);
            const int held = UNIT(monitor_faulty)(&net.monitor[k], DRIFTS);
            if (t <= FROM || t > TO + 5 || !V(hears)(&net, k, DRIFTS)) assert_false(held);
            if (t > FROM + 40 && t <= TO && V(hears)(&net, k, DRIFTS)) assert_true(held);
        }
        if (t >= 50 && t < FROM) before += V(errors)(&net) / (FROM - 50);
        if (t < FROM + 40 || t > TO) continue;
        during[0] += V(errors)(&net) / (TO - FROM - 40);
        during[1] += V(errors)(&bare) / (TO - FROM - 40);
    }
    for (int k = 0; k < NODES; k++) assert_int_equal(net.monitor[k].core.ends, V(hears)(&net, k, DRIFTS));
    assert_true(during[0] < 1.5 * before && during[1] > 5.0 * during[0]);

    assert_int_equal(recorder.lost, 0);
    V(bench_make)(&again, 10, 11, 15, 13);
    assert_true(V(replay)(&again, recorder.bytes, recorder.used) > 4 * STEPS);
    assert_memory_equal(again.node.filter.x, net.bench[0].node.filter.x, sizeof again.node.filter.x);

    unsigned long long *const other = &hashes[BITS == 64];
    assert_true(*other == 0 || *other == hash);
    *other = hash;
}

/* A node saved and restored in the fault, with its monitor copied, goes on bit for bit. */
static void V(restored)(void **unused) {
    (void)unused;
    static V(watched_t) net, other;
    static uint8_t blob[UNIT(blob_max)];
    V(watched_make)(&net, 1, 6);
    for (int t = 0; t < RESTORED; t++) V(watched_step)(&net, t);
    V(watched_make)(&other, 1, 6);
    for (int k = 0; k < NODES; k++) {
        const size_t length = UNIT(save)(&net.bench[k].node, blob);
        assert_int_equal(UNIT(restore)(&other.bench[k].node, &other.bench[k].config, blob, length), MK_OK);
        other.monitor[k] = net.monitor[k];
        other.monitor[k].core.config = &other.config;
        assert_int_equal(UNIT(monitor_faulty)(&other.monitor[k], DRIFTS), V(hears)(&net, k, DRIFTS));
    }
    memcpy(other.x, net.x, sizeof net.x);
    other.g = net.g;
    for (int t = RESTORED; t < STEPS; t++) {
        V(watched_step)(&net, t);
        V(watched_step)(&other, t);
        for (int k = 0; k < NODES; k++) {
            assert_memory_equal(net.bench[k].node.filter.x, other.bench[k].node.filter.x, sizeof net.bench[k].node.filter.x);
            assert_true(net.monitor[k].core.aime == other.monitor[k].core.aime && net.monitor[k].core.ends == other.monitor[k].core.ends);
        }
    }
}

/* A node that starts again in the fault with a monitor that starts again, too, finds it again; one whose monitor goes on never lets go of it. */
static void V(restarted)(void **unused) {
    (void)unused;
    static V(watched_t) net;
    for (int fresh = 0; fresh < 2; fresh++) {
        V(watched_make)(&net, 1, 7);
        for (int t = 0; t < STEPS; t++) {
            V(watched_step)(&net, t);
            V(bench_t) *const b = &net.bench[0];
            if (t == RESTORED) {
                assert_true(UNIT(monitor_faulty)(&net.monitor[0], DRIFTS));
                assert_int_equal(UNIT(restart)(&b->node, b->x0, b->P0), MK_OK);
                if (fresh) assert_int_equal(UNIT(monitor_restart)(&net.monitor[0]), MK_OK);
                assert_int_equal(UNIT(monitor_faulty)(&net.monitor[0], DRIFTS), !fresh);
            }
            if (t > RESTORED && t <= TO && (!fresh || t > RESTORED + 20)) assert_true(UNIT(monitor_faulty)(&net.monitor[0], DRIFTS));
            if (t > TO + 5) assert_false(UNIT(monitor_faulty)(&net.monitor[0], DRIFTS));
            for (int l = 0; l < SLOTS; l++)
                assert_true(b->nodes[l] == DRIFTS || !UNIT(monitor_faulty)(&net.monitor[0], b->nodes[l]));
        }
    }
}

/* Between incremental and diffuse there is nothing to watch: nothing changes. */
static void V(refused_watch)(void **unused) {
    (void)unused;
    static V(watched_t) net;
    V(watched_make)(&net, 1, 8);
    for (int t = 0; t < 50; t++) V(watched_step)(&net, t);
    V(bench_t) *const b = &net.bench[0], before;
    assert_int_equal(UNIT(incremental)(&b->node), MK_OK);
    memcpy(&before, b, sizeof before);
    const UNIT(monitor_t) monitor = net.monitor[0];
    assert_int_equal(UNIT(watch)(&b->node, &net.monitor[0], b->nodes), MK_ERROR_ORDER);
    assert_memory_equal(&before, b, sizeof before);
    assert_memory_equal(&monitor, &net.monitor[0], sizeof monitor);
}
