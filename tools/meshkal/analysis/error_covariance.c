/* SPDX-License-Identifier: MIT */
#include "analysis/error_covariance.h"

#include <stdlib.h>
#include <string.h>

#include "dense.h"
#include "design/design.h"
#include "parallel.h"

static double *doubles(size_t count) { return mk_allocate(count, sizeof(double)); }

/* Room of one worker: the pass's own, then blocks (n x width) of the sensors that a panel touches, G and S G, and one more. */
static size_t worker_room(const mk_error_covariance_t *x) {
    return mk_panel_scratch(&x->shape) + (2 * (size_t)x->sensors + 1) * (size_t)(x->n * x->shape.width);
}

/* Marks of one worker: of each sensor its place among the touched ones, those themselves, of each estimator whether it is done. */
static size_t worker_marks(const mk_error_covariance_t *x) { return 2 * (size_t)x->sensors + (size_t)x->estimators; }

static void make_listeners(mk_error_covariance_t *x) {
    const mk_topology_t *hears = x->topology;
    const int links = hears->first[x->estimators];
    x->listener_first = mk_allocate((size_t)x->sensors + 2, sizeof(int));
    x->listener = mk_allocate((size_t)links, sizeof(int));
    int *end = x->listener_first + 1; /* one ahead while it is filled */
    for (int i = 0; i < links; i++) end[hears->slot[i] + 1]++;
    for (int s = 0; s < x->sensors; s++) end[s + 1] += end[s];
    for (int e = 0; e < x->estimators; e++)
        for (int i = hears->first[e]; i < hears->first[e + 1]; i++) x->listener[end[hears->slot[i]]++] = e;
}

static void make_mixing(mk_error_covariance_t *x, int diffuses) {
    if (diffuses) {
        const mk_mixing_t mixing = {x->topology->first, x->topology->slot, x->topology->weight};
        x->mixing = mixing;
        return;
    }
    const size_t E = (size_t)x->estimators;
    x->own_first = mk_allocate(2 * E + 1, sizeof(int));
    x->own_slot = x->own_first + E + 1;
    x->own_weight = doubles(E);
    for (int e = 0; e < x->estimators; e++) {
        x->own_first[e + 1] = e + 1;
        x->own_slot[e] = e;
        x->own_weight[e] = 1.0;
    }
    const mk_mixing_t mixing = {x->own_first, x->own_slot, x->own_weight};
    x->mixing = mixing;
}

static void make_information(mk_error_covariance_t *x, const mk_scenario_t *s) {
    const size_t square = (size_t)(x->n * x->n);
    double *own = doubles((size_t)MK_PACKED(x->n));
    for (int k = 0; k < x->sensors; k++) {
        mk_sensor_matrices(x->n, &s->sensor[k], NULL, own, NULL);
        mk_unpack(x->n, own, x->sensor + (size_t)k * square);
    }
    free(own);
    for (int e = 0; e < x->estimators; e++)
        for (int i = x->topology->first[e]; i < x->topology->first[e + 1]; i++)
            for (size_t j = 0; j < square; j++) x->heard[(size_t)e * square + j] += x->sensor[(size_t)x->topology->slot[i] * square + j];
}

