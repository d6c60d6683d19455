/* SPDX-License-Identifier: MIT */
#include "campaign.h"

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "commands.h"

static volatile sig_atomic_t stop_now;

static void on_signal(int number) {
    (void)number;
    stop_now = 1;
}

void mk_catch_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    /* A reader that goes away is an error of writing, not the end of the process. */
    action.sa_handler = SIG_IGN;
    (void)sigaction(SIGPIPE, &action, NULL);
}

typedef struct {
    const mk_campaign_t *c;
    mk_source_t *source;
    mk_result_t *result;
    mk_topology_t topology;
    void *net;
    size_t slots;
    uint8_t *y_arrived, *psi_arrived;
    double *estimate, *error, *tolerance, *schedule;
    mk_snapshot_t snapshot;
    mk_run_log_t log;
    double *state_square, *state_count;
    double run_steady, steady_steps;
    /* Sums as they were before the run under way, and their places. */
    double *saved;
} mk_running_t;

/* Copies all sums away before a run, or back after one that was cut: figures are of complete runs. */
static void save_sums(mk_running_t *r, int back) {
    mk_result_t *result = r->result;
    const size_t sums = 2 * (size_t)r->c->steps + (size_t)result->estimators, n = (size_t)r->c->scenario->n;
    double *const scalar[] = {&result->theta, &result->tolerance, &result->nis_ratio, &r->steady_steps};
    double *saved = r->saved;
    memcpy(back ? result->msd : saved, back ? saved : result->msd, sums * sizeof *saved);
    saved += sums;
    memcpy(back ? r->state_square : saved, back ? saved : r->state_square, 2 * n * sizeof *saved);
    saved += 2 * n;
    for (size_t i = 0; i < 4; i++) *(back ? scalar[i] : &saved[i]) = *(back ? &saved[i] : scalar[i]);
}

/* Links that work in step t. A node always hears itself; a centre hears every sensor over a link. */
static void draw_links(mk_running_t *r, int run, int t) {
    const mk_topology_t *topology = &r->topology;
    memset(r->y_arrived, 1, r->slots);
    memset(r->psi_arrived, 1, r->slots);
    if (!(r->c->loss > 0.0)) return;
    for (int e = 0; e < topology->estimators; e++) {
        mk_random_t random;
        mk_random_start(&random, r->c->seed, (uint32_t)run, (uint32_t)e, (uint32_t)t, MK_DRAW_LOSS);
        const int begin = topology->first[e] + !r->c->filter->central, end = topology->first[e + 1];
        for (int i = begin; i < end; i++) r->y_arrived[i] = mk_random_uniform(&random) >= r->c->loss;
        for (int i = begin; i < end; i++) r->psi_arrived[i] = mk_random_uniform(&random) >= r->c->loss;
    }
}

/* Errors of the estimates before the step, into the sums of the result. */
static void take_errors(mk_running_t *r, int t) {
    const mk_scenario_t *s = r->c->scenario;
    mk_result_t *result = r->result;
    const int E = r->topology.estimators, n = s->n, steady = t >= r->c->steps / 2;
    double total = 0.0, position = 0.0;
    r->c->network->estimate(r->net, r->estimate);
    for (int e = 0; e < E; e++) {
        double square = 0.0;
        for (int i = 0; i < n; i++) {
            const double d = r->source->x[i] - r->estimate[e * n + i];
            if (isnan(d)) continue;
            square += d * d;
            r->state_square[i] += d * d;
            r->state_count[i] += 1.0;
        }
        for (int p = 0; p < s->position_count; p++) {
            const double d = r->source->x[s->position_states[p]] - r->estimate[e * n + s->position_states[p]];
            if (!isnan(d)) position += d * d;
        }
        r->error[e] = sqrt(square);
        total += square;
        if (steady) result->node_msd[e] += square;
    }
    result->msd[t] += total / E;
    result->position_msd[t] += position / E;
    if (steady) r->run_steady += total / E;
}

