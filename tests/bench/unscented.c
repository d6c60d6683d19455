/* SPDX-License-Identifier: MIT */
/* Unscented and extended filters side by side: first that they agree, then ns a step, relative to Meshkal's, medians of rounds in which all take turns.

   usage: unscented FOLDER [--rounds N]

   Writes FOLDER/unscented-native.json (times) and, for the programs of other languages (unscented.py, rust), FOLDER/unscented-SCENE.txt: numbers
   between spaces, n, bearings, dt, variance, positions, x0, P0, Q, readings; then for each step x and P of Meshkal's filters JULIER, SCALED and EXTENDED,
   packed. Exit status 1 if two implementations disagree or one fails, never for a time. */
#define _POSIX_C_SOURCE 200112L

#include "unscented.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define CONTENDERS 8 /* at most, of one scene */
#define ROUNDS 1000  /* at most */
#define BATCH_NS 60e3

static const char *const filters[FILTERS] = {"UKF", "UKF scaled", "EKF", "MPUKF, N = 5", "MPUKF, N = 30", "IUKF"};

/* --- scenes ------------------------------------------------------------------------------------------------------------------- */

static uint64_t state = 1;

/* Normal, as the sum of twelve uniform numbers; a fixed sequence on every machine. */
static double draw(void) {
    double sum = -6.0;
    for (int k = 0; k < 12; k++) {
        state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
        sum += (double)(state >> 11) * 0x1p-53;
    }
    return sum;
}

/* Sensors, noises and P0 of spec 2.5, on two or three axes. */
static scene_t make(const char *name, int n, int bearings) {
    static const double place[SCENE_ROWS][3] = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}};
    scene_t scene;
    double x[SCENE_N], q = 1e-5;
    memset(&scene, 0, sizeof scene);
    memcpy(scene.position, place, sizeof place);
    scene.name = name;
    scene.n = n;
    scene.bearings = bearings;
    scene.dt = 1.0;
    scene.variance = bearings ? 1e-4 : 2e-3;
    for (int i = 0; i < n; i += 2) {
        scene.x0[i] = 3.0;
        scene.x0[i + 1] = 0.05;
        scene.P0[SCENE_PACKED(i) + i] = 0.1;
        scene.P0[SCENE_PACKED(i + 1) + i + 1] = 1e-3;
        scene.Q[SCENE_PACKED(i) + i] = q / 3.0;
        scene.Q[SCENE_PACKED(i + 1) + i] = q / 2.0;
        scene.Q[SCENE_PACKED(i + 1) + i + 1] = q;
    }
    for (int i = 0; i < n; i++) x[i] = scene.x0[i] + sqrt(scene.P0[SCENE_PACKED(i) + i]) * draw();
    for (int t = 0; t < SCENE_STEPS; t++) {
        for (int i = 0; i < n; i += 2) {
            const double kick = sqrt(q) * draw();
            x[i] += x[i + 1] + 0.5 * kick;
            x[i + 1] += kick;
        }
        for (int r = 0; r < SCENE_ROWS; r++) {
            const double *const p = scene.position[r], z = n > 4 ? x[4] - p[2] : 0.0;
            const double exact = bearings ? atan2(x[2] - p[1], x[0] - p[0])
                                          : sqrt((x[0] - p[0]) * (x[0] - p[0]) + (x[2] - p[1]) * (x[2] - p[1]) + z * z);
            scene.z[t][r] = exact + sqrt(scene.variance) * draw();
        }
    }
    return scene;
}

/* --- agreement ---------------------------------------------------------------------------------------------------------------- */

typedef struct {
    const contender_t *who;
    int steps; /* in a batch */
    double times[ROUNDS], median;
} entry_t;

static entry_t entries[CONTENDERS];

static int enter(const scene_t *scene, int filter, int bits) {
    int found = 0, count;
    for (int from = 0; from < 2; from++) {
        const contender_t *const all = from == 0 ? scene_meshkal(&count) : scene_eigen(&count);
        for (int k = 0; k < count; k++)
            if (all[k].n == scene->n && all[k].bits == bits && all[k].start(scene, filter)) entries[found++].who = all + k;
    }
    return found;
}

/* Largest difference, relative to standard deviations (x) and to what they give (P). */
static double difference(int n, const double *x, const double *P, const double *y, const double *S) {
    double most = 0.0;
    for (int i = 0; i < n; i++) {
        const double sigma = sqrt(P[SCENE_PACKED(i) + i]);
        most = fmax(most, fabs(x[i] - y[i]) / sigma);
        for (int j = 0; j <= i; j++) most = fmax(most, fabs(P[SCENE_PACKED(i) + j] - S[SCENE_PACKED(i) + j]) / (sigma * sqrt(P[SCENE_PACKED(j) + j])));
        if (!(most <= 1e300)) return HUGE_VAL;
    }
    return most;
}

/* All against the first over SCENE_STEPS steps; float32 against its own precision. */
static int agree(const scene_t *scene, int filter, int bits, int count, double *most) {
    const double limit = bits == 32 ? 0.05 : 1e-9;
    *most = 0.0;
    for (int t = 0; t < SCENE_STEPS; t++) {
        double x[SCENE_N], P[SCENE_PACKED(SCENE_N)], y[SCENE_N], S[SCENE_PACKED(SCENE_N)];
        for (int k = 0; k < count; k++) {
            if (!entries[k].who->run(1)) return fprintf(stderr, "unscented: %s, %s, %s: fails at step %d\n", scene->name, filters[filter], entries[k].who->name, t), 0;
            entries[k].who->read(k == 0 ? x : y, k == 0 ? P : S);
            const double apart = k == 0 ? 0.0 : difference(scene->n, x, P, y, S);
            *most = fmax(*most, apart);
            if (!(apart <= limit)) {
                return fprintf(stderr, "unscented: %s, %s, float%d: %s differs from %s by %.2g standard deviations at step %d\n", scene->name,
                               filters[filter], bits, entries[k].who->name, entries[0].who->name, apart, t), 0;
            }
        }
    }
    return 1;
}

