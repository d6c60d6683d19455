/* SPDX-License-Identifier: MIT */
/* Loops on several threads. Also runs clean under the thread sanitizer. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "first_error.h"
#include "parallel.h"

typedef struct {
    int threads, calls[10000];
    int busy[64], strange;   /* by worker; calls that should not be */
    long count;
    pthread_mutex_t lock;
    int met, meeting;
} job_t;

static void open(job_t *job, int threads, long count) {
    memset(job, 0, sizeof *job);
    job->threads = threads;
    job->count = count;
    (void)pthread_mutex_init(&job->lock, NULL);
}

static void count_call(void *context, int worker, long index) {
    job_t *job = context;
    (void)pthread_mutex_lock(&job->lock);
    if (worker < 0 || worker >= job->threads || index < 0 || index >= job->count || job->busy[worker]++) job->strange++;
    else job->calls[index]++;
    (void)pthread_mutex_unlock(&job->lock);
    for (volatile int i = 0; i < 50; i++) continue;
    (void)pthread_mutex_lock(&job->lock);
    job->busy[worker]--;
    (void)pthread_mutex_unlock(&job->lock);
}

/* Every index exactly once, and a worker's number is that of one thread at a time: its scratch memory is its own. */
static void every_index_once(void **unused) {
    static const long counts[] = {0, 1, 2, 3, 7, 63, 64, 65, 1000, 10000};
    static job_t job;
    (void)unused;
    for (int threads = 1; threads <= 33; threads = 2 * threads - (threads > 2))
        for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
            open(&job, threads, counts[i]);
            mk_parallel(threads, counts[i], count_call, &job);
            assert_int_equal(job.strange, 0);
            for (long k = 0; k < 10000; k++) assert_int_equal(job.calls[k], k < counts[i]);
        }
}

/* Waits until all threads are in here at once, or ten seconds. */
static void meet(void *context, int worker, long index) {
    job_t *job = context;
    const struct timespec pause = {0, 1000000};
    (void)index;
    for (int i = 0; i < 10000; i++) {
        (void)pthread_mutex_lock(&job->lock);
        job->meeting += i == 0;
        job->busy[worker] += i == 0;
        job->met |= job->meeting == job->threads;
        const int met = job->met;
        (void)pthread_mutex_unlock(&job->lock);
        if (met) return;
        (void)nanosleep(&pause, NULL);
    }
}

static void all_at_once(void **unused) {
    static job_t job;
    (void)unused;
    for (int threads = 2; threads <= 5; threads++) {
        open(&job, threads, threads);
        mk_parallel(threads, threads, meet, &job);
        assert_true(job.met);
        for (int i = 0; i < threads; i++) assert_int_equal(job.busy[i], 1); /* each with its own number */
    }
    assert_true(mk_cores() >= 1);
}

static void loop_in_a_loop(void *context, int worker, long index) {
    job_t *inner = (job_t *)context + index;
    (void)worker;
    open(inner, 3, 100);
    mk_parallel(3, 100, count_call, inner);
}

static void nested(void **unused) {
    job_t *jobs = calloc(4, sizeof *jobs);
    (void)unused;
    assert_non_null(jobs);
    mk_parallel(2, 4, loop_in_a_loop, jobs);
    for (int i = 0; i < 4; i++) {
        assert_int_equal(jobs[i].strange, 0);
        for (int k = 0; k < 100; k++) assert_int_equal(jobs[i].calls[k], 1);
    }
    free(jobs);
}

static void fail_sometimes(void *context, int worker, long index) {
    mk_error_t error;
    (void)worker;
    if (index < 137 || index % 3) return;
    (void)mk_fail(&error, "index %ld", index);
    mk_first_error_put(context, index, &error);
}

/* Of the failures, the one that a loop on one thread would have met first. */
static void first_of_the_errors(void **unused) {
    (void)unused;
    for (int threads = 1; threads <= 4; threads++) {
        mk_first_error_t first;
        mk_error_t error;
        mk_first_error_open(&first);
        mk_parallel(threads, 1000, fail_sometimes, &first);
        assert_true(mk_first_error_before(&first, 139));
        assert_false(mk_first_error_before(&first, 138));
        assert_false(mk_first_error_close(&first, &error));
        assert_string_equal(error.text, "index 138");
        mk_first_error_open(&first);
        mk_parallel(threads, 100, fail_sometimes, &first);
        assert_true(mk_first_error_close(&first, &error));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_index_once), cmocka_unit_test(all_at_once), cmocka_unit_test(nested),
                                       cmocka_unit_test(first_of_the_errors)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
