/* SPDX-License-Identifier: MIT */
/* The update of meshkal/unscented.h: readings stacked, linearised, gated, used. Nothing of the object changes before mk_unscented_commit. */

static mk_status_t MK_F(mk_shared_stack)(MK_F_T(mk_updating) * u, const MK_REAL *x, const MK_REAL *L) {
    return MK_F(mk_inline_stack)(u->n, u->m, u->slots, u, x, L);
}

static MK_REAL MK_F(mk_shared_absorb)(MK_F_T(mk_updating) * u, int first, int rows, MK_REAL scale, MK_REAL *L, MK_REAL *x) {
    return MK_F(mk_inline_absorb)(u->n, u, first, rows, scale, L, x);
}

/* Made when it is needed: a constant one would be data that a loader of position-independent code writes. */
static MK_F_T(mk_unscented_kernels) MK_F(mk_shared_kernels)(void) {
    MK_F_T(mk_unscented_kernels) kernels;
    kernels.stack = MK_F(mk_shared_stack);
    kernels.absorb = MK_F(mk_shared_absorb);
    return kernels;
}

/* Pointers to the parts of the work array; those of linearising and those used between share their place. */
static void MK_F(mk_updating_open)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, const MK_F_T(mk_unscented_kernels) * kernels,
                                   MK_F_T(mk_updating) * u) {
    const int most = m * slots, packed = MK_AT(n, 0), stacked = MK_AT(most, 0);
    MK_REAL *next = view->work;
    memset(u, 0, sizeof *u);
    u->view = view;
    u->config = view->core->config;
    u->kernels = kernels;
    u->n = n;
    u->m = m;
    u->slots = slots;
    u->linear.row = n;
    u->linear.column = 1;
#define MK_TAKE(part, size) \
    part = next; \
    next += size
    MK_TAKE(u->linear.D, most * n);
    MK_TAKE(u->linear.U, most * n);
    MK_TAKE(u->linear.mu, most);
    MK_TAKE(u->linear.epsilon, most);
    MK_TAKE(u->e, most);
    MK_TAKE(u->noise, stacked);
    MK_TAKE(u->factor, slots);
    MK_TAKE(u->d2, slots);
    MK_TAKE(u->L0, packed);
    MK_TAKE(u->L, packed);
    MK_TAKE(u->x, n);
    MK_TAKE(u->one, m);
    MK_TAKE(u->mean, m);
    MK_REAL *const shared = next;
    MK_TAKE(u->points, n * (2 * n + 1));
    MK_TAKE(u->results, m * (2 * n + 1));
    next = shared;
    MK_TAKE(u->B, most * n);
    MK_TAKE(u->S, stacked);
    MK_TAKE(u->b, most);
    MK_TAKE(u->scratch, 2 * n);
    MK_TAKE(u->trial_L, packed);
    MK_TAKE(u->trial_x, n);
#undef MK_TAKE
    for (int i = 0; i < packed; i++) u->L0[i] = view->L[i];
    for (int l = 0; l < slots; l++) {
        u->factor[l] = view->have[l] ? MK_R(1.0) : MK_R(0.0);
        u->d2[l] = MK_R(0.0);
        u->present += view->have[l] != 0;
    }
}

/* noise := R of the stacked sensors, uncorrelated between them. */
static void MK_F(mk_stack_noise)(MK_F_T(mk_updating) * u) {
    int first = 0;
    for (int l = 0; l < u->slots; l++) {
        if (!(u->factor[l] > MK_R(0.0))) continue;
        const MK_F_T(mk_sensor) *const sensor = u->config->sensor + l;
        for (int r = 0; r < sensor->rows; r++) {
            for (int s = 0; s < first; s++) u->noise[MK_AT(first + r, s)] = MK_R(0.0);
            for (int s = 0; s <= r; s++) u->noise[MK_AT(first + r, first + s)] = sensor->R[MK_AT(r, s)];
        }
        first += sensor->rows;
    }
}

