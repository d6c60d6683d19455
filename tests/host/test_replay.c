/* SPDX-License-Identifier: MIT */
/* Records of a node that lives through everything, replayed: equal, also from where a recorder began again and with another configuration. */
#include "replay.h"

static void equal_records(void **unused) {
    static const unsigned lives[] = {0, NO_INPUT, GATE, FOREIGN, SEALED, TROUBLE, GATE | TROUBLE, FOREIGN | TROUBLE, GATE | FOREIGN | SEALED | TROUBLE,
                                     STEADY, STEADY | GATE | TROUBLE};
    size_t kinds[MK_ITEM_KINDS] = {0};
    uint64_t frames[MK_STATUS_COUNT] = {0};
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32)
        for (size_t i = 0; i < sizeof lives / sizeof *lives; i++)
            for (uint32_t seed = 1; seed <= 10; seed++) {
                make(bits, lives[i], 60, seed);
                const mk_playback_t p = play(&record, record.used, NULL);
                if (p.differences || p.end != MK_END_WHOLE)
                    fail_msg("float%d, life %u, seed %u: item %zu, %s[%d]: %s", bits, lives[i], seed, p.first.item, p.first.what, p.first.element,
                             p.reason.text);
                assert_int_equal(p.total, list(&record, place, MOST));
                assert_int_equal(p.facts.bits, bits);
                assert_int_equal(p.facts.node, number[0]);
                assert_true(p.first_step >= START && p.last_step > p.first_step);
                for (int k = 0; k < MK_ITEM_KINDS; k++) kinds[k] += p.items[k];
                for (int k = 0; k < MK_STATUS_COUNT; k++) frames[k] += p.frames[k];
            }
    /* Nothing of what was to be shown was absent. */
    assert_true(frozen_steps > 100);
    for (int k = 1; k < MK_ITEM_KINDS; k++) assert_true(kinds[k] > 20);
    static const int seen[] = {MK_OK, MK_ERROR_NOT_FINITE, MK_ERROR_REPEATED, MK_ERROR_LENGTH, MK_ERROR_TYPE, MK_ERROR_LATE, MK_ERROR_AHEAD, MK_ERROR_IMPLAUSIBLE};
    for (size_t i = 0; i < sizeof seen / sizeof *seen; i++) assert_true(frames[seen[i]] > 0);
    assert_int_equal(frames[MK_ERROR_CHECKSUM] + frames[MK_ERROR_FORGED], 0);
}

/* A recorder that was too small and started again, and one that started again for nothing. */
static void states_within(void **unused) {
    size_t gaps = 0, seamless = 0;
    (void)unused;
    for (int bits = 32; bits <= 64; bits += 32)
        for (uint32_t seed = 1; seed <= 20; seed++) {
            mk_playback_t p;
            make(bits, TIGHT | (seed % 2 ? TROUBLE : STEADY), 120, seed);
            memset(&p, 0, sizeof p);
            mk_playback_run(&p, record.bytes, record.used, NULL);
            assert_int_equal(p.end, MK_END_WHOLE);
            assert_int_equal(p.differences, 0);
            assert_int_equal(p.begins, p.items[MK_ITEM_STATE]);
            assert_int_equal(p.begin[0].kind, MK_BEGIN_FIRST);
            for (size_t i = 1; i < p.begins; i++) {
                assert_true(p.begin[i].kind == MK_BEGIN_GAP || p.begin[i].kind == MK_BEGIN_SEAMLESS);
                if (p.begin[i].kind == MK_BEGIN_SEAMLESS) assert_int_equal(p.begin[i].step, p.begin[i].from);
                gaps += p.begin[i].kind == MK_BEGIN_GAP;
                seamless += p.begin[i].kind == MK_BEGIN_SEAMLESS;
            }
            mk_playback_free(&p);
        }
    assert_true(gaps > 10 && seamless > 10);
    /* The same step, but x[0], the tolerance or its stage is another. */
    static const size_t other[] = {20 + 8 * PACKED_N, 20 + 8 * (PACKED_N + N + SLOTS * (M + N)), 0};
    for (int i = 0; i < 3; i++) {
        mk_playback_t p;
        make(64, 0, 8, 1);
        (void)list(&record, place, MOST);
        changed.bytes[place[1].at + ITEM_HEAD + (other[i] ? other[i] : place[1].item.length - 4 - 3 * SLOTS - 2)] ^= other[i] ? 1 : 3;
        repair_state(&changed, &place[1]);
        append(&record, changed.bytes + place[1].at, place[1].size);
        memmove(record.bytes + place[2].at, record.bytes + record.used - place[1].size, place[1].size);
        memset(&p, 0, sizeof p);
        mk_playback_run(&p, record.bytes, place[2].at + place[1].size, NULL);
        assert_int_equal(p.end, MK_END_WHOLE);
        assert_int_equal(p.begins, 2);
        assert_int_equal(p.begin[1].kind, MK_BEGIN_GAP);
        assert_int_equal(p.begin[1].step, p.begin[1].from);
        mk_playback_free(&p);
    }
}

