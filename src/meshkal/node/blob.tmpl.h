/* SPDX-License-Identifier: MIT */
/* Saving and restoring a node. Blob: header (MK_BLOB_HEADER bytes), numbers, counters and flags as walked below, CRC-32 of all before. */

static void MK_F(mk_blob_numbers)(mk_blob_t *blob, int count, MK_REAL *values) {
    for (int i = 0; i < count; i++) {
        MK_UINT bits;
        if (blob->from) {
            bits = (MK_UINT)mk_get_bytes(blob->from + blob->at, (int)sizeof bits);
            memcpy(values + i, &bits, sizeof bits);
        } else {
            memcpy(&bits, values + i, sizeof bits);
            mk_put_bytes(blob->to + blob->at, (int)sizeof bits, bits);
        }
        blob->at += sizeof bits;
    }
}

/* Numbers first: restore looks at them before it takes any. */
static void MK_F(mk_node_walk)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const MK_F_T(mk_node_config) * config,
                               mk_blob_t *blob) {
    MK_F_T(mk_node) *const node = view->node;
    const MK_F_T(mk_rkfd_view) *const filter = &view->filter;
    MK_F_T(mk_rkfd) *const core = filter->core;
    MK_F(mk_blob_numbers)(blob, MK_AT(n, 0), filter->W);
    MK_F(mk_blob_numbers)(blob, n, filter->x);
    MK_F(mk_blob_numbers)(blob, slots * m, filter->y);
    MK_F(mk_blob_numbers)(blob, slots * n, filter->psi);
    MK_F(mk_blob_numbers)(blob, 1, &core->tolerance);
    MK_F(mk_blob_numbers)(blob, 1, &core->theta);
    MK_F(mk_blob_numbers)(blob, 1, &core->trace_P);
    MK_F(mk_blob_numbers)(blob, 1, &core->nis);
    for (int l = 0; config->foreign && l < slots; l++)
        if (config->foreign->slot[l]) MK_F(mk_blob_numbers)(blob, m * n, config->foreign->C + l * m * n);
    mk_blob_u32(blob, &core->steps);
    mk_blob_u32(blob, &core->steps_since_measurement);
    mk_blob_u32(blob, &core->rejected);
    mk_blob_u32(blob, &node->step);
    mk_blob_u32(blob, &node->early);
    mk_blob_u32(blob, &node->caught_up);
    mk_blob_u32(blob, &node->restarts);
    mk_blob_u32(blob, &node->reinitialised);
    mk_blob_u32(blob, &node->unsent);
    mk_blob_u32(blob, &node->behind);
    for (int i = 0; i < MK_STATUS_COUNT; i++) mk_blob_u32(blob, node->counts + i);
    for (int l = 0; l < slots; l++) mk_blob_u32(blob, view->heard + l);
    mk_blob_u16(blob, &core->nis_rows);
    mk_blob_u16(blob, &core->iterations);
    mk_blob_u16(blob, &core->measurements);
    mk_blob_u16(blob, &core->estimates);
    mk_blob_u16(blob, &core->faults);
    mk_blob_u16(blob, &node->gated);
    mk_blob_u16(blob, &node->gated_steps);
    mk_blob_u16(blob, &node->left_behind);
    mk_blob_u16(blob, &core->steady);
    mk_blob_u8(blob, &core->frozen);
    mk_blob_u8(blob, &core->stage);
    mk_blob_u8(blob, &core->rejected_now);
    for (int l = 0; l < slots; l++) {
        mk_blob_u8(blob, filter->have_y + l);
        mk_blob_u8(blob, filter->have_psi + l);
        mk_blob_u8(blob, view->seen + l);
    }
}

/* Numbers of a blob; those before the foreign models are always there. */
static int MK_F(mk_node_blob_numbers)(int n, int m, int slots, const MK_F_T(mk_node_config) * config) {
    int foreign = 0;
    for (int l = 0; config->foreign && l < slots; l++) foreign += config->foreign->slot[l] != 0;
    return 4 + n + MK_AT(n, 0) + slots * (m + n) + foreign * m * n;
}

