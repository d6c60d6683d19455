/* SPDX-License-Identifier: MIT */
#include "tracking/coverage.h"

#include <string.h>

int mk_coverage(const mk_models_f64_t *models, long steps, long runs, mk_coverage_t *c, mk_error_t *error) {
    mk_events_t *events = mk_events_draw(models, models->scenario->seed, steps);
    mk_run_events_t stream;
    mk_instant_t instant;
    int more = 0;
    memset(c, 0, sizeof *c);
    c->runs = runs;
    c->steps = steps;
    mk_run_events_open(&stream, events);
    for (int run = 0; run < runs && more >= 0; run++) {
        long row = 0, before = c->few;
        mk_run_events_start(&stream, run);
        while ((more = mk_run_events_next(&stream, &instant, error)) > 0) {
            row = instant.count < 2 ? row + 1 : 0;
            c->few += instant.count < 2;
            c->none += instant.count == 0;
            if (row > c->longest) c->longest = row;
        }
        c->runs_few += c->few > before;
    }
    mk_run_events_close(&stream);
    mk_events_free(events);
    return more >= 0;
}
