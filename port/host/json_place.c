/* SPDX-License-Identifier: MIT */
#include "json_place.h"

#include <stdlib.h>
#include <string.h>

static const char *skip_space(const char *p) {
    while (*p == ' ' || *p == '\t' || *p == '\n' || *p == '\r') p++;
    return p;
}

static const char *skip_string(const char *p) {
    for (p++; *p && *p != '"'; p++)
        if (*p == '\\' && p[1]) p++;
    return *p ? p + 1 : p;
}

/* Past one value. Brackets are counted, not matched: the text is known to be valid. */
static const char *skip_value(const char *p) {
    int depth = 0;
    p = skip_space(p);
    do {
        if (*p == '"') {
            p = skip_string(p);
        } else if (*p == '[' || *p == '{') {
            depth++;
            p++;
        } else if (*p == ']' || *p == '}') {
            depth--;
            p++;
        } else if (depth == 0) {
            while (*p && !strchr(",]} \t\r\n", *p)) p++;
        } else {
            p++;
        }
    } while (*p && depth > 0);
    return p;
}

/* The member of the object at p with this key, or, key being null, the one at `index`: *key_place its key, returns its value; null if there
   is none. */
static const char *find_member(const char *p, const char *key, size_t length, long index, const char **key_place) {
    if (*p != '{') return NULL;
    p = skip_space(p + 1);
    for (; *p == '"'; index--) {
        const char *name = p + 1, *end = skip_string(p);
        const char *value = skip_space(skip_space(end) + 1);
        if (key ? (size_t)(end - name) == length + 1 && strncmp(name, key, length) == 0 : index == 0) {
            *key_place = p;
            return value;
        }
        p = skip_space(skip_value(value));
        if (*p != ',') return NULL;
        p = skip_space(p + 1);
    }
    return NULL;
}

static const char *find_element(const char *p, long index) {
    if (*p != '[') return NULL;
    p = skip_space(p + 1);
    for (; *p && *p != ']'; index--) {
        if (index == 0) return p;
        p = skip_space(skip_value(p));
        if (*p != ',') return NULL;
        p = skip_space(p + 1);
    }
    return NULL;
}

int mk_json_line(const char *text, const char *path) {
    const char *value = skip_space(text), *place = value;
    while (*path) {
        const char *next, *next_place;
        if (*path == '[' || *path == '{') {
            char *end;
            const long index = strtol(path + 1, &end, 10);
            if (*path == '{') next = find_member(value, NULL, 0, index, &next_place);
            else next = next_place = find_element(value, index);
            path = *end ? end + 1 : end;
        } else {
            if (*path == '.') path++;
            const size_t length = strcspn(path, ".[{");
            next = find_member(value, path, length, 0, &next_place);
            path += length;
        }
        if (!next) break;
        value = next;
        place = next_place;
    }
    int line = 1;
    for (const char *p = text; p < place; p++) line += *p == '\n';
    return line;
}
