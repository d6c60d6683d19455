/* SPDX-License-Identifier: MIT */
/* Records that were changed in every way, and what replay then says of them. */
#include "replay.h"

/* Where in the record what an input changes is to be seen first. */
static size_t consequence(size_t items, size_t from) {
    const place_t *p = &place[from];
    const int estimate = p->item.kind == MK_ITEM_FRAME && (p->item.content[1] & 3) == MK_STAGE_ESTIMATE;
    for (size_t i = from; i < items; i++)
        if (place[i].item.kind == (estimate ? MK_ITEM_DIFFUSE : MK_ITEM_INCREMENTAL)) return i;
    return items;
}

/* Every bit of status and content of a small record, CRC repaired. An output is named to the element; an input at its own item or where
   its step ends. */
static void every_bit(void **unused) {
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32) {
        const size_t size = (size_t)bits / 8;
        size_t inputs = 0, seen = 0;
        make(bits, 0, 8, 5);
        const size_t items = list(&record, place, MOST);
        for (size_t k = 0; k < items; k++) {
            const mk_item_t *item = &place[k].item;
            for (size_t bit = 8; bit < 8 * (ITEM_HEAD + item->length); bit++) {
                if (bit == 16) bit = 8 * ITEM_HEAD; /* not its length */
                uint8_t *const byte = changed.bytes + place[k].at + bit / 8;
                *byte ^= (uint8_t)(1u << bit % 8);
                repair(&changed, &place[k]);
                const mk_playback_t p = play(&changed, changed.used, NULL);
                *byte ^= (uint8_t)(1u << bit % 8);
                repair(&changed, &place[k]);
                const size_t at = bit / 8 < ITEM_HEAD ? 0 : bit / 8 - ITEM_HEAD;
                const int is_status = bit < 16, input = item->kind == MK_ITEM_MEASURE || item->kind == MK_ITEM_FRAME || item->kind == MK_ITEM_DROP;
                if (item->kind == MK_ITEM_CONFIGURATION || (item->kind == MK_ITEM_STATE && is_status)) continue; /* no status; it may stand for much */
                if (item->kind == MK_ITEM_STATE) { /* its own CRC */
                    assert_int_equal(p.end, MK_END_UNREADABLE);
                    assert_int_equal(p.end_item, k);
                    continue;
                }
                if (item->kind == MK_ITEM_INCREMENTAL && is_status && item->length > N * size) { /* too long for a failure */
                    assert_int_equal(p.end, MK_END_UNREADABLE);
                    continue;
                }
                assert_int_equal(p.end, MK_END_WHOLE);
                if (item->kind == MK_ITEM_FRAME && at < MK_FRAME_HEADER) { /* refused now */
                    assert_int_equal(p.first.item, k);
                    assert_string_equal(p.first.what, "status");
                    continue;
                }
                if (input && !is_status) {
                    inputs++;
                    if (!p.differences) continue;
                    seen++;
                    if (p.first.item == k) assert_string_equal(p.first.what, "status");
                    else assert_int_equal(p.first.item, consequence(items, k));
                    continue;
                }
                const size_t x = item->kind == MK_ITEM_DIFFUSE ? 4 : item->length - N * size;
                if (item->kind == MK_ITEM_INCREMENTAL && at < x && !is_status) continue; /* the input given */
                assert_true(p.differences >= 1);
                assert_int_equal(p.first.item, k);
                assert_int_equal(p.first.offset, place[k].at);
                assert_int_equal(p.first.kind, item->kind);
                assert_string_equal(p.first.what, is_status ? "status" : at < x ? "step" : item->kind == MK_ITEM_DIFFUSE ? "x" : "psi");
                assert_int_equal(p.first.element, is_status || at < x ? -1 : (int)((at - x) / size));
                if (is_status || at < x) continue;
                assert_int_equal(p.first.recorded ^ p.first.replayed, (uint64_t)1 << (8 * ((at - x) % size) + bit % 8));
                /* Below the exponent a bit is worth itself in units of the last place. */
                if (8 * ((at - x) % size) + bit % 8 < (bits == 32 ? 23 : 52)) assert_int_equal(mk_difference_ulp(&p.first), p.first.recorded ^ p.first.replayed);
            }
        }
        assert_true(seen > inputs / 2);
    }
}

