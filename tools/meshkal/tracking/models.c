/* SPDX-License-Identifier: MIT */
#include "tracking/models.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plugin_load.h"

/* The own model that a motion or a node names, if it fits. *model stays null for a ready one. */
static int find_own(const mk_plugin_t *plugin, int kind, const mk_own_model_t *own, const char *at, int size, int bits,
                    const mk_plugin_model_t **model, mk_error_t *error) {
    const char *const what = kind == MK_PLUGIN_MOTION ? "states" : "rows";
    mk_error_t reason;
    *model = NULL;
    if (!own->name) return 1;
    const mk_plugin_model_t *const found = mk_plugin_find(plugin, kind, own->name, &reason);
    if (!found) return mk_fail(error, "%s: %s", at, reason.text);
    if (found->size > 0 && found->size != size)
        return mk_fail(error, "%s: %s has %d %s, the scenario has %d", at, own->name, found->size, what, size);
    if (found->parameters != own->parameters)
        return mk_fail(error, "%s: %s needs %d parameters, the scenario has %d", at, own->name, found->parameters, own->parameters);
    if (bits == 32 && !found->f32.function) return mk_fail(error, "%s: %s has no float32 functions", at, own->name);
    *model = found;
    return 1;
}

static int most_rows(const mk_scenario_t *s) {
    int most = 1;
    for (int k = 0; k < s->nodes; k++)
        if (s->sensor[k].rows > most) most = s->sensor[k].rows;
    return most;
}

static int update_of(const char *filter) {
    if (strcmp(filter, "ekf") == 0 || strcmp(filter, "rekfd") == 0) return MK_UPDATE_EXTENDED;
    if (strcmp(filter, "iukf") == 0) return MK_UPDATE_ITERATED;
    if (strcmp(filter, "iukf-literal") == 0) return MK_UPDATE_ITERATED_LITERAL;
    if (strcmp(filter, "pukf") == 0 || strcmp(filter, "mpukf") == 0) return MK_UPDATE_PROGRESSIVE;
    return MK_UPDATE_UNSCENTED;
}

#define MK_BITS 32
#define MK_OWN f32
#include <meshkal/real.h>
#include "tracking/models.tmpl.h"
#undef MK_BITS
#undef MK_OWN

#define MK_BITS 64
#define MK_OWN f64
#include <meshkal/real.h>
#include "tracking/models.tmpl.h"
#undef MK_BITS
#undef MK_OWN
