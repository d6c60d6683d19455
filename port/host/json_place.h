/* SPDX-License-Identifier: MIT */
/* Where in a JSON text a value stands. jansson knows lines of syntax errors only; a person wants the line of a wrong value. */
#ifndef MESHKAL_HOST_JSON_PLACE_H
#define MESHKAL_HOST_JSON_PLACE_H

/* Line, from 1, of the value at `path`, for example "nodes[3].R[0]", in valid JSON; of the deepest part of the path that
   exists, if not all of it does. Object members are reported where their key stands; "model{2}" is the member of model that comes third,
   whatever its key. */
int mk_json_line(const char *text, const char *path);

#endif
