/* SPDX-License-Identifier: MIT */
#include "json_out.h"

#include <math.h>

void mk_json_put(FILE *stream, json_t *value) {
    (void)json_dumpf(value, stream, JSON_COMPACT | JSON_ENCODE_ANY | JSON_REAL_PRECISION(17));
    json_decref(value);
}

void mk_json_set(json_t *object, const char *key, json_t *value) { (void)json_object_set_new(object, key, value); }

json_t *mk_json_number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

void mk_json_set_number(json_t *object, const char *key, double value) { mk_json_set(object, key, mk_json_number(value)); }

json_t *mk_json_numbers(const double *values, size_t count) {
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++) (void)json_array_append_new(array, mk_json_number(values[i]));
    return array;
}

json_t *mk_json_symmetric(int n, const double *S) {
    json_t *rows = json_array();
    for (int i = 0; i < n; i++) {
        json_t *row = json_array();
        for (int j = 0; j < n; j++) (void)json_array_append_new(row, json_real(S[i > j ? i * (i + 1) / 2 + j : j * (j + 1) / 2 + i]));
        (void)json_array_append_new(rows, row);
    }
    return rows;
}
