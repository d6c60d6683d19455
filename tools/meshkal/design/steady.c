/* SPDX-License-Identifier: MIT */
#include "design/steady.h"

#include <math.h>
#include <meshkal/inline.h>
#include <stdlib.h>
#include <string.h>

#include "design/design.h"

/* A node that takes more steps to its limit has no use for it. */
#define SETTLE_LIMIT 20000
/* Steps of a trial: at least, and as long as they lead anywhere. */
enum { TRIAL_FIRST = 128, TRIAL_LAST = 16384 };

/* Phi, G by columns and W of the limit, one after another as in the steady part. 1, or 0: there is none. */
static int find_limit(const mk_scenario_t *s, const mk_topology_t *topology, int e, int m, double tolerance, double *numbers, double *theta,
                      double *trace_P) {
    const int n = s->n, slots = topology->first[e + 1] - topology->first[e];
    const int *slot = topology->slot + topology->first[e];
    mk_recursion_t r;
    mk_recursion_open(&r, s, tolerance);
    for (int l = 0; l < slots; l++) mk_recursion_add(&r, &s->sensor[slot[l]]);
    const int good = mk_recursion_settle(&r, SETTLE_LIMIT);
    if (good) {
        double *Phi = numbers, *G = Phi + n * n, *W = G + slots * m * n;
        double *MA = mk_allocate((size_t)(4 * n * n + 3 * MK_PACKED(n) + m * n), sizeof *MA), *map = MA + n * n, *F = map + n * n, *scratch = F + m * n;
        mk_recursion_gain(&r, MA, map, scratch);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) Phi[j * n + i] = map[i * n + j];
        for (int l = 0; l < slots; l++) {
            const int rows = s->sensor[slot[l]].rows;
            mk_sensor_matrices(n, &s->sensor[slot[l]], F, NULL, NULL);
            for (int i = 0; i < m * n; i++) {
                const int row = i / n, state = i % n;
                double sum = 0.0;
                for (int k = 0; k < n && row < rows; k++) sum += MA[k * n + state] * F[row * n + k];
                G[l * m * n + i] = sum;
            }
        }
        memcpy(W, r.W, (size_t)MK_PACKED(n) * sizeof *W);
        *theta = r.theta;
        *trace_P = 0.0;
        for (int i = 0; i < n; i++) *trace_P += r.P[MK_AT(i, i)];
        free(MA);
    }
    mk_recursion_close(&r);
    return good;
}

#define MK_BITS 32
#include <meshkal/real.h>
#include "design/steady.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "design/steady.tmpl.h"
