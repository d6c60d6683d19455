/* SPDX-License-Identifier: MIT */
/* Files of own models (meshkal/plugin.h), loaded. */
#ifndef MESHKAL_HOST_PLUGIN_LOAD_H
#define MESHKAL_HOST_PLUGIN_LOAD_H

#include <meshkal/plugin.h>

#include "error.h"

/* Loads the file, whose table is then checked: version, names, sizes, functions. path null: *plugin is null. 1, or 0 and an error. A loaded
   file stays until the program ends. */
int mk_plugin_load(const char *path, const mk_plugin_t **plugin, mk_error_t *error);

/* The model of this name and kind. Null and an error that lists what there is. plugin null: says that a file is needed. */
const mk_plugin_model_t *mk_plugin_find(const mk_plugin_t *plugin, int kind, const char *name, mk_error_t *error);

#endif
