/* SPDX-License-Identifier: MIT */
/* The node object of meshkal/duif.h: an unscented filter whose readings go into a consensus. Part of the shared build, with run-time dimensions. */

static mk_status_t MK_F(mk_duif_check)(int n, int slots, const MK_F_T(mk_duif_config) * config) {
    if (!config || !config->nodes || n < 1 || config->filter.weights) return MK_ERROR_ARGUMENT;
    if (config->numbers > MK_NUMBERS_F16 || (MK_BITS == 32 && config->numbers == MK_NUMBERS_F64)) return MK_ERROR_ARGUMENT;
    if (!(config->limit >= MK_R(0.0) && config->limit <= MK_LARGEST) || !(config->epsilon >= MK_R(0.0) && config->epsilon <= MK_LARGEST))
        return MK_ERROR_ARGUMENT;
    const mk_status_t status = MK_F(mk_consensus_check)(MK_DUIF_VALUES(n), slots, &config->consensus);
    if (status != MK_OK) return status;
    if (config->consensus.values != n + MK_AT(n, 0) + (config->consensus.protocol == MK_CONSENSUS_SUM ? n : 0)) return MK_ERROR_SHAPE;
    if (mk_link_named_twice(slots, config->nodes)) return MK_ERROR_ARGUMENT;
    return !config->origin || MK_F(mk_all_finite)(n, config->origin) ? MK_OK : MK_ERROR_NOT_FINITE;
}

mk_status_t MK_F(mk_duif_start)(int n, int m, int slots, const MK_F_T(mk_duif_view) * view, const MK_F_T(mk_duif_config) * config) {
    mk_status_t status = MK_F(mk_duif_check)(n, slots, config);
    if (status == MK_OK) status = MK_F(mk_unscented_start)(n, m, 1, &view->filter, &config->filter);
    if (status == MK_OK) status = MK_F(mk_consensus_start)(MK_DUIF_VALUES(n), slots, &view->consensus, &config->consensus);
    if (status != MK_OK) return status;
    memset(view->core, 0, sizeof *view->core);
    memset(view->heard, 0, (size_t)slots * sizeof *view->heard);
    memset(view->seen, 0, (size_t)slots);
    view->core->config = config;
    return MK_OK;
}

mk_status_t MK_F(mk_duif_secure)(const MK_F_T(mk_duif_view) * view, mk_secure_t *secure) {
    if (!view->core->config) return MK_ERROR_ARGUMENT;
    const mk_status_t status = mk_link_secure(secure, view->core->config->consensus.slots);
    if (status == MK_OK) view->core->secure = secure;
    return status;
}

static int MK_F(mk_duif_reads)(const MK_F_T(mk_duif) * core) { return core->config && core->stage == MK_DUIF_READING; }

/* x := x - origin */
static void MK_F(mk_duif_shift)(int n, const MK_REAL *origin, MK_REAL *x) {
    for (int i = 0; i < n && origin; i++) x[i] -= origin[i];
}

/* Numbers of a message outside of what the filter's own functions use. */
static MK_REAL *MK_F(mk_duif_values)(int n, const MK_F_T(mk_duif_view) * view) {
    return view->work + MK_UNSCENTED_WORK(n, view->core->config->filter.m, 1);
}

/* Where x or P have left the range of the precision: the same from x and P0, then from x0. */
static mk_status_t MK_F(mk_duif_recover)(int n, const MK_F_T(mk_duif_view) * view, MK_REAL dt, const MK_REAL *Q, mk_status_t status) {
    const MK_F_T(mk_unscented_config) *const config = &view->core->config->filter;
    MK_REAL *const x = MK_F(mk_duif_values)(n, view), *const L = x + n;
    const MK_F_T(mk_unscented) before = *view->filter.core;
    const uint8_t had = view->filter.have[0];
    for (int i = 0; i < n; i++) x[i] = view->filter.x[i];
    for (int i = 0; i < MK_AT(n, 0); i++) L[i] = view->filter.L[i];
    for (int attempt = 0; attempt < 2; attempt++)
        if (MK_F(mk_unscented_restart)(n, 1, &view->filter, attempt ? config->x0 : x, config->P0) == MK_OK &&
            MK_F(mk_unscented_predict)(n, &view->filter, dt, Q) == MK_OK) {
            view->core->reinitialised++;
            return MK_OK;
        }
    /* It was dt, Q or the model. */
    for (int i = 0; i < n; i++) view->filter.x[i] = x[i];
    for (int i = 0; i < MK_AT(n, 0); i++) view->filter.L[i] = L[i];
    *view->filter.core = before;
    view->filter.have[0] = had;
    return status;
}