/* e' (noise + Omega + D D')^-1 e of these rows; the largest number where it cannot be had. */
static MK_REAL MK_F(mk_stack_distance)(MK_F_T(mk_updating) * u, int first, int rows) {
    const MK_REAL d2 = u->kernels->absorb(u, first, rows, MK_R(1.0), 0, 0);
    return d2 >= MK_R(0.0) && d2 <= MK_LARGEST ? d2 : MK_LARGEST;
}

/* Innovation variance times f, by the noise: f noise + (f - 1) (Omega + D D'). */
static void MK_F(mk_stack_inflate)(MK_F_T(mk_updating) * u, int first, int rows, MK_REAL f) {
    for (int r = first; r < first + rows; r++)
        for (int s = first; s <= r; s++)
            u->noise[MK_AT(r, s)] = f * u->noise[MK_AT(r, s)] + (f - MK_R(1.0)) * MK_F(mk_stack_spread)(u->n, u, r, s);
}

/* What the gate's record will say, without saying it yet. */
static MK_REAL MK_F(mk_foresee)(const MK_F_T(mk_gate) * gate, MK_REAL threshold, MK_REAL d2) {
    MK_F_T(mk_gate_record) record;
    memset(&record, 0, sizeof record);
    return MK_F(mk_gate_judge)(gate->policy, threshold, d2, &record);
}

/* Rows first .. first + rows - 1 of the stack become rows to .. , to <= first; those between are gone. noise is uncorrelated between sensors. */
static void MK_F(mk_stack_move)(MK_F_T(mk_updating) * u, int first, int rows, int to) {
    const int n = u->n;
    if (first == to) return;
    for (int r = 0; r < rows; r++) {
        for (int i = 0; i < n; i++) {
            u->linear.D[(to + r) * n + i] = u->linear.D[(first + r) * n + i];
            u->linear.U[(to + r) * n + i] = u->linear.U[(first + r) * n + i];
        }
        u->linear.mu[to + r] = u->linear.mu[first + r];
        u->linear.epsilon[to + r] = u->linear.epsilon[first + r];
        u->e[to + r] = u->e[first + r];
        for (int s = 0; s < to; s++) u->noise[MK_AT(to + r, s)] = MK_R(0.0);
        for (int s = 0; s <= r; s++) u->noise[MK_AT(to + r, to + s)] = u->noise[MK_AT(first + r, first + s)];
    }
}

/* Judges the stacked sensors one by one; only those that are left stay stacked. */
static void MK_F(mk_judge_sensors)(MK_F_T(mk_updating) * u) {
    const MK_F_T(mk_gate) *const gate = u->config->gate;
    int first = 0, left = 0;
    for (int l = 0; l < u->slots; l++) {
        if (!(u->factor[l] > MK_R(0.0))) continue;
        const int rows = u->config->sensor[l].rows;
        u->d2[l] = MK_F(mk_stack_distance)(u, first, rows);
        u->factor[l] = MK_F(mk_foresee)(gate, gate->sensor[rows - 1], u->d2[l]);
        u->beyond += u->factor[l] != MK_R(1.0);
        if (u->factor[l] > MK_R(1.0)) MK_F(mk_stack_inflate)(u, first, rows, u->factor[l]);
        if (u->factor[l] > MK_R(0.0)) {
            MK_F(mk_stack_move)(u, first, rows, left);
            left += rows;
        }
        first += rows;
    }
    u->rows = left;
}

/* Judges all that is stacked. */
static void MK_F(mk_judge_stack)(MK_F_T(mk_updating) * u) {
    const MK_F_T(mk_gate) *const gate = u->config->gate;
    u->stacked_rows = u->rows;
    u->together = MK_F(mk_stack_distance)(u, 0, u->rows);
    const MK_REAL f = MK_F(mk_foresee)(gate, gate->stacked[u->rows - 1], u->together);
    u->nis = f > MK_R(1.0) ? u->together / f : u->together;
    if (f == MK_R(1.0)) return;
    for (int l = 0; l < u->slots; l++) {
        u->beyond += u->factor[l] == MK_R(1.0);
        u->factor[l] *= f;
    }
    if (f > MK_R(0.0)) MK_F(mk_stack_inflate)(u, 0, u->rows, f);
    else u->rows = 0;
}