static void other_configuration(void **unused) {
    stream_t other = {NULL, 0, 0};
    mk_item_t configuration;
    int damaged;
    (void)unused;
    make(64, BARE, 12, 1);
    mk_playback_t p = play(&record, record.used, NULL);
    assert_int_equal(p.end, MK_END_UNREADABLE);
    assert_non_null(strstr(p.reason.text, "configuration"));
    append(&other, record.bytes, record.used);
    make(64, 0, 12, 1);
    (void)list(&record, place, MOST);
    const place_t *const own = &place[0];
    uint8_t *const content = changed.bytes + ITEM_HEAD;
    assert_true(mk_item_read(changed.bytes, changed.used, &configuration, &damaged) > 0);
    p = play(&other, other.used, &configuration);
    assert_int_equal(p.end, MK_END_WHOLE);
    assert_int_equal(p.differences, 0);
    assert_true(p.steps > 5);
    /* Another node, another model, a tolerance that the state overrules, another A. */
    put16(content + 18, 8);
    assert_non_null(strstr(play(&other, other.used, &configuration).reason.text, "of another node"));
    put16(content + 18, number[0]);
    content[14] ^= 1;
    assert_non_null(strstr(play(&other, other.used, &configuration).reason.text, "of another model"));
    content[14] ^= 1;
    content[18 + 4 * SLOTS + 6] ^= 16; /* A[0] */
    p = play(&other, other.used, &configuration);
    assert_int_equal(p.end, MK_END_WHOLE);
    assert_true(p.differences > 5);
    assert_string_equal(p.first.what, "psi");
    assert_int_equal(p.first.element, 0);
    content[13] |= 64; /* a part of a later version */
    repair(&changed, own);
    assert_non_null(strstr(play(&changed, changed.used, NULL).reason.text, "does not know"));
    /* Another precision. */
    make(32, 0, 12, 1);
    assert_true(mk_item_read(changed.bytes, changed.used, &configuration, &damaged) > 0);
    assert_non_null(strstr(play(&other, other.used, &configuration).reason.text, "precision"));
    /* In place of the record's own it counts, too: two nodes one after the other, then one with the other's. */
    append(&other, record.bytes, record.used);
    p = play(&other, other.used, &configuration);
    assert_int_equal(p.end, MK_END_UNREADABLE);
    assert_int_equal(p.end_item, 0);
    make(64, 0, 12, 2);
    other.used = 0;
    append(&other, record.bytes, record.used);
    make(32, GATE, 12, 2);
    append(&other, record.bytes, record.used);
    memset(&p, 0, sizeof p);
    mk_playback_run(&p, other.bytes, other.used, NULL);
    assert_int_equal(p.end, MK_END_WHOLE);
    assert_int_equal(p.differences, 0);
    assert_int_equal(p.begins, 2);
    assert_int_equal(p.begin[1].kind, MK_BEGIN_OTHER);
    mk_playback_free(&p);
    free(other.bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(equal_records), cmocka_unit_test(states_within), cmocka_unit_test(other_configuration)};
    return cmocka_run_group_tests_name("replay", tests, NULL, free_records);
}
