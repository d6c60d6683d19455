/* SPDX-License-Identifier: MIT */
#include "simulation/look.tmpl.h"

/* A node keeps core, x, W and psi. What lives within a step only, its readings and what it hears of psi, is the thread's. So is, in a network
   too large for the caches, its configuration: put together for each step out of what the network holds of each sensor once. */
typedef struct {
    int n, estimators, threads;
    const mk_scenario_t *scenario;
    const mk_topology_t *topology;
    const double *tolerance;
    MK_REAL *model;     /* A, Q, input, x0, P0 */
    MK_F_T(mk_rkfd) * core;
    MK_REAL *x, *W, *psi;
    MK_REAL *sensor;     /* the blocks of all sensors that are heard; null once every estimator has its own copies */
    size_t *sensor_first;
    uint8_t *sensor_rows;
    MK_F_T(mk_rkfd_config) * config; /* of every estimator; with `sensor` of every thread */
    MK_REAL *room;                   /* of the configurations */
    uint8_t *rows;
    MK_F_T(mk_rkfd_steady) * steady; /* of every estimator, Phi null where it has none; null: no gain is frozen */
    MK_REAL *steady_room;
    size_t *steady_first;
    double close;
    MK_F_T(mk_host_monitor) **monitor; /* of every estimator; null: none */
    /* Of each thread: scratch of the kernels, y, psi; have_y, have_psi. */
    MK_REAL *scratch;
    uint8_t *flags;
    size_t work_size, y_size, scratch_size, most_slots, room_size;
    chunk_t *chunk;
} MK_F_T(network);

static int MK_F(most_rows)(const MK_F_T(network) * net, int e) {
    const mk_topology_t *topology = net->topology;
    int most = 1;
    for (int i = topology->first[e]; i < topology->first[e + 1]; i++) {
        const int rows = net->sensor_rows[heard_of(topology, i)];
        if (rows > most) most = rows;
    }
    return most;
}

/* Sensors of estimator e into room and rows, and the configuration over them. Weights are not among what the incremental step asks for. */
static void MK_F(configure)(const MK_F_T(network) * net, int e, MK_F_T(mk_rkfd_config) * config, MK_REAL *room, uint8_t *rows) {
    const mk_topology_t *topology = net->topology;
    const int first = topology->first[e], slots = topology->first[e + 1] - first, m = MK_F(most_rows)(net, e);
    MK_F(mk_config_open)(config, net->n, m, slots, net->tolerance[e], net->model, room, rows);
    if (net->steady && net->steady[e].Phi) config->steady = &net->steady[e];
    for (int l = 0; l < slots; l++) {
        const int k = heard_of(topology, first + l);
        MK_F(mk_config_slot)(net->n, m, slots, l, net->sensor + net->sensor_first[k], net->sensor_rows[k], room, rows);
    }
}

/* The configuration that estimator e steps with on this thread. */
static const MK_F_T(mk_rkfd_config) * MK_F(configuration)(MK_F_T(network) * net, int worker, int e) {
    if (!net->sensor) return &net->config[e];
    MK_F_T(mk_rkfd_config) *config = &net->config[worker];
    MK_F(configure)(net, e, config, net->room + (size_t)worker * net->room_size, net->rows + (size_t)worker * net->most_slots);
    net->core[e].config = config;
    return config;
}

/* Its weights, which are all that the diffusion asks for; the number of its slots. */
static int MK_F(configure_weights)(MK_F_T(network) * net, int worker, int e) {
    const int first = net->topology->first[e], slots = net->topology->first[e + 1] - first;
    if (!net->sensor) return slots;
    MK_F_T(mk_rkfd_config) *config = &net->config[worker];
    MK_REAL *room = net->room + (size_t)worker * net->room_size;
    config->slots = (uint16_t)slots;
    config->weight = room;
    MK_F(mk_config_weights)(net->topology->weight + first, slots, room);
    net->core[e].config = config;
    return slots;
}

