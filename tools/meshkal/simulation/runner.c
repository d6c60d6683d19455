/* SPDX-License-Identifier: MIT */
#include "simulation/runner.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "parallel.h"
#include "scenario_faults.h"
#include "scenario_read.h"
#include "signals.h"

/* Estimators that a thread takes at once. Fewer than some of those are not worth waking threads for. */
enum { CHUNK = 1024, WORTH_THREADS = 4 * CHUNK };

/* Steps whose sums wait for the other parts: one sum for all of them costs no more than one for each. Only then is it known that a part has
   failed or was told to stop, so they wait for about as many node steps. */
#define LONGEST_WAIT 64
#define NODE_STEPS_WAIT 100000

/* Sums of one step, in their order. */
enum { SQUARE, POSITION, FINDINGS, STEP_SUMS = FINDINGS + MK_FINDINGS };

int mk_runner_watches(const mk_runner_t *r) { return r->c->monitor.scheme != MK_MONITOR_NONE; }

/* A centre's own sensors are all, a node's is one. */
static void open_snapshot(mk_runner_t *r) {
    const mk_scenario_t *s = r->c->scenario;
    const int E = r->topology->estimators, all = r->source->row_first[s->nodes];
    r->own_first = mk_allocate((size_t)E + 1, sizeof *r->own_first);
    for (int e = 0; e < E; e++) r->own_first[e + 1] = r->own_first[e] + (r->c->filter->central ? all : s->sensor[mk_topology_id(r->topology, e)].rows);
    r->snapshot = mk_snapshot_make(r->c->network, E, s, r->own_first);
}

void mk_runner_open(mk_runner_t *r, const mk_campaign_t *c, const mk_source_t *source, mk_team_t *team, const mk_topology_t *topology,
                    const double *tolerance, const double *schedule, int threads) {
    const mk_scenario_t *s = c->scenario;
    const size_t E = (size_t)topology->estimators, n = (size_t)s->n;
    memset(r, 0, sizeof *r);
    r->c = c;
    r->source = source;
    r->team = team;
    r->topology = topology;
    r->total = c->filter->central ? 1 : s->nodes;
    r->schedule = schedule;
    r->threads = topology->estimators < WORTH_THREADS ? 1 : threads;
    mk_stream_open(&r->stream, source, c->filter->central || team->ranks == 1 ? NULL : topology, team, s->nodes < WORTH_THREADS ? 1 : threads);
    r->net = c->network->open(s, topology, tolerance, schedule ? 0.0 : c->frozen, &c->monitor, threads);
    if (mk_runner_watches(r)) mk_alerts_open(&r->alerts, s, topology, &c->monitor, c->network->real_size, r->total);
    if (c->log_path) open_snapshot(r);
    r->slots = (size_t)topology->first[E];
    r->y_arrived = mk_allocate(2 * r->slots, 1);
    r->psi_arrived = r->y_arrived + r->slots;
    r->state_square = mk_allocate(E * n + 2 * E + n, sizeof *r->state_square);
    r->error = r->state_square + E * n;
    r->node_square = r->error + E;
    r->state_known = r->node_square + E;
    r->sums = mk_allocate(1 + LONGEST_WAIT * STEP_SUMS, sizeof *r->sums); /* more than states, too */
    r->thread_sums = mk_allocate((size_t)r->threads * STEP_SUMS, sizeof *r->thread_sums);
    r->estimate = mk_allocate((size_t)r->threads * CHUNK * n, sizeof *r->estimate);
    const size_t rows = (size_t)source->row_first[s->nodes], value = 8 * (n > MK_LARGEST_STATE ? n : MK_LARGEST_STATE);
    if (r->stream.part) r->own_y = mk_allocate(rows + 1, sizeof *r->own_y);
    r->send = mk_allocate((size_t)topology->sends + 1, value);
    r->receive = mk_allocate((size_t)topology->halo + 1, value);
    if (team->rank == 0 && c->log_path && topology->id) r->gathered = mk_allocate(mk_runner_log_room(r), 1);
}

void mk_runner_close(mk_runner_t *r) {
    if (mk_runner_watches(r)) mk_alerts_close(&r->alerts);
    mk_stream_close(&r->stream);
    r->c->network->close(r->net);
    if (r->c->log_path) mk_snapshot_free(&r->snapshot);
    free(r->y_arrived);
    free(r->state_square);
    free(r->estimate);
    free(r->thread_sums);
    free(r->sums);
    free(r->send);
    free(r->receive);
    free(r->gathered);
    free(r->own_y);
    free(r->own_first);
}

