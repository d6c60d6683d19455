/* SPDX-License-Identifier: MIT */
/* Consensus of meshkal/consensus.h. Part of the shared build, with run-time dimensions. */

/* A ratio is believed if rounding has not eaten the mass: it is a difference of sums, and this many roundings of them must fit in it. */
#define MK_RATIO_ROUNDINGS 100

/* Does the mass travel with the values? */
static int MK_F(mk_consensus_carries)(const MK_F_T(mk_consensus_config) * config) {
    return config->protocol == MK_CONSENSUS_RATIO || (config->protocol == MK_CONSENSUS_PERRON && !(config->total > MK_R(0.0)));
}

int MK_F(mk_consensus_numbers)(const MK_F_T(mk_consensus_config) * config) { return config->values + MK_F(mk_consensus_carries)(config); }

static mk_status_t MK_F(mk_consensus_check)(int p, int slots, const MK_F_T(mk_consensus_config) * config) {
    if (!config || p < 1 || slots < 1) return MK_ERROR_ARGUMENT;
    if (config->slots != slots || config->values < 1 || config->values > p) return MK_ERROR_SHAPE;
    const int protocol = config->protocol, needs_degree = protocol == MK_CONSENSUS_METROPOLIS || protocol == MK_CONSENSUS_RATIO;
    if (protocol >= MK_CONSENSUS_COUNT || config->iterations < 1 || (protocol == MK_CONSENSUS_SUM && config->iterations != 1) ||
        config->network < 1 || !(config->total >= MK_R(0.0) && config->total <= MK_LARGEST) || (needs_degree && !config->degree))
        return MK_ERROR_ARGUMENT;
    for (int l = 1; l < slots && config->weight; l++)
        if (!(config->weight[l] >= MK_R(0.0) && config->weight[l] <= MK_LARGEST)) return MK_ERROR_ARGUMENT;
    return MK_OK;
}

void MK_F(mk_consensus_reset)(int p, const MK_F_T(mk_consensus_view) * view) {
    MK_F_T(mk_consensus) *const core = view->core;
    if (!core->config) return;
    const int slots = core->config->slots;
    core->iteration = 0;
    core->running = 0;
    core->known = 0;
    memset(view->now, 0, (size_t)(slots * (p + 1)) * sizeof *view->now); /* for RATIO: nothing has been heard */
    memset(view->have, 0, (size_t)slots);
}

mk_status_t MK_F(mk_consensus_start)(int p, int slots, const MK_F_T(mk_consensus_view) * view, const MK_F_T(mk_consensus_config) * config) {
    const mk_status_t status = MK_F(mk_consensus_check)(p, slots, config);
    if (status != MK_OK) return status;
    memset(view->core, 0, sizeof *view->core);
    memset(view->next, 0, (size_t)(slots * (p + 1)) * sizeof *view->next);
    memset(view->sum, 0, (size_t)(p + 1) * sizeof *view->sum);
    view->core->config = config;
    MK_F(mk_consensus_reset)(p, view);
    return MK_OK;
}

/* What a node's values are scaled by before the first iteration. */
static MK_REAL MK_F(mk_consensus_scale)(const MK_F_T(mk_consensus_config) * config, int measures) {
    if (config->protocol != MK_CONSENSUS_PERRON) return MK_R(1.0);
    MK_REAL sum = (MK_REAL)measures;
    for (int l = 1; l < config->slots; l++) sum += config->weight ? config->weight[l] : MK_R(1.0);
    if (!(sum > MK_R(0.0))) return MK_R(0.0); /* it hears nobody, and what it has weighs nothing */
    return config->total > MK_R(0.0) ? config->total / ((MK_REAL)config->network * sum) : MK_R(1.0) / sum;
}

/* RATIO: the values and mass that this node holds, in next[0], are shared out; the sum of shares sent is the message, now[0]. */
static void MK_F(mk_consensus_share)(const MK_F_T(mk_consensus_view) * view, int count) {
    const MK_REAL parts = (MK_REAL)(1 + view->core->config->degree[0]);
    for (int i = 0; i < count; i++) {
        view->next[i] /= parts;
        view->now[i] += view->next[i];
    }
}