static MK_F_T(mk_rkfd_view) MK_F(view)(MK_F_T(network) * net, int worker, int e) {
    const size_t n = (size_t)net->n;
    MK_REAL *const work = net->scratch + (size_t)worker * net->scratch_size;
    uint8_t *const flags = net->flags + (size_t)worker * 2 * net->most_slots;
    const MK_F_T(mk_rkfd_view) view = {&net->core[e],
                                       net->x + (size_t)e * n,
                                       net->W + (size_t)e * (size_t)MK_PACKED(n),
                                       work + net->work_size,
                                       net->psi + (size_t)e * n,
                                       flags,
                                       flags + net->most_slots,
                                       work};
    return view;
}

/* --- opening --------------------------------------------------------------------------------------------------------------- */

static void MK_F(put_sensors)(void *context, int worker, long index) {
    MK_F_T(network) *net = context;
    const mk_scenario_t *s = net->scenario;
    const int begin = (int)index * CHUNK, sensors = sensors_of(net->topology, s), end = begin + CHUNK < sensors ? begin + CHUNK : sensors;
    double *work = mk_allocate(MK_SENSOR_NUMBERS((size_t)s->n, (size_t)MK_LARGEST_STATE), sizeof *work);
    (void)worker;
    for (int k = begin; k < end; k++)
        MK_F(mk_sensor_put)(s->n, &s->sensor[node_of(net->topology, k)], net->sensor + net->sensor_first[k], work);
    free(work);
}

/* Room for the configurations and for the threads. */
static void MK_F(allocate)(MK_F_T(network) * net) {
    const size_t n = (size_t)net->n, E = (size_t)net->estimators, threads = (size_t)net->threads;
    size_t all = 0;
    for (int e = 0; e < net->estimators; e++) {
        const size_t slots = (size_t)(net->topology->first[e + 1] - net->topology->first[e]), m = (size_t)MK_F(most_rows)(net, e);
        const size_t own = MK_CONFIG_NUMBERS(n, m, slots), work = MK_RKFD_WORK(n, m), predict = MK_RKFD_PREDICT_WORK(n, m);
        all += own;
        if (own > net->room_size) net->room_size = own;
        if (slots > net->most_slots) net->most_slots = slots;
        if (work > net->work_size) net->work_size = work;
        if (predict > net->work_size) net->work_size = predict; /* the innovations' is no larger */
        if (slots * m > net->y_size) net->y_size = slots * m;
    }
    net->scratch_size = net->work_size + net->y_size + net->most_slots * n;
    net->scratch = mk_allocate(threads * net->scratch_size, sizeof *net->scratch);
    net->flags = mk_allocate(threads * 2 * net->most_slots, 1);
    const int copies = all * sizeof *net->room <= MOST_COPIED || all <= 2 * net->sensor_first[sensors_of(net->topology, net->scenario)];
    net->config = mk_allocate(copies ? E : threads, sizeof *net->config);
    net->room = mk_allocate(copies ? all : threads * net->room_size, sizeof *net->room);
    net->rows = mk_allocate(copies ? (size_t)net->topology->first[E] : threads * net->most_slots, 1);
    if (!copies) return;
    MK_REAL *next = net->room;
    for (int e = 0; e < net->estimators; e++) {
        MK_F_T(mk_rkfd_config) *config = &net->config[e];
        MK_F(configure)(net, e, config, next, net->rows + net->topology->first[e]);
        MK_F(mk_config_weights)(net->topology->weight + net->topology->first[e], config->slots, next);
        next += MK_CONFIG_NUMBERS(n, (size_t)config->m, (size_t)config->slots);
    }
    free(net->sensor);
    net->sensor = NULL;
}

static void MK_F(put_steady)(void *context, int worker, long index) {
    MK_F_T(network) *net = context;
    const int e = (int)index;
    const char *why;
    MK_F_T(mk_rkfd_config) config;
    (void)worker;
    MK_F(mk_config_make)(&config, net->scenario, net->topology, e, net->tolerance[e]);
    MK_F_T(mk_rkfd_steady) *steady = &net->steady[e];
    if (!MK_F(mk_steady_make)(steady, net->steady_room + net->steady_first[e], &config, net->scenario, net->topology, e, net->tolerance[e], net->close, &why))
        steady->Phi = NULL;
    MK_F(mk_config_free)(&config);
}