mk_status_t MK_F(mk_duif_predict)(int n, const MK_F_T(mk_duif_view) * view, MK_REAL dt, const MK_REAL *Q) {
    if (!MK_F(mk_duif_reads)(view->core)) return MK_ERROR_ORDER;
    mk_status_t status = MK_F(mk_unscented_predict)(n, &view->filter, dt, Q);
    if (status == MK_ERROR_NOT_FINITE || status == MK_ERROR_NOT_POSITIVE_DEFINITE) status = MK_F(mk_duif_recover)(n, view, dt, Q, status);
    if (status == MK_OK) view->core->dt = dt;
    return status;
}

mk_status_t MK_F(mk_duif_measure)(int m, const MK_F_T(mk_duif_view) * view, const MK_REAL *z) {
    return MK_F(mk_unscented_put)(m, 1, &view->filter, 0, z);
}

mk_status_t MK_F(mk_duif_drop)(const MK_F_T(mk_duif_view) * view) { return MK_F(mk_unscented_drop)(1, &view->filter, 0); }

mk_status_t MK_F(mk_duif_contribute)(int n, int m, const MK_F_T(mk_duif_view) * view) {
    MK_F_T(mk_duif) *const core = view->core;
    if (!MK_F(mk_duif_reads)(core)) return MK_ERROR_ORDER;
    MK_REAL *const s = MK_F(mk_duif_values)(n, view), *const S = s + n, *const x = S + MK_AT(n, 0);
    const mk_status_t status = MK_F(mk_unscented_contribution)(n, m, 1, &view->filter, core->config->paper_information, s, S);
    if (status != MK_OK) return status;
    core->measured = view->filter.core->measurements > 0;
    for (int i = 0; i < n && core->config->origin; i++)
        for (int j = 0; j < n; j++) s[i] -= S[MK_PLACE(i, j)] * core->config->origin[j];
    if (core->config->consensus.protocol == MK_CONSENSUS_SUM) {
        for (int i = 0; i < n; i++) x[i] = view->filter.x[i];
        MK_F(mk_duif_shift)(n, core->config->origin, x);
    }
    if (MK_F(mk_consensus_begin)(MK_DUIF_VALUES(n), &view->consensus, s, core->measured) != MK_OK) {
        /* Scaled it overflows: a reading as good as none. */
        core->measured = 0;
        for (int i = 0; i < n + MK_AT(n, 0); i++) s[i] = MK_R(0.0);
        (void)MK_F(mk_consensus_begin)(MK_DUIF_VALUES(n), &view->consensus, s, 0);
    }
    core->stage = MK_DUIF_CONSENSUS;
    return MK_OK;
}

/* --- frames ---------------------------------------------------------------------------------------------------------------- */

#define MK_DUIF_PROTOCOL 7u
#define MK_DUIF_MEASURED 8u

size_t MK_F(mk_duif_frame)(const MK_F_T(mk_duif_view) * view, uint8_t *bytes) {
    MK_F_T(mk_duif) *const core = view->core;
    const MK_F_T(mk_duif_config) *const config = core->config;
    if (!config || !bytes || core->stage != MK_DUIF_CONSENSUS) return 0;
    const int count = MK_F(mk_consensus_numbers)(&config->consensus);
    mk_frame_t frame;
    memset(&frame, 0, sizeof frame);
    frame.model = config->model;
    frame.step = core->step;
    frame.node = config->nodes[0];
    frame.stage = MK_STAGE_CONSENSUS;
    frame.numbers = config->numbers;
    frame.sealed = core->secure != 0;
    frame.length = (uint16_t)(MK_CONSENSUS_HEADER + MK_NUMBERS_BYTES(config->numbers, count));
    uint8_t *const payload = mk_frame_payload(bytes, frame.sealed);
    mk_put_u16(payload, view->consensus.core->iteration);
    payload[2] = (uint8_t)(config->consensus.protocol | (core->measured ? MK_DUIF_MEASURED : 0u));
    size_t length = 0;
    if (mk_link_can_send(core->secure) &&
        MK_F(mk_numbers_put)(config->numbers, count, view->consensus.now, payload + MK_CONSENSUS_HEADER) == MK_OK)
        length = mk_link_send(&frame, bytes, core->secure);
    if (length == 0) core->unsent++;
    return length;
}

