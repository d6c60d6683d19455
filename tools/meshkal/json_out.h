/* SPDX-License-Identifier: MIT */
/* Results as JSON. */
#ifndef MESHKAL_JSON_OUT_H
#define MESHKAL_JSON_OUT_H

#include <jansson.h>

#include "file.h"

/* Writes the value, compact, numbers with 17 digits, and releases it. Errors stay in the stream. */
void mk_json_put(FILE *stream, json_t *value);
/* object[key] = value, which is given away. */
void mk_json_set(json_t *object, const char *key, json_t *value);
/* A number; null if it is not finite, for which JSON has no word. */
json_t *mk_json_number(double value);
void mk_json_set_number(json_t *object, const char *key, double value);
json_t *mk_json_numbers(const double *values, size_t count);
/* Packed symmetric matrix as an array of rows. */
json_t *mk_json_symmetric(int n, const double *S);

#endif
