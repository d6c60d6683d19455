/* SPDX-License-Identifier: MIT */
/* Runs one filter type over varied inputs for the instruction counter (count.c), which watches the markers, and measures its stack. The model
   is dense. Writes what size.py reads:  scenario NAME INCREMENTAL-STEPS FAILED-STEPS  in order,  stack FUNCTION BYTES,  ram BYTES. */
#include <string.h>

#include "markers.h"
#include "node.h"
#include "semihost.h"
#include "stack.h"

enum { N = SIZE_N, M = SIZE_M, SLOTS = SIZE_SLOTS, PACKED_N = MK_PACKED(SIZE_N), PACKED_M = MK_PACKED(SIZE_M) };
typedef size_real_t real_t;

/* --- markers ------------------------------------------------------------------------------------------------------------------ */

MARKER(size_begin_start)
MARKER(size_begin_put)
MARKER(size_begin_incremental)
MARKER(size_begin_frozen)
MARKER(size_begin_put_estimate)
MARKER(size_begin_diffuse)

/* --- inputs ----------------------------------------------------------------------------------------------------------------- */

static real_t A[N * N], Q[PACKED_N], x0[N], P0[PACKED_N], weight[SLOTS], C[SLOTS * M * N], F[SLOTS * M * N], S[SLOTS * PACKED_N];
static real_t R_inverse[SLOTS * PACKED_M], limit[PACKED_N], square_root[N * N];
static uint8_t rows[SLOTS];
static filter_config_t config;
static size_steady_t steady;
static filter_t node;
static uint32_t seed = 1;

/* Uniform on [-1, 1). */
static real_t draw(void) {
    seed = seed * UINT32_C(1664525) + UINT32_C(1013904223);
    return (real_t)((int32_t)seed >> 8) * (real_t)(1.0f / 8388608.0f);
}

/* Positive definite: D (G G' + ridge I) D with D = diag(1, decay, decay^2 ..) times size. */
static void draw_covariance(int n, real_t size, real_t ridge, real_t decay, real_t *packed) {
    for (int i = 0; i < n * n; i++) square_root[i] = draw();
    real_t row = size;
    for (int i = 0; i < n; i++, row *= decay) {
        real_t column = (real_t)1.0f;
        for (int j = 0; j <= i; j++, column *= decay) {
            real_t sum = i == j ? ridge : (real_t)0.0f;
            for (int k = 0; k < n; k++) sum += square_root[i * n + k] * square_root[j * n + k];
            packed[MK_PACKED(i) + j] = row * column * sum;
        }
    }
}

/* Sensors with dense C and R^-1. */
static void draw_sensors(real_t precision) {
    for (int l = 0; l < SLOTS; l++) {
        real_t *const Cl = C + l * M * N, *const Fl = F + l * M * N, *const Sl = S + l * PACKED_N, *const Ril = R_inverse + l * PACKED_M;
        rows[l] = (uint8_t)M;
        weight[l] = (real_t)1.0f / (real_t)SLOTS;
        for (int i = 0; i < M * N; i++) Cl[i] = draw();
        draw_covariance(M, precision, (real_t)0.5f, (real_t)1.0f, Ril);
        memset(Sl, 0, sizeof *Sl * PACKED_N);
        for (int r = 0; r < M; r++)
            for (int i = 0; i < N; i++) {
                real_t sum = (real_t)0.0f;
                for (int s = 0; s < M; s++) sum += Cl[s * N + i] * Ril[s > r ? MK_PACKED(s) + r : MK_PACKED(r) + s];
                Fl[r * N + i] = sum;
                for (int j = 0; j <= i; j++) Sl[MK_PACKED(i) + j] += sum * Cl[r * N + j];
            }
    }
}

/* --- runs ------------------------------------------------------------------------------------------------------------------- */

enum { START, PUT, INCREMENTAL, PUT_ESTIMATE, DIFFUSE, FUNCTIONS };
static const char *const names[FUNCTIONS] = {"start", "put", "incremental", "put_estimate", "diffuse"};
static uint32_t worst[FUNCTIONS];

typedef enum { ALL, SOME, NONE } arrivals_t;