void mk_error_covariance_open(mk_error_covariance_t *x, const mk_scenario_t *s, const mk_topology_t *topology, int diffuses, int threads) {
    const int n = s->n;
    const size_t square = (size_t)(n * n), E = (size_t)topology->estimators;
    memset(x, 0, sizeof *x);
    x->n = n;
    x->estimators = topology->estimators;
    x->sensors = s->nodes;
    x->threads = threads;
    x->topology = topology;
    x->shape = mk_panel_shape(n, x->estimators);
    x->X = doubles(mk_panel_size(&x->shape));
    x->T = doubles(mk_panel_size(&x->shape));
    x->cross = doubles((9 * E + (size_t)x->sensors + 8) * square);
    x->next = x->cross + E * square;
    x->heard = x->next + E * square;
    x->MA_transposed = x->heard + E * square;
    x->E = x->MA_transposed + E * square;
    x->K = x->E + E * square;
    x->L = x->K + E * square; /* twice as wide */
    x->sensor = x->L + 2 * E * square;
    x->central = x->sensor + (size_t)x->sensors * square;
    x->small = doubles(6 * square);
    x->H = doubles((size_t)x->shape.panels * 2 * (size_t)(n * x->shape.width));
    x->Q_repeated = doubles((size_t)(n * x->shape.width));
    x->Q_full = doubles(square);
    x->Q = x->Q_full;
    mk_unpack(n, s->Q, x->Q_full);
    for (int i = 0; i < n; i++)
        for (int c = 0; c < x->shape.width; c++) x->Q_repeated[i * x->shape.width + c] = x->Q[i * n + c % n];
    x->scratch = doubles((size_t)threads * worker_room(x));
    x->marks = mk_allocate((size_t)threads * worker_marks(x), sizeof(int));
    make_listeners(x);
    make_mixing(x, diffuses);
    make_information(x, s);
    mk_unpack(n, s->P0, x->central);
    for (size_t e = 0; e < E; e++) memcpy(x->cross + e * square, x->central, square * sizeof *x->cross);
    for (int k = 0; k < x->estimators; k++)
        for (int j = 0; j < x->estimators; j++) {
            double *block = x->X + mk_panel_at(&x->shape, k, j);
            for (int i = 0; i < n; i++) memcpy(block + i * x->shape.width, x->central + i * n, (size_t)n * sizeof *block);
        }
}

void mk_error_covariance_close(mk_error_covariance_t *x) {
    free(x->X);
    free(x->T);
    free(x->cross);
    free(x->small);
    free(x->H);
    free(x->Q_repeated);
    free(x->Q_full);
    free(x->scratch);
    free(x->marks);
    free(x->listener_first);
    free(x->listener);
    free(x->own_first);
    free(x->own_weight);
    memset(x, 0, sizeof *x);
}

const double *mk_error_covariance_block(const mk_error_covariance_t *x, int k, int j, int *stride) {
    *stride = x->shape.width;
    return x->X + mk_panel_at(&x->shape, k, j);
}

/* --- one step -------------------------------------------------------------------------------------------------------------- */

/* Products that all estimators share: F = Ag + Z N Ag; D with E[error of psi_l e(t+1)'] = Phi_l E[(x - xh_l) e'] F' + E_l D; J = N Ag;
   half = (N + J E[e e'] J') / 2. */
typedef struct {
    const mk_error_covariance_t *x;
    const mk_error_maps_t *maps;
    mk_panel_step_t step;
    double *F, *D, *J, *half;
} stepping_t;

static void symmetric(int n, double *S) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) S[i * n + j] = S[j * n + i] = 0.5 * (S[i * n + j] + S[j * n + i]);
}

/* The same for RKFC and its own covariance, which goes on to t + 1. */
static void step_central(const stepping_t *s) {
    const mk_error_covariance_t *x = s->x;
    const mk_error_maps_t *m = s->maps;
    const int n = x->n, square = n * n;
    double *F = s->F, *D = s->D, *J = s->J, *half = s->half, *Z = half + square, *T = Z + square;
    double *U = D; /* until D is made */
    memset(U, 0, (size_t)square * sizeof *U);
    for (int k = 0; k < x->sensors; k++)
        for (int i = 0; i < square; i++) U[i] += x->sensor[k * square + i];
    mk_multiply(n, U, m->central_MA, T);
    mk_multiply_left_transposed(n, m->central_MA, T, Z);
    for (int i = 0; i < square; i++) Z[i] += x->Q[i];
    symmetric(n, Z);
    memcpy(F, m->Ag, (size_t)square * sizeof *F);
    if (!m->N) {
        memset(D, 0, (size_t)square * sizeof *D);
        for (int i = 0; i < n; i++) D[i * n + i] = 1.0;
    } else {
        mk_multiply(n, m->N, m->Ag, J);
        mk_multiply(n, J, x->central, T);
        mk_multiply_transposed(n, T, J, half);
        for (int i = 0; i < square; i++) half[i] = 0.5 * (half[i] + m->N[i]);
        symmetric(n, half);
        mk_multiply(n, Z, J, D);
        for (int i = 0; i < square; i++) F[i] += D[i];
        mk_multiply_transposed(n, T, F, D);
        mk_multiply(n, m->N, Z, T);
        for (int i = 0; i < square; i++) D[i] += T[i] + (i % (n + 1) == 0);
    }
    /* F E[e e'] F' + Z + Z N Z */
    mk_multiply(n, F, x->central, T);
    mk_multiply_transposed(n, T, F, x->central);
    for (int i = 0; i < square; i++) x->central[i] += Z[i];
    if (m->N) {
        double *ZN = T, *ZNZ = x->L; /* not in use yet */
        mk_multiply(n, Z, m->N, ZN);
        mk_multiply(n, ZN, Z, ZNZ);
        for (int i = 0; i < square; i++) x->central[i] += ZNZ[i];
    }
    symmetric(n, x->central);
}

