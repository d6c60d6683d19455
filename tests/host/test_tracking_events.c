/* SPDX-License-Identifier: MIT */
/* Recorded events of tracking scenarios, and models bound to what the filters take. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "tracking/events.h"

static char folder[] = "/tmp/meshkal-events-XXXXXX";

static const char *place(const char *name) {
    static char path[8][96];
    static int next;
    char *const to = path[next++ % 8];
    (void)snprintf(to, sizeof path[0], "%s/%s", folder, name);
    return to;
}

static const char *put(const char *name, const char *text) {
    const char *path = place(name);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, strlen(text), file), strlen(text));
    assert_int_equal(fclose(file), 0);
    return path;
}

#define NODES                                                                                                                 \
    "\"nodes\": [{\"sensor\": \"range\", \"position_m\": [0, 0], \"R\": [[2]]},"                                               \
    "{\"sensor\": \"range-bearing\", \"position_m\": [1, 2], \"R\": [[3, 0.5], [0.5, 0.25]]}, {\"sensor\": \"none\"},"            \
    "{\"sensor\": \"tdoa\", \"position_m\": [5, 5], \"reference_m\": [-5, 5], \"R\": [[0.1]]}], \"edges\": [[0, 1], [1, 2]]"
#define MODEL(more)                                                                                                           \
    "\"model\": {\"motion\": \"constant-velocity\", \"states\": [\"px\", \"py\", \"vx\", \"vy\"], \"acceleration_psd\": 0.5, "   \
    "\"x0\": [1, 2, 3, 4], \"P0\": [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 3, 0], [0, 0, 0, 4]]" more "}, "
static const char plain[] = "{" MODEL("") NODES "}";

typedef struct {
    mk_scenario_t s;
    mk_models_f64_t *models;
} scene_t;

static void open_scene(scene_t *scene, const char *text) {
    mk_error_t error = {""};
    if (!mk_scenario_load_any(&scene->s, put("s.json", text), &error)) fail_msg("%s", error.text);
    scene->models = mk_models_open_f64(&scene->s, NULL, &error);
    if (!scene->models) fail_msg("%s", error.text);
}

static void close_scene(scene_t *scene) {
    mk_models_close_f64(scene->models);
    mk_scenario_free(&scene->s);
}

static mk_events_t *record(const scene_t *scene, const char *y, const char *x, long steps) {
    mk_error_t error = {""};
    mk_events_t *events = mk_events_record(scene->models, put("y.csv", y), x ? put("x.csv", x) : NULL, steps, &error);
    if (!events) fail_msg("%s", error.text);
    return events;
}

/* --- recorded -------------------------------------------------------------------------------------------------------------- */

#define HEAD "t,node,row,value\n"
#define STATE "t,state,value\n"

/* Node 1's log behind node 0's, rows in any order, one reading without its second row. */
static const char asynchronous[] = HEAD "0.5,0,0,10\n0.5000001,0,0,11\n2.25,0,0,12\n-1,1,1,0.25\n-1,1,0,20\n0.5,1,0,21\n0.5,1,1,0.5\n1.75,1,0,22\n2.25,3,0,-3\n";

static void instants_of_a_recording(void **state) {
    (void)state;
    static const struct {
        double t, dt;
        int count, node[2];
        double z[2][2];
    } wanted[] = {{-1, 0, 1, {1, 0}, {{20, 0.25}, {0, 0}}},
                  {0.5, 1.5, 2, {0, 1}, {{10, 0}, {21, 0.5}}},
                  {0.5000001, 0.5000001 - 0.5, 1, {0, 0}, {{11, 0}, {0, 0}}},
                  {2.25, 2.25 - 0.5000001, 2, {0, 3}, {{12, 0}, {-3, 0}}}};
    scene_t scene;
    mk_instant_t instant;
    mk_error_t error;
    mk_run_events_t stream;
    open_scene(&scene, plain);
    mk_events_t *events = record(&scene, asynchronous, NULL, 0);
    const mk_events_facts_t facts = mk_events_facts(events);
    assert_int_equal(facts.steps, 4);
    assert_int_equal(facts.readings, 6);
    assert_int_equal(facts.dropped, 1);
    assert_false(facts.drawn);
    assert_false(facts.has_truth);
    assert_true(facts.start_s == -1.0);
    assert_int_equal(strlen(facts.sha256), 64);
    mk_run_events_open(&stream, events);
    for (int round = 0; round < 2; round++) { /* a run can be started again */
        mk_run_events_start(&stream, 0);
        assert_memory_equal(stream.estimate, scene.s.x0, 4 * sizeof(double));
        assert_null(stream.truth);
        for (int i = 0; i < 4; i++) {
            assert_int_equal(mk_run_events_next(&stream, &instant, &error), 1);
            assert_true(instant.t == wanted[i].t && instant.dt == wanted[i].dt);
            assert_int_equal(instant.count, wanted[i].count);
            for (int j = 0; j < instant.count; j++) {
                const int node = instant.reading[j].node;
                assert_int_equal(node, wanted[i].node[j]);
                assert_int_equal(instant.reading[j].faulty, 0);
                for (int r = 0; r < scene.s.sensor[node].rows; r++) assert_true(instant.reading[j].z[r] == wanted[i].z[j][r]);
            }
            for (int j = 0; j < 4; j++) assert_true(isnan(instant.x[j]));
        }
        assert_int_equal(mk_run_events_next(&stream, &instant, &error), 0);
        assert_int_equal(mk_run_events_next(&stream, &instant, &error), 0);
    }
    mk_run_events_close(&stream);
    mk_events_free(events);
    close_scene(&scene);
}

