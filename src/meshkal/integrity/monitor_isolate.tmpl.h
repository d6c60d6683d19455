/* SPDX-License-Identifier: MIT */
/* Which sensor: meshkal/monitor.h, MK_MONITOR_EXCLUDE. */

/* The rows `out` of I and v are estimated freely: what is left in the rows `rest` is what these know when the offset of the others may be anything
   (Schur complement). `order` takes the rows in the order in which they went; returns its length, `done` before. */
static int MK_F(mk_monitor_eliminate)(uint32_t out, uint32_t rest, MK_REAL *I, MK_REAL *v, int done, uint8_t *order) {
    for (int k = 0; k < MK_MONITOR_ROWS; k++) {
        if (!(out >> k & 1u)) continue;
        out &= ~(UINT32_C(1) << k);
        order[done++] = (uint8_t)k;
        const uint32_t left = I[MK_AT(k, k)] > MK_R(0.0) ? out | rest : 0;
        for (int i = 0; i < MK_MONITOR_ROWS; i++) {
            if (!(left >> i & 1u)) continue;
            const MK_REAL f = I[MK_PLACE(i, k)] / I[MK_AT(k, k)];
            v[i] -= f * v[k];
            for (int j = 0; j <= i; j++)
                if (left >> j & 1u) I[MK_AT(i, j)] -= f * I[MK_PLACE(j, k)];
        }
    }
    return done;
}

/* b: offsets of the rows that were eliminated, together, where the others have none. */
static void MK_F(mk_monitor_offsets)(int count, const uint8_t *order, const MK_REAL *I, const MK_REAL *v, MK_REAL *b) {
    for (int i = count - 1; i >= 0; i--) {
        const int k = order[i];
        MK_REAL sum = v[k];
        for (int j = i + 1; j < count; j++) sum -= I[MK_PLACE(k, order[j])] * b[order[j]];
        b[k] = I[MK_AT(k, k)] > MK_R(0.0) ? sum / I[MK_AT(k, k)] : MK_R(0.0);
    }
}

/* The places, as bits, of at most `most` sensors that explain the alarm, and the offsets b of their rows; 0: there are none, or another would do as
   well as the last of them; with `force`, of the first suspect, or of them all the same. *sure: whether it is without force; b stays where nobody is
   suspected. I and v: the sums, spoilt; rows: what they hold; q: the statistic. work: a packed matrix and a vector. */
static uint32_t MK_F(mk_monitor_isolate)(const MK_F_T(mk_monitor_config) * config, int most, int force, uint32_t rows, MK_REAL q, MK_REAL *I,
                                         MK_REAL *v, MK_REAL *b, MK_REAL *work, int *sure) {
    const int m = config->m;
    uint32_t suspects = 0, first = 0;
    uint8_t order[MK_MONITOR_ROWS];
    int gone = 0, gone_first = 0;
    *sure = 0;
    for (int step = 0; step < most && rows; step++) {
        int suspect = -1;
        MK_REAL least = MK_R(0.0), w = MK_R(0.0), next = -MK_LARGEST;
        for (int p = 0; p < config->places; p++) {
            const uint32_t own = rows & mk_rows_of(m, p, m);
            if (!own) continue;
            const int left = mk_rows_count(rows & ~own);
            MK_REAL taken;
            (void)MK_F(mk_monitor_statistic)(own, I, v, 0, 0, work, &taken);
            const MK_REAL ratio = left ? (q - taken) / config->threshold[left - 1] : MK_R(0.0);
            const int better = suspect < 0 || ratio < least;
            const MK_REAL loser = better ? w : taken; /* of the best so far and this one */
            if (suspect >= 0 && loser > next) next = loser;
            if (!better) continue;
            suspect = p;
            least = ratio;
            w = taken;
        }
        const uint32_t own = rows & mk_rows_of(m, suspect, m);
        rows &= ~own;
        suspects |= UINT32_C(1) << suspect;
        gone = MK_F(mk_monitor_eliminate)(own, rows, I, v, gone, order);
        if (step == 0) {
            first = suspects;
            gone_first = gone;
        }
        const int left = MK_F(mk_monitor_statistic)(rows, I, v, 0, 0, work, &q);
        if (left && q >= config->threshold[left - 1]) continue;
        *sure = w - next >= config->separation;
        if (!*sure && !force) return 0;
        MK_F(mk_monitor_offsets)(gone, order, I, v, b);
        return suspects;
    }
    if (!force) return 0;
    MK_F(mk_monitor_offsets)(gone_first, order, I, v, b);
    return first;
}
