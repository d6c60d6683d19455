/* SPDX-License-Identifier: MIT */
#include "csv.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "file.h"

static int check_header(const char *path, long number, char *line, int columns, const char *const *names, mk_error_t *error) {
    char wanted[128] = "";
    for (int c = 0; c < columns; c++) {
        (void)strncat(wanted, c ? "," : "", sizeof wanted - strlen(wanted) - 1);
        (void)strncat(wanted, names[c], sizeof wanted - strlen(wanted) - 1);
    }
    char *to = line;
    for (const char *from = line; *from; from++)
        if (*from != ' ' && *from != '\r' && *from != '"') *to++ = *from;
    *to = 0;
    if (strcmp(line, wanted) == 0) return 1;
    return mk_fail(error, "%s:%ld: the header must be %s, not %.60s%s", path, number, wanted, line,
                   strchr(line, ';') || strchr(line, '\t') ? ": columns are separated by commas, and decimals have a point" : "");
}

static int read_line(mk_csv_t *csv, char *text, long line, const char *const *names, unsigned long gaps, mk_error_t *error) {
    double *value = csv->value + csv->rows * (size_t)csv->columns;
    for (int c = 0; c < csv->columns; c++) {
        char *end;
        value[c] = strtod(text, &end);
        const int gap = (gaps >> c & 1) && (end == text || isnan(value[c])), filled = gap || end != text;
        while (*end == ' ' || *end == '\r') end++;
        if (!filled || *end != (c < csv->columns - 1 ? ',' : 0))
            return mk_fail(error, "%s:%ld: column %s: expected a number and %s", csv->path, line, names[c],
                           c < csv->columns - 1 ? "a comma" : "the end of the line");
        if (gap) value[c] = (double)NAN;
        else if (!isfinite(value[c])) return mk_fail(error, "%s:%ld: column %s is not finite", csv->path, line, names[c]);
        text = end + 1;
    }
    csv->line[csv->rows++] = line;
    return 1;
}

int mk_csv_read(mk_csv_t *csv, const char *path, int columns, const char *const *names, mk_error_t *error) {
    return mk_csv_read_gaps(csv, path, columns, names, 0, error);
}

int mk_csv_read_gaps(mk_csv_t *csv, const char *path, int columns, const char *const *names, unsigned long gaps, mk_error_t *error) {
    size_t length;
    memset(csv, 0, sizeof *csv);
    char *text = mk_read_file(path, &length, error);
    if (!text) return 0;
    if (strlen(text) != length) {
        free(text);
        return mk_fail(error, "%s: a zero byte: not a text", path);
    }
    size_t lines = 1;
    for (size_t i = 0; i < length; i++) lines += text[i] == '\n';
    csv->path = path;
    csv->columns = columns;
    csv->value = mk_allocate(lines * (size_t)columns, sizeof *csv->value);
    csv->line = mk_allocate(lines, sizeof *csv->line);
    int good = 1, headed = 0;
    long line = 0;
    /* Spreadsheets put a byte order mark in front. */
    for (char *at = strncmp(text, "\xef\xbb\xbf", 3) == 0 ? text + 3 : text; good && at && *at;) {
        char *end = strchr(at, '\n');
        if (end) *end = 0;
        line++;
        const char first = at[strspn(at, " \r")];
        const int empty = first == '#' || first == 0;
        if (!empty && !headed) good = headed = check_header(path, line, at, columns, names, error);
        else if (!empty) good = read_line(csv, at, line, names, gaps, error);
        at = end ? end + 1 : NULL;
    }
    if (good && !headed) good = mk_fail(error, "%s: empty", path);
    free(text);
    if (!good) mk_csv_free(csv);
    return good;
}

int mk_csv_index(const mk_csv_t *csv, size_t i, int column, const char *name, int limit, int *result, mk_error_t *error) {
    const double value = csv->value[i * (size_t)csv->columns + (size_t)column];
    if (!(value >= 0.0 && value < limit && value == floor(value)))
        return mk_fail(error, "%s:%ld: %s is %.15g: must be an integer from 0 to %d", csv->path, csv->line[i], name, value, limit - 1);
    *result = (int)value;
    return 1;
}

void mk_csv_free(mk_csv_t *csv) {
    free(csv->value);
    free(csv->line);
    memset(csv, 0, sizeof *csv);
}
