/* SPDX-License-Identifier: MIT */
/* Numbers in CSV files with a header line. */
#ifndef MESHKAL_HOST_CSV_H
#define MESHKAL_HOST_CSV_H

#include <stddef.h>

#include "error.h"

typedef struct {
    const char *path;
    int columns;
    size_t rows;
    double *value; /* rows x columns */
    long *line;    /* of each row, in the file */
} mk_csv_t;

/* Reads a file whose header is exactly the given column names. Empty lines are skipped, and those that begin with #; no value may be empty, NaN or
   infinite: leave the row out instead. 1, or 0 and an error that names file and line. path must outlive the result. */
int mk_csv_read(mk_csv_t *csv, const char *path, int columns, const char *const *names, mk_error_t *error);
/* The same where columns, those with a bit in `gaps`, may be empty or NaN: NaN. */
int mk_csv_read_gaps(mk_csv_t *csv, const char *path, int columns, const char *const *names, unsigned long gaps, mk_error_t *error);

/* Column `column` (called `name`) of row i as an integer from 0 to limit - 1. 1, or 0 and an error. */
int mk_csv_index(const mk_csv_t *csv, size_t i, int column, const char *name, int limit, int *result, mk_error_t *error);
void mk_csv_free(mk_csv_t *csv);

#endif