/* The hash is of what is said, not of how. */
static void order_does_not_matter(void **state) {
    (void)state;
    scene_t scene;
    open_scene(&scene, plain);
    mk_events_t *one = record(&scene, asynchronous, NULL, 0);
    mk_events_t *other = record(&scene,
                                HEAD "2.25,3,0,-3\n 2.250 ,0,0,1.2e1\n0.5,1,1,0.5\n-1.0,1,0,20\n0.5,1,0,21\n\n5e-1,0,0,10\n0.5000001,0,0,11\n-1,1,1,0.25\n",
                                NULL, 0);
    assert_int_equal(mk_events_facts(other).dropped, 0);
    assert_string_equal(mk_events_facts(one).sha256, mk_events_facts(other).sha256);
    mk_events_free(other);
    other = record(&scene, HEAD "2.25,3,0,-3\n2.25,0,0,12\n0.5,1,1,0.5\n-1,1,0,20\n0.5,1,0,21\n0.5,0,0,10\n0.5000001,0,0,11\n-1,1,1,0.2500001\n", NULL, 0);
    assert_string_not_equal(mk_events_facts(one).sha256, mk_events_facts(other).sha256);
    mk_events_free(other);
    /* The first two instants only. */
    other = record(&scene, asynchronous, NULL, 2);
    assert_int_equal(mk_events_facts(other).steps, 2);
    assert_int_equal(mk_events_facts(other).readings, 3);
    mk_events_free(other);
    mk_events_free(one);
    close_scene(&scene);
}

static void start_of_a_recording(void **state) {
    (void)state;
    scene_t scene;
    mk_error_t error;
    mk_run_events_t stream;
    mk_instant_t instant;
    open_scene(&scene, "{" MODEL(", \"start_s\": -1.5") NODES "}");
    mk_events_t *events = record(&scene, asynchronous, NULL, 0);
    mk_run_events_open(&stream, events);
    assert_int_equal(mk_run_events_next(&stream, &instant, &error), 1);
    assert_true(instant.t == -1.0 && instant.dt == 0.5);
    mk_run_events_close(&stream);
    mk_events_free(events);
    assert_null(mk_events_record(scene.models, put("y.csv", HEAD "3,0,0,1\n-1.75,0,0,1\n"), NULL, 0, &error));
    assert_non_null(strstr(error.text, "y.csv:3: t is -1.75: before model.start_s, -1.5"));
    close_scene(&scene);
}

#define NONE ((double)NAN)
static void nearest_truth(void **state) {
    (void)state;
    /* Intervals 1, 1, 1, 4, 1: the median 1, so half of it counts. State 2 is not known at 1; the instant at 5 is too far from 3 and 7. */
    static const char x[] = STATE "1,0,101\n0,2,200\n0,0,100\n2,0,102\n2,2,202\n3,0,103\n3,2,203\n7,0,107\n8,0,108\n8,2,208\n";
    static const char y[] = HEAD "-0.5,0,0,1\n-0.51,0,0,1\n0.25,0,0,1\n0.5,0,0,1\n0.75,0,0,1\n1,0,0,1\n2.49,0,0,1\n3.5,0,0,1\n3.6,0,0,1\n5,0,0,1\n7.4,0,0,1\n"
                                 "8.5,0,0,1\n9,0,0,1\n";
    static const double wanted[][2] = {{NONE, NONE}, {100, 200}, {100, 200}, {100, 200}, {101, NONE}, {101, NONE}, {102, 202},
                                       {103, 203}, {NONE, NONE}, {NONE, NONE}, {107, NONE}, {108, 208}, {NONE, NONE}};
    scene_t scene;
    mk_error_t error;
    mk_run_events_t stream;
    mk_instant_t instant;
    open_scene(&scene, plain);
    mk_events_t *events = record(&scene, y, x, 0);
    assert_true(mk_events_facts(events).has_truth);
    assert_int_equal(mk_events_facts(events).with_truth, 9);
    mk_run_events_open(&stream, events);
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; i++) {
        assert_int_equal(mk_run_events_next(&stream, &instant, &error), 1);
        for (int j = 0; j < 2; j++) {
            const double given = instant.x[2 * j], right = wanted[i][j];
            if (!(given == right || (isnan(given) && isnan(right)))) fail_msg("t = %g, state %d: %g, not %g", instant.t, 2 * j, given, right);
        }
        assert_true(isnan(instant.x[1]) && isnan(instant.x[3]));
    }
    assert_int_equal(mk_run_events_next(&stream, &instant, &error), 0);
    mk_run_events_close(&stream);
    mk_events_free(events);
    /* A single time is met exactly only. */
    events = record(&scene, HEAD "1,0,0,1\n1.001,0,0,1\n", STATE "1,0,5\n", 0);
    assert_int_equal(mk_events_facts(events).with_truth, 1);
    mk_events_free(events);
    close_scene(&scene);
}

