/* SPDX-License-Identifier: MIT */
#define MK_ROLLED
#include "scenario_read.h"

#include <math.h>
#include <meshkal/kernels.h>
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

int mk_read_word(mk_reader_t *reader, json_t *value, const char *key, const char *const *words) {
    const char *text = json_string_value(value);
    char message[300] = "must be";
    for (int i = 0; words[i]; i++) {
        if (text && strcmp(text, words[i]) == 0) return i;
        const size_t used = strlen(message);
        (void)snprintf(message + used, sizeof message - used, "%s\"%s\"", i == 0 ? " " : words[i + 1] ? ", " : " or ", words[i]);
    }
    (void)mk_read_bad(reader, key, "%s", message);
    return -1;
}

int mk_read_between(mk_reader_t *reader, json_t *object, const char *key, const char *name, double least, double most, const char *must,
                    double *number) {
    json_t *value = json_object_get(object, name);
    if (!value) return 1;
    const double given = json_is_number(value) ? json_number_value(value) : (double)NAN;
    if (given >= least && given <= most) {
        *number = given;
        return 1;
    }
    char place[160];
    (void)snprintf(place, sizeof place, "%.80s%s%s", key, *key ? "." : "", name);
    return mk_read_bad(reader, place, "must be %s", must);
}

int mk_read_integer(mk_reader_t *reader, json_t *object, const char *key, const char *name, int least, int most, int *number) {
    json_t *value = json_object_get(object, name);
    if (!value) return 1;
    if (json_is_integer(value) && json_integer_value(value) >= least && json_integer_value(value) <= most) {
        *number = (int)json_integer_value(value);
        return 1;
    }
    char place[160];
    (void)snprintf(place, sizeof place, "%.80s%s%s", key, *key ? "." : "", name);
    return mk_read_bad(reader, place, "must be an integer from %d to %d", least, most);
}

/* Places are spelled out for complaints only: a million nodes have many entries. row < 0: a vector. */
static int read_row(mk_reader_t *reader, json_t *value, const char *key, int row, int count, double *numbers) {
    char place[160];
    if (row < 0) (void)snprintf(place, sizeof place, "%.140s", key);
    if (!json_is_array(value) || json_array_size(value) != (size_t)count) {
        if (row >= 0) (void)snprintf(place, sizeof place, "%.120s[%d]", key, row);
        return json_is_array(value) ? mk_read_bad(reader, place, "has %zu entries, not %d", json_array_size(value), count)
                                    : mk_read_bad(reader, place, "must be an array of %d numbers", count);
    }
    for (int i = 0; i < count; i++) {
        json_t *entry = json_array_get(value, (size_t)i);
        if (json_is_number(entry) && isfinite(numbers[i] = json_number_value(entry))) continue;
        if (row >= 0) (void)snprintf(place, sizeof place, "%.120s[%d][%d]", key, row, i);
        else (void)snprintf(place, sizeof place, "%.120s[%d]", key, i);
        return mk_read_number(reader, entry, place, &numbers[i]);
    }
    return 1;
}

int mk_read_vector(mk_reader_t *reader, json_t *value, const char *key, int count, double *vector) {
    return read_row(reader, value, key, -1, count, vector);
}

int mk_read_matrix(mk_reader_t *reader, json_t *value, const char *key, int rows, int columns, double *matrix) {
    if (!json_is_array(value) || json_array_size(value) != (size_t)rows)
        return mk_read_bad(reader, key, "must be an array of %d rows of %d numbers", rows, columns);
    for (int i = 0; i < rows; i++)
        if (!read_row(reader, json_array_get(value, (size_t)i), key, i, columns, matrix + (size_t)i * (size_t)columns)) return 0;
    return 1;
}

/* 1 if S is positive definite beyond doubt: S - n epsilon trace S I has a factor. work: n (n + 1) / 2 numbers. */
static int surely_definite(int n, const double *S, double *work) {
    double trace = 0.0;
    for (int i = 0; i < n; i++) trace += S[MK_AT(i, i)];
    memcpy(work, S, (size_t)MK_PACKED(n) * sizeof *work);
    for (int i = 0; i < n; i++) work[MK_AT(i, i)] -= 4.0 * n * 2.3e-16 * trace;
    return mk_ldl_f64(n, work);
}