static mk_status_t MK_F(mk_stack_prior)(MK_F_T(mk_updating) * u) {
    for (int i = 0; i < u->n; i++) u->x[i] = u->view->x[i];
    for (int i = 0; i < MK_AT(u->n, 0); i++) u->L[i] = u->L0[i];
    const mk_status_t status = u->kernels->stack(u, u->x, u->L);
    if (status == MK_OK) MK_F(mk_stack_noise)(u);
    return status;
}

/* The readings stacked at the prior and gated. */
static mk_status_t MK_F(mk_prepare)(MK_F_T(mk_updating) * u) {
    const MK_F_T(mk_gate) *const gate = u->config->gate;
    u->together = MK_R(-1.0);
    u->nis = MK_R(-1.0);
    const mk_status_t status = MK_F(mk_stack_prior)(u);
    if (status != MK_OK || !gate) return status;
    if (gate->sensor) MK_F(mk_judge_sensors)(u);
    if (gate->stacked && u->rows > 0) MK_F(mk_judge_stack)(u);
    if (2 * u->beyond <= u->present || gate->patience == 0 || u->view->core->gated_updates < gate->patience) return MK_OK;
    u->back = 1;
    u->nis = MK_R(-1.0);
    for (int i = 0; i < MK_AT(u->n, 0); i++) u->L0[i] = u->config->P0[i];
    (void)MK_F(mk_cholesky)(u->n, u->L0); /* which start has found to be positive definite */
    for (int l = 0; l < u->slots; l++) u->factor[l] = u->view->have[l] ? MK_R(1.0) : MK_R(0.0);
    return MK_F(mk_stack_prior)(u);
}

