/* SPDX-License-Identifier: MIT */
/* The node object of meshkal/node.h: neighbours, frames, steps. Part of the shared build, with run-time dimensions. */

static mk_status_t MK_F(mk_node_check)(int slots, const MK_F_T(mk_node_config) * config) {
    if (!config || !config->nodes) return MK_ERROR_ARGUMENT;
    if (config->numbers > MK_NUMBERS_F16 || (MK_BITS == 32 && config->numbers == MK_NUMBERS_F64)) return MK_ERROR_ARGUMENT;
    /* The filter tells other dimensions from its own; until then only what both agree on is read. */
    if (config->filter.slots != slots) return MK_ERROR_SHAPE;
    if (mk_link_named_twice(slots, config->nodes)) return MK_ERROR_ARGUMENT;
    const MK_F_T(mk_node_gate) *const gate = config->gate;
    if (gate) {
        if (!gate->reading || !(gate->estimate >= MK_R(0.0) && gate->estimate <= MK_LARGEST)) return MK_ERROR_ARGUMENT;
        for (int l = 0; l < slots; l++)
            if (!(gate->reading[l] >= MK_R(0.0) && gate->reading[l] <= MK_LARGEST)) return MK_ERROR_ARGUMENT;
    }
    const MK_F_T(mk_node_foreign) *const foreign = config->foreign;
    /* A steady gain is one of models that stay. */
    if (foreign && (config->filter.steady || !foreign->slot || foreign->slot[0] || foreign->C != config->filter.C ||
                    foreign->F != config->filter.F || foreign->S != config->filter.S ||
                    foreign->R_inverse != config->filter.R_inverse || !(foreign->limit >= MK_R(0.0))))
        return MK_ERROR_ARGUMENT;
    return MK_OK;
}

mk_status_t MK_F(mk_node_start)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const MK_F_T(mk_node_config) * config) {
    mk_status_t status = MK_F(mk_node_check)(slots, config);
    if (status == MK_OK) status = MK_F(mk_rkfd_start)(n, m, slots, &view->filter, &config->filter);
    if (status != MK_OK) return status;
    memset(view->node, 0, sizeof *view->node);
    view->node->config = config;
    for (int l = 0; l < slots; l++) {
        view->heard[l] = 0;
        view->seen[l] = 0;
    }
    return MK_OK;
}

mk_status_t MK_F(mk_node_secure)(const MK_F_T(mk_node_view) * view, mk_secure_t *secure, int slots) {
    if (!view->node->config) return MK_ERROR_ARGUMENT;
    const mk_status_t status = mk_link_secure(secure, slots);
    if (status == MK_OK) view->node->secure = secure;
    return status;
}

/* --- what comes in --------------------------------------------------------------------------------------------------------- */

/* A reading into its slot, for this step or, in stage 2, for the next one. */
static mk_status_t MK_F(mk_node_put)(int m, const MK_F_T(mk_node_view) * view, int slot, const MK_REAL *y) {
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    const int rows = filter->core->config->rows[slot];
    if (filter->have_y[slot]) return MK_ERROR_REPEATED;
    if (!MK_F(mk_all_finite)(rows, y)) return MK_ERROR_NOT_FINITE;
    for (int r = 0; r < m; r++) filter->y[slot * m + r] = r < rows ? y[r] : MK_R(0.0);
    filter->have_y[slot] = 1;
    return MK_OK;
}

mk_status_t MK_F(mk_node_measure)(int m, const MK_F_T(mk_node_view) * view, const MK_REAL *y) {
    if (!y) return MK_ERROR_ARGUMENT;
    if (!view->node->config) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_node_put)(m, view, 0, y);
    if (view->node->recorder) MK_F(mk_note_numbers)(view, MK_ITEM_MEASURE, status, view->filter.core->config->rows[0], y);
    return status;
}

/* Is this trace of S one that is believed? */
static int MK_F(mk_node_plausible)(const MK_F_T(mk_node_foreign) * foreign, MK_REAL trace) {
    return trace <= MK_LARGEST && !(foreign->limit > MK_R(0.0) && trace > foreign->limit);
}

