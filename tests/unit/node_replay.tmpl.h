/* SPDX-License-Identifier: MIT */
/* Records, run again. */

static REAL V(number_at)(const uint8_t *bytes, int i) {
    REAL value;
    memcpy(&value, bytes + (size_t)i * sizeof value, sizeof value);
    return value;
}

/* Runs a record again in `b`, whose configuration it must have been made with, and compares what every item says. Returns the items. */
static int V(replay)(V(bench_t) * b, const uint8_t *bytes, size_t length) {
    int items = 0;
    for (size_t at = 0, size; at < length; at += size, items++) {
        mk_item_t item;
        int damaged = 7;
        size = mk_item_read(bytes + at, length - at, &item, &damaged);
        assert_true(size == item.length + 10 && damaged == 0);
        REAL values[N + 6];
        uint32_t word[2] = {0, 0};
        for (int i = 0; i < N + 6 && (size_t)(i + 1) * sizeof(REAL) <= item.length; i++) values[i] = V(number_at)(item.content, i);
        mk_status_t status = MK_OK;
        const int wide = (int)(item.length / sizeof(REAL));
        switch (item.kind) {
        case MK_ITEM_STATE: status = UNIT(restore)(&b->node, &b->config, item.content, item.length); break;
        case MK_ITEM_MEASURE: status = UNIT(measure)(&b->node, values); break;
        case MK_ITEM_FRAME: {
            REAL work[MK_NODE_WORK(N, M)];
            const MK_T(mk_node_view) view = UNIT(node_view)(&b->node, work);
            status = MK(mk_node_accept_recorded)(N, M, SLOTS, &view, item.content, item.length);
            break;
        }
        case MK_ITEM_INCREMENTAL:
            status = item.status == MK_OK && wide == 2 * N ? UNIT(incremental_with)(&b->node, values) : UNIT(incremental)(&b->node);
            if (status == MK_OK) assert_memory_equal(item.content + item.length - sizeof(REAL) * N, b->node.filter.psi, sizeof(REAL) * N);
            break;
        case MK_ITEM_DIFFUSE:
        case MK_ITEM_ADVANCE:
            memcpy(word, item.content, item.kind == MK_ITEM_ADVANCE ? 8 : 4);
            status = item.kind == MK_ITEM_ADVANCE ? UNIT(advance)(&b->node, word[0]) : UNIT(diffuse)(&b->node);
            assert_int_equal(word[item.kind == MK_ITEM_ADVANCE], b->node.node.step);
            assert_memory_equal(item.content + item.length - sizeof(REAL) * N, b->node.filter.x, sizeof(REAL) * N);
            break;
        case MK_ITEM_TOLERANCE: status = UNIT(set_tolerance)(&b->node, values[0]); break;
        case MK_ITEM_DROP: status = UNIT(drop)(&b->node, item.content[0] | item.content[1] << 8); break;
        case MK_ITEM_RESTART: status = UNIT(restart)(&b->node, values, values + N); break;
        default: assert_int_equal(item.kind, MK_ITEM_CONFIGURATION);
        }
        assert_int_equal(item.status, status);
    }
    return items;
}
