/* SPDX-License-Identifier: MIT */
/* Once for each precision and number of rows: REAL, NAME(name), KIND, ROWS, EIGEN, LIMIT (of the relative difference). */

MONITOR(NAME(watcher), KIND, 1, ROWS, BENCH_WINDOW);

static int NAME(run)(int rounds) {
    static NAME(watcher_t) monitor;
    static REAL S[EPOCHS][MK_PACKED(ROWS)], r[EPOCHS][ROWS], threshold[ROWS];
    static double ours[ROUNDS], theirs[ROUNDS];
    NAME(watcher_config_t) config;
    uint16_t id[ROWS];
    uint8_t one[ROWS];
    REAL q_R, q_A;
    double apart = 0.0;
    memset(&config, 0, sizeof config);
    for (int i = 0; i < ROWS; i++) {
        threshold[i] = (REAL)1e6;
        id[i] = (uint16_t)i;
        one[i] = 1;
    }
    for (int t = 0; t < EPOCHS; t++) {
        double L[MK_PACKED(ROWS)];
        for (int i = 0; i < ROWS; i++) {
            double sum = 0.0;
            for (int j = 0; j <= i; j++) L[MK_PACKED(i) + j] = i == j ? 1.25 + 0.25 * draw() : 0.25 * draw();
            for (int k = 0; k <= i; k++) sum += L[MK_PACKED(i) + k] * 1.7 * draw();
            r[t][i] = (REAL)sum;
            for (int j = 0; j <= i; j++) {
                sum = 0.0;
                for (int k = 0; k <= j; k++) sum += L[MK_PACKED(i) + k] * L[MK_PACKED(j) + k];
                S[t][MK_PACKED(i) + j] = (REAL)sum;
            }
        }
    }
    config.m = 1;
    config.places = ROWS;
    config.window = BENCH_WINDOW;
    config.threshold = threshold;
    config.scheme = MK_MONITOR_AIME;
    if (NAME(watcher_start)(&monitor, &config) != MK_OK) return 0;
    for (int t = 0; t < EPOCHS; t++) {
        if (NAME(watcher_watch)(&monitor, ROWS, id, one, r[t], S[t]) != MK_OK || !EIGEN(ROWS, r[t], S[t], &q_R, &q_A))
            return fprintf(stderr, "monitor: fails at epoch %d\n", t), 0;
        apart = fmax(apart, fmax(fabs((double)(monitor.core.rctm / q_R) - 1.0), fabs((double)(monitor.core.aime / q_A) - 1.0)));
    }
    if (!(apart <= LIMIT)) return fprintf(stderr, "monitor: %d rows: the statistics differ by %.2g of them\n", ROWS, apart), 0;
    for (int k = 0; k < rounds; k++) {
        double begin = now();
        for (int t = 0; t < EPOCHS; t++) (void)NAME(watcher_watch)(&monitor, ROWS, id, one, r[t], S[t]);
        ours[k] = (now() - begin) / EPOCHS;
        begin = now();
        for (int t = 0; t < EPOCHS; t++) (void)EIGEN(ROWS, r[t], S[t], &q_R, &q_A);
        theirs[k] = (now() - begin) / EPOCHS;
    }
    qsort(ours, (size_t)rounds, sizeof *ours, by_size);
    qsort(theirs, (size_t)rounds, sizeof *theirs, by_size);
    printf("| %d, %d | float%d | %.0f | %.0f | %.2f | %.1e |\n", ROWS, BENCH_WINDOW, (int)sizeof(REAL) * 8, ours[rounds / 2], theirs[rounds / 2],
           theirs[rounds / 2] / ours[rounds / 2], apart);
    return 1;
}