/* Can S be an average of information matrices? Rounding to a short format keeps the sign of its diagonal. */
static int MK_F(mk_duif_plausible)(int n, const MK_F_T(mk_duif_config) * config, const MK_REAL *values) {
    const MK_REAL *const S = values + n;
    const MK_REAL mass = MK_F(mk_consensus_carries)(&config->consensus) ? values[config->consensus.values] : MK_R(1.0);
    if (mass < MK_R(0.0)) return 0;
    for (int i = 0; i < n; i++)
        if (S[MK_AT(i, i)] < MK_R(0.0)) return 0;
    const MK_REAL trace = MK_F(mk_trace)(n, S);
    return trace <= MK_LARGEST && !(config->limit > MK_R(0.0) && trace > config->limit * mass);
}

/* What a frame of a neighbour brings, its seal or checksum having been good. */
static mk_status_t MK_F(mk_duif_use)(int n, const MK_F_T(mk_duif_view) * view, const mk_frame_t *frame, int slot) {
    MK_F_T(mk_duif) *const core = view->core;
    const MK_F_T(mk_consensus_config) *const consensus = &core->config->consensus;
    const int count = MK_F(mk_consensus_numbers)(consensus);
    const uint32_t L = consensus->iterations, now = view->consensus.core->iteration;
    if (frame->stage != MK_STAGE_CONSENSUS) return MK_ERROR_TYPE;
    if (frame->length != MK_CONSENSUS_HEADER + MK_NUMBERS_BYTES(frame->numbers, count)) return MK_ERROR_LENGTH;
    const uint32_t iteration = mk_get_u16(frame->payload);
    if ((frame->payload[2] & ~MK_DUIF_MEASURED) != consensus->protocol || iteration >= L) return MK_ERROR_TYPE;

    /* The consensus waits for the iterations of this step, or once it is over for those of the next one. */
    const uint32_t difference = frame->step - core->step - (core->stage == MK_DUIF_FUSION), relative = iteration + (difference == 1 ? L : 0);
    mk_status_t status = difference <= 1            ? MK_F(mk_consensus_expect)(&view->consensus, slot, relative)
                         : difference < 0x80000000u ? MK_ERROR_AHEAD
                                                    : MK_ERROR_LATE;
    if (status == MK_ERROR_AHEAD) {
        /* Where that neighbour will be when this node ends its step. */
        const uint32_t left = core->stage == MK_DUIF_FUSION ? 0 : L - now;
        mk_link_ahead(frame->step + (iteration + left >= L), view->heard + slot, view->seen + slot);
        return status;
    }
    mk_link_heard(frame->step, status == MK_ERROR_LATE, view->heard + slot, view->seen + slot);
    if (status != MK_OK) return status;
    status = MK_F(mk_numbers_get)(frame->numbers, count, frame->payload + MK_CONSENSUS_HEADER, view->work);
    if (status != MK_OK) return status;
    if (!MK_F(mk_duif_plausible)(n, core->config, view->work)) return MK_ERROR_IMPLAUSIBLE;
    core->early += relative != now;
    return MK_F(mk_consensus_put)(MK_DUIF_VALUES(n), &view->consensus, slot, relative, view->work);
}

mk_status_t MK_F(mk_duif_accept)(int n, const MK_F_T(mk_duif_view) * view, const uint8_t *bytes, size_t length) {
    MK_F_T(mk_duif) *const core = view->core;
    const MK_F_T(mk_duif_config) *const config = core->config;
    if (!config) return MK_ERROR_ORDER;
    mk_frame_t frame;
    int slot;
    mk_status_t status = mk_link_receive(bytes, length, config->consensus.slots, config->nodes, config->model, core->secure, &frame, &slot);
    if (status == MK_OK) status = MK_F(mk_duif_use)(n, view, &frame, slot);
    core->counts[status]++;
    return status;
}

/* --- steps ----------------------------------------------------------------------------------------------------------------- */

