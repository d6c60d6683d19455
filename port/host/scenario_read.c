/* SPDX-License-Identifier: MIT */
#include "scenario_read.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "json_place.h"

/* place: where the line is; key: what is shown. */
static int bad_at(mk_reader_t *reader, const char *place, const char *key, const char *message) {
    return mk_fail(reader->error, "%s:%d: %s%s%s", reader->path, mk_json_line(reader->text, place), key, *key ? ": " : "", message);
}

int mk_read_bad(mk_reader_t *reader, const char *key, const char *format, ...) {
    char message[512];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    return bad_at(reader, key, key, message);
}

int mk_read_keys(mk_reader_t *reader, json_t *value, const char *key, const char *const *known) {
    if (!json_is_object(value)) return mk_read_bad(reader, key, "must be an object");
    int index = 0;
    for (void *entry = json_object_iter(value); entry; entry = json_object_iter_next(value, entry), index++) {
        const char *name = json_object_iter_key(entry);
        const char *const *candidate = known;
        while (*candidate && strcmp(*candidate, name) != 0) candidate++;
        if (*candidate) continue;
        /* By its number, which any key has; a name may hold dots and brackets. */
        char place[160], shown[240], message[240] = "unknown key; known are";
        (void)snprintf(place, sizeof place, "%s{%d}", key, index);
        (void)snprintf(shown, sizeof shown, "%s%s%.100s", key, *key ? "." : "", *name ? name : "\"\"");
        for (candidate = known; *candidate; candidate++) {
            (void)strncat(message, candidate == known ? " " : ", ", sizeof message - strlen(message) - 1);
            (void)strncat(message, *candidate, sizeof message - strlen(message) - 1);
        }
        return bad_at(reader, place, shown, message);
    }
    return 1;
}

json_t *mk_read_member(mk_reader_t *reader, json_t *object, const char *key, const char *name, int required) {
    json_t *value = json_object_get(object, name);
    if (!value && required) (void)mk_read_bad(reader, key, "key \"%s\" is missing", name);
    return value;
}

int mk_read_number(mk_reader_t *reader, json_t *value, const char *key, double *number) {
    if (!json_is_number(value)) return mk_read_bad(reader, key, "must be a number");
    *number = json_number_value(value);
    return isfinite(*number) ? 1 : mk_read_bad(reader, key, "must be finite");
}

static int read_row(mk_reader_t *reader, json_t *value, const char *key, int count, double *row) {
    if (!json_is_array(value)) return mk_read_bad(reader, key, "must be an array of %d numbers", count);
    if (json_array_size(value) != (size_t)count)
        return mk_read_bad(reader, key, "has %zu entries, not %d", json_array_size(value), count);
    for (int i = 0; i < count; i++) {
        json_t *entry = json_array_get(value, (size_t)i);
        char place[160];
        (void)snprintf(place, sizeof place, "%.140s[%d]", key, i);
        if (!mk_read_number(reader, entry, place, &row[i])) return 0;
    }
    return 1;
}

double *mk_read_vector(mk_reader_t *reader, json_t *value, const char *key, int count) {
    double *vector = mk_allocate((size_t)count, sizeof *vector);
    if (read_row(reader, value, key, count, vector)) return vector;
    free(vector);
    return NULL;
}

double *mk_read_matrix(mk_reader_t *reader, json_t *value, const char *key, int rows, int columns) {
    if (!json_is_array(value) || json_array_size(value) != (size_t)rows) {
        (void)mk_read_bad(reader, key, "must be an array of %d rows of %d numbers", rows, columns);
        return NULL;
    }
    double *matrix = mk_allocate((size_t)rows * (size_t)columns, sizeof *matrix);
    for (int i = 0; i < rows; i++) {
        char place[128];
        (void)snprintf(place, sizeof place, "%.100s[%d]", key, i);
        if (!read_row(reader, json_array_get(value, (size_t)i), place, columns, matrix + i * columns)) {
            free(matrix);
            return NULL;
        }
    }
    return matrix;
}

double *mk_read_symmetric(mk_reader_t *reader, json_t *value, const char *key, int n, int definite) {
    double *full = mk_read_matrix(reader, value, key, n, n);
    if (!full) return NULL;
    double *packed = mk_allocate((size_t)(n * (n + 1) / 2), sizeof *packed);
    int good = 1;
    for (int i = 0; i < n && good; i++)
        for (int j = 0; j <= i && good; j++) {
            const double a = full[i * n + j], b = full[j * n + i];
            /* Files written with 16 digits may differ in the last one. */
            if (fabs(a - b) > 1e-14 * (fabs(a) + fabs(b)))
                good = mk_read_bad(reader, key, "is not symmetric: entries [%d][%d] and [%d][%d] differ", i, j, j, i);
            packed[i * (i + 1) / 2 + j] = a;
        }
    if (good) {
        double *values = mk_allocate((size_t)n, sizeof *values);
        good = mk_eigen_symmetric(n, packed, values, NULL);
        const double least = values[0], bound = n * 2.3e-16 * values[n - 1];
        if (!good || (definite ? !(least > bound) : !(least >= -bound) || values[n - 1] < 0.0))
            good = mk_read_bad(reader, key, "is not positive %s: smallest eigenvalue %.3g", definite ? "definite" : "semidefinite", least);
        free(values);
    }
    free(full);
    if (good) return packed;
    free(packed);
    return NULL;
}