static size_t MK_F(mk_node_blob_length)(int n, int m, int slots, const MK_F_T(mk_node_config) * config) {
    return MK_BLOB_HEADER + 40 + 4 * MK_STATUS_COUNT + 21 + 7 * (size_t)slots + 4 +
           sizeof(MK_REAL) * (size_t)MK_F(mk_node_blob_numbers)(n, m, slots, config);
}

static void MK_F(mk_node_blob_header)(int n, int m, int slots, const MK_F_T(mk_node_config) * config, uint8_t header[MK_BLOB_HEADER]) {
    memset(header, 0, MK_BLOB_HEADER);
    memcpy(header, "MKS", 3);
    header[3] = MK_BLOB_VERSION;
    header[4] = MK_BITS;
    header[5] = config->foreign != 0;
    mk_put_u16(header + 6, (uint16_t)n);
    mk_put_u16(header + 8, (uint16_t)m);
    mk_put_u16(header + 10, (uint16_t)slots);
    mk_put_u16(header + 12, config->nodes[0]);
    mk_put_u32(header + 14, config->model);
}

size_t MK_F(mk_node_save)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, uint8_t *bytes) {
    const MK_F_T(mk_node_config) *const config = view->node->config;
    if (!config || !bytes) return 0;
    mk_blob_t blob = {0, bytes, MK_BLOB_HEADER};
    MK_F(mk_node_blob_header)(n, m, slots, config, bytes);
    MK_F(mk_node_walk)(n, m, slots, view, config, &blob);
    mk_put_u32(bytes + blob.at, mk_crc32(0, bytes, blob.at));
    return blob.at + 4;
}

/* Is what a blob with the right checksum holds a state? Its writer may have been broken, or an enemy. work: 2 MK_PACKED(n). */
static mk_status_t MK_F(mk_node_blob_check)(int n, int m, int slots, const MK_F_T(mk_node_config) * config, const uint8_t *bytes,
                                            size_t end, MK_REAL *work) {
    mk_blob_t blob = {bytes, 0, MK_BLOB_HEADER};
    MK_REAL *const W = work;
    MK_F(mk_blob_numbers)(&blob, MK_AT(n, 0), W);
    if (!MK_F(mk_all_finite)(MK_AT(n, 0), W)) return MK_ERROR_NOT_FINITE;
    if (!MK_F(mk_positive_definite)(n, W, W + MK_AT(n, 0))) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    const int single = MK_AT(n, 0) + n + slots * (m + n), models = single + 4;
    MK_REAL trace = MK_R(0.0);
    for (int i = MK_AT(n, 0); i < MK_F(mk_node_blob_numbers)(n, m, slots, config); i++) {
        MK_F(mk_blob_numbers)(&blob, 1, work);
        if (!MK_F(mk_all_finite)(1, work)) return MK_ERROR_NOT_FINITE;
        /* The first of the four single numbers is the tolerance. */
        if (i == single && !(work[0] >= MK_R(0.0))) return MK_ERROR_TOLERANCE;
        if (i < models) continue;
        trace = ((i - models) % (m * n) ? trace : MK_R(0.0)) + work[0] * work[0];
        if (!MK_F(mk_node_plausible)(config->foreign, trace)) return MK_ERROR_IMPLAUSIBLE;
    }
    const uint8_t *const flags = bytes + end - 3 * slots, stage = flags[-2];
    if (stage < 1 || stage > 2) return MK_ERROR_ARGUMENT;
    for (int l = 0; l < slots; l++)
        if (flags[3 * l] > 2 || flags[3 * l + 1] > 1 || flags[3 * l + 2] > 2) return MK_ERROR_ARGUMENT;
    return MK_OK;
}