/* --- time --------------------------------------------------------------------------------------------------------------------- */

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void measure(int count, int rounds) {
    for (int k = 0; k < count; k++) {
        const double begin = now();
        entries[k].who->run(2 * SCENE_STEPS);
        const double ns = (now() - begin) / (2 * SCENE_STEPS);
        entries[k].steps = ns < BATCH_NS / SCENE_STEPS ? SCENE_STEPS * (int)(BATCH_NS / ns / SCENE_STEPS) : SCENE_STEPS;
    }
    for (int r = 0; r < rounds; r++)
        for (int k = 0; k < count; k++) {
            const double begin = now();
            entries[k].who->run(entries[k].steps);
            entries[k].times[r] = (now() - begin) / entries[k].steps;
        }
    for (int k = 0; k < count; k++) {
        qsort(entries[k].times, (size_t)rounds, sizeof entries[k].times[0], by_size);
        entries[k].median = entries[k].times[rounds / 2];
    }
}

static int run_all(const scene_t *scenes, int count, FILE *json, int rounds) {
    printf("A step (prediction, three readings, update) of unscented and extended filters in ns, medians, and relative to Meshkal's first;\n"
           "largest difference between them over %d steps, in standard deviations.\n\n| scene, states | filter | real |", SCENE_STEPS);
    int rows = 0;
    for (int s = 0; s < count; s++)
        for (int filter = 0; filter < FILTERS; filter++)
            for (int bits = 64; bits >= 32; bits -= 32) {
                double apart;
                const int found = enter(scenes + s, filter, bits);
                if (!agree(scenes + s, filter, bits, found, &apart)) return 0;
                measure(found, rounds);
                if (rows == 0) {
                    for (int k = 0; k < found; k++) printf(" %s | ratio |", entries[k].who->name);
                    printf(" difference |\n|---|---|---|");
                    for (int k = 0; k < found; k++) printf("---|---|");
                    printf("---|\n");
                }
                printf("| %s, %d | %s | float%d |", scenes[s].name, scenes[s].n, filters[filter], bits);
                for (int k = 0; k < 5; k++) {
                    if (k < found) printf(" %.0f | %.2f |", entries[k].median, entries[k].median / entries[0].median);
                    else printf(" | |");
                }
                printf(" %.1e |\n", apart);
                fflush(stdout);
                fprintf(json, "%s\n {\"scene\": \"%s\", \"n\": %d, \"filter\": \"%s\", \"bits\": %d, \"difference\": %.3e, \"ns\": {", rows++ ? "," : "", scenes[s].name,
                        scenes[s].n, filters[filter], bits, apart);
                for (int k = 0; k < found; k++) fprintf(json, "%s\"%s\": %.2f", k ? ", " : "", entries[k].who->name, entries[k].median);
                fprintf(json, "}}");
            }
    return 1;
}

/* --- for the other programs --------------------------------------------------------------------------------------------------- */

static void numbers(FILE *out, const double *values, int count) {
    for (int k = 0; k < count; k++) fprintf(out, "%.17g%c", values[k], k == count - 1 ? '\n' : ' ');
}

static int hand_over(const scene_t *scene, const char *folder) {
    char path[4096];
    snprintf(path, sizeof path, "%s/unscented-%s.txt", folder, scene->name);
    FILE *const out = fopen(path, "w");
    if (!out) return perror(path), 0;
    const double head[] = {scene->n, scene->bearings, scene->dt, scene->variance};
    numbers(out, head, 4);
    numbers(out, scene->position[0], 3 * SCENE_ROWS);
    numbers(out, scene->x0, scene->n);
    numbers(out, scene->P0, SCENE_PACKED(scene->n));
    numbers(out, scene->Q, SCENE_PACKED(scene->n));
    numbers(out, scene->z[0], SCENE_STEPS * SCENE_ROWS);
    for (int filter = FILTER_JULIER; filter <= FILTER_EXTENDED; filter++) {
        (void)enter(scene, filter, 64);
        for (int t = 0; t < SCENE_STEPS; t++) {
            double x[SCENE_N], P[SCENE_PACKED(SCENE_N)];
            if (!entries[0].who->run(1)) return fclose(out), 0;
            entries[0].who->read(x, P);
            numbers(out, x, scene->n);
            numbers(out, P, SCENE_PACKED(scene->n));
        }
    }
    return fclose(out) == 0 ? 1 : (perror(path), 0);
}

int main(int argc, char **argv) {
    const int rounds = argc == 4 && strcmp(argv[2], "--rounds") == 0 ? atoi(argv[3]) : 100;
    if ((argc != 2 && argc != 4) || rounds < 1 || rounds > ROUNDS) return fprintf(stderr, "usage: unscented FOLDER [--rounds 1..%d]\n", ROUNDS), 2;
    const scene_t scenes[] = {make("ranges", 4, 0), make("bearings", 4, 1), make("space", 6, 0)};
    char path[4096];
    snprintf(path, sizeof path, "%s/unscented-native.json", argv[1]);
    FILE *const json = fopen(path, "w");
    if (!json) return perror(path), 2;
    fprintf(json, "[");
    int good = run_all(scenes, 3, json, rounds);
    fprintf(json, "]\n");
    if (fclose(json) != 0) return perror(path), 2;
    for (int s = 0; s < 3; s++) good = good && hand_over(scenes + s, argv[1]);
    return good ? 0 : 1;
}
