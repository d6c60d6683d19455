/* SPDX-License-Identifier: MIT */
#include "plugin_load.h"

#include <dlfcn.h>
#include <stdio.h>
#include <string.h>

typedef const mk_plugin_t *(*entry_t)(void);

static int check_model(const char *path, const mk_plugin_t *plugin, int i, mk_error_t *error) {
    const mk_plugin_model_t *model = &plugin->model[i];
    if (!model->name || !*model->name) return mk_fail(error, "%s: own model %d has no name", path, i);
    if (model->kind != MK_PLUGIN_MOTION && model->kind != MK_PLUGIN_SENSOR)
        return mk_fail(error, "%s: own model %s: kind %d is neither MK_PLUGIN_MOTION nor MK_PLUGIN_SENSOR", path, model->name, model->kind);
    if (model->size < (model->kind == MK_PLUGIN_SENSOR) || model->size > 64)
        return mk_fail(error, "%s: own model %s: size is %d: must be %s to 64", path, model->name, model->size,
                       model->kind == MK_PLUGIN_SENSOR ? "1" : "0 (any)");
    if (model->parameters < 0) return mk_fail(error, "%s: own model %s: parameters is %d", path, model->name, model->parameters);
    if (!model->f64.function) return mk_fail(error, "%s: own model %s: f64.function is null: truth is drawn from it", path, model->name);
    if ((model->f64.mean && !model->f64.difference) || (model->f32.mean && !model->f32.difference))
        return mk_fail(error, "%s: own model %s has a mean but no difference", path, model->name);
    for (int j = 0; j < i; j++)
        if (plugin->model[j].kind == model->kind && strcmp(plugin->model[j].name, model->name) == 0)
            return mk_fail(error, "%s: own model %s stands twice in the table", path, model->name);
    return 1;
}

int mk_plugin_load(const char *path, const mk_plugin_t **plugin, mk_error_t *error) {
    char place[4096];
    entry_t entry;
    *plugin = NULL;
    if (!path) return 1;
    /* A name without a slash would be looked for among the system's libraries. */
    if ((size_t)snprintf(place, sizeof place, "%s%s", strchr(path, '/') ? "" : "./", path) >= sizeof place)
        return mk_fail(error, "%.100s...: the name is too long", path);
    void *file = dlopen(place, RTLD_NOW | RTLD_LOCAL);
    if (!file) return mk_fail(error, "--models: %s", dlerror());
    void *symbol = dlsym(file, "meshkal_plugin");
    if (!symbol) return mk_fail(error, "%s: has no function meshkal_plugin (meshkal/plugin.h)", path);
    memcpy(&entry, &symbol, sizeof entry);
    const mk_plugin_t *table = entry();
    if (!table) return mk_fail(error, "%s: meshkal_plugin returned no table", path);
    if (table->version != MK_PLUGIN_VERSION)
        return mk_fail(error, "%s: made for version %d of meshkal/plugin.h, not %d: compile it again", path, table->version, MK_PLUGIN_VERSION);
    if (table->models < 1 || !table->model) return mk_fail(error, "%s: its table has no models", path);
    for (int i = 0; i < table->models; i++)
        if (!check_model(path, table, i, error)) return 0;
    *plugin = table;
    return 1;
}

const mk_plugin_model_t *mk_plugin_find(const mk_plugin_t *plugin, int kind, const char *name, mk_error_t *error) {
    const char *const what = kind == MK_PLUGIN_MOTION ? "motion" : "sensor";
    char known[300] = "none";
    int count = 0;
    for (int i = 0; plugin && i < plugin->models; i++) {
        if (plugin->model[i].kind != kind) continue;
        if (strcmp(plugin->model[i].name, name) == 0) return &plugin->model[i];
        const size_t used = count++ ? strlen(known) : 0;
        (void)snprintf(known + used, sizeof known - used, "%s%s", used ? ", " : "", plugin->model[i].name);
    }
    if (!plugin) (void)mk_fail(error, "%s %s is an own model: give its file with --models FILE.so", what, name);
    else (void)mk_fail(error, "no %s called %s in the file of --models; there: %s", what, name, known);
    return NULL;
}
