/* SPDX-License-Identifier: MIT */
/* Authenticated frames of a node object and the replay window, with ChaCha20-Poly1305 of libsodium. */
#define NODE_TESTS "node_sealed.tmpl.h"
#include "node_variants.h"

/* --- the window against a list of what was accepted --------------------------------------------------------------------------- */

enum { REMEMBERED = 4096 };

static void window(void **unused) {
    (void)unused;
    static const uint64_t starts[] = {0, 1, 1000, UINT64_MAX - 300, UINT64_MAX - 63};
    generator_t g = {5};
    int all = 0;
    for (int run = 0; run < 300; run++) {
        static uint64_t accepted[REMEMBERED];
        mk_replay_t found = {0, 0};
        uint64_t highest = 0, centre = starts[run % 5];
        int count = 0;
        for (int i = 0; i < 400; i++) {
            const int width = draw_chance(&g, 0.1) ? 200 : draw_chance(&g, 0.5) ? 3 : 66;
            const uint64_t shift = (uint64_t)draw_below(&g, width);
            uint64_t sequence = draw_chance(&g, 0.5) ? centre + shift : centre - shift;
            if (draw_chance(&g, 0.02)) sequence = draw_bits(&g);
            if (draw_chance(&g, 0.01)) sequence = UINT64_MAX - (uint64_t)draw_below(&g, 2);
            int is_new = count == 0 || sequence > highest || highest - sequence < 64;
            for (int k = 0; k < count; k++) is_new &= accepted[k] != sequence;
            const mk_replay_t before = found;
            assert_int_equal(mk_replay_new(&found, sequence) != 0, is_new);
            assert_memory_equal(&before, &found, sizeof found);
            if (!is_new || draw_chance(&g, 0.1)) continue; /* new, but its seal did not open: not marked */
            mk_replay_mark(&found, sequence);
            accepted[count++] = sequence;
            if (count == 1 || sequence > highest) highest = sequence;
            if (draw_chance(&g, 0.7)) centre = highest;
        }
        all += count;
    }
    assert_true(all > 10000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(window), EACH(bytes_on_the_air), EACH(altered), EACH(replayed), EACH(wrong_kind), EACH(nonces),
        EACH(recorded), EACH(last_sequence), EACH(secure_statuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