/* Something done for all estimators in step t of a run. */
typedef struct {
    mk_runner_t *r;
    int run, t;
    void (*some)(mk_runner_t *r, int run, int t, int worker, int begin, int end);
} pass_t;

static void pass_chunk(void *context, int worker, long index) {
    const pass_t *pass = context;
    const int estimators = pass->r->topology->estimators, begin = (int)index * CHUNK, end = begin + CHUNK < estimators ? begin + CHUNK : estimators;
    pass->some(pass->r, pass->run, pass->t, worker, begin, end);
}

/* The first thread adds to the sums of the step itself. */
static mk_exact_t *sums_of(mk_runner_t *r, int worker) {
    return worker == 0 ? r->sums + 1 + r->waiting * STEP_SUMS : r->thread_sums + (worker - 1) * STEP_SUMS;
}

static void for_all(mk_runner_t *r, int run, int t, void (*some)(mk_runner_t *r, int run, int t, int worker, int begin, int end)) {
    pass_t pass = {r, run, t, some};
    mk_parallel(r->threads, (r->topology->estimators + CHUNK - 1) / CHUNK, pass_chunk, &pass);
    for (int worker = 1; worker < r->threads; worker++)
        for (int i = 0; i < STEP_SUMS; i++) mk_exact_move(sums_of(r, 0) + i, sums_of(r, worker) + i);
}

static void draw_some_links(mk_runner_t *r, int run, int t, int worker, int from, int to) {
    const mk_topology_t *topology = r->topology;
    (void)worker;
    if (r->c->arrivals) {
        mk_arrivals_links(r->c->arrivals, t, topology, from, to, r->y_arrived, r->psi_arrived);
        return;
    }
    for (int e = from; e < to; e++) {
        mk_random_t random;
        mk_random_start(&random, r->c->seed, (uint32_t)run, (uint32_t)mk_topology_id(topology, e), (uint32_t)t, MK_DRAW_LOSS);
        const int begin = topology->first[e] + !r->c->filter->central, end = topology->first[e + 1];
        for (int i = begin; i < end; i++) r->y_arrived[i] = mk_random_uniform(&random) >= r->c->loss;
        for (int i = begin; i < end; i++) r->psi_arrived[i] = mk_random_uniform(&random) >= r->c->loss;
    }
}

/* Links that work in step t. A node always hears itself; a centre hears every sensor over a link. */
static void draw_links(mk_runner_t *r, int run, int t) {
    memset(r->y_arrived, 1, 2 * r->slots); /* and psi_arrived */
    if (r->c->loss > 0.0 || r->c->arrivals) for_all(r, run, t, draw_some_links);
}

/* Errors of the estimates before the step. */
static void take_some_errors(mk_runner_t *r, int run, int t, int worker, int begin, int end) {
    const mk_scenario_t *s = r->c->scenario;
    const int n = s->n, steady = t >= r->c->steps / 2;
    const double *x = r->stream.x;
    const double *estimate = r->estimate + (size_t)worker * CHUNK * (size_t)n;
    mk_exact_t *sums = sums_of(r, worker);
    (void)run;
    r->c->network->estimate(r->net, begin, end, r->estimate + (size_t)worker * CHUNK * (size_t)n);
    for (int e = begin; e < end; e++, estimate += n) {
        double square = 0.0, position = 0.0;
        for (int i = 0; i < n; i++) {
            const double d = x[i] - estimate[i];
            if (isnan(x[i])) continue;
            square += d * d;
            r->state_square[(size_t)e * (size_t)n + (size_t)i] += d * d;
        }
        for (int p = 0; p < s->position_count; p++) {
            const double d = x[s->position_states[p]] - estimate[s->position_states[p]];
            if (!isnan(d)) position += d * d;
        }
        r->error[e] = sqrt(square);
        mk_exact_add(&sums[SQUARE], square);
        mk_exact_add(&sums[POSITION], position);
        if (steady) r->node_square[e] += square;
    }
}

/* What the estimators say of the step after it. */
static void take_some_findings(mk_runner_t *r, int run, int t, int worker, int begin, int end) {
    (void)run;
    (void)t;
    r->c->network->add(r->net, begin, end, sums_of(r, worker) + FINDINGS);
}

static void take_some_alerts(mk_runner_t *r, int run, int t, int worker, int begin, int end) {
    (void)run;
    (void)worker;
    r->c->network->look_monitor(r->net, begin, end, &r->alerts.snapshot, r->alerts.rejected);
    mk_alerts_take(&r->alerts, t, begin, end);
}

