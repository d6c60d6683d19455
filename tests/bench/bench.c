/* SPDX-License-Identifier: MIT */
/* Compares implementations of one filter step: first that they agree, then how long they take, side by side in one run.

   usage: bench [--json FILE] [--rounds N] [--only n]

   Every round runs one short batch of each implementation and of the yardstick loop, so that whatever slows the machine slows
   all; the medians over the rounds are printed. Exit status 1 if two implementations disagree or one fails, never for a time. */
#define _POSIX_C_SOURCE 200112L

#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define ENGINES 8    /* at most, for one case */
#define ROUNDS 1000  /* at most */
#define BATCH_NS 40e3
#define PEAK_COUNT 96000

typedef struct {
    const bench_engine *engine;
    int steps; /* in a batch */
    double times[ROUNDS], median, least;
} contender;

static contender contenders[ENGINES];
static double peaks[ROUNDS];

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count) {
    qsort(values, (size_t)count, sizeof *values, by_size);
    return values[count / 2];
}

static int select_engines(int n, int bits) {
    const bench_engine *(*const sources[])(int *) = {bench_meshkal, bench_eigen, bench_lapacke};
    int found = 0;
    for (int s = 0; s < 3; s++) {
        int count;
        const bench_engine *const list = sources[s](&count);
        for (int k = 0; k < count && found < ENGINES; k++)
            if (list[k].n == n && list[k].bits == bits) contenders[found++].engine = &list[k];
    }
    return found;
}

/* Runs all from the start and compares theta and x with the first after 1, 2, .. 64 steps. */
static int agree(const bench_case *c, int count) {
    const double limit = contenders[0].engine->bits == 32 ? 1e-3 : 1e-10;
    for (int k = 0; k < count; k++) {
        if (!contenders[k].engine->start(c)) return fprintf(stderr, "bench: %s does not start\n", contenders[k].engine->name), 0;
    }
    for (int t = 0; t < 7; t++) {
        double theta, x[BENCH_N];
        for (int k = 0; k < count; k++) {
            const bench_engine *const engine = contenders[k].engine;
            double other, z[BENCH_N], distance = 0.0, size = 1e-300;
            if (!engine->run(c, t == 0 ? 1 : 1 << (t - 1))) return fprintf(stderr, "bench: %s fails\n", engine->name), 0;
            engine->read(&other, z);
            if (k == 0) {
                theta = other;
                memcpy(x, z, sizeof x);
            }
            for (int i = 0; i < c->n; i++) {
                distance += fabs(z[i] - x[i]);
                size += fabs(x[i]);
            }
            if (!(fabs(other - theta) <= limit * theta && distance <= limit * size)) {
                fprintf(stderr, "bench: %s disagrees with %s: n = %d, f%d, %s, step %d: theta %.17g and %.17g, x by %.2g\n", engine->name,
                        contenders[0].engine->name, c->n, engine->bits, c->shape, 1 << t, other, theta, distance / size);
                return 0;
            }
        }
    }
    return 1;
}

/* Fills the medians; returns the median rate of the yardstick in operations a ns. */
static double measure(const bench_case *c, int count, int rounds) {
    const int bits = contenders[0].engine->bits;
    for (int k = 0; k < count; k++) {
        const double begin = now();
        contenders[k].engine->run(c, 200);
        const double ns = (now() - begin) / 200;
        contenders[k].steps = ns < BATCH_NS / 2 ? (int)(BATCH_NS / ns) : 2;
    }
    for (int r = 0; r < rounds; r++) {
        const double begin = now();
        const double done = bench_peak(bits, PEAK_COUNT);
        peaks[r] = done / (now() - begin);
        for (int k = 0; k < count; k++) {
            const double from = now();
            contenders[k].engine->run(c, contenders[k].steps);
            contenders[k].times[r] = (now() - from) / contenders[k].steps;
        }
    }
    for (int k = 0; k < count; k++) {
        contenders[k].median = median(contenders[k].times, rounds);
        contenders[k].least = contenders[k].times[0];
    }
    return median(peaks, rounds);
}