/* What overflows goes. A running sum cannot be left out, its past is in the present one: then what this node holds goes, too. */
static void MK_F(mk_duif_forget)(int n, const MK_F_T(mk_duif_view) * view) {
    const MK_F_T(mk_consensus_config) *const consensus = &view->core->config->consensus;
    const size_t row = (size_t)(MK_DUIF_VALUES(n) + 1) * sizeof *view->consensus.now;
    for (int l = 1; l < consensus->slots; l++) {
        view->core->counts[MK_ERROR_IMPLAUSIBLE] += view->consensus.have[l] & 1u;
        view->consensus.have[l] &= 2;
    }
    if (consensus->protocol != MK_CONSENSUS_RATIO) return;
    memset(view->consensus.now, 0, consensus->slots * row);
    memset(view->consensus.next, 0, row);
    memset(view->consensus.sum, 0, row);
}

mk_status_t MK_F(mk_duif_iterate)(int n, const MK_F_T(mk_duif_view) * view) {
    MK_F_T(mk_duif) *const core = view->core;
    if (!core->config || core->stage != MK_DUIF_CONSENSUS) return MK_ERROR_ORDER;
    mk_status_t status = MK_F(mk_consensus_iterate)(MK_DUIF_VALUES(n), &view->consensus);
    if (status == MK_ERROR_NOT_FINITE) {
        MK_F(mk_duif_forget)(n, view);
        status = MK_F(mk_consensus_iterate)(MK_DUIF_VALUES(n), &view->consensus);
    }
    if (status == MK_OK && !view->consensus.core->running) core->stage = MK_DUIF_FUSION;
    return status;
}

/* t := gamma P t, with t the sum of x over this node and the neighbours heard at first: the consensus term of the Kalman-consensus filter. */
static mk_status_t MK_F(mk_duif_attraction)(int n, const MK_F_T(mk_duif_view) * view, MK_REAL *t) {
    MK_REAL *const P = view->work, *const d = P + MK_AT(n, 0);
    MK_REAL square = MK_R(0.0);
    const mk_status_t status = MK_F(mk_unscented_covariance)(n, &view->filter, P);
    if (status != MK_OK) return status;
    for (int i = 0; i < n; i++) {
        d[i] = t[i] - (MK_REAL)(view->consensus.core->heard + 1) * view->filter.x[i];
        for (int j = 0; j < n; j++) square += P[MK_PLACE(i, j)] * P[MK_PLACE(i, j)];
    }
    const MK_REAL gamma = view->core->config->epsilon / (MK_R(1.0) + MK_F(mk_sqrt)(square));
    for (int i = 0; i < n; i++) {
        t[i] = MK_R(0.0);
        for (int j = 0; j < n; j++) t[i] += gamma * (P[MK_PLACE(i, j)] * d[j]);
    }
    return MK_F(mk_all_finite)(n, t) ? MK_OK : MK_ERROR_NOT_FINITE;
}

/* With x relative to the origin: the prediction becomes the estimate, or stays. Returns the flags that say why. */
static unsigned MK_F(mk_duif_join)(int n, const MK_F_T(mk_duif_view) * view, MK_REAL *s) {
    const MK_F_T(mk_consensus_config) *const consensus = &view->core->config->consensus;
    const int sum = consensus->protocol == MK_CONSENSUS_SUM, alone = view->consensus.core->heard == 0;
    MK_REAL *const S = s + n, *const t = S + MK_AT(n, 0), *const x = view->filter.x;
    if (MK_F(mk_consensus_average)(&view->consensus, s) != MK_OK) return alone && !view->core->measured ? MK_DUIF_UNINFORMED : MK_DUIF_UNFUSED;
    const int informed = MK_F(mk_trace)(n, S) != MK_R(0.0);
    if (!informed && !sum) return MK_DUIF_UNINFORMED;
    if (sum && MK_F(mk_duif_attraction)(n, view, t) != MK_OK) return MK_DUIF_UNFUSED;
    const MK_REAL scale = sum || alone ? MK_R(1.0) : (MK_REAL)consensus->network;
    if (MK_F(mk_unscented_inform)(n, &view->filter, scale, s, S) != MK_OK) return MK_DUIF_UNFUSED;
    if (sum) {
        for (int i = 0; i < n; i++) t[i] += x[i];
        for (int i = 0; i < n && MK_F(mk_all_finite)(n, t); i++) x[i] = t[i];
    }
    return informed ? 0 : MK_DUIF_UNINFORMED;
}

