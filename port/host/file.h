/* SPDX-License-Identifier: MIT */
/* Whole files in, whole files out. */
#ifndef MESHKAL_HOST_FILE_H
#define MESHKAL_HOST_FILE_H

#include <stddef.h>
#include <stdio.h>

#include "error.h"

/* Contents of a file, with a zero byte behind it; null and *error on failure. Free it. */
char *mk_read_file(const char *path, size_t *length, mk_error_t *error);

/* A file that appears complete or not at all: written beside its place, moved there by mk_close_output. What stands there already and is
   not a plain file (a device, a pipe, a link) is written to as it is. */
typedef struct {
    FILE *stream;
    char *path, *partial; /* partial: null if written in place */
} mk_output_t;

/* 1, or 0 and *error. */
int mk_open_output(mk_output_t *output, const char *path, mk_error_t *error);
/* keep = 0 discards it. 1, or 0 and *error (disk full, ...). */
int mk_close_output(mk_output_t *output, int keep, mk_error_t *error);

#endif