/* The values that other parts wait for go out; theirs come in until `finish`. */
static void begin_readings(mk_runner_t *r) {
    unsigned char *next = r->send;
    const int *first = r->source->row_first;
    for (int i = 0; i < r->topology->sends; i++) {
        const int k = mk_topology_id(r->topology, r->topology->send_estimator[i]);
        const size_t bytes = (size_t)(first[k + 1] - first[k]) * sizeof(double);
        memcpy(next, r->stream.y + first[k], bytes);
        next += bytes;
    }
    r->team->begin(r->team, MK_EXCHANGE_READINGS, r->send, r->receive);
}

static void finish_readings(mk_runner_t *r) {
    const unsigned char *next = r->receive;
    const int *first = r->source->row_first;
    r->team->finish(r->team);
    for (int i = 0; i < r->topology->halo; i++) {
        const int k = r->topology->halo_node[i];
        const size_t bytes = (size_t)(first[k + 1] - first[k]) * sizeof(double);
        memcpy(r->stream.y + first[k], next, bytes);
        next += bytes;
    }
}

/* What can fail in a step, in the order in which it is done. */
typedef enum { PHASE_START, PHASE_TOLERANCE, PHASE_INCREMENTAL, PHASE_DIFFUSE, PHASE_RECORD, PHASE_LOG, PHASES } phase_t;

/* Keeps the failure of the lowest step, phase and node, with its text: the one that a single process meets. 1 if it is the first so far. */
static int is_first(mk_runner_t *r, int t, phase_t phase, int node) {
    const int64_t place = ((int64_t)t * PHASES + (int64_t)phase) * ((int64_t)1 << 30) + node;
    if (r->failed >= 0 && r->failed <= place) return 0;
    r->failed = place;
    return 1;
}

/* Takes note of the failure of r->bad; 1 if there is none. */
static int check(mk_runner_t *r, int run, int t, phase_t phase, mk_status_t status, mk_error_t *error) {
    if (status == MK_OK) return 1;
    const int node = mk_topology_id(r->topology, r->bad);
    if (is_first(r, t, phase, node))
        (void)mk_fail(error, "run %d, step %d, %s %d: %s%s", run, t, r->c->filter->central ? "central filter" : "node", node, mk_status_name(status),
                      status == MK_ERROR_NOT_POSITIVE_DEFINITE ? ": its covariance has grown beyond this precision; does it observe all states?" : "");
    return 0;
}

/* The node objects do what the network has just done: stage 1, then stage 2. good: it went well. */
static void record_stage(mk_runner_t *r, int t, mk_exchange_t stage, int good, mk_error_t *error) {
    const double *schedule = r->schedule ? r->schedule + (size_t)t * (size_t)r->topology->estimators : NULL;
    mk_error_t trouble;
    int bad = 0;
    const int recorded = stage == MK_EXCHANGE_READINGS
                             ? mk_node_records_incremental(r->records, t, schedule, r->stream.y, r->source->row_first, r->y_arrived,
                                                           mk_runner_watches(r) ? r->alerts.snapshot.excluded : NULL, r->net, good, &bad, &trouble)
                             : mk_node_records_diffuse(r->records, t, r->psi_arrived, r->net, good, &bad, &trouble);
    if (!recorded && is_first(r, t, PHASE_RECORD, bad)) *error = trouble;
}

/* Both exchanges and both halves of a step. A part in which a node has failed goes on exchanging what it has, so that no other part waits. */
static void step_network(mk_runner_t *r, int run, int t, mk_error_t *error) {
    const mk_network_t *network = r->c->network;
    const mk_topology_t *topology = r->topology;
    uint8_t *psi_arrived = r->c->filter->central ? NULL : r->psi_arrived;
    const int E = topology->estimators, inner = topology->interior;
    const double *y = r->stream.y;
    const int *rows = r->source->row_first;
    mk_snapshot_t *const seen = r->c->log_path ? &r->snapshot : NULL;
    int *bad = &r->bad, good = r->failed < 0;
    mk_status_t status;
    if (r->schedule && good) {
        status = network->set_tolerance(r->net, r->schedule + (size_t)t * (size_t)E, bad);
        good = check(r, run, t, PHASE_TOLERANCE, status, error);
    }
    begin_readings(r);
    /* The inner nodes' failure does not hide that of a lower one among the rest. */
    const int begun = good;
    if (begun) {
        status = network->incremental(r->net, 0, inner, y, rows, r->y_arrived, seen, bad);
        good = check(r, run, t, PHASE_INCREMENTAL, status, error);
    }
    finish_readings(r);
    if (begun) {
        status = network->incremental(r->net, inner, E, y, rows, r->y_arrived, seen, bad);
        good = check(r, run, t, PHASE_INCREMENTAL, status, error) && good;
    }
    if (mk_runner_watches(r)) for_all(r, run, t, take_some_alerts);
    const int records = r->records && run == 0 && begun;
    if (records) record_stage(r, t, MK_EXCHANGE_READINGS, good, error);
    network->intermediate(r->net, topology->send_estimator, topology->sends, r->send);
    r->team->begin(r->team, MK_EXCHANGE_ESTIMATES, r->send, r->receive);
    if (good) {
        status = network->diffuse(r->net, 0, inner, psi_arrived, NULL, bad);
        (void)check(r, run, t, PHASE_DIFFUSE, status, error);
    }
    r->team->finish(r->team);
    if (good) {
        status = network->diffuse(r->net, inner, E, psi_arrived, r->receive, bad);
        (void)check(r, run, t, PHASE_DIFFUSE, status, error);
        if (records) record_stage(r, t, MK_EXCHANGE_ESTIMATES, r->failed < 0, error);
    }
}