/* The model of a foreign neighbour into the filter's arrays, so that it is like any other: R = I, F = C' = G', S = G'G. */
static mk_status_t MK_F(mk_node_put_model)(int n, int m, const MK_F_T(mk_node_foreign) * foreign, int slot, int rows, const MK_REAL *G) {
    const int packed = MK_AT(n, 0);
    MK_REAL trace = MK_R(0.0);
    for (int i = 0; i < rows * n; i++) trace += G[i] * G[i];
    if (!MK_F(mk_node_plausible)(foreign, trace)) return MK_ERROR_IMPLAUSIBLE;
    MK_REAL *const C = foreign->C + slot * m * n, *const F = foreign->F + slot * m * n, *const S = foreign->S + slot * packed;
    for (int i = 0; i < m * n; i++) C[i] = F[i] = i < rows * n ? G[i] : MK_R(0.0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            MK_REAL sum = MK_R(0.0);
            for (int r = 0; r < rows; r++) sum += C[r * n + i] * C[r * n + j];
            S[MK_AT(i, j)] = sum;
        }
    for (int r = 0; r < m; r++)
        for (int s = 0; s <= r; s++) foreign->R_inverse[slot * MK_AT(m, 0) + MK_AT(r, s)] = r == s && r < rows ? MK_R(1.0) : MK_R(0.0);
    return MK_OK;
}

/* What a frame of a neighbour brings, its seal or checksum having been good. */
static mk_status_t MK_F(mk_node_use)(int n, int m, const MK_F_T(mk_node_view) * view, const mk_frame_t *frame, int slot) {
    MK_F_T(mk_node) *const node = view->node;
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    const MK_F_T(mk_node_foreign) *const foreign = node->config->foreign;
    const int reading = frame->stage == MK_STAGE_MEASUREMENT, with_model = reading && foreign && foreign->slot[slot];
    const int rows = filter->core->config->rows[slot];
    const int count = !reading ? n : with_model ? rows * (n + 1) : rows;
    if (frame->stage == MK_STAGE_CONSENSUS || frame->with_model != with_model || count == 0) return MK_ERROR_TYPE;
    if (frame->length != MK_NUMBERS_BYTES(frame->numbers, count)) return MK_ERROR_LENGTH;

    /* Stages from the one that this node is in to the frame's; modulo 2^32 steps. */
    const uint32_t difference = frame->step - node->step;
    const int stages = difference == 0          ? (reading ? 0 : 1) - (filter->core->stage == 2)
                       : difference == 1        ? (reading ? 2 : 3) - (filter->core->stage == 2)
                       : difference < 0x80000000u ? 2
                                                : -1;
    if (stages >= 2) {
        /* Where that neighbour will be when this node ends its step: a step farther, unless it began one only after this node's stage 1. */
        mk_link_ahead(frame->step + !(reading && filter->core->stage == 2), view->heard + slot, view->seen + slot);
        return MK_ERROR_AHEAD;
    }
    mk_link_heard(frame->step, stages < 0, view->heard + slot, view->seen + slot);
    if (stages < 0) return MK_ERROR_LATE;

    if (reading ? filter->have_y[slot] : filter->have_psi[slot]) return MK_ERROR_REPEATED;
    MK_REAL *const values = filter->work;
    mk_status_t status = MK_F(mk_numbers_get)(frame->numbers, count, frame->payload, values);
    if (status != MK_OK) return status;
    if (with_model) status = MK_F(mk_node_put_model)(n, m, foreign, slot, rows, values);
    if (status != MK_OK) return status;
    if (reading) {
        status = MK_F(mk_node_put)(m, view, slot, with_model ? values + rows * n : values);
        if (status != MK_OK) return status;
    } else {
        for (int i = 0; i < n; i++) filter->psi[slot * n + i] = values[i];
        filter->have_psi[slot] = 1;
    }
    if (stages == 1) node->early++;
    return MK_OK;
}

static mk_status_t MK_F(mk_node_take)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const uint8_t *bytes, size_t length) {
    MK_F_T(mk_node) *const node = view->node;
    mk_frame_t frame;
    int slot;
    mk_status_t status = mk_link_receive(bytes, length, slots, node->config->nodes, node->config->model, node->secure, &frame, &slot);
    if (status != MK_OK) return status;
    status = MK_F(mk_node_use)(n, m, view, &frame, slot);
    if (node->recorder) mk_note_frame(node->recorder, status, bytes, &frame);
    return status;
}

