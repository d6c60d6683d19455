/* SPDX-License-Identifier: MIT */
/* When is it over: meshkal/monitor.h, MK_MONITOR_EXCLUDE. */

/* Variance of what level and slope change in an epoch. */
#define MK_FAULT_LEVEL MK_R(0.01)
#define MK_FAULT_SLOPE MK_R(1e-4)

static void MK_F(mk_fault_begin)(int rows, const MK_REAL *z, MK_F_T(mk_fault) * fault) {
    for (int r = 0; r < rows; r++) {
        fault[r].level = z[r];
        fault[r].slope = MK_R(0.0);
        fault[r].P[0] = MK_R(1.0);
        fault[r].P[1] = MK_R(0.0);
        fault[r].P[2] = MK_R(0.1);
    }
}

/* One epoch of a sensor held faulty, with innovations z of unit variance. Returns log N(z; 0, 1) - log N(z; level, 1 + P). */
static MK_REAL MK_F(mk_fault_follow)(int rows, const MK_REAL *z, MK_F_T(mk_fault) * fault) {
    MK_REAL evidence = MK_R(0.0);
    for (int r = 0; r < rows; r++) {
        MK_REAL *const P = fault[r].P;
        fault[r].level += fault[r].slope;
        P[0] += MK_R(2.0) * P[1] + P[2] + MK_FAULT_LEVEL;
        P[1] += P[2];
        P[2] += MK_FAULT_SLOPE;
        const MK_REAL s = MK_R(1.0) + P[0], e = z[r] - fault[r].level, g = e / s;
        evidence += MK_R(0.5) * (e * g + MK_F(mk_log)(s) - z[r] * z[r]);
        fault[r].level += P[0] * g;
        fault[r].slope += P[1] * g;
        P[2] -= P[1] * P[1] / s;
        P[1] /= s;
        P[0] /= s;
    }
    return evidence;
}