static void MK_F(make_steady)(MK_F_T(network) * net) {
    const size_t n = (size_t)net->n, E = (size_t)net->estimators;
    net->steady = mk_allocate(E, sizeof *net->steady);
    net->steady_first = mk_allocate(E + 1, sizeof *net->steady_first);
    for (size_t e = 0; e < E; e++) {
        const size_t slots = (size_t)(net->topology->first[e + 1] - net->topology->first[e]), m = (size_t)MK_F(most_rows)(net, (int)e);
        net->steady_first[e + 1] = net->steady_first[e] + MK_STEADY_NUMBERS(n, m, slots);
    }
    net->steady_room = mk_allocate(net->steady_first[E], sizeof *net->steady_room);
    mk_parallel(net->threads, net->estimators, MK_F(put_steady), net);
}

static void *MK_F(open)(const mk_scenario_t *s, const mk_topology_t *topology, const double *tolerance, double frozen,
                        const mk_monitor_settings_t *monitor, int threads) {
    const size_t n = (size_t)s->n, E = (size_t)topology->estimators;
    const int sensors = sensors_of(topology, s);
    MK_F_T(network) *net = mk_allocate(1, sizeof *net);
    net->n = s->n;
    net->estimators = topology->estimators;
    net->threads = threads;
    net->scenario = s;
    net->topology = topology;
    net->tolerance = tolerance;
    net->model = mk_allocate(MK_MODEL_NUMBERS(n), sizeof *net->model);
    MK_F(mk_model_put)(s, net->model);
    net->core = mk_allocate(E, sizeof *net->core);
    net->x = mk_allocate(E * n, sizeof *net->x);
    net->W = mk_allocate(E * MK_PACKED(n), sizeof *net->W);
    net->psi = mk_allocate(E * n, sizeof *net->psi);
    net->chunk = mk_allocate(E / CHUNK + 1, sizeof *net->chunk);
    net->sensor_rows = mk_allocate((size_t)sensors, 1);
    net->sensor_first = mk_allocate((size_t)sensors + 1, sizeof *net->sensor_first);
    for (int k = 0; k < sensors; k++) {
        const size_t rows = (size_t)s->sensor[node_of(topology, k)].rows;
        net->sensor_rows[k] = (uint8_t)rows;
        net->sensor_first[k + 1] = net->sensor_first[k] + MK_SENSOR_NUMBERS(n, rows);
    }
    net->sensor = mk_allocate(net->sensor_first[sensors], sizeof *net->sensor);
    mk_parallel(threads, (sensors + CHUNK - 1) / CHUNK, MK_F(put_sensors), net);
    net->close = frozen;
    if (frozen > 0.0) MK_F(make_steady)(net);
    MK_F(allocate)(net);
    if (!monitor || monitor->scheme == MK_MONITOR_NONE) return net;
    net->monitor = mk_allocate(E, sizeof(MK_F_T(mk_host_monitor) *));
    for (int e = 0; e < net->estimators; e++)
        net->monitor[e] = MK_F(mk_host_monitor_open)(monitor, MK_F(most_rows)(net, e), topology->first[e + 1] - topology->first[e]);
    return net;
}

static void MK_F(close)(void *network) {
    MK_F_T(network) *net = network;
    for (int e = 0; net->monitor && e < net->estimators; e++) free(net->monitor[e]);
    free(net->monitor);
    free(net->model);
    free(net->core);
    free(net->x);
    free(net->W);
    free(net->psi);
    free(net->sensor);
    free(net->sensor_first);
    free(net->sensor_rows);
    free(net->config);
    free(net->room);
    free(net->rows);
    free(net->steady);
    free(net->steady_room);
    free(net->steady_first);
    free(net->scratch);
    free(net->flags);
    free(net->chunk);
    free(net);
}

