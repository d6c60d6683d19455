/* SPDX-License-Identifier: MIT */
/* Where in a JSON text a value stands. jansson knows lines of syntax errors only; a person wants the line of a wrong value. */
#ifndef MESHKAL_HOST_JSON_PLACE_H
#define MESHKAL_HOST_JSON_PLACE_H

#include <stddef.h>

/* The elements of a top-level array, by their places in the text: they can then be parsed one by one, without a tree of them all. */
typedef struct {
    const char *begin, *end; /* of the array: its bracket, and behind the closing one */
    const char **place;      /* begin and end of element i at 2 i and 2 i + 1 */
    size_t count;
} mk_json_list_t;

/* 1, or 0, *list being empty, if the text's member `key` is no array, or the text no JSON as far as this can tell: it looks at brackets,
   strings and commas only. An array cut this way is JSON if every element is, and the text if it is JSON with [] in the array's place. */
int mk_json_list(const char *text, const char *key, mk_json_list_t *list);
void mk_json_list_free(mk_json_list_t *list);

/* Line, from 1, of the value at `path`, for example "nodes[3].R[0]", in valid JSON; of the deepest part of the path that
   exists, if not all of it does. Object members are reported where their key stands; "model{2}" is the member of model that comes third,
   whatever its key. */
int mk_json_line(const char *text, const char *path);

#endif