static void bad_recordings(void **state) {
    (void)state;
    static const struct {
        const char *y, *x, *message;
    } bad[] = {
        {"", NULL, "y.csv: empty"},
        {"t,node,value\n", NULL, "y.csv:1: the header must be t,node,row,value"},
        {HEAD, NULL, "y.csv: no measurements"},
        {HEAD "0.1,1,0,5\n0.1,0,0\n", NULL, "y.csv:3: column row: expected a number and a comma"},
        {HEAD "nan,0,0,1\n", NULL, "y.csv:2: column t is not finite"},
        {HEAD "0,0,0,inf\n", NULL, "y.csv:2: column value is not finite"},
        {HEAD "0,4,0,1\n", NULL, "y.csv:2: node is 4: must be an integer from 0 to 3"},
        {HEAD "0,0,0,1\n\n0,2,0,1\n", NULL, "y.csv:4: node 2 has no sensor"},
        {HEAD "0,0,1,1\n", NULL, "y.csv:2: row is 1: must be an integer from 0 to 0"},
        {HEAD "0,1,2,1\n", NULL, "y.csv:2: row is 2: must be an integer from 0 to 1"},
        {HEAD "0.3,1,1,1\n0.1,0,0,1\n0.30,1,1,2\n", NULL, "y.csv:4: a second value for the same place: line 2 has it, too"},
        {HEAD "0.3,1,1,1\n0.2,1,0,1\n", NULL, "y.csv: no reading has all its rows"},
        {HEAD "0,0,0,1\n", "", "x.csv: empty"},
        {HEAD "0,0,0,1\n", STATE, "x.csv: no truth"},
        {HEAD "0,0,0,1\n3,0,0,1\n", STATE "1,0,1\n2,0,1\n", "x.csv: no truth at any instant: it is for 1 to 2 s, the measurements are for 0 to 3 s: two clocks"},
        {HEAD "0,0,0,1\n", HEAD, "x.csv:1: the header must be t,state,value"},
        {HEAD "0,0,0,1\n", STATE "0.5,4,1\n", "x.csv:2: state is 4: must be an integer from 0 to 3"},
        {HEAD "0,0,0,1\n", STATE "0.5,1,1\n0,1,1\n0.5,1,2\n", "x.csv:4: a second value for the same place: line 2 has it, too"},
    };
    scene_t scene;
    mk_error_t error;
    open_scene(&scene, plain);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        const char *y = put("y.csv", bad[i].y), *x = bad[i].x ? put("x.csv", bad[i].x) : NULL;
        (void)snprintf(error.text, sizeof error.text, "none");
        assert_null(mk_events_record(scene.models, y, x, 0, &error));
        if (!strstr(error.text, bad[i].message)) fail_msg("%zu: %s", i, error.text);
    }
    assert_null(mk_events_record(scene.models, place("none.csv"), NULL, 0, &error));
    assert_non_null(strstr(error.text, "none.csv: No such file"));
    close_scene(&scene);
}

