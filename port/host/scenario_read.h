/* SPDX-License-Identifier: MIT */
/* Values out of a scenario's JSON, each checked, each complaint with its file, line and key. */
#ifndef MESHKAL_HOST_SCENARIO_READ_H
#define MESHKAL_HOST_SCENARIO_READ_H

#include <jansson.h>

#include "error.h"
#include "json_place.h"

#define MK_LARGEST_STATE 64

typedef struct {
    const char *path, *text;
    mk_error_t *error;
    int no_json; /* an element of an array turned out to be no JSON: jansson can say why */
} mk_reader_t;

/* "path:line: key: message" into the reader's error; returns 0. */
int mk_read_bad(mk_reader_t *reader, const char *key, const char *format, ...) MK_PRINTF(3, 4);

/* 1 if value is an object with no keys but those of the null-terminated list. */
int mk_read_keys(mk_reader_t *reader, json_t *value, const char *key, const char *const *known);
/* Member `name` of the object at `key`; null, with an error, if it is required and missing. */
json_t *mk_read_member(mk_reader_t *reader, json_t *object, const char *key, const char *name, int required);

/* A finite number. jansson itself refuses numbers beyond the range of double. */
int mk_read_number(mk_reader_t *reader, json_t *value, const char *key, double *number);
/* Index of a string in a null-terminated list; -1 and an error that lists them. */
int mk_read_word(mk_reader_t *reader, json_t *value, const char *key, const char *const *words);
/* Members of the object at `key` that may be missing, which leaves *number as it is. 1, or 0 and an error: `must` says what it must be. */
int mk_read_between(mk_reader_t *reader, json_t *object, const char *key, const char *name, double least, double most, const char *must,
                    double *number);
int mk_read_integer(mk_reader_t *reader, json_t *object, const char *key, const char *name, int least, int most, int *number);
/* `count` numbers, and matrices by rows, into places that have room for them. 1, or 0 and an error. */
int mk_read_vector(mk_reader_t *reader, json_t *value, const char *key, int count, double *vector);
int mk_read_matrix(mk_reader_t *reader, json_t *value, const char *key, int rows, int columns, double *matrix);
/* Packed symmetric matrix, positive definite (definite = 1) or semidefinite. */
int mk_read_symmetric(mk_reader_t *reader, json_t *value, const char *key, int n, int definite, double *packed);

/* "position_m" of the node at `at`: 2 or 3 numbers, or exactly `dimensions` where that is above 0, and how many there are. */
int mk_read_position(mk_reader_t *reader, json_t *position, const char *at, int dimensions, double *position_m, int *counted);

/* A top-level array, element by element: parsed one at a time where the text can be cut, else out of the tree. */
typedef struct {
    mk_json_list_t list;
    json_t *array; /* of the tree: all of it, or [] where the list has it */
    size_t count;
} mk_elements_t;

/* Parses the text but for the elements of the arrays `key`, of which there are `count`. Null and jansson's error if it is no JSON as far as
   it was looked at. mk_elements_close then frees each. */
json_t *mk_read_outline(const char *text, size_t length, const char *const *key, mk_elements_t *elements, int count, json_error_t *error);
void mk_elements_close(mk_elements_t *elements);
/* Element `index`, to be released with json_decref; null if it is no JSON. Several threads may do this at once. */
json_t *mk_element(const mk_elements_t *elements, size_t index);

#endif