/* x, L := those given what is stacked, its noise times `scale`. */
static mk_status_t MK_F(mk_use)(MK_F_T(mk_updating) * u, MK_REAL scale) {
    const MK_REAL nis = u->kernels->absorb(u, 0, u->rows, scale, u->L, u->x);
    if (nis < MK_R(0.0)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    if (u->nis < MK_R(0.0)) u->nis = nis;
    if (u->config->weights) {
        const mk_status_t status = MK_F(mk_reweigh)(u);
        if (status != MK_OK) return status;
        if (!(u->nis <= MK_LARGEST)) u->nis = MK_LARGEST; /* of a reading that is not used */
    }
    return MK_F(mk_all_finite)(u->n, u->x) && MK_F(mk_all_finite)(MK_AT(u->n, 0), u->L) && MK_F(mk_is_factor)(u->n, u->L) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* What the rule compares. */
static MK_REAL MK_F(mk_rule_measure)(MK_F_T(mk_updating) * u) {
    if (u->config->rule == MK_RULE_MAHALANOBIS) return MK_F(mk_stack_distance)(u, 0, u->rows);
    MK_REAL sum = MK_R(0.0);
    for (int r = 0; r < u->rows && u->config->rule == MK_RULE_INNOVATION; r++) sum += u->e[r] * u->e[r];
    return sum;
}

/* Progressive, and the iterated one as published (scale 1). *done: increments; *stopped: by the rule. */
static mk_status_t MK_F(mk_progress)(MK_F_T(mk_updating) * u, MK_REAL scale, int *done, int *stopped) {
    MK_REAL before = MK_LARGEST;
    if (u->nis < MK_R(0.0)) u->nis = MK_F(mk_stack_distance)(u, 0, u->rows);
    for (*done = 0; *done < u->config->increments; ++*done) {
        mk_status_t status = *done == 0 ? MK_OK : u->kernels->stack(u, u->x, u->L);
        if (status != MK_OK) return status;
        const MK_REAL now = MK_F(mk_rule_measure)(u);
        *stopped = *done > 0 && now > before;
        if (*stopped) return MK_OK;
        before = now;
        status = MK_F(mk_use)(u, scale);
        if (status != MK_OK) return status;
    }
    return MK_OK;
}

/* The cost of Gauss-Newton at x: |z - h(x)|^2_R + |x - x0|^2_P0, over the stacked sensors. */
static mk_status_t MK_F(mk_cost)(MK_F_T(mk_updating) * u, const MK_REAL *x, MK_REAL *cost) {
    const int n = u->n;
    int first = 0;
    for (int l = 0; l < u->slots; l++) {
        if (!(u->factor[l] > MK_R(0.0))) continue;
        const MK_F_T(mk_sensor) *const sensor = u->config->sensor + l;
        mk_status_t status = MK_F(mk_call)(&sensor->model, n, sensor->rows, 1, MK_R(0.0), 1, x, u->mean);
        if (status == MK_OK && !MK_F(mk_all_finite)(sensor->rows, u->mean)) status = MK_ERROR_NOT_FINITE;
        if (status != MK_OK) {
            u->view->core->failed = (uint16_t)l;
            return status;
        }
        MK_F(mk_space_difference)(sensor->model.space, sensor->rows, u->view->z + l * u->m, u->mean, u->b + first);
        first += sensor->rows;
    }
    for (int i = 0; i < MK_AT(u->rows, 0); i++) u->S[i] = u->noise[i];
    if (!MK_F(mk_whiten)(n, u->rows, u->S, 0, u->b)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    MK_REAL *const d = u->scratch;
    MK_REAL sum = MK_R(0.0);
    for (int i = 0; i < n; i++) d[i] = x[i] - u->view->x[i];
    MK_F(mk_solve_left)(n, u->L0, d);
    for (int i = 0; i < n; i++) sum += d[i] * d[i];
    for (int r = 0; r < u->rows; r++) sum += u->b[r] * u->b[r];
    *cost = sum;
    return sum <= MK_LARGEST ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* trial := the update from the prior with what is stacked, linearised over x and L, which are the present iterate. */
static mk_status_t MK_F(mk_gauss_newton)(MK_F_T(mk_updating) * u) {
    const int n = u->n;
    for (int r = 0; r < u->rows; r++) {
        MK_REAL *const d = u->linear.D + r * n;
        MK_F(mk_solve_right)(n, u->L, d); /* H, a row */
        for (int i = 0; i < n; i++) u->e[r] += d[i] * (u->x[i] - u->view->x[i]);
        for (int j = 0; j < n; j++) { /* H L0 */
            MK_REAL sum = MK_R(0.0);
            for (int i = j; i < n; i++) sum += d[i] * u->L0[MK_AT(i, j)];
            d[j] = sum;
        }
    }
    for (int i = 0; i < n; i++) u->trial_x[i] = u->view->x[i];
    for (int i = 0; i < MK_AT(n, 0); i++) u->trial_L[i] = u->L0[i];
    if (!MK_F(mk_stack_whiten)(n, u, 0, u->rows, MK_R(1.0), 1)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    (void)MK_F(mk_shrink)(n, u->rows, u->B, u->b, u->trial_L, u->trial_x, u->scratch);
    return MK_F(mk_all_finite)(n, u->trial_x) && MK_F(mk_all_finite)(MK_AT(n, 0), u->trial_L) && MK_F(mk_is_factor)(n, u->trial_L)
               ? MK_OK
               : MK_ERROR_NOT_FINITE;
}

/* Iterated: Gauss-Newton. */
static mk_status_t MK_F(mk_iterate)(MK_F_T(mk_updating) * u, int *done) {
    const int n = u->n;
    MK_REAL cost;
    if (u->nis < MK_R(0.0)) u->nis = MK_F(mk_stack_distance)(u, 0, u->rows);
    mk_status_t status = MK_F(mk_cost)(u, u->x, &cost);
    int falls = 1;
    for (*done = 0; status == MK_OK && falls && *done < u->config->increments; ++*done) {
        if (*done > 0) status = u->kernels->stack(u, u->x, u->L);
        if (status == MK_OK) status = MK_F(mk_gauss_newton)(u);
        if (status != MK_OK) return status;
        falls = 0;
        for (int half = 0; half <= MK_HALVINGS && !falls; half++) {
            MK_REAL next;
            for (int i = 0; i < n && half > 0; i++) u->trial_x[i] = MK_R(0.5) * (u->trial_x[i] + u->x[i]);
            /* A point outside a model's domain is one where the cost does not fall. */
            falls = MK_F(mk_cost)(u, u->trial_x, &next) == MK_OK && next < cost;
            if (falls) cost = next;
        }
        for (int i = 0; i < n && falls; i++) u->x[i] = u->trial_x[i];
        for (int i = 0; i < MK_AT(n, 0); i++) u->L[i] = u->trial_L[i];
    }
    return status;
}

/* What an update leaves: counters, records, result. */
static void MK_F(mk_unscented_commit)(const MK_F_T(mk_updating) * u, int done, int stopped) {
    const MK_F_T(mk_unscented_view) *const view = u->view;
    MK_F_T(mk_unscented) *const core = view->core;
    const MK_F_T(mk_gate) *const gate = u->config->gate;
    core->nis = u->rows > 0 ? u->nis : MK_R(0.0);
    core->nis_rows = (uint16_t)u->rows;
    core->measurements = 0;
    core->increments = (uint16_t)done;
    core->stopped = (uint8_t)stopped;
    core->rule_fired += (uint32_t)stopped;
    core->failed = (uint16_t)u->slots;
    core->updates += u->present > 0;
    for (int l = 0; l < u->slots; l++) {
        if (!view->have[l]) continue;
        const MK_REAL threshold = gate && gate->sensor && !u->back ? gate->sensor[u->config->sensor[l].rows - 1] : MK_R(0.0);
        (void)MK_F(mk_gate_rate)(threshold, u->d2[l], view->record + l);
        MK_F(mk_gate_count)(u->factor[l], view->record + l); /* which may be what all together were judged to be */
        core->measurements = (uint16_t)(core->measurements + (u->factor[l] > MK_R(0.0)));
        view->have[l] = 0;
    }
    if (u->together >= MK_R(0.0) && !u->back)
        (void)MK_F(mk_gate_judge)(gate->policy, gate->stacked[u->stacked_rows - 1], u->together, &core->stacked);
    if (u->back) core->reinitialised++;
    if (u->back) core->gated_updates = 0;
    else if (2 * u->beyond > u->present) core->gated_updates = (uint16_t)(core->gated_updates + (core->gated_updates < UINT16_MAX));
    else if (u->present > 0 && core->gated_updates > 0) core->gated_updates--;
    for (int i = 0; i < u->n; i++) view->x[i] = u->x[i];
    for (int i = 0; i < MK_AT(u->n, 0); i++) view->L[i] = u->L[i];
}

mk_status_t MK_F(mk_unscented_update_with)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view, const MK_F_T(mk_unscented_kernels) * kernels) {
    MK_F_T(mk_updating) u;
    if (!view->core->started) return MK_ERROR_ORDER;
    MK_F(mk_updating_open)(n, m, slots, view, kernels, &u);
    int done = 0, stopped = 0;
    mk_status_t status = MK_F(mk_prepare)(&u);
    if (status == MK_OK && u.rows > 0) {
        const MK_REAL increments = (MK_REAL)u.config->increments;
        switch (u.config->update) {
        case MK_UPDATE_PROGRESSIVE: status = MK_F(mk_progress)(&u, increments, &done, &stopped); break;
        case MK_UPDATE_ITERATED_LITERAL: status = MK_F(mk_progress)(&u, MK_R(1.0), &done, &stopped); break;
        case MK_UPDATE_ITERATED: status = MK_F(mk_iterate)(&u, &done); break;
        default:
            status = MK_F(mk_use)(&u, MK_R(1.0));
            done = 1;
        }
    }
    if (status != MK_OK) return status;
    MK_F(mk_unscented_commit)(&u, done, stopped);
    if (u.config->weights) MK_F(mk_weights_commit)(&u);
    return MK_OK;
}

mk_status_t MK_F(mk_unscented_update)(int n, int m, int slots, const MK_F_T(mk_unscented_view) * view) {
    const MK_F_T(mk_unscented_kernels) kernels = MK_F(mk_shared_kernels)();
    return MK_F(mk_unscented_update_with)(n, m, slots, view, &kernels);
}

mk_status_t MK_F(mk_unscented_predict)(int n, const MK_F_T(mk_unscented_view) * view, MK_REAL dt, const MK_REAL *Q) {
    return MK_F(mk_inline_unscented_predict)(n, view, view->work + 2 * n * (2 * n + 1), dt, Q);
}