static mk_status_t MK_F(set_tolerance)(void *network, const double *tolerance, int *bad) {
    MK_F_T(network) *net = network;
    mk_status_t first = MK_OK;
    for (int e = 0; e < net->estimators; e++) {
        const mk_status_t status = MK_F(mk_rkfd_set_tolerance)(&net->core[e], (MK_REAL)tolerance[e]);
        if (!is_worse(net->topology, status, e, first, *bad)) continue;
        first = status;
        *bad = e;
    }
    return first;
}

/* --- steps of one estimator, on one thread --------------------------------------------------------------------------------- */

static mk_status_t MK_F(start_one)(MK_F_T(network) * net, int worker, int e) {
    const MK_F_T(mk_rkfd_config) *config = MK_F(configuration)(net, worker, e);
    MK_F_T(mk_rkfd_view) view = MK_F(view)(net, worker, e);
    (void)MK_F(configure_weights)(net, worker, e);
    if (net->monitor) MK_F(mk_host_monitor_start)(net->monitor[e]);
    view.psi = view.y + net->y_size; /* all slots, which start clears */
    return MK_F(mk_rkfd_start)(config->n, config->m, config->slots, &view, config);
}

/* What name_watch of meshkal/monitor.h does. What the monitor cannot take it counts; the step says itself whether it is possible. */
static void MK_F(watch)(MK_F_T(network) * net, const MK_F_T(mk_rkfd_config) * config, const MK_F_T(mk_rkfd_view) * view, int e) {
    MK_F_T(mk_host_monitor) *const monitor = net->monitor[e];
    MK_REAL r[MK_MONITOR_ROWS], S[MK_PACKED(MK_MONITOR_ROWS)];
    uint8_t rows[MK_MONITOR_ROWS];
    if (MK_F(mk_rkfd_innovations)(config->n, config->m, config->slots, view, r, S, rows) == MK_OK)
        (void)MK_F(mk_host_monitor_watch)(monitor, config->slots, slot_number, rows, r, S);
    for (int l = 0; l < config->slots; l++)
        if (MK_F(mk_monitor_faulty)(&monitor->view, slot_number[l])) (void)MK_F(mk_rkfd_drop)(view, l);
}

static mk_status_t MK_F(incremental_one)(const phase_t *phase, int worker, int e) {
    MK_F_T(network) *net = phase->network;
    const MK_F_T(mk_rkfd_config) *config = MK_F(configuration)(net, worker, e);
    const MK_F_T(mk_rkfd_view) view = MK_F(view)(net, worker, e);
    const int base = net->topology->first[e];
    memset(view.have_y, 0, config->slots);
    for (int l = 0; l < config->slots; l++) {
        const int node = net->topology->slot[base + l], rows = config->rows[l];
        const double *reading = phase->y + phase->row_first[node];
        MK_REAL values[MK_LARGEST_STATE];
        if (isnan(reading[0])) phase->arrived[base + l] = 0;
        if (!phase->arrived[base + l]) continue;
        for (int r = 0; r < rows; r++) values[r] = (MK_REAL)reading[r];
        const mk_status_t status = MK_F(mk_rkfd_put)(config->n, config->m, &view, l, values, 0);
        if (status != MK_OK) return status;
    }
    if (phase->seen) MK_F(mk_look_innovations)(&view, e, phase->seen);
    if (net->monitor) MK_F(watch)(net, config, &view, e);
    return MK_F(mk_sized_incremental)(config->n, config->m, config->slots, &view);
}