/* The sums of the steps that wait, into the record. What the parts know of trouble comes with them. */
static mk_run_state_t add_up(mk_runner_t *r, mk_record_t *record) {
    const int steps = r->c->steps, truth = r->source->has_truth, position = r->c->scenario->position_count > 0;
    const double total = r->total, window = steps - steps / 2;
    r->sums[0].digit[0] = r->failed >= 0;
    r->sums[0].digit[1] = mk_stopped();
    r->team->sum(r->team, r->sums, 1 + (size_t)r->waiting * STEP_SUMS);
    const mk_run_state_t state = r->sums[0].digit[0] ? MK_RUN_FAILED : r->sums[0].digit[1] ? MK_RUN_STOPPED : MK_RUN_DONE;
    for (int i = 0; i < r->waiting && state == MK_RUN_DONE; i++) {
        const int t = r->from + i;
        double value[STEP_SUMS];
        for (int j = 0; j < (t < steps / 2 ? FINDINGS : STEP_SUMS); j++) value[j] = mk_exact_value(&r->sums[1 + i * STEP_SUMS + j]);
        record->msd[t] = truth ? value[SQUARE] / total : (double)NAN;
        record->position_msd[t] = truth && position ? value[POSITION] / total : (double)NAN;
        if (t < steps / 2) continue;
        *record->steady += record->msd[t] / window;
        *record->position_steady += record->position_msd[t] / window;
        *record->theta += value[FINDINGS + MK_THETA] / total / window;
        *record->tolerance += value[FINDINGS + MK_TOLERANCE] / total / window;
        *record->nis_ratio += value[FINDINGS + MK_NIS_ROWS] > 0.0 ? value[FINDINGS + MK_NIS] / value[FINDINGS + MK_NIS_ROWS] / window : 0.0;
        r->nis_steps += value[FINDINGS + MK_NIS_ROWS] > 0.0;
    }
    memset(r->sums, 0, (1 + (size_t)r->waiting * STEP_SUMS) * sizeof *r->sums);
    r->from += r->waiting;
    r->waiting = 0;
    return state;
}

/* Means before, during and after the faults. */
static void split_msd(const mk_runner_t *r, mk_record_t *record) {
    const mk_scenario_t *s = r->c->scenario;
    const double begin = mk_faults_begin(s), end = mk_faults_end(s);
    double steps[MK_PHASES] = {0.0};
    /* The last step before the faults. */
    const int last = begin < 0.0 ? -1 : begin < r->c->steps * s->dt_s ? (int)floor(begin / s->dt_s) : r->c->steps - 1;
    for (int t = last > 0 ? (last + 1) / 2 : 0; t < r->c->steps; t++) {
        const double t_s = t * s->dt_s;
        const int phase = t_s <= begin ? MK_BEFORE : t_s <= end ? MK_DURING : MK_AFTER;
        record->phase_msd[phase] += record->msd[t];
        steps[phase] += 1.0;
    }
    for (int i = 0; i < MK_PHASES; i++) record->phase_msd[i] /= steps[i]; /* NaN where there is none */
}

