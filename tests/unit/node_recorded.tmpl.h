/* SPDX-License-Identifier: MIT */
/* Records: the second half of node_saved.tmpl.h. */

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

static uint8_t V(memory)[1 << 20];

/* What was recorded from the middle of a run gives the same node again. */
static void V(recorded)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    generator_t g = {23};
    for (int configuration = 0; configuration < 2; configuration++) {
        mk_recorder_t recorder = {V(memory), sizeof V(memory), 77, 5, (uint8_t)configuration};
        mk_item_t item;
        int damaged;
        V(full_bench)(&a, 0);
        V(full_bench)(&b, 0);
        assert_int_equal(UNIT(start)(&a.node, &a.config), MK_OK);
        for (int i = 0; i < 333; i++) V(happen)(&a, NULL, &g);
        assert_int_equal(UNIT(record)(&a.node, &recorder), MK_OK);
        assert_int_equal(recorder.lost, 0);
        for (int i = 0; i < 2000; i++) V(happen)(&a, NULL, &g);
        assert_int_equal(recorder.lost, 0);
        assert_true(V(replay)(&b, recorder.bytes, recorder.used) > 1500);
        for (int l = 0; l < SLOTS; l++) b.node.seen[l] = a.node.seen[l], b.node.heard[l] = a.node.heard[l];
        /* Frames refused before their step was looked at are not recorded, so counters of those differ. */
        memcpy(b.node.node.counts, a.node.node.counts, sizeof a.node.node.counts);
        V(same_state)(&a, &b);
        const size_t size = mk_item_read(recorder.bytes, recorder.used, &item, &damaged);
        assert_int_equal(item.kind, configuration ? MK_ITEM_CONFIGURATION : MK_ITEM_STATE);
        if (configuration) {
            /* By the layout of the header: 18 + 4 slots bytes, then numbers. */
            const uint8_t *const numbers = item.content + 18 + 4 * SLOTS;
            assert_int_equal(item.length, 18 + 4 * SLOTS + sizeof(REAL) * (9 + 6 + 3 + 3 + 6 + 4 + 24 + 24 + 24 + 12 + 1 + 5 + 1));
            assert_int_equal(item.content[0] | item.content[2] << 8 | item.content[4] << 16 | item.content[6] << 24, 3 | 2 << 8 | 4 << 16 | 5 << 24);
            assert_int_equal(item.content[8], 2);
            assert_int_equal(item.content[10], BITS);
            assert_int_equal(item.content[13], 7);
            for (int l = 0; l < SLOTS; l++) {
                const uint8_t slot[4] = {(uint8_t)(10 + l), 0, b.rows[l], b.is_foreign[l]};
                assert_memory_equal(item.content + 18 + 4 * l, slot, 4);
            }
            assert_memory_equal(numbers, a.A, sizeof a.A);
            assert_memory_equal(numbers + sizeof(REAL) * (9 + 6 + 3), a.x0, sizeof a.x0);
            assert_memory_equal(numbers + sizeof(REAL) * 31, a.C, sizeof(REAL) * M * N);
            assert_true(V(number_at)(numbers, 120) == (REAL)200.0 && V(number_at)(numbers, 121) == (REAL)1000.0);
        }
        /* Every flipped bit of an item is seen, every cut is one. */
        for (size_t bit = 0; bit < 8 * size; bit++) {
            recorder.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
            assert_int_equal(mk_item_read(recorder.bytes, size, &item, &damaged), 0);
            recorder.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        }
        for (size_t cut = 0; cut < size; cut++) {
            assert_int_equal(mk_item_read(recorder.bytes, cut, &item, &damaged), 0);
            assert_int_equal(damaged, 0);
        }
    }
}

/* Taken out piece by piece it is the same record. */
static void V(stream)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    static uint8_t small[4096], all[1 << 20];
    generator_t g = {24}, h = {24};
    size_t length = 0;
    mk_recorder_t whole = {V(memory), sizeof V(memory), 0, 0, 1}, part = {small, sizeof small, 0, 0, 1};
    V(full_bench)(&a, 0);
    V(full_bench)(&b, 0);
    assert_int_equal(UNIT(start)(&a.node, &a.config), MK_OK);
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    assert_int_equal(UNIT(record)(&a.node, &whole), MK_OK);
    assert_int_equal(UNIT(record)(&b.node, &part), MK_OK);
    for (int i = 0; i < 1000; i++) {
        V(happen)(&a, NULL, &g);
        V(happen)(&b, NULL, &h);
        if (i % 3) continue;
        assert_true(length + part.used <= sizeof all);
        memcpy(all + length, small, part.used);
        length += part.used;
        part.used = 0;
    }
    assert_int_equal(part.lost + whole.lost, 0);
    assert_int_equal(length, whole.used);
    assert_memory_equal(all, whole.bytes, length);
    assert_int_equal(UNIT(record)(&a.node, NULL), MK_OK);
    const size_t used = whole.used;
    for (int i = 0; i < 50; i++) V(happen)(&a, NULL, &g);
    assert_int_equal(whole.used, used);
}

static uint32_t V(items)(const mk_recorder_t *recorder) {
    uint32_t count = 0;
    for (size_t at = 0; at < recorder->used; count++) {
        mk_item_t item;
        int damaged;
        const size_t size = mk_item_read(recorder->bytes + at, recorder->used - at, &item, &damaged);
        assert_true(size > 0);
        at += size;
    }
    return count;
}

/* Full: closed, and all later items are counted; what is before can be read. Not a byte is written beyond. */
static void V(full)(void **unused) {
    (void)unused;
    static V(bench_t) a, b, beside;
    for (size_t capacity = 0; capacity < 3000; capacity += 37) {
        generator_t g = {25};
        uint8_t *const bytes = malloc(capacity + 1);
        assert_non_null(bytes);
        bytes[capacity] = 0x77;
        mk_recorder_t recorder = {bytes, capacity, 0, 0, 0}, large = {V(memory), sizeof V(memory), 0, 0, 0};
        V(full_bench)(&a, 0);
        V(full_bench)(&b, 0);
        V(full_bench)(&beside, 0);
        assert_int_equal(UNIT(start)(&a.node, &a.config), MK_OK);
        assert_int_equal(UNIT(start)(&beside.node, &beside.config), MK_OK);
        assert_int_equal(UNIT(record)(&beside.node, &large), MK_OK);
        const mk_status_t status = UNIT(record)(&a.node, &recorder);
        if (status != MK_OK) {
            assert_int_equal(status, MK_ERROR_LENGTH);
            assert_null(a.node.node.recorder);
            assert_true(capacity < UNIT(blob_max) + 10);
        } else {
            for (int i = 0; i < 200; i++) V(happen)(&a, &beside, &g);
            assert_true(recorder.lost > 0);
            assert_int_equal(V(items)(&recorder) + recorder.lost, V(items)(&large));
            assert_true(V(replay)(&b, bytes, recorder.used) >= 1);
            /* Room again does not open it; a new start does. */
            recorder.used = 0;
            const uint32_t lost = recorder.lost;
            for (int i = 0; i < 20; i++) V(happen)(&a, &beside, &g);
            assert_true(recorder.lost > lost && recorder.used == 0);
            assert_int_equal(UNIT(record)(&a.node, &recorder), MK_OK);
            assert_true(recorder.lost == 0 && V(items)(&recorder) == 1);
        }
        assert_int_equal(bytes[capacity], 0x77);
        free(bytes);
    }
}
