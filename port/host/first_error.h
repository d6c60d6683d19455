/* SPDX-License-Identifier: MIT */
/* The error of a parallel loop: of all that fail, the one with the lowest index, which a loop on one thread would have met first. */
#ifndef MESHKAL_HOST_FIRST_ERROR_H
#define MESHKAL_HOST_FIRST_ERROR_H

#include <pthread.h>

#include "error.h"

typedef struct {
    pthread_mutex_t lock;
    long index; /* -1: none */
    mk_error_t error;
} mk_first_error_t;

void mk_first_error_open(mk_first_error_t *first);
/* 1 if an index before this one has failed: what this one does cannot matter any more. */
int mk_first_error_before(mk_first_error_t *first, long index);
void mk_first_error_put(mk_first_error_t *first, long index, const mk_error_t *error);
/* 1, or 0 and *error if any has failed. */
int mk_first_error_close(mk_first_error_t *first, mk_error_t *error);

#endif
