/* SPDX-License-Identifier: MIT */
/* Values out of a scenario's JSON, each checked, each complaint with its file, line and key. */
#ifndef MESHKAL_HOST_SCENARIO_READ_H
#define MESHKAL_HOST_SCENARIO_READ_H

#include <jansson.h>

#include "error.h"

#define MK_LARGEST_STATE 64

typedef struct {
    const char *path, *text;
    mk_error_t *error;
} mk_reader_t;

/* "path:line: key: message" into the reader's error; returns 0. */
int mk_read_bad(mk_reader_t *reader, const char *key, const char *format, ...) MK_PRINTF(3, 4);

/* 1 if value is an object with no keys but those of the null-terminated list. */
int mk_read_keys(mk_reader_t *reader, json_t *value, const char *key, const char *const *known);
/* Member `name` of the object at `key`; null, with an error, if it is required and missing. */
json_t *mk_read_member(mk_reader_t *reader, json_t *object, const char *key, const char *name, int required);

/* A finite number. jansson itself refuses numbers beyond the range of double. */
int mk_read_number(mk_reader_t *reader, json_t *value, const char *key, double *number);
/* Arrays of numbers, allocated; null with an error. */
double *mk_read_vector(mk_reader_t *reader, json_t *value, const char *key, int count);
double *mk_read_matrix(mk_reader_t *reader, json_t *value, const char *key, int rows, int columns);
/* Packed symmetric matrix, positive definite (definite = 1) or semidefinite. */
double *mk_read_symmetric(mk_reader_t *reader, json_t *value, const char *key, int n, int definite);

#endif