static void write_item(mk_running_t *r, int run, int t) {
    mk_run_log_t *log = &r->log;
    const mk_scenario_t *s = r->c->scenario;
    const size_t E = (size_t)r->topology.estimators, size = r->c->network->real_size;
    const int truth = r->source->has_truth, central = r->c->filter->central, positions = s->position_count;
    mk_log_begin(log, run, t, 9 + 2 * truth + !central + (positions > 0));
    if (truth) mk_log_reals(log, "truth", r->source->x, 8, (size_t)s->n);
    mk_log_reals(log, "measurements", r->source->y, 8, (size_t)r->source->row_first[s->nodes]);
    mk_log_uint8(log, "measurements_arrived", r->y_arrived, r->slots);
    if (!central) mk_log_uint8(log, "estimates_arrived", r->psi_arrived, r->slots);
    mk_log_reals(log, "estimate", r->snapshot.estimate, size, E * (size_t)s->n);
    if (truth) mk_log_reals(log, "error", r->error, 8, E);
    mk_log_reals(log, "trace_covariance", r->snapshot.trace_covariance, size, E);
    if (positions > 0)
        mk_log_reals(log, "position_covariance", r->snapshot.position_covariance, size, E * (size_t)MK_PACKED(positions));
    mk_log_reals(log, "theta", r->snapshot.theta, size, E);
    mk_log_reals(log, "tolerance", r->snapshot.tolerance, size, E);
    mk_log_reals(log, "nis", r->snapshot.nis, size, E);
    mk_log_uint32(log, "nis_rows", r->snapshot.nis_rows, E);
    mk_log_uint32(log, "faults", r->snapshot.faults, E);
    mk_log_end(log);
}

static int one_step(mk_running_t *r, int run, int t, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    const mk_network_t *network = c->network;
    int bad = 0;
    mk_source_step(r->source, run, t);
    draw_links(r, run, t);
    if (r->source->has_truth) take_errors(r, t);
    if (c->log_path) network->look_before(r->net, &r->snapshot);
    mk_status_t status = MK_OK;
    if (r->schedule) status = network->set_tolerance(r->net, r->schedule + (size_t)t * (size_t)r->topology.estimators, &bad);
    if (status == MK_OK) status = network->incremental(r->net, r->source->y, r->source->row_first, r->y_arrived, &bad);
    if (status == MK_OK) status = network->diffuse(r->net, c->filter->central ? NULL : r->psi_arrived, &bad);
    if (status != MK_OK)
        return mk_fail(error, "run %d, step %d, %s %d: %s%s", run, t, c->filter->central ? "central filter" : "node", bad, mk_status_name(status),
                       status == MK_ERROR_NOT_POSITIVE_DEFINITE ? ": its covariance has grown beyond this precision; does it observe all states?" : "");
    if (c->log_path) {
        network->look_after(r->net, &r->snapshot);
        /* A centre has nobody to exchange estimates with: nothing is missing. */
        if (c->filter->central) r->snapshot.faults[0] &= ~(uint32_t)MK_FAULT_ESTIMATE_MISSING;
        write_item(r, run, t);
        if (r->log.failed) return mk_fail(error, "writing the log: %s", strerror(r->log.failed));
    }
    if (t >= c->steps / 2) {
        double theta, tolerance, nis;
        network->means(r->net, &theta, &tolerance, &nis);
        r->result->theta += theta;
        r->result->tolerance += tolerance;
        r->result->nis_ratio += nis;
        r->steady_steps += 1.0;
    }
    r->result->steps_done++;
    return 1;
}

static void show_progress(const mk_campaign_t *c, long done, long total, int *shown) {
    const int percent = (int)(100 * done / total);
    if (percent == *shown) return;
    *shown = percent;
    (void)fprintf(stderr, "\r%-8s [%-40.*s] %3d %%", c->filter->name, percent * 40 / 100, "########################################", percent);
    if (done == total) (void)fputs("\r\033[K", stderr);
}

static int run_all(mk_running_t *r, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    mk_result_t *result = r->result;
    double sum = 0.0, square = 0.0;
    int shown = -1;
    for (int run = 0; run < c->runs && !stop_now; run++) {
        int bad = 0;
        const mk_status_t status = c->network->start(r->net, &bad);
        if (status != MK_OK) return mk_fail(error, "start of estimator %d: %s", bad, mk_status_name(status));
        r->run_steady = 0.0;
        save_sums(r, 0);
        for (int t = 0; t < c->steps && !stop_now; t++) {
            if (!one_step(r, run, t, error)) return 0;
            if (c->progress) show_progress(c, (long)run * c->steps + t + 1, (long)c->runs * c->steps, &shown);
        }
        if (stop_now) {
            save_sums(r, 1);
            break;
        }
        const double mean = r->run_steady / (c->steps - c->steps / 2);
        sum += mean;
        square += mean * mean;
        result->runs_done++;
    }
    result->interrupted = stop_now != 0;
    const double runs = result->runs_done;
    result->steady = sum / runs;
    result->steady_ci95 = runs < 2.0 ? (double)NAN : 1.96 * sqrt(fmax(square / runs - result->steady * result->steady, 0.0) / (runs - 1.0));
    return 1;
}