mk_status_t MK_F(mk_consensus_begin)(int p, const MK_F_T(mk_consensus_view) * view, const MK_REAL *values, int measures) {
    MK_F_T(mk_consensus) *const core = view->core;
    const MK_F_T(mk_consensus_config) *const config = core->config;
    if (!config || core->running) return MK_ERROR_ORDER;
    if (!values || measures < 0 || measures > 1) return MK_ERROR_ARGUMENT;
    const MK_REAL scale = MK_F(mk_consensus_scale)(config, measures);
    MK_REAL *const own = view->work;
    for (int i = 0; i < config->values; i++) own[i] = scale * values[i];
    own[config->values] = scale;
    if (!MK_F(mk_all_finite)(config->values, values) || !MK_F(mk_all_finite)(config->values + 1, own)) return MK_ERROR_NOT_FINITE;
    MK_F(mk_row_copy)(config->values + 1, own, view->now);
    if (config->protocol == MK_CONSENSUS_RATIO) {
        MK_F(mk_row_copy)(config->values + 1, own, view->next);
        memset(view->sum, 0, (size_t)(p + 1) * sizeof *view->sum);
        memset(view->now, 0, (size_t)(p + 1) * sizeof *view->now);
        MK_F(mk_consensus_share)(view, config->values + 1);
    }
    core->kept = 0;
    core->heard = core->missing = 0;
    core->measures = (uint8_t)measures;
    core->running = core->known = 1;
    return MK_OK;
}

mk_status_t MK_F(mk_consensus_expect)(const MK_F_T(mk_consensus_view) * view, int slot, uint32_t iteration) {
    const uint32_t now = view->core->iteration;
    if (iteration < now) return MK_ERROR_LATE;
    if (iteration - now > 1) return MK_ERROR_AHEAD;
    return (unsigned)view->have[slot] >> (iteration - now) & 1u ? MK_ERROR_REPEATED : MK_OK;
}

mk_status_t MK_F(mk_consensus_put)(int p, const MK_F_T(mk_consensus_view) * view, int slot, uint32_t iteration, const MK_REAL *values) {
    const MK_F_T(mk_consensus_config) *const config = view->core->config;
    if (!config) return MK_ERROR_ORDER;
    if (!values || slot < 1 || slot >= config->slots) return MK_ERROR_ARGUMENT;
    const mk_status_t status = MK_F(mk_consensus_expect)(view, slot, iteration);
    if (status != MK_OK) return status;
    const int count = MK_F(mk_consensus_numbers)(config), early = iteration != view->core->iteration;
    if (!MK_F(mk_all_finite)(count, values)) return MK_ERROR_NOT_FINITE;
    MK_F(mk_row_copy)(count, values, (early ? view->next : view->now) + slot * (p + 1));
    view->have[slot] = (uint8_t)(view->have[slot] | 1 << early);
    return MK_OK;
}

/* Weight of a neighbour that was heard, before it is divided by anything. */
static MK_REAL MK_F(mk_consensus_weight)(const MK_F_T(mk_consensus_config) * config, int slot) {
    if (config->protocol == MK_CONSENSUS_METROPOLIS) {
        const uint16_t own = config->degree[0], other = config->degree[slot];
        return MK_R(1.0) / (MK_REAL)(1 + (own > other ? own : other));
    }
    return config->protocol != MK_CONSENSUS_SUM && config->weight ? config->weight[slot] : MK_R(1.0);
}

/* x := own values and those heard, combined. */
static void MK_F(mk_consensus_combine)(int p, const MK_F_T(mk_consensus_view) * view, int count, MK_REAL *x) {
    const MK_F_T(mk_consensus_config) *const config = view->core->config;
    const int divides = config->protocol == MK_CONSENSUS_PAPER || config->protocol == MK_CONSENSUS_PERRON;
    MK_REAL total = MK_R(0.0), own = MK_R(1.0), divisor = MK_R(1.0);
    for (int l = 1; l < config->slots; l++)
        if (view->have[l] & 1) total += MK_F(mk_consensus_weight)(config, l);
    if (config->protocol == MK_CONSENSUS_METROPOLIS) own = MK_R(1.0) - total;
    if (divides && total > MK_R(0.0)) {
        divisor = (MK_REAL)view->core->measures + total;
        own = (MK_REAL)view->core->measures / divisor;
    }
    MK_F(mk_row_scale)(count, own, view->now, x);
    for (int l = 1; l < config->slots && total > MK_R(0.0); l++)
        if (view->have[l] & 1) MK_F(mk_row_add)(count, MK_F(mk_consensus_weight)(config, l) / divisor, view->now + l * (p + 1), x);
}

