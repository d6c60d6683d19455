/* SPDX-License-Identifier: MIT */
/* CPU_COUNT and sched_getaffinity are not POSIX. */
#define _GNU_SOURCE
#include "parallel.h"

#include <pthread.h>
#include <sched.h>
#include <stdlib.h>

#include "error.h"

int mk_cores(void) {
    cpu_set_t set;
    return sched_getaffinity(0, sizeof set, &set) == 0 && CPU_COUNT(&set) > 0 ? CPU_COUNT(&set) : 1;
}

typedef struct {
    pthread_mutex_t lock;
    long next, count, chunk;
    void (*body)(void *context, int worker, long index);
    void *context;
} loop_t;

typedef struct {
    loop_t *loop;
    int worker;
    pthread_t thread;
} worker_t;

static void *work(void *argument) {
    const worker_t *w = argument;
    loop_t *loop = w->loop;
    for (;;) {
        (void)pthread_mutex_lock(&loop->lock);
        const long begin = loop->next, left = loop->count - begin, end = begin + (left < loop->chunk ? left : loop->chunk);
        loop->next = end;
        (void)pthread_mutex_unlock(&loop->lock);
        if (begin >= end) return NULL;
        for (long i = begin; i < end; i++) loop->body(loop->context, w->worker, i);
    }
}

void mk_parallel(int threads, long count, void (*body)(void *context, int worker, long index), void *context) {
    if (threads > count) threads = (int)count;
    if (threads < 2) {
        for (long i = 0; i < count; i++) body(context, 0, i);
        return;
    }
    /* Short chunks: the last one decides how long a core stands idle. */
    const long chunk = count / (64L * threads) + 1;
    loop_t loop = {PTHREAD_MUTEX_INITIALIZER, 0, count, chunk, body, context};
    worker_t *workers = mk_allocate((size_t)threads, sizeof *workers);
    int started = 1;
    for (int i = 0; i < threads; i++) {
        workers[i].loop = &loop;
        workers[i].worker = i;
    }
    while (started < threads && pthread_create(&workers[started].thread, NULL, work, &workers[started]) == 0) started++;
    (void)work(&workers[0]);
    for (int i = 1; i < started; i++) (void)pthread_join(workers[i].thread, NULL);
    free(workers);
}