static mk_status_t MK_F(diffuse_one)(const phase_t *phase, int worker, int e) {
    MK_F_T(network) *net = phase->network;
    const int base = net->topology->first[e], slots = MK_F(configure_weights)(net, worker, e);
    const MK_REAL *const halo = phase->halo;
    const size_t n = (size_t)net->n;
    MK_F_T(mk_rkfd_view) view = MK_F(view)(net, worker, e);
    const MK_REAL *const own = view.psi;
    view.psi = view.y + net->y_size;
    memcpy(view.psi, own, n * sizeof *own);
    memset(view.have_psi, 0, (size_t)slots);
    view.have_psi[0] = 1;
    for (int l = 1; l < slots && phase->arrived; l++) {
        if (!phase->arrived[base + l]) continue;
        const int k = heard_of(net->topology, base + l);
        const MK_REAL *psi = k < net->estimators ? net->psi + (size_t)k * n : halo + (size_t)(k - net->estimators) * n;
        const mk_status_t status = MK_F(mk_rkfd_put_estimate)(net->n, &view, l, psi);
        if (status != MK_OK) return status;
    }
    return MK_F(mk_rkfd_diffuse)(net->n, slots, &view);
}

/* --- all of them ----------------------------------------------------------------------------------------------------------- */

static void MK_F(run_chunk)(void *context, int worker, long index) {
    const phase_t *phase = context;
    MK_F_T(network) *net = phase->network;
    chunk_t *chunk = &net->chunk[index];
    const int begin = phase->begin + (int)index * CHUNK, end = begin + CHUNK < phase->end ? begin + CHUNK : phase->end;
    chunk->status = MK_OK;
    /* Readings lie in the order of node numbers, far apart where estimators are in another: asked for together, they come together. */
    for (int e = begin; e < end && phase->kind == INCREMENT && net->topology->id; e++) PREFETCH(phase->y + phase->row_first[net->topology->id[e]]);
    for (int e = begin; e < end; e++) {
        const mk_status_t status = phase->kind == START       ? MK_F(start_one)(net, worker, e)
                                   : phase->kind == INCREMENT ? MK_F(incremental_one)(phase, worker, e)
                                                              : MK_F(diffuse_one)(phase, worker, e);
        if (!is_worse(net->topology, status, e, chunk->status, chunk->bad)) continue;
        chunk->status = status;
        chunk->bad = e;
    }
}

static mk_status_t MK_F(run_phase)(phase_t *phase, int *bad) {
    MK_F_T(network) *net = phase->network;
    const int chunks = (phase->end - phase->begin + CHUNK - 1) / CHUNK;
    mk_parallel(net->threads, chunks, MK_F(run_chunk), phase);
    mk_status_t first = MK_OK;
    for (int i = 0; i < chunks; i++) {
        const chunk_t *chunk = &net->chunk[i];
        if (!is_worse(net->topology, chunk->status, chunk->bad, first, *bad)) continue;
        first = chunk->status;
        *bad = chunk->bad;
    }
    return first;
}

static mk_status_t MK_F(start)(void *network, int *bad) {
    MK_F_T(network) *net = network;
    phase_t phase = {START, network, 0, net->estimators, NULL, NULL, NULL, NULL, NULL};
    return MK_F(run_phase)(&phase, bad);
}

static mk_status_t MK_F(incremental)(void *network, int begin, int end, const double *y, const int *row_first, uint8_t *arrived, mk_snapshot_t *seen,
                                     int *bad) {
    phase_t phase = {INCREMENT, network, begin, end, y, row_first, arrived, NULL, seen};
    return MK_F(run_phase)(&phase, bad);
}

static mk_status_t MK_F(diffuse)(void *network, int begin, int end, uint8_t *arrived, const void *halo, int *bad) {
    phase_t phase = {DIFFUSE, network, begin, end, NULL, NULL, arrived, halo, NULL};
    return MK_F(run_phase)(&phase, bad);
}

#include "simulation/network_look.tmpl.h"

const mk_network_t MK_F(mk_network) = {sizeof(MK_REAL),     MK_REAL_NAME,      MK_F(open),         MK_F(close),      MK_F(start),
                                       MK_F(set_tolerance), MK_F(incremental), MK_F(diffuse),      MK_F(intermediate), MK_F(estimate),
                                       MK_F(nees),          MK_F(look_before), MK_F(look_after),   MK_F(look_monitor), MK_F(add)};
