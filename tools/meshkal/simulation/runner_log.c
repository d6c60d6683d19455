/* SPDX-License-Identifier: MIT */
#include <string.h>

#include "simulation/runner.h"

size_t mk_runner_log_room(const mk_runner_t *r) {
    const mk_scenario_t *s = r->c->scenario;
    const size_t rows = (size_t)r->source->row_first[s->nodes], positions = (size_t)MK_PACKED(s->position_count), n = (size_t)s->n;
    const size_t estimators = 8 * (n > positions ? n : positions) * (size_t)r->total;
    const size_t slots = (mk_runner_watches(r) ? 8 : 1) * (size_t)s->first[s->nodes]; /* bytes of the widest that is logged of each */
    const size_t most = estimators > slots ? estimators : slots;
    return most > 8 * rows ? most : 8 * rows;
}

/* What every part has of an array over estimators, in the order of their numbers, where the log is written. */
static const void *whole(mk_runner_t *r, const void *local, const int *first, size_t width) {
    if (!r->topology->id) return local;
    r->team->gather(r->team, r->topology, local, first, width, r->gathered);
    return r->gathered;
}

static void log_reals(mk_runner_t *r, mk_run_log_t *log, const char *key, const void *local, size_t size, size_t width) {
    const void *all = whole(r, local, NULL, size * width);
    if (log) mk_log_reals(log, key, all, size, (size_t)r->total * width);
}

/* Of the rows of the estimators' own sensors. */
static void log_own(mk_runner_t *r, mk_run_log_t *log, const char *key, const void *local) {
    const int *first = r->source->row_first;
    const size_t size = r->c->network->real_size;
    const void *all = whole(r, local, first, size);
    if (log) mk_log_reals(log, key, all, size, (size_t)first[r->c->scenario->nodes]);
}

static void log_uint32(mk_runner_t *r, mk_run_log_t *log, const char *key, const uint32_t *local) {
    const void *all = whole(r, local, NULL, sizeof *local);
    if (log) mk_log_uint32(log, key, all, (size_t)r->total);
}

/* Where the slots of each estimator begin, of all parts. */
static const int *slots_of(const mk_runner_t *r) { return r->c->filter->central ? r->topology->first : r->c->scenario->first; }

static void log_slots(mk_runner_t *r, mk_run_log_t *log, const char *key, const uint8_t *local) {
    const void *all = whole(r, local, slots_of(r), 1);
    if (log) mk_log_uint8(log, key, all, (size_t)slots_of(r)[r->total]);
}

static void log_monitor(mk_runner_t *r, mk_run_log_t *log) {
    mk_monitor_field_t field[MK_MONITOR_FIELDS];
    const int fields = mk_monitor_fields(&r->alerts.snapshot, field);
    for (int i = 0; i < fields; i++) {
        const void *all = whole(r, field[i].values, field[i].per_slot ? slots_of(r) : NULL, field[i].width);
        if (log) mk_log_field(log, &field[i], all, (size_t)(field[i].per_slot ? slots_of(r)[r->total] : r->total));
    }
}

static void log_readings(mk_runner_t *r, mk_run_log_t *log) {
    const int *first = r->source->row_first;
    double *next = r->own_y;
    for (int e = 0; next && e < r->topology->estimators; e++) {
        const int k = mk_topology_id(r->topology, e), rows = first[k + 1] - first[k];
        memcpy(next, r->stream.y + first[k], (size_t)rows * sizeof *next);
        next += rows;
    }
    const void *all = r->own_y ? whole(r, r->own_y, first, sizeof *next) : r->stream.y;
    if (log) mk_log_reals(log, "measurements", all, sizeof *next, (size_t)first[r->c->scenario->nodes]);
}

void mk_runner_log(mk_runner_t *r, mk_run_log_t *log, int run, int t) {
    const mk_scenario_t *s = r->c->scenario;
    const mk_snapshot_t *seen = &r->snapshot;
    const size_t size = r->c->network->real_size;
    const int truth = r->source->has_truth, central = r->c->filter->central, positions = s->position_count;
    mk_monitor_field_t field[MK_MONITOR_FIELDS];
    const int monitor = mk_runner_watches(r) ? mk_monitor_fields(&r->alerts.snapshot, field) : 0, fault = r->stream.fault != NULL;
    if (log) mk_log_begin(log, run, t, 12 + 2 * truth + !central + (positions > 0) + (r->c->frozen > 0.0) + fault + monitor);
    if (truth && log) mk_log_reals(log, "truth", r->stream.x, 8, (size_t)s->n);
    log_readings(r, log);
    log_slots(r, log, "measurements_arrived", r->y_arrived);
    if (!central) log_slots(r, log, "estimates_arrived", r->psi_arrived);
    log_reals(r, log, "estimate", seen->estimate, size, (size_t)s->n);
    if (truth) log_reals(r, log, "error", r->error, 8, 1);
    log_reals(r, log, "variance", seen->variance, size, (size_t)s->n);
    log_reals(r, log, "trace_covariance", seen->trace_covariance, size, 1);
    if (positions > 0) log_reals(r, log, "position_covariance", seen->position_covariance, size, (size_t)MK_PACKED(positions));
    log_own(r, log, "innovation", seen->innovation);
    log_own(r, log, "innovation_variance", seen->innovation_variance);
    log_reals(r, log, "theta", seen->theta, size, 1);
    log_reals(r, log, "tolerance", seen->tolerance, size, 1);
    log_reals(r, log, "nis", seen->nis, size, 1);
    log_uint32(r, log, "nis_rows", seen->nis_rows);
    log_uint32(r, log, "faults", seen->faults);
    if (r->c->frozen > 0.0) {
        const void *all = whole(r, seen->frozen, NULL, 1);
        if (log) mk_log_uint8(log, "frozen", all, (size_t)r->total);
    }
    if (fault && log) mk_log_reals(log, "fault", r->stream.fault, 8, (size_t)r->source->row_first[s->nodes]);
    if (monitor) log_monitor(r, log);
    if (log) mk_log_end(log);
}
