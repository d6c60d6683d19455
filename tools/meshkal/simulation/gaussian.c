/* SPDX-License-Identifier: MIT */
#include "simulation/gaussian.h"

#include <math.h>

void mk_gaussian_root(int n, const double *S, double *L) {
    for (int i = 0; i < n; i++) {
        double *row = L + i * (i + 1) / 2;
        for (int j = 0; j <= i; j++) {
            const double *other = L + j * (j + 1) / 2;
            double sum = S[i * (i + 1) / 2 + j];
            for (int k = 0; k < j; k++) sum -= row[k] * other[k];
            if (j < i) row[j] = other[j] > 0.0 ? sum / other[j] : 0.0;
            else row[i] = sum > 1e-14 * S[i * (i + 1) / 2 + i] ? sqrt(sum) : 0.0;
        }
    }
}

void mk_gaussian_add(mk_random_t *random, int n, const double *L, double *target) {
    double g[64];
    for (int i = 0; i < n; i++) g[i] = mk_random_normal(random);
    for (int i = 0; i < n; i++) {
        double sum = target[i];
        for (int j = 0; j <= i; j++) sum += L[i * (i + 1) / 2 + j] * g[j];
        target[i] = sum;
    }
}