static void estimator(void *context, int worker, long l) {
    const stepping_t *s = context;
    const mk_error_covariance_t *x = s->x;
    const int n = x->n, square = n * n;
    const size_t at = (size_t)l * (size_t)square;
    const double *MA = s->maps->MA + at;
    double *T = x->scratch + (size_t)worker * worker_room(x), *a = T + square, *E = x->E + at, *K = x->K + at, *psi = x->next + at;
    mk_multiply(n, x->heard + at, s->maps->central_MA, T);
    mk_multiply_left_transposed(n, MA, T, E);
    for (int i = 0; i < square; i++) E[i] += x->Q[i];
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) x->MA_transposed[at + (size_t)(i * n + j)] = MA[j * n + i];
    mk_multiply(n, s->maps->Phi + at, x->cross + at, a);
    mk_multiply_transposed(n, a, s->F, psi);
    mk_multiply(n, E, s->D, T);
    for (int i = 0; i < square; i++) psi[i] += T[i];
    if (!s->maps->N) return;
    mk_multiply_transposed(n, a, s->J, K);
    mk_multiply(n, E, s->half, T);
    for (int i = 0; i < square; i++) K[i] += T[i];
}

/* Diffusion of what `estimator` made: cross, and K E' + E K' as L H. */
static void mix(void *context, int worker, long k) {
    const stepping_t *s = context;
    const mk_error_covariance_t *x = s->x;
    const int n = x->n, square = n * n, width = x->shape.width, b = (int)k % x->shape.blocks;
    double *cross = x->cross + (size_t)k * (size_t)square, *L = x->L + (size_t)k * (size_t)(2 * square);
    double *H = x->H + (size_t)(k / x->shape.blocks) * (size_t)(2 * n * width) + b * n;
    (void)worker;
    memset(cross, 0, (size_t)square * sizeof *cross);
    memset(L, 0, (size_t)(2 * square) * sizeof *L);
    for (int i = x->mixing.first[k]; i < x->mixing.first[k + 1]; i++) {
        const size_t at = (size_t)x->mixing.slot[i] * (size_t)square;
        const double w = x->mixing.weight[i];
        for (int j = 0; j < square; j++) cross[j] += w * x->next[at + (size_t)j];
        if (!s->maps->N) continue;
        for (int r = 0; r < n; r++)
            for (int c = 0; c < n; c++) {
                L[r * 2 * n + c] += w * x->K[at + (size_t)(r * n + c)];
                L[r * 2 * n + n + c] += w * x->E[at + (size_t)(r * n + c)];
            }
    }
    for (int r = 0; r < n; r++)
        for (int c = 0; c < n; c++) {
            H[r * width + c] = L[c * 2 * n + n + r];
            H[(n + r) * width + c] = L[c * 2 * n + r];
        }
}

static void first_pass(void *context, int worker, long p) {
    const stepping_t *s = context;
    mk_panel_first(&s->step, (int)p, s->x->X, s->x->T, s->x->scratch + (size_t)worker * worker_room(s->x));
}

/* Adds to block (l, j) of F T, for every j of the panel, what l shares of the noise of the sensors with those whose estimates j combines:
   MA_l' S_s times the sum of w_ij MA_i over the i that hear s. */
