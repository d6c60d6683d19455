/* SPDX-License-Identifier: MIT */
/* Whole files in, whole files out. */
#ifndef MESHKAL_HOST_FILE_H
#define MESHKAL_HOST_FILE_H

#include <stddef.h>
#include <stdio.h>

#include "error.h"

/* Contents of a file, with a zero byte behind it; null and *error on failure. Free it. */
char *mk_read_file(const char *path, size_t *length, mk_error_t *error);

/* A file that appears complete or not at all: written beside its place, moved there by mk_close_output. */
typedef struct {
    FILE *stream;
    char *path, *partial;
} mk_output_t;

/* 1, or 0 and *error. */
int mk_open_output(mk_output_t *output, const char *path, mk_error_t *error);
/* keep = 0 discards it. 1, or 0 and *error (disk full, ...). */
int mk_close_output(mk_output_t *output, int keep, mk_error_t *error);

#endif