static void print_row(const bench_case *c, int count, double flops, double peak) {
    printf("%3d  f%d  %-5s  %4g", c->n, contenders[0].engine->bits, c->shape, c->d.tolerance[0]);
    for (int k = 0; k < count; k++) printf(" %8.0f", contenders[k].median);
    for (int k = 1; k < count; k++) printf(" %7.1f", contenders[k].median / contenders[0].median);
    printf(" %6.0f %6.1f %5.0f%%\n", flops, peak, 100.0 * flops / (contenders[0].median * peak));
}

static void json_row(FILE *json, int first, const bench_case *c, int count, double flops, double peak) {
    fprintf(json, "%s\n    {\"n\": %d, \"bits\": %d, \"shape\": \"%s\", \"tolerance\": %g, \"flops\": %.0f, \"peak_gflops\": %.3f, "
                  "\"fraction_of_peak\": %.4f, \"engines\": [",
            first ? "" : ",", c->n, contenders[0].engine->bits, c->shape, c->d.tolerance[0], flops, peak,
            flops / (contenders[0].median * peak));
    for (int k = 0; k < count; k++)
        fprintf(json, "%s\n      {\"name\": \"%s\", \"median_ns\": %.2f, \"least_ns\": %.2f, \"ratio\": %.3f}", k ? "," : "",
                contenders[k].engine->name, contenders[k].median, contenders[k].least, contenders[k].median / contenders[0].median);
    fprintf(json, "]}");
}

static int run_all(FILE *json, int rounds, int only) {
    static const int sizes[] = {4, 6, 9, 17};
    static const char *const shapes[] = {"dense", "block"};
    static bench_case c;
    int rows = 0;
    for (int bits = 64; bits >= 32; bits -= 32) {
        for (int s = 0; s < 4; s++) {
            if (only && sizes[s] != only) continue;
            for (int k = 0; k < 4; k++) {
                const double tolerance = k < 2 ? 0.02 : 0.0;
                const int count = select_engines(sizes[s], bits);
                if (!bench_make_case(&c, sizes[s], shapes[k % 2], tolerance) || !agree(&c, count)) return 0;
                if (rows == 0) {
                    printf("Times in ns a step (medians), times relative to Meshkal, operations of the step, scalar peak in GFLOP/s\n"
                           "and Meshkal's share of it. Columns:");
                    for (int e = 0; e < count; e++) printf(" %d %s%s", e + 1, contenders[e].engine->name, e < count - 1 ? "," : "\n\n");
                    printf("  n real  shape     c        1        2        3        4        5        6     2/1     3/1     4/1     5/1     6/1  flops   peak share\n");
                }
                const double peak = measure(&c, count, rounds);
                const double flops = bench_flops(sizes[s], tolerance > 0.0, bench_meshkal_evaluations(sizes[s], bits));
                print_row(&c, count, flops, peak);
                fflush(stdout);
                if (json) json_row(json, rows == 0, &c, count, flops, peak);
                rows++;
            }
        }
    }
    return 1;
}

int main(int argc, char **argv) {
    const char *file = NULL;
    int rounds = 200, only = 0;
    for (int k = 1; k < argc; k += 2) {
        if (k + 1 < argc && strcmp(argv[k], "--json") == 0) file = argv[k + 1];
        else if (k + 1 < argc && strcmp(argv[k], "--rounds") == 0) rounds = atoi(argv[k + 1]);
        else if (k + 1 < argc && strcmp(argv[k], "--only") == 0) only = atoi(argv[k + 1]);
        else return fprintf(stderr, "usage: bench [--json FILE] [--rounds N] [--only n]\n"), 2;
    }
    if (rounds < 1 || rounds > ROUNDS) return fprintf(stderr, "bench: --rounds is 1 to %d\n", ROUNDS), 2;
    FILE *const json = file ? fopen(file, "w") : NULL;
    if (file && !json) return perror(file), 2;
    if (json) fprintf(json, "{\"compiler\": \"%s\", \"rounds\": %d, \"cases\": [", __VERSION__, rounds);
    const int good = run_all(json, rounds, only);
    if (json) {
        fprintf(json, "]}\n");
        if (fclose(json) != 0) return perror(file), 2;
    }
    return good ? 0 : 1;
}
