/* SPDX-License-Identifier: MIT */

typedef struct {
    MK_F_T(mk_node_config) * config;
    MK_F_T(mk_host_node) * node, *next; /* next: room for a state, to be compared with the node's */
    MK_REAL *input;                     /* numbers of an item: at most those of x0 and P0 */
    int has_state;
} MK_F_T(playing);

static void MK_F(player_close)(void *player) {
    MK_F_T(playing) *const g = player;
    free(g->config);
    free(g->node);
    free(g->next);
    free(g->input);
    free(g);
}

static void *MK_F(player_open)(const uint8_t *content, size_t length, mk_error_t *error) {
    MK_F_T(mk_node_config) *const config = MK_F(mk_host_config)(content, length, error);
    if (!config) return NULL;
    MK_F_T(playing) *const g = mk_allocate(1, sizeof *g);
    const int n = config->filter.n, m = config->filter.m, slots = config->filter.slots;
    const size_t most = (size_t)(n + MK_PACKED(n)), rows = (size_t)config->filter.rows[0];
    g->config = config;
    g->node = MK_F(mk_host_node_open)(n, m, slots);
    g->next = MK_F(mk_host_node_open)(n, m, slots);
    g->input = mk_allocate(most > rows ? most : rows, sizeof *g->input);
    return g;
}

static uint32_t MK_F(player_step)(const void *player) { return ((const MK_F_T(playing) *)player)->node->view.node->step; }

static int MK_F(player_restore)(void *player, const mk_item_t *item, mk_error_t *error) {
    MK_F_T(playing) *const g = player;
    MK_F_T(mk_host_node) *const h = g->next;
    const mk_status_t status = MK_F(mk_node_restore)(h->n, h->m, h->slots, &h->view, g->config, item->content, item->length);
    if (status != MK_OK) {
        (void)mk_fail(error, "the state does not go with the configuration: %s%s", mk_status_name(status),
                      status == MK_ERROR_STRANGER ? " (of another node)"
                      : status == MK_ERROR_MODEL  ? " (of another model)"
                      : status == MK_ERROR_SHAPE  ? " (other dimensions or precision)"
                                                  : "");
        return -1;
    }
    const int seamless = g->has_state && MK_F(mk_host_node_equal)(g->node, g->next);
    g->next = g->node;
    g->node = h;
    g->has_state = 1;
    return seamless ? MK_BEGIN_SEAMLESS : MK_BEGIN_GAP;
}

static void MK_F(player_lengths)(const void *player, const mk_item_t *item, size_t *least, size_t *most) {
    const MK_F_T(playing) *const g = player;
    const size_t n = (size_t)g->node->n, size = sizeof(MK_REAL);
    *least = *most = 0;
    switch (item->kind) {
    case MK_ITEM_STATE: *most = 2 * g->node->blob_most; break; /* one of the other precision is told by its head */
    case MK_ITEM_MEASURE: *least = *most = size * g->config->filter.rows[0]; break;
    case MK_ITEM_FRAME:
        /* Which frames have another length than what they bring, the node said when it refused them. */
        *least = MK_FRAME_HEADER;
        *most = *least + (item->status == MK_ERROR_LENGTH || item->status == MK_ERROR_TYPE ? UINT16_MAX : 8 * MK_NODE_NUMBERS(n, (size_t)g->node->m));
        break;
    case MK_ITEM_INCREMENTAL: *least = item->status == MK_OK ? size * n : 0, *most = *least + size * n; break;
    case MK_ITEM_DIFFUSE: *least = *most = 4 + size * n; break;
    case MK_ITEM_ADVANCE: *least = *most = 8 + size * n; break;
    case MK_ITEM_TOLERANCE: *least = *most = size; break;
    case MK_ITEM_DROP: *least = *most = 2; break;
    case MK_ITEM_RESTART: *least = *most = size * (n + MK_PACKED(n)); break;
    default: break;
    }
}