/* A million rows, not sorted, in seconds; the sanitizers take their time. */
static void large_recording(void **state) {
    (void)state;
    enum { ROWS = 1000000 };
    scene_t scene;
    mk_error_t error;
    mk_run_events_t stream;
    mk_instant_t instant;
    open_scene(&scene, plain);
    const char *path = place("large.csv");
    FILE *file = fopen(path, "wb");
    (void)fputs(HEAD, file);
    for (long i = 0; i < ROWS; i++) (void)fprintf(file, "%.6f,0,0,%ld\n", 1.7e9 + 1e-3 * (double)(i * 7919 % ROWS), i * 7919 % ROWS);
    assert_int_equal(fclose(file), 0);
    const clock_t begin = clock();
    mk_events_t *events = mk_events_record(scene.models, path, NULL, 0, &error);
    const double seconds = (double)(clock() - begin) / CLOCKS_PER_SEC;
    assert_non_null(events);
    assert_int_equal(mk_events_facts(events).steps, ROWS);
    mk_run_events_open(&stream, events);
    for (long i = 0; i < ROWS; i++) {
        assert_int_equal(mk_run_events_next(&stream, &instant, &error), 1);
        if (instant.reading[0].z[0] != (double)i) fail_msg("row %ld is %g", i, instant.reading[0].z[0]);
    }
    mk_run_events_close(&stream);
    mk_events_free(events);
    close_scene(&scene);
    (void)printf("%d rows: %.2f s\n", ROWS, seconds);
    assert_true(seconds < 20.0);
}

/* What draw writes is what record reads. */
static void drawn_and_recorded(void **state) {
    (void)state;
    scene_t scene;
    mk_error_t error;
    mk_run_events_t stream[2];
    mk_instant_t instant[2];
    open_scene(&scene, "{" MODEL(", \"start_s\": 3, \"dt_s\": 0.1") NODES ", \"reading_loss\": 0.2}");
    mk_events_t *drawn = mk_events_draw(scene.models, 3, 50);
    FILE *y = fopen(place("y.csv"), "wb"), *x = fopen(place("x.csv"), "wb");
    (void)fputs(HEAD, y);
    (void)fputs(STATE, x);
    mk_run_events_open(&stream[0], drawn);
    mk_run_events_start(&stream[0], 2);
    while (mk_run_events_next(&stream[0], &instant[0], &error) > 0) {
        for (int j = 0; j < 4; j++) (void)fprintf(x, "%.17g,%d,%.17g\n", instant[0].t, j, instant[0].x[j]);
        for (int i = 0; i < instant[0].count; i++)
            for (int r = 0; r < scene.s.sensor[instant[0].reading[i].node].rows; r++)
                (void)fprintf(y, "%.17g,%d,%d,%.17g\n", instant[0].t, instant[0].reading[i].node, r, instant[0].reading[i].z[r]);
    }
    (void)fclose(y);
    (void)fclose(x);
    mk_events_t *recorded = mk_events_record(scene.models, place("y.csv"), place("x.csv"), 0, &error);
    assert_non_null(recorded);
    mk_run_events_open(&stream[1], recorded);
    mk_run_events_start(&stream[0], 2);
    while (mk_run_events_next(&stream[1], &instant[1], &error) > 0) {
        do assert_int_equal(mk_run_events_next(&stream[0], &instant[0], &error), 1);
        while (instant[0].count == 0);
        assert_true(instant[0].t == instant[1].t);
        assert_int_equal(instant[0].count, instant[1].count);
        assert_memory_equal(instant[0].x, instant[1].x, 4 * sizeof(double));
        for (int i = 0; i < instant[0].count; i++) {
            const mk_reading_t *a = &instant[0].reading[i], *b = &instant[1].reading[i];
            assert_int_equal(a->node, b->node);
            assert_memory_equal(a->z, b->z, (size_t)scene.s.sensor[a->node].rows * sizeof(double));
        }
    }
    for (int i = 0; i < 2; i++) mk_run_events_close(&stream[i]);
    mk_events_free(drawn);
    mk_events_free(recorded);
    close_scene(&scene);
}

/* --- models ---------------------------------------------------------------------------------------------------------------- */

static mk_status_t twice_f64(const void *context, double dt, int count, const double *x, double *y);

#define MK_BITS 32
#include <meshkal/real.h>
#include "tracking_models.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "tracking_models.tmpl.h"
#undef MK_BITS

static int make_folder(void **state) {
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state) {
    (void)state;
    static const char *const names[] = {"s.json", "x.csv", "y.csv", "large.csv"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) (void)remove(place(names[i]));
    return rmdir(folder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(instants_of_a_recording), cmocka_unit_test(order_does_not_matter), cmocka_unit_test(start_of_a_recording),
        cmocka_unit_test(nearest_truth),           cmocka_unit_test(bad_recordings),        cmocka_unit_test(large_recording),
        cmocka_unit_test(drawn_and_recorded),      cmocka_unit_test(models_f32),            cmocka_unit_test(models_f64),
        cmocka_unit_test(noise_f32),               cmocka_unit_test(noise_f64),             cmocka_unit_test(own_f32),
        cmocka_unit_test(own_f64),                 cmocka_unit_test(start_f32),             cmocka_unit_test(start_f64),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