static unsigned MK_F(mk_duif_join_shifted)(int n, const MK_F_T(mk_duif_view) * view) {
    const MK_F_T(mk_duif_config) *const config = view->core->config;
    MK_REAL *const s = MK_F(mk_duif_values)(n, view), *const before = s + MK_DUIF_VALUES(n), *const x = view->filter.x;
    for (int i = 0; i < n; i++) before[i] = x[i];
    MK_F(mk_duif_shift)(n, config->origin, x);
    const unsigned flags = MK_F(mk_duif_join)(n, view, s);
    /* What stayed is not to be rounded. */
    const int stays = (flags & MK_DUIF_UNFUSED) || (flags && config->consensus.protocol != MK_CONSENSUS_SUM);
    for (int i = 0; i < n && config->origin; i++) x[i] = stays ? before[i] : x[i] + config->origin[i];
    return flags;
}

/* Predictions for the steps up to `step`, or a new start there. */
static void MK_F(mk_duif_follow)(int n, const MK_F_T(mk_duif_view) * view, uint32_t step) {
    MK_F_T(mk_duif) *const core = view->core;
    const MK_F_T(mk_duif_config) *const config = core->config;
    core->behind = 0;
    core->left_behind = 0;
    MK_F(mk_consensus_reset)(MK_DUIF_VALUES(n), &view->consensus);
    (void)MK_F(mk_unscented_drop)(1, &view->filter, 0);
    mk_status_t status = step - core->step <= config->catch_up ? MK_OK : MK_ERROR_AHEAD;
    for (; status == MK_OK && core->step != step; core->step++, core->caught_up++) {
        status = MK_F(mk_unscented_predict)(n, &view->filter, core->dt, 0);
        if (status != MK_OK) break;
    }
    if (status == MK_OK) return;
    (void)MK_F(mk_unscented_restart)(n, 1, &view->filter, config->filter.x0, config->filter.P0); /* which start has found to be good */
    core->step = step;
    core->restarts++;
}

mk_status_t MK_F(mk_duif_fuse)(int n, const MK_F_T(mk_duif_view) * view) {
    MK_F_T(mk_duif) *const core = view->core;
    if (!core->config || core->stage != MK_DUIF_FUSION) return MK_ERROR_ORDER;
    const unsigned joined = MK_F(mk_duif_join_shifted)(n, view);
    const MK_F_T(mk_consensus) *const consensus = view->consensus.core;
    core->heard = consensus->heard;
    core->missing = consensus->missing;
    core->flags = (uint8_t)(joined | (core->measured ? 0u : MK_DUIF_BLIND) | (core->missing > 0 ? MK_DUIF_MISSING : 0u) |
                            (core->heard == 0 ? MK_DUIF_ISOLATED : 0u));
    core->isolated += core->heard == 0;
    core->uninformed += (joined & MK_DUIF_UNINFORMED) != 0;
    core->unfused += (joined & MK_DUIF_UNFUSED) != 0;
    core->stage = MK_DUIF_READING;
    core->measured = 0;
    core->step++;
    core->behind = mk_link_behind(core->config->consensus.slots, core->step, MK_NODE_LEFT_BEHIND, view->heard, view->seen, &core->left_behind);
    if (core->behind) MK_F(mk_duif_follow)(n, view, core->step + core->behind);
    return MK_OK;
}

mk_status_t MK_F(mk_duif_advance)(int n, const MK_F_T(mk_duif_view) * view, uint32_t step) {
    MK_F_T(mk_duif) *const core = view->core;
    if (!MK_F(mk_duif_reads)(core)) return MK_ERROR_ORDER;
    const uint32_t steps = step - core->step;
    if (steps == 0 || steps >= 0x80000000u) return MK_ERROR_ARGUMENT;
    MK_F(mk_duif_follow)(n, view, step);
    return MK_OK;
}

mk_status_t MK_F(mk_duif_restart)(int n, const MK_F_T(mk_duif_view) * view, const MK_REAL *x0, const MK_REAL *P0) {
    MK_F_T(mk_duif) *const core = view->core;
    if (!core->config) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_unscented_restart)(n, 1, &view->filter, x0, P0);
    if (status != MK_OK) return status;
    MK_F(mk_consensus_reset)(MK_DUIF_VALUES(n), &view->consensus);
    core->stage = MK_DUIF_READING;
    core->measured = 0;
    return MK_OK;
}