static void scenario(const char *name, arrivals_t arrivals, int steps, real_t tolerance, int freezes) {
    mk_status_t status;
    uint32_t full = 0, failed = 0;
    real_t y[M], psi[N];
    config.tolerance = tolerance;
    config.steady = freezes ? &steady : 0;
    CALL(START, size_begin_start, node_start(&node, &config));
    for (int t = 0; t < steps && status == MK_OK; t++) {
        for (int l = 0; l < SLOTS; l++) {
            if (arrivals == NONE || (arrivals == SOME && draw() < (real_t)0.0f)) continue;
            for (int r = 0; r < M; r++) y[r] = draw();
            CALL(PUT, size_begin_put, node_put(&node, l, y));
        }
        if (node.core.steady && arrivals == ALL) CALL(INCREMENTAL, size_begin_frozen, node_incremental(&node));
        else {
            CALL(INCREMENTAL, size_begin_incremental, node_incremental(&node));
            full++;
        }
        if (status != MK_OK) {
            failed++;
            break;
        }
        for (int l = 1; l < SLOTS; l++) {
            if (arrivals == NONE || (arrivals == SOME && draw() < (real_t)0.0f)) continue;
            for (int i = 0; i < N; i++) psi[i] = node.psi[i] + (real_t)0.1f * draw();
            CALL(PUT_ESTIMATE, size_begin_put_estimate, node_put_estimate(&node, l, psi));
        }
        CALL(DIFFUSE, size_begin_diffuse, node_diffuse(&node));
    }
    mk_write("scenario ");
    mk_write(name);
    mk_write(" ");
    mk_write_number(full);
    mk_write(" ");
    mk_write_number(failed);
    mk_write("\n");
}

static void model(real_t P_size, real_t P_decay, real_t Q_size, real_t precision) {
    for (int i = 0; i < N * N; i++) A[i] = (real_t)(0.6f / (float)N) * draw() + (i % (N + 1) == 0 ? (real_t)0.6f : (real_t)0.0f);
    for (int i = 0; i < N; i++) x0[i] = draw();
    draw_covariance(N, Q_size, (real_t)0.5f, P_decay, Q);
    draw_covariance(N, P_size, (real_t)1.0f, P_decay, P0);
    draw_sensors(precision);
}

int main(void) {
    const filter_config_t made = {N, M, SLOTS, A, Q, 0, x0, P0, weight, rows, C, F, S, R_inverse, (real_t)0.0f, 0};
    config = made;
    size_loops();

    for (int turn = 0; turn < 3; turn++) {
        model((real_t)1.0f, (real_t)1.0f, (real_t)0.01f, (real_t)4.0f);
        scenario("all", ALL, 6, (real_t)0.02f, 0);
        scenario("some", SOME, 6, (real_t)0.02f, 0);
        scenario("none", NONE, 3, (real_t)0.02f, 0);
        scenario("plain", ALL, 3, (real_t)0.0f, 0);
        scenario("c=1e-6", SOME, 3, (real_t)1e-6f, 0);
        scenario("c=0.5", SOME, 3, (real_t)0.5f, 0);
        scenario("c=10", SOME, 3, (real_t)10.0f, 0);
        model((real_t)1.0f, (real_t)0.3f, (real_t)0.01f, (real_t)4.0f);
        scenario("ill-conditioned", SOME, 4, (real_t)0.02f, 0);
        scenario("ill-conditioned,c=1", NONE, 4, (real_t)1.0f, 0);
        model((real_t)1e6f, (real_t)1.0f, (real_t)0.01f, (real_t)4.0f);
        scenario("flat", ALL, 3, (real_t)0.02f, 0);
        model((real_t)0.01f, (real_t)1.0f, (real_t)1e-4f, (real_t)1e-4f);
        scenario("weak-sensors", ALL, 4, (real_t)0.1f, 0);
    }

    /* The frozen gain: its limit is where the filter has come to; Phi and G may be any numbers, as counts do not depend on them. */
    model((real_t)1.0f, (real_t)1.0f, (real_t)0.01f, (real_t)4.0f);
    scenario("settling", ALL, 30, (real_t)0.02f, 0);
    memcpy(limit, node.W, sizeof limit);
    steady.Phi = A;
    steady.G = F;
    steady.W = limit;
    steady.theta = node.core.theta;
    steady.trace_P = node.core.trace_P;
    steady.close = (real_t)0.01f;
    steady.period = 5;
    scenario("freezing", ALL, 40, (real_t)0.02f, 1);

    size_tell(FUNCTIONS, names, worst, (uint32_t)sizeof node);
    return 0;
}
