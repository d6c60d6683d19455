/* SPDX-License-Identifier: MIT */
/* Loops on several cores. */
#ifndef MESHKAL_HOST_PARALLEL_H
#define MESHKAL_HOST_PARALLEL_H

/* Cores that this process may run on, at least 1. */
int mk_cores(void);

/* Calls body(context, worker, index) once for every index = 0 .. count - 1, on up to `threads` threads, and returns when all are done.
   worker, 0 .. threads - 1, names the thread: a place for its scratch memory. The order is not known: results must not depend on it.
   One thread, one index or a system without threads to give: the caller's own thread does the rest. */
void mk_parallel(int threads, long count, void (*body)(void *context, int worker, long index), void *context);

#endif
