/* SPDX-License-Identifier: MIT */
/* The parts of port/host that are used by themselves: random numbers, places in JSON, CSV, files. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "csv.h"
#include "file.h"
#include "json_place.h"
#include "random.h"

/* --- random numbers ----------------------------------------------------------------------------------------------------- */

/* Known answers that the generator's authors publish (Random123, kat_vectors: philox 4x32, 10 rounds). */
static void philox_known_answers(void **unused) {
    static const uint32_t known[3][10] = {
        /* counter, key, answer */
        {0, 0, 0, 0, 0, 0, 0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8},
        {0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff, 0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd},
        {0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344, 0xa4093822, 0x299f31d0, 0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}};
    (void)unused;
    for (int i = 0; i < 3; i++) {
        uint32_t block[4];
        mk_philox(known[i], known[i] + 4, block);
        assert_memory_equal(block, known[i] + 6, sizeof block);
    }
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* sqrt(N) times the Kolmogorov-Smirnov distance of N numbers, which are sorted, from a distribution. */
static double distance(double *x, int count, double (*distribution)(double)) {
    double most = 0.0;
    qsort(x, (size_t)count, sizeof *x, compare);
    for (int i = 0; i < count; i++) {
        const double p = distribution(x[i]);
        most = fmax(most, fmax(p - (double)i / count, (i + 1.0) / count - p));
    }
    return sqrt(count) * most;
}

static double normal_distribution(double x) { return 0.5 * erfc(-x / sqrt(2.0)); }
static double uniform_distribution(double x) { return fmin(fmax(x, 0.0), 1.0); }

#define DRAWS 200000
#define NORMAL_999 3.2905     /* two-sided 99.9 % of a normal */
#define KOLMOGOROV_999 1.9495 /* 99.9 % of sqrt(N) D */

/* The seed is fixed, so a test that passes always passes; a generator off by more than the bounds fails. */
static void check_normal(double *x) {
    double mean = 0.0, square = 0.0, fourth = 0.0, serial = 0.0;
    for (int i = 0; i < DRAWS; i++) mean += x[i] / DRAWS;
    for (int i = 0; i < DRAWS; i++) {
        const double d = x[i] - mean;
        square += d * d / DRAWS;
        fourth += d * d * d * d / DRAWS;
        if (i > 0) serial += x[i] * x[i - 1] / DRAWS;
    }
    assert_true(fabs(mean) < NORMAL_999 / sqrt(DRAWS));
    assert_true(fabs(square - 1.0) < NORMAL_999 * sqrt(2.0 / DRAWS));
    assert_true(fabs(fourth / (square * square) - 3.0) < NORMAL_999 * sqrt(24.0 / DRAWS));
    assert_true(fabs(serial) < NORMAL_999 / sqrt(DRAWS));
    assert_true(distance(x, DRAWS, normal_distribution) < KOLMOGOROV_999);
}

/* One long stream, and many short ones as the simulator uses them: two numbers of each (owner, step). */
static void draws_are_normal(void **unused) {
    double *x = malloc(DRAWS * sizeof *x);
    mk_random_t random;
    (void)unused;
    mk_random_start(&random, 5, 0, 0, 0, MK_DRAW_PROCESS);
    for (int i = 0; i < DRAWS; i++) x[i] = mk_random_normal(&random);
    check_normal(x);
    for (uint32_t i = 0; i < DRAWS; i += 2) {
        mk_random_start(&random, 5, 3, i / 2 % 20, i / 40, MK_DRAW_MEASUREMENT);
        x[i] = mk_random_normal(&random);
        x[i + 1] = mk_random_normal(&random);
    }
    check_normal(x);
    free(x);
}

static void draws_are_uniform(void **unused) {
    double *x = malloc(DRAWS * sizeof *x);
    int ones[53] = {0};
    mk_random_t random;
    (void)unused;
    mk_random_start(&random, 8, 0, 0, 0, MK_DRAW_LOSS);
    for (int i = 0; i < DRAWS; i++) {
        x[i] = mk_random_uniform(&random);
        assert_true(x[i] >= 0.0 && x[i] < 1.0);
        const double scaled = ldexp(x[i], 53);
        assert_true(scaled == floor(scaled));
        for (int bit = 0; bit < 53; bit++) ones[bit] += (int)((uint64_t)scaled >> bit & 1u);
    }
    /* All 53 bits are random. 4.3: 99.9 % that none of them goes beyond. */
    for (int bit = 0; bit < 53; bit++) assert_true(abs(2 * ones[bit] - DRAWS) < 4.3 * sqrt(DRAWS));
    assert_true(distance(x, DRAWS, uniform_distribution) < KOLMOGOROV_999);
    free(x);
}

/* What a stream gives depends on its name only; another name is another stream. */
static void streams_are_independent(void **unused) {
    mk_random_t a, b, one;
    double alone[9];
    (void)unused;
    mk_random_start(&one, UINT64_C(1) << 40, 1, 2, 3, MK_DRAW_PROCESS);
    for (int i = 0; i < 9; i++) alone[i] = mk_random_normal(&one);
    mk_random_start(&b, 99, 0, 0, 0, MK_DRAW_INITIAL);
    (void)mk_random_normal(&b);
    mk_random_start(&a, UINT64_C(1) << 40, 1, 2, 3, MK_DRAW_PROCESS);
    for (int i = 0; i < 9; i++) {
        assert_true(mk_random_normal(&a) == alone[i]);
        (void)mk_random_normal(&b);
    }
    static const struct {
        uint64_t seed;
        uint32_t run, owner, step;
        int purpose;
    } name[] = {{7, 1, 2, 3, MK_DRAW_INITIAL},     {8, 1, 2, 3, MK_DRAW_INITIAL}, {7 + (UINT64_C(1) << 32), 1, 2, 3, MK_DRAW_INITIAL},
                {7, 0, 2, 3, MK_DRAW_INITIAL},     {7, 1, 1, 3, MK_DRAW_INITIAL}, {7, 1, 2, 2, MK_DRAW_INITIAL},
                {7, 1, 2, 3, MK_DRAW_PROCESS},     {7, 1, 2, 3, MK_DRAW_LOSS},    {7, 1, 2, 3, MK_DRAW_NETWORK},
                {7, 1, 2, 3, MK_DRAW_MEASUREMENT}, {7, 2, 1, 3, MK_DRAW_INITIAL}, {7, 1, 3, 2, MK_DRAW_INITIAL}};
    /* No number of one is a number of another, be it later: streams do not overlap. */
    enum { STREAMS = sizeof name / sizeof name[0], LENGTH = 1000 };
    double *x = malloc(STREAMS * LENGTH * sizeof *x);
    for (int i = 0; i < STREAMS * LENGTH; i++) {
        const int k = i / LENGTH;
        if (i % LENGTH == 0) mk_random_start(&a, name[k].seed, name[k].run, name[k].owner, name[k].step, name[k].purpose);
        x[i] = mk_random_uniform(&a);
    }
    qsort(x, STREAMS * LENGTH, sizeof *x, compare);
    for (int i = 1; i < STREAMS * LENGTH; i++) assert_true(x[i] != x[i - 1]);
    free(x);
}

/* --- places in JSON ----------------------------------------------------------------------------------------------------- */

static void lines_of_json(void **unused) {
    static const char text[] = "\n{ \"a\": 1,\n\"nodes\"\n:[ {\"R\": [\n[1],\n[ {\"x\": \"]},\\\"\"}, 2\n]]},\n{},3],\n\"b\":{\"a\":\n\"\\\\\",\"c\":null}\n,\"nodes2\":[]}";
    static const struct {
        const char *path;
        int line;
    } known[] = {{"", 2},           {"a", 2},          {"nodes", 3},       {"nodes[0]", 4}, {"nodes[0].R", 4}, {"nodes[0].R[0]", 5}, {"nodes[0].R[0][0]", 5},
                 {"nodes[0].R[1]", 6}, {"nodes[0].R[1][0].x", 6}, {"nodes[0].R[1][1]", 6}, {"nodes[1]", 8}, {"nodes[2]", 8}, {"b", 9}, {"b.a", 9},
                 {"b.c", 10},       {"nodes2", 11},
                 /* what is not there: the deepest part that is */
                 {"missing", 2},    {"nodes[7]", 3},   {"nodes[0].Q", 4},  {"nodes[2].R", 8}, {"b.a.c", 9}};
    (void)unused;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (mk_json_line(text, known[i].path) != known[i].line) fail_msg("%s: line %d", known[i].path, mk_json_line(text, known[i].path));
}

/* --- files -------------------------------------------------------------------------------------------------------------- */

static char folder[64];

static const char *in_folder(const char *name) {
    static char path[128];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static void write_text(const char *path, const char *text) {
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

static void csv(void **unused) {
    static const char *const names[] = {"t", "value"};
    static const struct {
        const char *text, *message; /* message null: 2 rows */
    } known[] = {{"t,value\n0,1.5\n2,-3e2\n", NULL},
                 {"\"t\", \"value\"\r\n0, 1.5\r\n\r\n2 ,-3e2", NULL},
                 {"", ": empty"},
                 {"t;value\n", ":1: the header must be t,value, not t;value: columns are separated by commas, and decimals have a point"},
                 {"value,t\n0,1\n", ":1: the header must be t,value, not value,t"},
                 {"t,value,unit\n", ":1: the header must be t,value, not t,value,unit"},
                 {"# of noon\n\nt;value\n", ":3: the header must be t,value, not t;value: columns are separated by commas, and decimals have a point"},
                 {"# of noon\n", ": empty"},
                 {"t,value\n0,1\n\n1\n", ":4: column t: expected a number and a comma"},
                 {"t,value\n0,\n", ":2: column value: expected a number and the end of the line"},
                 {"t,value\n0,1,2\n", ":2: column value: expected a number and the end of the line"},
                 {"t,value\n,1\n", ":2: column t: expected a number and a comma"},
                 {"t,value\n0,1\n1,warm\n", ":3: column value: expected a number and the end of the line"},
                 {"t,value\n0,1 2\n", ":2: column value: expected a number and the end of the line"},
                 {"t,value\n0,nan\n", ":2: column value is not finite"},
                 {"t,value\n0,1e999\n", ":2: column value is not finite"},
                 {"t,value\n-inf,0\n", ":2: column t is not finite"}};
    char wanted[200];
    const char *path = in_folder("data.csv");
    (void)unused;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        mk_csv_t read;
        mk_error_t error = {""};
        write_text(path, known[i].text);
        const int good = mk_csv_read(&read, path, 2, names, &error);
        (void)snprintf(wanted, sizeof wanted, "%s%s", known[i].message ? path : "", known[i].message ? known[i].message : "");
        assert_string_equal(error.text, wanted);
        assert_int_equal(good, known[i].message == NULL);
        if (!good) continue;
        assert_int_equal(read.rows, 2);
        assert_true(read.value[0] == 0.0 && read.value[1] == 1.5 && read.value[2] == 2.0 && read.value[3] == -300.0);
        assert_int_equal(read.line[0], 2);
        assert_int_equal(read.line[1], 3 + (int)(i == 1));
        mk_csv_free(&read);
    }
    (void)remove(path);
}

/* A file is there whole or not at all, and one that was there stays until the new one is whole. */
static void output_is_whole(void **unused) {
    mk_output_t output;
    mk_error_t error = {""};
    char path[128], partial[140];
    size_t length;
    (void)unused;
    (void)snprintf(path, sizeof path, "%s", in_folder("out"));
    (void)snprintf(partial, sizeof partial, "%s.partial", path);
    for (int keep = 0; keep <= 1; keep++) {
        write_text(path, "old");
        assert_int_equal(mk_open_output(&output, path, &error), 1);
        assert_true(fputs("new", output.stream) >= 0);
        char *text = mk_read_file(path, &length, &error);
        assert_string_equal(text, "old");
        free(text);
        assert_int_equal(mk_close_output(&output, keep, &error), 1);
        text = mk_read_file(path, &length, &error);
        assert_string_equal(text, keep ? "new" : "old");
        assert_int_equal(length, 3);
        free(text);
        assert_int_not_equal(access(partial, F_OK), 0);
    }
    (void)remove(path);
    assert_int_equal(mk_open_output(&output, in_folder("none/out"), &error), 0);
    assert_non_null(strstr(error.text, "none/out: No such file or directory"));
    assert_null(mk_read_file(in_folder("none"), &length, &error));
    assert_null(mk_read_file(folder, &length, &error));
    assert_non_null(strstr(error.text, ": Is a directory"));
}

static int make_folder(void **unused) {
    (void)unused;
    (void)strcpy(folder, "/tmp/meshkal-test-host-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **unused) {
    (void)unused;
    return rmdir(folder); /* fails if a test left something */
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(philox_known_answers), cmocka_unit_test(draws_are_normal),
                                       cmocka_unit_test(draws_are_uniform),    cmocka_unit_test(streams_are_independent),
                                       cmocka_unit_test(lines_of_json),        cmocka_unit_test(csv),
                                       cmocka_unit_test(output_is_whole)};
    return cmocka_run_group_tests_name("test_host", tests, make_folder, remove_folder);
}
