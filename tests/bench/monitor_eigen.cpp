/* SPDX-License-Identifier: MIT */
// The window of the monitor in textbook form, in Eigen with fixed sizes: S^-1 and S^-1 r of each epoch are kept, and summed anew in every epoch.
#include <Eigen/Dense>

#include "monitor.h"

namespace {

template <typename T, int N> struct Window {
    using Square = Eigen::Matrix<T, N, N>;
    using Vector = Eigen::Matrix<T, N, 1>;
    Square S, Z[BENCH_WINDOW];
    Vector r, v[BENCH_WINDOW];
    int at = 0, held = 0;

    bool watch(const T *residual, const T *packed, T *q_R, T *q_A) {
        for (int i = 0; i < N; i++) {
            r(i) = residual[i];
            for (int j = 0; j <= i; j++) S(i, j) = S(j, i) = *packed++;
        }
        const Eigen::LLT<Square> factor(S);
        if (factor.info() != Eigen::Success) return false;
        Z[at] = factor.solve(Square::Identity());
        v[at].noalias() = Z[at] * r;
        *q_R = r.dot(v[at]);
        at = (at + 1) % BENCH_WINDOW;
        held = held < BENCH_WINDOW ? held + 1 : held;
        Square I = Z[0];
        Vector sum = v[0];
        for (int k = 1; k < held; k++) {
            I += Z[k];
            sum += v[k];
        }
        *q_A = sum.dot(I.llt().solve(sum));
        return true;
    }
};

template <typename T, int N> int watch(const T *r, const T *S, T *q_R, T *q_A) {
    static Window<T, N> window;
    return window.watch(r, S, q_R, q_A);
}

} // namespace

int eigen_watch_f32(int rows, const float *r, const float *S, float *q_R, float *q_A) {
    return rows == 8 ? watch<float, 8>(r, S, q_R, q_A) : watch<float, 16>(r, S, q_R, q_A);
}
int eigen_watch_f64(int rows, const double *r, const double *S, double *q_R, double *q_A) {
    return rows == 8 ? watch<double, 8>(r, S, q_R, q_A) : watch<double, 16>(r, S, q_R, q_A);
}