static void finish(mk_running_t *r) {
    const mk_campaign_t *c = r->c;
    mk_result_t *result = r->result;
    const double runs = result->runs_done, window = c->steps - c->steps / 2;
    const int truth = r->source->has_truth, position = c->scenario->position_count > 0;
    for (int t = 0; t < c->steps; t++) {
        result->msd[t] = truth ? result->msd[t] / runs : (double)NAN;
        result->position_msd[t] = truth && position ? result->position_msd[t] / runs : (double)NAN;
        if (t >= c->steps / 2) result->position_steady += result->position_msd[t] / window;
    }
    for (int e = 0; e < result->estimators; e++) result->node_msd[e] = truth ? result->node_msd[e] / (runs * window) : (double)NAN;
    for (int i = 0; i < c->scenario->n; i++)
        result->state_rmse[i] = r->state_count[i] > 0.0 ? sqrt(r->state_square[i] / r->state_count[i]) : (double)NAN;
    if (!truth) result->steady = result->steady_ci95 = (double)NAN;
    result->theta /= r->steady_steps;
    result->tolerance /= r->steady_steps;
    result->nis_ratio /= r->steady_steps;
}

/* The work and its log, once everything that can be refused is known to be good. */
static int run_logged(mk_running_t *r, mk_error_t *error) {
    const mk_campaign_t *c = r->c;
    struct timespec from, to;
    if (c->log_path) {
        const mk_run_facts_t facts = {c->filter->name, c->network->name,        r->source->recorded ? "recorded" : "drawn",
                                      c->seed,         c->runs,                 c->steps,
                                      r->topology.estimators, c->loss,          r->topology.first,
                                      r->topology.slot};
        if (!mk_log_open(&r->log, c->log_path, error)) return MK_EXIT_INPUT;
        mk_log_header(&r->log, c->scenario, &facts);
    }
    (void)clock_gettime(CLOCK_MONOTONIC, &from);
    int good = run_all(r, error);
    (void)clock_gettime(CLOCK_MONOTONIC, &to);
    r->result->seconds = (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec);
    if (c->log_path) {
        mk_error_t log_error;
        const int written = mk_log_close(&r->log, !good ? "failed" : stop_now ? "interrupted" : "complete", &log_error);
        if (good && !written) {
            *error = log_error;
            good = 0;
        }
    }
    return good ? 0 : MK_EXIT_FAILED;
}

int mk_campaign_run(const mk_campaign_t *c, mk_source_t *source, mk_result_t *result, mk_error_t *error) {
    const mk_scenario_t *s = c->scenario;
    mk_running_t r;
    memset(&r, 0, sizeof r);
    memset(result, 0, sizeof *result);
    r.c = c;
    r.source = source;
    r.result = result;
    r.topology = c->filter->central ? mk_central_topology(s) : mk_distributed_topology(s);
    const size_t E = (size_t)r.topology.estimators, n = (size_t)s->n, steps = (size_t)c->steps;
    r.slots = (size_t)r.topology.first[E];
    result->estimators = (int)E;
    result->steps = c->steps;
    result->msd = mk_allocate(2 * steps + E + n, sizeof *result->msd);
    result->position_msd = result->msd + steps;
    result->node_msd = result->position_msd + steps;
    result->state_rmse = result->node_msd + E;
    r.y_arrived = mk_allocate(2 * r.slots, 1);
    r.psi_arrived = r.y_arrived + r.slots;
    r.estimate = mk_allocate(E * n + 2 * E + 2 * n, sizeof *r.estimate);
    r.error = r.estimate + E * n;
    r.tolerance = r.error + E;
    r.state_square = r.tolerance + E;
    r.state_count = r.state_square + n;
    r.saved = mk_allocate(2 * steps + E + 2 * n + 4, sizeof *r.saved);
    r.snapshot = mk_snapshot_make(c->network, (int)E, s);
    int status = MK_EXIT_INPUT;
    if (mk_filter_tolerances(c->filter, s, c->tolerance, c->steps, r.tolerance, &r.schedule, error)) {
        r.net = c->network->open(s, &r.topology, r.tolerance);
        status = run_logged(&r, error);
        c->network->close(r.net);
        finish(&r);
    }
    mk_snapshot_free(&r.snapshot);
    free(r.schedule);
    free(r.y_arrived);
    free(r.estimate);
    free(r.saved);
    if (c->filter->central) mk_central_free(&r.topology);
    if (status) mk_result_free(result);
    return status;
}

void mk_result_free(mk_result_t *result) {
    free(result->msd);
    memset(result, 0, sizeof *result);
}