mk_status_t MK_F(mk_node_accept)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const uint8_t *bytes, size_t length) {
    if (!view->node->config) return MK_ERROR_ORDER;
    const mk_status_t status = MK_F(mk_node_take)(n, m, slots, view, bytes, length);
    view->node->counts[status]++;
    return status;
}

mk_status_t MK_F(mk_node_accept_recorded)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const uint8_t *content,
                                          size_t length) {
    mk_frame_t frame;
    if (!view->node->config) return MK_ERROR_ORDER;
    mk_status_t status = mk_frame_parse(content, length, &frame);
    if (status == MK_OK && frame.model != view->node->config->model) status = MK_ERROR_MODEL;
    const int slot = status == MK_OK ? mk_link_slot(slots, view->node->config->nodes, frame.node) : 0;
    if (status == MK_OK) status = slot ? MK_F(mk_node_use)(n, m, view, &frame, slot) : MK_ERROR_STRANGER;
    view->node->counts[status]++;
    return status;
}

/* --- what goes out --------------------------------------------------------------------------------------------------------- */

/* The reading of slot 0 with its model as G, z: R^-1 = L L', G = L' C, z = L' y. values: rows (n + 1) numbers, then MK_PACKED(rows). */
static void MK_F(mk_node_whiten)(int n, const MK_F_T(mk_rkfd_view) * filter, int rows, MK_REAL *values) {
    const MK_F_T(mk_rkfd_config) *const config = filter->core->config;
    MK_REAL *const L = values + rows * (n + 1), *const z = values + rows * n;
    for (int r = 0; r < rows; r++)
        for (int s = 0; s <= r; s++) {
            MK_REAL sum = config->R_inverse[MK_AT(r, s)];
            for (int k = 0; k < s; k++) sum -= L[MK_AT(r, k)] * L[MK_AT(s, k)];
            L[MK_AT(r, s)] = r == s ? MK_F(mk_sqrt)(sum) : sum / L[MK_AT(s, s)];
        }
    for (int r = 0; r < rows; r++) {
        z[r] = MK_R(0.0);
        for (int i = 0; i < n; i++) values[r * n + i] = MK_R(0.0);
        for (int s = r; s < rows; s++) {
            z[r] += L[MK_AT(s, r)] * filter->y[s];
            for (int i = 0; i < n; i++) values[r * n + i] += L[MK_AT(s, r)] * config->C[s * n + i];
        }
    }
}

size_t MK_F(mk_node_frame)(int n, const MK_F_T(mk_node_view) * view, int stage, uint8_t *bytes) {
    MK_F_T(mk_node) *const node = view->node;
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    const MK_F_T(mk_node_config) *const config = node->config;
    if (!config || !bytes) return 0;
    const int rows = config->filter.rows[0], second = filter->core->stage == 2;
    const MK_REAL *values = filter->psi;
    int count = n;
    mk_frame_t frame;
    memset(&frame, 0, sizeof frame);
    frame.step = node->step;
    if (stage == MK_STAGE_MEASUREMENT) {
        /* An innovation cannot be sent: its receiver would have to know h. */
        if (filter->have_y[0] != 1 || rows == 0) return 0;
        if (second) frame.step++;
        frame.with_model = config->with_model;
        values = filter->y;
        count = rows;
        if (config->with_model) {
            MK_F(mk_node_whiten)(n, filter, rows, filter->work);
            values = filter->work;
            count = rows * (n + 1);
        }
    } else if (stage != MK_STAGE_ESTIMATE || !second) {
        return 0;
    }
    frame.model = config->model;
    frame.node = config->nodes[0];
    frame.stage = (uint8_t)stage;
    frame.numbers = config->numbers;
    frame.sealed = node->secure != 0;
    frame.length = (uint16_t)MK_NUMBERS_BYTES(config->numbers, count);
    size_t length = 0;
    if (mk_link_can_send(node->secure) &&
        MK_F(mk_numbers_put)(config->numbers, count, values, mk_frame_payload(bytes, frame.sealed)) == MK_OK)
        length = mk_link_send(&frame, bytes, node->secure);
    if (length == 0) node->unsent++;
    return length;
}
