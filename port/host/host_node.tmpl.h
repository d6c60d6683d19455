/* SPDX-License-Identifier: MIT */

/* What begins each block; behind it its arrays, numbers first. */
typedef struct {
    MK_F_T(mk_host_node) host;
    MK_F_T(mk_node) node;
    MK_F_T(mk_rkfd) core;
} MK_F_T(node_head);

typedef struct {
    MK_F_T(mk_node_config) config; /* first: what the caller frees */
    MK_F_T(mk_node_gate) gate;
    MK_F_T(mk_node_foreign) foreign;
    MK_F_T(mk_rkfd_steady) steady;
} MK_F_T(config_head);

MK_F_T(mk_host_node) * MK_F(mk_host_node_open)(int n, int m, int slots) {
    const size_t N = (size_t)n, M = (size_t)m, L = (size_t)slots;
    size_t work = MK_NODE_WORK(N, M);
    if (work < MK_NODE_GATE_WORK(N, M)) work = MK_NODE_GATE_WORK(N, M);
    const size_t numbers = N + MK_PACKED(N) + L * (M + N) + work;
    /* Words before bytes, each type where it is aligned. */
    MK_F_T(node_head) *const head = mk_allocate(1, sizeof *head + numbers * sizeof(MK_REAL) + L * (sizeof(uint32_t) + 3));
    MK_F_T(mk_host_node) *const host = &head->host;
    MK_F_T(mk_node_view) *const view = &host->view;
    host->n = n;
    host->m = m;
    host->slots = slots;
    host->frame_most = MK_FRAME_SEALED + sizeof(MK_REAL) * MK_NODE_NUMBERS(N, M);
    host->blob_most = MK_NODE_BLOB(sizeof(MK_REAL), N, M, L);
    view->node = &head->node;
    view->filter.core = &head->core;
    view->filter.x = (MK_REAL *)(void *)(head + 1);
    view->filter.W = view->filter.x + N;
    view->filter.y = view->filter.W + MK_PACKED(N);
    view->filter.psi = view->filter.y + L * M;
    view->filter.work = view->filter.psi + L * N;
    view->heard = (uint32_t *)(void *)(view->filter.work + work);
    view->seen = (uint8_t *)(void *)(view->heard + L);
    view->filter.have_y = view->seen + L;
    view->filter.have_psi = view->filter.have_y + L;
    return host;
}

int MK_F(mk_host_node_equal)(const MK_F_T(mk_host_node) * a, const MK_F_T(mk_host_node) * b) {
    const size_t numbers = (size_t)(a->view.filter.work - a->view.filter.x), slots = (size_t)a->slots;
    const MK_F_T(mk_rkfd) *const one = a->view.filter.core, *const other = b->view.filter.core;
    return a->view.node->step == b->view.node->step && one->stage == other->stage && one->steady == other->steady &&
           one->tolerance == other->tolerance &&
           memcmp(a->view.filter.x, b->view.filter.x, numbers * sizeof(MK_REAL)) == 0 &&
           memcmp(a->view.heard, b->view.heard, slots * (sizeof(uint32_t) + 3)) == 0;
}

static const uint8_t *MK_F(take_numbers)(const uint8_t *from, size_t count, MK_REAL **next) {
    for (size_t i = 0; i < count; i++, from += sizeof(MK_REAL)) {
        const MK_UINT bits = (MK_UINT)mk_get_bytes(from, (int)sizeof bits);
        memcpy(*next + i, &bits, sizeof bits);
    }
    *next += count;
    return from;
}

static void MK_F(take_steady)(const uint8_t *from, size_t n, size_t m, size_t slots, MK_F_T(mk_rkfd_steady) * steady, MK_REAL *next) {
    MK_REAL *const Phi = next, *const G = Phi + n * n, *const W = G + slots * m * n, *const single = W + MK_PACKED(n);
    from = MK_F(take_numbers)(from, (size_t)(single - Phi) + 3, &next);
    steady->Phi = Phi;
    steady->G = G;
    steady->W = W;
    steady->theta = single[0];
    steady->trace_P = single[1];
    steady->close = single[2];
    steady->period = mk_get_u16(from);
}

MK_F_T(mk_node_config) * MK_F(mk_host_config)(const uint8_t *content, size_t length, mk_error_t *error) {
    mk_host_facts_t f;
    if (!mk_host_facts(content, length, length, &f, error)) return NULL;
    if (f.bits != MK_BITS) {
        (void)mk_fail(error, "numbers of %d bits, not %d", f.bits, MK_BITS);
        return NULL;
    }
    const size_t n = (size_t)f.n, m = (size_t)f.m, slots = (size_t)f.slots;
    const unsigned flags = content[13];
    const size_t numbers = (length - HEAD - SLOT * slots) / sizeof(MK_REAL);
    MK_F_T(config_head) *const head = mk_allocate(1, sizeof *head + numbers * sizeof(MK_REAL) + slots * (sizeof(uint16_t) + 2));
    MK_F_T(mk_node_config) *const config = &head->config;
    MK_F_T(mk_rkfd_config) *const filter = &config->filter;
    MK_REAL *next = (MK_REAL *)(void *)(head + 1);
    uint16_t *const nodes = (uint16_t *)(void *)(next + numbers);
    uint8_t *const rows = (uint8_t *)(void *)(nodes + slots), *const foreign = rows + slots;
    filter->n = (uint16_t)n;
    filter->m = (uint16_t)m;
    filter->slots = (uint16_t)slots;
    config->catch_up = mk_get_u16(content + 6);
    head->gate.patience = mk_get_u16(content + 8);
    config->numbers = content[11];
    config->with_model = content[12];
    config->model = f.model;
    const uint8_t *from = content + HEAD;
    for (size_t l = 0; l < slots; l++, from += SLOT) {
        nodes[l] = mk_get_u16(from);
        rows[l] = from[2];
        foreign[l] = from[3];
    }
    config->nodes = nodes;
    filter->rows = rows;
#define TAKE(member, count) (filter->member = next, from = MK_F(take_numbers)(from, count, &next))
    TAKE(A, n * n);
    TAKE(Q, MK_PACKED(n));
    if (flags & FLAG_INPUT) TAKE(input, n);
    TAKE(x0, n);
    TAKE(P0, MK_PACKED(n));
    TAKE(weight, slots);
    head->foreign.C = next;
    TAKE(C, slots * m * n);
    head->foreign.F = next;
    TAKE(F, slots * m * n);
    head->foreign.S = next;
    TAKE(S, slots * MK_PACKED(n));
    head->foreign.R_inverse = next;
    TAKE(R_inverse, slots * MK_PACKED(m));
#undef TAKE
    MK_REAL *single = &filter->tolerance;
    from = MK_F(take_numbers)(from, 1, &single);
    if (flags & FLAG_GATE) {
        head->gate.reading = next;
        from = MK_F(take_numbers)(from, slots, &next);
        single = &head->gate.estimate;
        from = MK_F(take_numbers)(from, 1, &single);
        config->gate = &head->gate;
    }
    if (flags & FLAG_FOREIGN) {
        head->foreign.slot = foreign;
        single = &head->foreign.limit;
        from = MK_F(take_numbers)(from, 1, &single);
        config->foreign = &head->foreign;
    }
    if (flags & FLAG_STEADY) {
        MK_F(take_steady)(from, n, m, slots, &head->steady, next);
        filter->steady = &head->steady;
    }
    return config;
}