static void add_noise(const stepping_t *s, int worker, int p) {
    const mk_error_covariance_t *x = s->x;
    const mk_panel_shape_t *shape = &x->shape;
    const int n = x->n, width = shape->width, size = n * width;
    double *scratch = x->scratch + (size_t)worker * worker_room(x);
    double *G = scratch + mk_panel_scratch(shape), *SG = G + (size_t)x->sensors * (size_t)size, *sum = SG + (size_t)x->sensors * (size_t)size;
    int *place = x->marks + (size_t)worker * worker_marks(x), *touched = place + x->sensors, *done = touched + x->sensors, count = 0;
    for (int b = 0, j = p * shape->blocks; b < shape->blocks && j < x->estimators; b++, j++)
        for (int i = x->mixing.first[j]; i < x->mixing.first[j + 1]; i++) {
            const int from = x->mixing.slot[i];
            const double w = x->mixing.weight[i], *MA = s->maps->MA + (size_t)from * (size_t)(n * n);
            for (int h = x->topology->first[from]; h < x->topology->first[from + 1]; h++) {
                const int sensor = x->topology->slot[h];
                if (place[sensor] == 0) {
                    memset(G + (size_t)count * (size_t)size, 0, (size_t)size * sizeof *G);
                    touched[count++] = sensor;
                    place[sensor] = count;
                }
                double *to = G + (size_t)(place[sensor] - 1) * (size_t)size + b * n;
                for (int r = 0; r < n; r++)
                    for (int c = 0; c < n; c++) to[r * width + c] += w * MA[r * n + c];
            }
        }
    for (int i = 0; i < count; i++)
        mk_panel_product(shape, x->sensor + (size_t)touched[i] * (size_t)(n * n), G + (size_t)i * (size_t)size, 0, SG + (size_t)i * (size_t)size);
    for (int i = 0; i < count; i++)
        for (int h = x->listener_first[touched[i]]; h < x->listener_first[touched[i] + 1]; h++) {
            const int l = x->listener[h];
            if (done[l]) continue;
            done[l] = 1;
            memset(sum, 0, (size_t)size * sizeof *sum);
            for (int g = x->topology->first[l]; g < x->topology->first[l + 1]; g++) {
                const int at = place[x->topology->slot[g]];
                const double *add = SG + (size_t)(at - 1) * (size_t)size;
                for (int e = 0; at > 0 && e < size; e++) sum[e] += add[e];
            }
            mk_panel_product(shape, x->MA_transposed + (size_t)l * (size_t)(n * n), sum, 1, scratch + (size_t)l * (size_t)size);
        }
    for (int i = 0; i < count; i++) {
        place[touched[i]] = 0;
        for (int h = x->listener_first[touched[i]]; h < x->listener_first[touched[i] + 1]; h++) done[x->listener[h]] = 0;
    }
}

/* Late panels have more to do: they come first. */
static void second_pass(void *context, int worker, long index) {
    const stepping_t *s = context;
    const long p = s->x->shape.panels - 1 - index;
    double *scratch = s->x->scratch + (size_t)worker * worker_room(s->x);
    mk_panel_map(&s->step, (int)p, s->x->T, scratch);
    add_noise(s, worker, (int)p);
    mk_panel_second(&s->step, (int)p, s->x->X, scratch);
}

void mk_error_covariance_step(mk_error_covariance_t *x, const mk_error_maps_t *maps) {
    const size_t square = (size_t)(x->n * x->n);
    const mk_panel_step_t step = {x->shape, x->mixing, maps->Phi, maps->N ? 2 * x->n : 0, x->L, x->H, x->Q_repeated};
    stepping_t s = {x, maps, step, x->small, x->small + square, x->small + 2 * square, x->small + 3 * square};
    step_central(&s);
    mk_parallel(x->threads, x->estimators, estimator, &s);
    mk_parallel(x->threads, x->estimators, mix, &s);
    mk_parallel(x->threads, x->shape.panels, first_pass, &s);
    mk_parallel(x->threads, x->shape.panels, second_pass, &s);
}