/* What every estimator has summed for itself. */
static void finish_record(mk_runner_t *r, mk_record_t *record) {
    const size_t n = (size_t)r->c->scenario->n, E = (size_t)r->topology->estimators;
    const int truth = r->source->has_truth, window = r->c->steps - r->c->steps / 2;
    /* A frozen step has no nis: the mean is over those that have. */
    if (r->c->frozen > 0.0) *record->nis_ratio = r->nis_steps ? *record->nis_ratio * window / r->nis_steps : (double)NAN;
    for (size_t e = 0; e < E; e++) {
        r->node_square[e] = truth ? r->node_square[e] / window : (double)NAN;
        for (size_t i = 0; i < n; i++) mk_exact_add(&r->sums[i], r->state_square[e * n + i]);
    }
    r->team->gather(r->team, r->topology, r->node_square, NULL, sizeof *r->node_square, record->node_msd);
    r->team->sum(r->team, r->sums, n);
    for (size_t i = 0; i < n; i++)
        record->state_square[i] = r->state_known[i] > 0.0 ? mk_exact_value(&r->sums[i]) / (r->state_known[i] * r->total) : (double)NAN;
    memset(r->sums, 0, n * sizeof *r->sums);
    if (record->phases) split_msd(r, record);
    if (mk_runner_watches(r)) mk_alerts_finish(&r->alerts, r->team, r->total, record->alert);
}

typedef struct {
    int64_t place;
    mk_error_t error;
} failure_t;

static void take_failure(void *context, const void *bytes, size_t length) {
    failure_t *first = context, next;
    memcpy(&next, bytes, length);
    if (next.place >= 0 && (first->place < 0 || next.place < first->place)) *first = next;
}

static void agree_on_failure(mk_runner_t *r, mk_error_t *error) {
    failure_t own = {r->failed, *error}, first;
    memset(&first, 0, sizeof first);
    first.place = -1;
    r->team->collect(r->team, &own, sizeof own, take_failure, &first);
    r->team->spread(r->team, &first, sizeof first);
    *error = first.error;
}

static void one_step(mk_runner_t *r, int run, int t, mk_error_t *error) {
    const mk_network_t *network = r->c->network;
    mk_stream_step(&r->stream, run, t);
    draw_links(r, run, t);
    if (r->source->has_truth) {
        for (int i = 0; i < r->c->scenario->n; i++) r->state_known[i] += !isnan(r->stream.x[i]);
        for_all(r, run, t, take_some_errors);
    }
    if (r->c->log_path) network->look_before(r->net, &r->snapshot);
    step_network(r, run, t, error);
    if (t >= r->c->steps / 2) for_all(r, run, t, take_some_findings);
    r->waiting++;
}

mk_run_state_t mk_runner_run(mk_runner_t *r, int run, mk_record_t *record, mk_run_log_t *log, void (*progress)(void *context, int t),
                             void *context, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    const size_t E = (size_t)r->topology->estimators, n = (size_t)c->scenario->n;
    const int most = NODE_STEPS_WAIT / r->total < LONGEST_WAIT ? NODE_STEPS_WAIT / r->total + 1 : LONGEST_WAIT;
    const int wait = c->log_path || r->team->ranks == 1 ? 1 : most;
    mk_run_state_t state = MK_RUN_DONE;
    r->from = r->waiting = r->nis_steps = 0;
    r->failed = -1;
    memset(r->state_square, 0, E * n * sizeof *r->state_square);
    memset(r->node_square, 0, (E + n) * sizeof *r->node_square); /* and state_known */
    memset(record->value, 0, record->count * sizeof *record->value);
    memset(error, 0, sizeof *error);
    if (mk_runner_watches(r)) mk_alerts_start(&r->alerts);
    const mk_status_t status = c->network->start(r->net, &r->bad);
    (void)check(r, run, 0, PHASE_START, status, error);
    for (int t = 0; t < c->steps && state == MK_RUN_DONE; t++) {
        one_step(r, run, t, error);
        if (r->waiting == wait || t + 1 == c->steps) state = add_up(r, record);
        if (state == MK_RUN_FAILED) break;
        if (c->log_path) {
            c->network->look_after(r->net, &r->snapshot);
            /* A centre has nobody to exchange estimates with: nothing is missing. */
            if (c->filter->central) r->snapshot.faults[0] &= ~(uint32_t)MK_FAULT_ESTIMATE_MISSING;
            mk_runner_log(r, log, run, t);
            if (log && log->failed && is_first(r, t, PHASE_LOG, 0)) {
                (void)mk_fail(error, "writing the log: %s", strerror(log->failed));
                if (r->team->ranks == 1) return MK_RUN_FAILED;
            }
        }
        r->steps_done++;
        if (progress) progress(context, t);
    }
    if (state == MK_RUN_FAILED) agree_on_failure(r, error);
    if (state == MK_RUN_DONE) finish_record(r, record);
    return state;
}