mk_status_t MK_F(mk_node_restore)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, const MK_F_T(mk_node_config) * config,
                                  const uint8_t *bytes, size_t length) {
    if (!bytes || !config) return MK_ERROR_ARGUMENT;
    mk_status_t status = MK_F(mk_node_check)(slots, config);
    if (status == MK_OK) status = MK_F(mk_rkfd_check)(n, m, slots, &config->filter);
    if (status == MK_OK) status = MK_F(mk_rkfd_check_steady)(n, m, slots, config->filter.steady, view->filter.work);
    if (status != MK_OK) return status;
    uint8_t header[MK_BLOB_HEADER];
    MK_F(mk_node_blob_header)(n, m, slots, config, header);
    if (length < MK_BLOB_HEADER + 4) return MK_ERROR_LENGTH;
    if (memcmp(bytes, header, 4) != 0) return MK_ERROR_VERSION;
    if (mk_crc32(0, bytes, length - 4) != mk_get_u32(bytes + length - 4)) return MK_ERROR_CHECKSUM;
    if (memcmp(bytes + 4, header + 4, 8) != 0) return MK_ERROR_SHAPE;
    if (memcmp(bytes + 12, header + 12, 2) != 0) return MK_ERROR_STRANGER;
    if (memcmp(bytes + 14, header + 14, 4) != 0) return MK_ERROR_MODEL;
    if (length != MK_F(mk_node_blob_length)(n, m, slots, config)) return MK_ERROR_LENGTH;
    status = MK_F(mk_node_blob_check)(n, m, slots, config, bytes, length - 4, view->filter.work);
    if (status != MK_OK) return status;

    mk_blob_t blob = {bytes, 0, MK_BLOB_HEADER};
    memset(view->node, 0, sizeof *view->node);
    memset(view->filter.core, 0, sizeof *view->filter.core);
    view->node->config = config;
    view->filter.core->config = &config->filter;
    MK_F(mk_node_walk)(n, m, slots, view, config, &blob);
    /* A frozen gain goes on only where it is this configuration's. */
    MK_F_T(mk_rkfd) *const core = view->filter.core;
    const MK_F_T(mk_rkfd_steady) *const steady = config->filter.steady;
    if (!steady || core->tolerance != config->filter.tolerance) core->steady = 0;
    else if (core->steady > steady->period) core->steady = steady->period;
    for (int i = 0; i < MK_AT(n, 0) && core->steady; i++)
        if (view->filter.W[i] != steady->W[i]) core->steady = 0;
    for (int l = 0; config->foreign && l < slots; l++)
        if (config->foreign->slot[l])
            (void)MK_F(mk_node_put_model)(n, m, config->foreign, l, config->filter.rows[l], config->foreign->C + l * m * n);
    return MK_OK;
}

/* A record begins with the state that everything after it starts from. */
mk_status_t MK_F(mk_node_record)(int n, int m, int slots, const MK_F_T(mk_node_view) * view, mk_recorder_t *recorder) {
    MK_F_T(mk_node) *const node = view->node;
    if (!recorder) {
        node->recorder = 0;
        return MK_OK;
    }
    if (!node->config) return MK_ERROR_ORDER;
    if (!recorder->bytes) return MK_ERROR_ARGUMENT;
    recorder->used = 0;
    recorder->lost = 0;
    if (recorder->with_configuration && MK_F(mk_note_configuration)(node->config, recorder) != MK_OK) return MK_ERROR_LENGTH;
    const size_t length = MK_F(mk_node_blob_length)(n, m, slots, node->config);
    uint8_t *const content = mk_item_begin(recorder, MK_ITEM_STATE, MK_OK, length);
    if (!content) return MK_ERROR_LENGTH;
    (void)MK_F(mk_node_save)(n, m, slots, view, content);
    mk_item_end(recorder);
    node->recorder = recorder;
    return MK_OK;
}