static void every_cut(void **unused) {
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32) {
        make(bits, TROUBLE, 12, 3);
        const size_t items = list(&record, place, MOST);
        size_t whole = 0; /* items before the cut */
        for (size_t cut = 0; cut <= record.used; cut++) {
            while (whole < items && place[whole].at + place[whole].size <= cut) whole++;
            const size_t end = whole ? place[whole - 1].at + place[whole - 1].size : 0;
            const mk_playback_t p = play(&record, cut, NULL);
            assert_int_equal(p.total, whole);
            assert_int_equal(p.end_offset, end);
            assert_int_equal(p.differences, 0);
            assert_int_equal(p.end, whole < 2 ? MK_END_UNREADABLE : cut == end ? MK_END_WHOLE : MK_END_CUT);
        }
    }
}

/* Bits of CRC and length: the item is unreadable, those before it count. Only at the end can a length look like a cut. */
static void damaged_items(void **unused) {
    (void)unused;
    make(64, 0, 8, 4);
    const size_t items = list(&record, place, MOST);
    for (size_t k = 0; k < items; k++)
        for (size_t bit = 0; bit < 8 * place[k].size; bit++) {
            changed.bytes[place[k].at + bit / 8] ^= (uint8_t)(1u << bit % 8);
            const mk_playback_t p = play(&changed, changed.used, NULL);
            changed.bytes[place[k].at + bit / 8] ^= (uint8_t)(1u << bit % 8);
            const int is_length = bit >= 16 && bit < 48;
            if (!(is_length && record.used - place[k].at < MK_FRAME_HEADER + 8 * 64)) assert_int_equal(p.end, MK_END_UNREADABLE);
            assert_true(p.end != MK_END_WHOLE);
            assert_int_equal(p.end_item, k);
            assert_int_equal(p.end_offset, place[k].at);
            assert_int_equal(p.differences, 0);
        }
}

static void hostile_sizes(void **unused) {
    static const unsigned sizes[] = {0, 1, 2, 4, 5, 1023, 1024, 1025, 32767, 32768, 46341, 65535};
    enum { SIZES = sizeof sizes / sizeof *sizes };
    (void)unused;
    make(64, 0, 8, 4);
    (void)list(&record, place, MOST);
    for (int i = 0; i < SIZES * SIZES * SIZES; i++) {
        uint8_t *const content = changed.bytes + ITEM_HEAD;
        put16(content, sizes[i % SIZES]);
        put16(content + 2, sizes[i / SIZES % SIZES]);
        put16(content + 4, sizes[i / SIZES / SIZES]);
        repair(&changed, &place[0]);
        const mk_playback_t p = play(&changed, changed.used, NULL);
        assert_int_equal(p.end, MK_END_UNREADABLE);
        assert_int_equal(p.end_item, 0);
    }
    /* The same item cut, so that its length cannot be compared with what is there. */
    const mk_playback_t p = play(&changed, 40, NULL);
    assert_int_equal(p.end, MK_END_UNREADABLE);
}

/* Some bytes of some items anew, CRC repaired; also that of a state, which it has inside. */
static void mutations(void **unused) {
    static const uint8_t liked[] = {0, 1, 2, 127, 128, 255};
    int unreadable = 0, different = 0;
    (void)unused;
    for (int round = 0; round < 6000; round++) {
        if (round % 100 == 0) {
            static const unsigned lives[] = {0, GATE | STEADY | TROUBLE, FOREIGN | TROUBLE};
            make(round / 100 % 2 ? 32 : 64, lives[round / 200 % 3], 10, (uint32_t)round + 1);
        }
        const size_t items = list(&record, place, MOST);
        memcpy(changed.bytes, record.bytes, record.used);
        mk_random_start(&source, (uint64_t)round, 1, 2, 3, 4);
        for (int i = draw(3); i >= 0; i--) {
            const size_t k = draw(3) ? (size_t)draw((int)items) : (size_t)draw(2);
            uint8_t *const b = changed.bytes + place[k].at;
            for (int j = draw(4); j >= 0 && place[k].item.length; j--) {
                const int at = draw(12) == 0 ? draw(2) : ITEM_HEAD + draw((int)place[k].item.length);
                b[at] = draw(2) ? liked[draw((int)sizeof liked)] : (uint8_t)draw(256);
            }
            if (place[k].item.kind == MK_ITEM_STATE) repair_state(&changed, &place[k]);
            else repair(&changed, &place[k]);
        }
        const mk_playback_t p = play(&changed, draw(10) ? changed.used : (size_t)draw((int)changed.used), NULL);
        unreadable += p.end == MK_END_UNREADABLE;
        different += p.differences > 0;
    }
    assert_true(unreadable > 500 && different > 500);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_bit), cmocka_unit_test(every_cut), cmocka_unit_test(damaged_items),
                                       cmocka_unit_test(hostile_sizes), cmocka_unit_test(mutations)};
    return cmocka_run_group_tests_name("replay of changed records", tests, NULL, free_records);
}
