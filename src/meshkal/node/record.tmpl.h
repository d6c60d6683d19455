/* SPDX-License-Identifier: MIT */
/* What a node writes into its record. */

/* Numbers as they are, also NaN: a refused reading is recorded as it was. Returns the place behind them. */
static uint8_t *MK_F(mk_put_numbers)(uint8_t *bytes, int count, const MK_REAL *values) {
    for (int i = 0; i < count; i++) {
        MK_UINT bits;
        memcpy(&bits, values + i, sizeof bits);
        mk_put_bytes(bytes, (int)sizeof bits, bits);
        bytes += sizeof bits;
    }
    return bytes;
}

static void MK_F(mk_note_numbers)(const MK_F_T(mk_node_view) * view, int kind, mk_status_t status, int count, const MK_REAL *values) {
    uint8_t *const content = mk_item_begin(view->node->recorder, kind, status, (size_t)count * sizeof *values);
    if (!content) return;
    (void)MK_F(mk_put_numbers)(content, count, values);
    mk_item_end(view->node->recorder);
}

static void MK_F(mk_note_restart)(int n, const MK_F_T(mk_node_view) * view, mk_status_t status, const MK_REAL *x0, const MK_REAL *P0) {
    uint8_t *const content = mk_item_begin(view->node->recorder, MK_ITEM_RESTART, status, (size_t)(n + MK_AT(n, 0)) * sizeof *x0);
    if (!content) return;
    (void)MK_F(mk_put_numbers)(MK_F(mk_put_numbers)(content, n, x0), MK_AT(n, 0), P0);
    mk_item_end(view->node->recorder);
}

void MK_F(mk_node_note)(int n, const MK_F_T(mk_node_view) * view, int kind, mk_status_t status, uint32_t step, const MK_REAL *input) {
    mk_recorder_t *const recorder = view->node->recorder;
    if (!recorder) return;
    const int first = kind == MK_ITEM_INCREMENTAL, good = status == MK_OK;
    const int numbers = (first && input ? n : 0) + (!first || good ? n : 0), words = kind == MK_ITEM_ADVANCE ? 2 : first ? 0 : 1;
    uint8_t *content = mk_item_begin(recorder, kind, status, (size_t)numbers * sizeof *view->filter.x + 4 * (size_t)words);
    if (!content) return;
    if (words == 2) mk_put_u32(content, step);
    if (words > 0) mk_put_u32(content + 4 * (words - 1), view->node->step);
    content += 4 * words;
    if (first && input) content = MK_F(mk_put_numbers)(content, n, input);
    if (!first || good) (void)MK_F(mk_put_numbers)(content, n, first ? view->filter.psi : view->filter.x);
    mk_item_end(recorder);
}

static mk_status_t MK_F(mk_note_configuration)(const MK_F_T(mk_node_config) * config, mk_recorder_t *recorder) {
    const MK_F_T(mk_rkfd_config) *const c = &config->filter;
    const int n = c->n, m = c->m, slots = c->slots, packed = MK_AT(n, 0);
    const MK_F_T(mk_rkfd_steady) *const steady = c->steady;
    const int gate = config->gate ? slots + 1 : 0, foreign = config->foreign != 0, limit = steady ? n * n + slots * m * n + packed + 3 : 0;
    const int numbers = n * n + 2 * packed + (c->input ? 2 : 1) * n + slots * (1 + 2 * m * n + packed + MK_AT(m, 0)) + 1 +
                        gate + foreign + limit;
    const size_t others = 18 + 4 * (size_t)slots + (steady ? 2 : 0);
    uint8_t *at = mk_item_begin(recorder, MK_ITEM_CONFIGURATION, MK_OK, others + (size_t)numbers * sizeof *c->A);
    if (!at) return MK_ERROR_LENGTH;
    mk_put_u16(at, c->n);
    mk_put_u16(at + 2, c->m);
    mk_put_u16(at + 4, c->slots);
    mk_put_u16(at + 6, config->catch_up);
    mk_put_u16(at + 8, config->gate ? config->gate->patience : 0);
    at[10] = MK_BITS;
    at[11] = config->numbers;
    at[12] = config->with_model;
    at[13] = (uint8_t)((c->input ? 1 : 0) | (gate ? 2 : 0) | (foreign ? 4 : 0) | (steady ? 8 : 0));
    mk_put_u32(at + 14, config->model);
    at += 18;
    for (int l = 0; l < slots; l++, at += 4) {
        mk_put_u16(at, config->nodes[l]);
        at[2] = c->rows[l];
        at[3] = foreign ? config->foreign->slot[l] : 0;
    }
    at = MK_F(mk_put_numbers)(at, n * n, c->A);
    at = MK_F(mk_put_numbers)(at, packed, c->Q);
    if (c->input) at = MK_F(mk_put_numbers)(at, n, c->input);
    at = MK_F(mk_put_numbers)(at, n, c->x0);
    at = MK_F(mk_put_numbers)(at, packed, c->P0);
    at = MK_F(mk_put_numbers)(at, slots, c->weight);
    at = MK_F(mk_put_numbers)(at, slots * m * n, c->C);
    at = MK_F(mk_put_numbers)(at, slots * m * n, c->F);
    at = MK_F(mk_put_numbers)(at, slots * packed, c->S);
    at = MK_F(mk_put_numbers)(at, slots * MK_AT(m, 0), c->R_inverse);
    at = MK_F(mk_put_numbers)(at, 1, &c->tolerance);
    if (gate) at = MK_F(mk_put_numbers)(MK_F(mk_put_numbers)(at, slots, config->gate->reading), 1, &config->gate->estimate);
    if (foreign) at = MK_F(mk_put_numbers)(at, 1, &config->foreign->limit);
    if (steady) {
        const MK_REAL single[3] = {steady->theta, steady->trace_P, steady->close};
        at = MK_F(mk_put_numbers)(at, n * n, steady->Phi);
        at = MK_F(mk_put_numbers)(at, slots * m * n, steady->G);
        at = MK_F(mk_put_numbers)(at, packed, steady->W);
        mk_put_u16(MK_F(mk_put_numbers)(at, 3, single), steady->period);
    }
    mk_item_end(recorder);
    return MK_OK;
}
