/* SPDX-License-Identifier: MIT */
/* Vectors of meshkal/monitor.h: both schemes that decide on ends of faults, on sensors of one to two rows that come and go, with faults that are found,
   followed and called over. */
#include "vectors.h"

#include <math.h>
#include <string.h>

#include <meshkal/monitor.h>

enum { M = 2, PLACES = 4, WINDOW = 5, EPOCHS = 160, N = M * PLACES };

#if MK_BITS == 32
MK_MONITOR(watch, f32, M, PLACES, WINDOW);
#else
MK_MONITOR(watch, f64, M, PLACES, WINDOW);
#endif

const char *const vectors_passes[2] = {"dimensions known", "dimensions at run time"};

static const MK_REAL threshold[N] = {MK_R(24.0), MK_R(28.0), MK_R(31.0), MK_R(33.5), MK_R(36.0), MK_R(38.0), MK_R(41.0), MK_R(43.0)};
static const MK_REAL zero[M] = {MK_R(10.8), MK_R(13.8)}, back[M] = {MK_R(2.7), MK_R(4.6)};
static watch_t monitor;

static mk_status_t watch(vectors_kernels_t kernels, int sensors, const uint16_t *id, const uint8_t *rows, const MK_REAL *r, const MK_REAL *S) {
    MK_REAL work[MK_MONITOR_WORK(N)];
    if (kernels == VECTORS_SHARED) return watch_watch(&monitor, sensors, id, rows, r, S);
    const MK_F_T(mk_monitor_view) view = watch_view(&monitor, work);
    return MK_F(mk_monitor_watch)(&view, sensors, id, rows, r, S);
}

static void tell(void) {
    const MK_F_T(mk_monitor) *const core = &monitor.core;
    const MK_REAL numbers[] = {core->rctm, core->aime, core->rctm_ratio, core->aime_ratio, core->rho, core->median};
    vector_numbers("statistics", 6, numbers);
    vector_word("decisions", (uint32_t)(core->alarm | core->ended << 1 | core->unresolved << 2 | core->faulty << 4 | core->rows << 8 | core->window_rows << 16));
    for (int p = 0; p < PLACES; p++) {
        const MK_REAL own[] = {monitor.sensor[p].w, monitor.sensor[p].ratio};
        vector_numbers("w, ratio", 2, own);
        for (int i = p * M; i < (p + 1) * M && monitor.sensor[p].faulty; i++) {
            const MK_F_T(mk_fault) *const fault = monitor.fault + i;
            const MK_REAL tracker[] = {fault->level, fault->slope, fault->P[0], fault->P[1], fault->P[2], fault->sum, fault->all};
            vector_numbers("tracker", 7, tracker);
        }
    }
}

void vectors_run(vectors_kernels_t kernels) {
    static const uint8_t schemes[2] = {MK_MONITOR_IMPROVED, MK_MONITOR_EXCLUDE};
    draw_seed(33);
    for (int k = 0; k < 2; k++) {
        watch_config_t config;
        memset(&config, 0, sizeof config);
        config.m = M;
        config.places = PLACES;
        config.window = WINDOW;
        config.threshold = threshold;
        config.jump = MK_R(5.0);
        config.evidence = MK_R(11.5);
        config.zero = zero;
        config.back = back;
        config.level = MK_R(0.01);
        config.slope = MK_R(1e-4);
        config.most = 2;
        config.patience = 4;
        config.separation = MK_R(6.0);
        config.scheme = schemes[k];
        vector_begin("monitor", M, PLACES, WINDOW, schemes[k]);
        vector_word("start", (uint32_t)watch_start(&monitor, &config));
        for (int t = 0; t < EPOCHS; t++) {
            static const uint16_t id[PLACES] = {4, 300, 7, 65535};
            uint8_t rows[PLACES];
            MK_REAL r[N], S[MK_PACKED(N)];
            int n = 0;
            for (int l = 0; l < PLACES; l++) {
                rows[l] = (uint8_t)(draw_below(8) == 0 ? 0 : l % 2 + 1);
                for (int i = 0; i < rows[l]; i++) {
                    r[n] = MK_R(3.0) * draw();
                    /* A ramp on one sensor, a jump on another; the last one of the stream is not finite. */
                    if (l == 0 && t >= 20 && t < 60) r[n] += MK_R(0.5) * (MK_REAL)(t - 20);
                    if (l == 3 && t >= 80 && t < 120) r[n] += MK_R(14.0);
                    n++;
                }
            }
            draw_covariance(n, 1, MK_R(1.0), S);
            if (t == EPOCHS - 1) r[0] = (MK_REAL)INFINITY;
            vector_word("watch", (uint32_t)watch(kernels, PLACES, id, rows, r, S));
            tell();
        }
        vector_word("alarms, ends", monitor.core.alarms << 16 | monitor.core.ends);
    }
}