static void MK_F(get_numbers)(const uint8_t *from, size_t count, MK_REAL *to) {
    for (size_t i = 0; i < count; i++) {
        const MK_UINT bits = (MK_UINT)mk_get_bytes(from + i * sizeof bits, (int)sizeof bits);
        memcpy(to + i, &bits, sizeof bits);
    }
}

static int MK_F(numbers_differ)(mk_difference_t *d, const char *what, int count, const uint8_t *recorded, const MK_REAL *replayed) {
    for (int i = 0; i < count; i++) {
        MK_UINT bits;
        memcpy(&bits, replayed + i, sizeof bits);
        if (differs(d, what, i, MK_BITS, mk_get_bytes(recorded + (size_t)i * sizeof bits, (int)sizeof bits), bits)) return 1;
    }
    return 0;
}

/* psi of a step that went well, behind the input if there was one. */
static int MK_F(play_incremental)(const MK_F_T(playing) * g, const mk_item_t *item, mk_difference_t *d) {
    const MK_F_T(mk_host_node) *const h = g->node;
    const size_t row = (size_t)h->n * sizeof(MK_REAL), psi = item->status == MK_OK ? row : 0;
    const int with_input = item->length > psi;
    if (with_input) MK_F(get_numbers)(item->content, (size_t)h->n, g->input);
    const mk_status_t status = MK_F(mk_node_incremental)(h->n, h->m, h->slots, &h->view, with_input ? g->input : NULL);
    return differs(d, "status", -1, 0, item->status, (uint64_t)status) ||
           (psi && MK_F(numbers_differ)(d, "psi", h->n, item->content + item->length - psi, h->view.filter.psi));
}

static int MK_F(player_play)(void *player, const mk_item_t *item, mk_difference_t *d) {
    const MK_F_T(playing) *const g = player;
    const MK_F_T(mk_host_node) *const h = g->node;
    const MK_F_T(mk_node_view) *const view = &h->view;
    const uint8_t *const content = item->content;
    mk_status_t status = MK_OK;
    size_t words = 0; /* bytes before x; the last four of them are the step */
    switch (item->kind) {
    case MK_ITEM_MEASURE:
        MK_F(get_numbers)(content, g->config->filter.rows[0], g->input);
        status = MK_F(mk_node_measure)(h->m, view, g->input);
        break;
    case MK_ITEM_FRAME: status = MK_F(mk_node_accept_recorded)(h->n, h->m, h->slots, view, content, item->length); break;
    case MK_ITEM_INCREMENTAL: return MK_F(play_incremental)(g, item, d);
    case MK_ITEM_DIFFUSE:
        status = MK_F(mk_node_diffuse)(h->n, h->m, h->slots, view);
        words = 4;
        break;
    case MK_ITEM_ADVANCE:
        status = MK_F(mk_node_advance)(h->n, h->m, h->slots, view, mk_get_u32(content));
        words = 8;
        break;
    case MK_ITEM_TOLERANCE:
        MK_F(get_numbers)(content, 1, g->input);
        status = MK_F(mk_node_set_tolerance)(view, g->input[0]);
        break;
    case MK_ITEM_DROP: status = MK_F(mk_node_drop)(view, mk_get_u16(content)); break;
    default:
        MK_F(get_numbers)(content, (size_t)(h->n + MK_PACKED(h->n)), g->input);
        status = MK_F(mk_node_restart)(h->n, h->slots, view, g->input, g->input + h->n);
        break;
    }
    return differs(d, "status", -1, 0, item->status, (uint64_t)status) ||
           (words && (differs(d, "step", -1, 0, mk_get_u32(content + words - 4), view->node->step) ||
                      MK_F(numbers_differ)(d, "x", h->n, content + words, view->filter.x)));
}

static const mk_player_t MK_F(player) = {MK_F(player_open), MK_F(player_close),   MK_F(player_restore),
                                         MK_F(player_step), MK_F(player_lengths), MK_F(player_play)};
