/* SPDX-License-Identifier: MIT */
#include "json_place.h"

#include <stdlib.h>
#include <string.h>

#include "error.h"

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
        const char *colon = skip_space(end);
        if (*colon != ':') return NULL;
        const char *value = skip_space(colon + 1);
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

int mk_json_list(const char *text, const char *key, mk_json_list_t *list) {
    const char *place;
    size_t room = 64;
    memset(list, 0, sizeof *list);
    const char *p = find_member(skip_space(text), key, strlen(key), 0, &place);
    if (!p || *p != '[') return 0;
    list->begin = p;
    list->place = mk_allocate(2 * room, sizeof *list->place);
    p = skip_space(p + 1);
    for (int more = *p != ']'; more;) {
        if (list->count == room) {
            const char **larger = realloc(list->place, 2 * (room *= 2) * sizeof *larger);
            if (!larger) break;
            list->place = larger;
        }
        const char **const element = list->place + 2 * list->count++;
        element[0] = p;
        element[1] = strchr(",:]}", *p) ? p : skip_value(p); /* strchr finds the end of the text, too */
        p = skip_space(element[1]);
        more = *p == ',';
        if (element[0] == element[1] || (!more && *p != ']')) break;
        if (more) p = skip_space(p + 1);
    }
    list->end = p + 1;
    if (*p == ']' && (list->count == 0 || list->place[2 * list->count - 1] != list->place[2 * list->count - 2])) return 1;
    mk_json_list_free(list);
    return 0;
}

void mk_json_list_free(mk_json_list_t *list) {
    free(list->place);
    memset(list, 0, sizeof *list);
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
