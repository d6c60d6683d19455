/* SPDX-License-Identifier: MIT */
/* The runs of a campaign that are complete, kept in a file from which a later call goes on: a CBOR sequence, log-format.md. Written run by
   run, so that what was done before a crash is there. */
#ifndef MESHKAL_KEPT_RUNS_H
#define MESHKAL_KEPT_RUNS_H

#include <stddef.h>
#include <stdio.h>

#include "error.h"

typedef struct {
    FILE *stream;
    const char *path, *filter;
    int runs;        /* that the file held: 0 .. runs - 1 */
    size_t count;    /* numbers in a record */
    double *records; /* of those, one after another */
} mk_kept_t;

/* Opens the file, which may not exist yet, locks it against other processes, and reads what it holds of the filter. campaign: everything
   that decides the numbers of a run but the filter; a file of another campaign is refused. An item that was cut is dropped, one that is
   damaged refused. 1, or 0 and an error: the file is then as it was. */
int mk_kept_open(mk_kept_t *kept, const char *path, const char *campaign, const char *filter, size_t count, mk_error_t *error);
/* Adds a run, and makes sure that it is on its way to the disk. 1, or 0 and an error. */
int mk_kept_add(mk_kept_t *kept, int run, const double *record, mk_error_t *error);
void mk_kept_close(mk_kept_t *kept);

#endif