int mk_read_symmetric(mk_reader_t *reader, json_t *value, const char *key, int n, int definite, double *packed) {
    double *full = mk_allocate((size_t)(n * n + n), sizeof *full), *values = full + n * n;
    int good = mk_read_matrix(reader, value, key, n, n, full);
    for (int i = 0; i < n && good; i++)
        for (int j = 0; j <= i && good; j++) {
            const double a = full[i * n + j], b = full[j * n + i];
            /* Files written with 16 digits may differ in the last one. */
            if (fabs(a - b) > 1e-14 * (fabs(a) + fabs(b)))
                good = mk_read_bad(reader, key, "is not symmetric: entries [%d][%d] and [%d][%d] differ", i, j, j, i);
            packed[i * (i + 1) / 2 + j] = a;
        }
    if (good && !surely_definite(n, packed, full)) {
        good = mk_eigen_symmetric(n, packed, values, NULL);
        const double least = values[0], bound = n * 2.3e-16 * values[n - 1];
        if (!good || (definite ? !(least > bound) : !(least >= -bound) || values[n - 1] < 0.0))
            good = mk_read_bad(reader, key, "is not positive %s: smallest eigenvalue %.3g", definite ? "definite" : "semidefinite", least);
    }
    free(full);
    return good;
}

/* --- arrays without a tree ------------------------------------------------------------------------------------------------- */

json_t *mk_read_outline(const char *text, size_t length, const char *const *key, mk_elements_t *elements, int count, json_error_t *error) {
    char *outline = mk_allocate(length + 1, 1), *to = outline;
    const char *from = text;
    for (int i = 0; i < count; i++) (void)mk_json_list(text, key[i], &elements[i].list);
    for (;;) {
        /* The next array to be left out. */
        const mk_json_list_t *next = NULL;
        for (int i = 0; i < count; i++)
            if (elements[i].list.begin && elements[i].list.begin >= from && (!next || elements[i].list.begin < next->begin)) next = &elements[i].list;
        const size_t piece = next ? (size_t)(next->begin - from) : length - (size_t)(from - text);
        memcpy(to, from, piece);
        to += piece;
        if (!next) break;
        *to++ = '[';
        *to++ = ']';
        from = next->end;
    }
    json_t *root = json_loadb(outline, (size_t)(to - outline), JSON_REJECT_DUPLICATES, error);
    free(outline);
    for (int i = 0; i < count; i++) {
        elements[i].array = json_object_get(root, key[i]);
        elements[i].count = elements[i].list.begin ? elements[i].list.count : json_array_size(elements[i].array);
    }
    return root;
}

void mk_elements_close(mk_elements_t *elements) { mk_json_list_free(&elements->list); }

json_t *mk_element(const mk_elements_t *elements, size_t index) {
    if (!elements->list.begin) return json_incref(json_array_get(elements->array, index));
    const char *const *place = elements->list.place + 2 * index;
    json_error_t error;
    return json_loadb(place[0], (size_t)(place[1] - place[0]), JSON_REJECT_DUPLICATES | JSON_DECODE_ANY, &error);
}

int mk_read_position(mk_reader_t *reader, json_t *position, const char *at, int dimensions, double *position_m, int *counted) {
    char place[80];
    (void)snprintf(place, sizeof place, "%s.position_m", at);
    const size_t count = json_is_array(position) ? json_array_size(position) : 0;
    if (dimensions > 0 && count != (size_t)dimensions) return mk_read_bad(reader, place, "must be %d numbers, as the states have", dimensions);
    if (count != 2 && count != 3) return mk_read_bad(reader, place, "must be 2 or 3 numbers");
    *counted = (int)count;
    return mk_read_vector(reader, position, place, (int)count, position_m);
}