/* RATIO: what this node holds and all that it has ever been sent in this run, into y and sum. */
static void MK_F(mk_consensus_collect)(int p, const MK_F_T(mk_consensus_view) * view, int count, MK_REAL *y, MK_REAL *sum) {
    for (int i = 0; i < count; i++) sum[i] = MK_R(0.0);
    for (int l = 1; l < view->core->config->slots; l++) MK_F(mk_row_sum)(count, view->now + l * (p + 1), sum);
    /* Rounding of the sums telescopes over the iterations. */
    for (int i = 0; i < count; i++) y[i] = view->next[i] + (sum[i] - view->sum[i]);
}

mk_status_t MK_F(mk_consensus_iterate)(int p, const MK_F_T(mk_consensus_view) * view) {
    MK_F_T(mk_consensus) *const core = view->core;
    const MK_F_T(mk_consensus_config) *const config = core->config;
    if (!config || !core->running) return MK_ERROR_ORDER;
    const int count = MK_F(mk_consensus_numbers)(config), ratio = config->protocol == MK_CONSENSUS_RATIO;
    const int last = core->iteration + 1 == config->iterations;
    MK_REAL *const x = view->work, *const sum = x + p + 1;
    if (ratio) {
        MK_F(mk_consensus_collect)(p, view, count, x, sum);
        /* Also what is sent must stay finite: the share to come is no larger than x. */
        MK_REAL probe = MK_R(0.0);
        for (int i = 0; i < count; i++) probe += (view->now[i] + x[i]) * MK_R(0.0);
        if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    } else {
        MK_F(mk_consensus_combine)(p, view, count, x);
    }
    if (!MK_F(mk_all_finite)(count, x)) return MK_ERROR_NOT_FINITE;

    if (ratio) {
        MK_F(mk_row_copy)(count, x, view->next);
        MK_F(mk_row_copy)(count, sum, view->sum);
    } else {
        MK_F(mk_row_copy)(count, x, view->now);
    }
    unsigned used = 0;
    for (int l = 1; l < config->slots; l++) {
        MK_REAL *const now = view->now + l * (p + 1);
        used += view->have[l] & 1u;
        if (view->have[l] & 2) MK_F(mk_row_copy)(count, view->next + l * (p + 1), now);
        else if (last) memset(now, 0, (size_t)(p + 1) * sizeof *now); /* of RATIO: the next run has heard nothing yet */
        view->have[l] >>= 1;
    }
    if (ratio && !last && used > 0) MK_F(mk_consensus_share)(view, count);
    core->heard += used;
    core->missing += (uint32_t)config->slots - 1u - used;
    if (used == 0) core->kept++;
    core->iteration = last ? 0 : (uint16_t)(core->iteration + 1);
    core->running = !last;
    return MK_OK;
}

mk_status_t MK_F(mk_consensus_average)(const MK_F_T(mk_consensus_view) * view, MK_REAL *values) {
    const MK_F_T(mk_consensus_config) *const config = view->core->config;
    if (!values) return MK_ERROR_ARGUMENT;
    if (!config || !view->core->known) return MK_ERROR_ORDER;
    const int count = config->values, ratio = config->protocol == MK_CONSENSUS_RATIO;
    const MK_REAL *const own = ratio ? view->next : view->now;
    const MK_REAL mass = MK_F(mk_consensus_carries)(config) ? own[count] : MK_R(1.0);
    if (!(mass > MK_R(0.0)) || (ratio && !(mass > MK_RATIO_ROUNDINGS * MK_EPSILON * view->sum[count]))) return MK_ERROR_NOT_FINITE;
    MK_REAL probe = MK_R(0.0);
    for (int i = 0; i < count; i++) probe += own[i] / mass * MK_R(0.0);
    if (!(probe == MK_R(0.0))) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < count; i++) values[i] = own[i] / mass;
    return MK_OK;
}
