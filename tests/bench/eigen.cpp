/* SPDX-License-Identifier: MIT */
// The step in Eigen with fixed sizes, in the same information form as Meshkal: W = V^-1 is carried, Y = L L' solved by Cholesky,
// P^-1 by another. theta comes from Eigen's eigenvalues of P and Newton's method, or from mk_gamma_root of libmeshkal, which
// separates the price of the root from that of the algebra.
#include <Eigen/Dense>
#include <cmath>
#include <type_traits>

#include <meshkal/gamma.h>

#include "bench.h"

namespace {

constexpr int M = BENCH_M, SLOTS = BENCH_SLOTS;

template <typename T> const auto &data(const bench_case *c) {
    if constexpr (std::is_same_v<T, float>) return c->f;
    else return c->d;
}

template <typename T, int N, bool EIGENVALUES> struct Filter {
    using Square = Eigen::Matrix<T, N, N>;
    using Vector = Eigen::Matrix<T, N, 1>;
    using Reading = Eigen::Matrix<T, M, 1>;

    Square A, At, Q, W, P, S[SLOTS];
    Eigen::Matrix<T, M, N> C[SLOTS];
    Eigen::Matrix<T, N, M> F[SLOTS];
    Vector x;
    T weight[SLOTS], tolerance, theta;
    unsigned turn;

    static Square unpack(const T *packed) {
        Square full;
        for (int i = 0; i < N; i++)
            for (int j = 0; j <= i; j++) full(i, j) = full(j, i) = packed[BENCH_PACKED(i) + j];
        return full;
    }

    bool start(const bench_case *c) {
        const auto &d = data<T>(c);
        A = Eigen::Map<const Eigen::Matrix<T, N, N, Eigen::RowMajor>>(d.A);
        At = A.transpose();
        Q = unpack(d.Q);
        W = unpack(d.P0).inverse();
        x = Eigen::Map<const Vector>(d.x0);
        for (int l = 0; l < SLOTS; l++) {
            C[l] = Eigen::Map<const Eigen::Matrix<T, M, N, Eigen::RowMajor>>(d.C + l * M * N);
            F[l] = Eigen::Map<const Eigen::Matrix<T, N, M>>(d.F + l * M * N);
            S[l] = unpack(d.S + l * BENCH_PACKED(N));
            weight[l] = d.weight[l];
        }
        tolerance = d.tolerance[0];
        theta = 0;
        turn = 0;
        return true;
    }

    // Newton's method from the root of the last step, halving its way where a step leaves the interval.
    bool root_of_eigenvalues() {
        Eigen::SelfAdjointEigenSolver<Square> solver;
        solver.compute(P, Eigen::EigenvaluesOnly);
        const Vector lambda = solver.eigenvalues();
        const T pole = 1 / lambda(N - 1);
        T low = 0, high = pole, trial = theta > 0 && theta < pole ? theta : pole / 2;
        for (int i = 0; i < 100; i++) {
            const auto kept = (1 - trial * lambda.array()).eval();
            const auto t = (trial * lambda.array() / kept).eval();
            const T gamma = std::log(kept.prod()) + t.sum(), slope = t.square().sum() / trial;
            const T step = (tolerance - gamma) / slope;
            (step > 0 ? low : high) = trial;
            const T next = trial + step;
            if (std::abs(step) < std::sqrt(std::numeric_limits<T>::epsilon()) * trial) {
                theta = next;
                return true;
            }
            trial = next > low && next < high ? next : (low + high) / 2;
        }
        return false;
    }

    bool root_of_meshkal() {
        T packed[BENCH_PACKED(N)], work[MK_GAMMA_WORK(N)];
        for (int i = 0; i < N; i++)
            for (int j = 0; j <= i; j++) packed[BENCH_PACKED(i) + j] = P(i, j);
        if constexpr (std::is_same_v<T, float>) return mk_gamma_root_f32(N, packed, tolerance, &theta, work) > 0;
        else return mk_gamma_root_f64(N, packed, tolerance, &theta, work) > 0;
    }

    bool step(const T (*y)[M], const T (*psis)[BENCH_N]) {
        Square Y = W;
        Vector b = Vector::Zero();
        for (int l = 0; l < SLOTS; l++) {
            Y += S[l];
            b.noalias() += F[l] * (Eigen::Map<const Reading>(y[l]) - C[l] * x);
        }
        const Eigen::LLT<Square> factor(Y);
        if (factor.info() != Eigen::Success) return false;
        const Square X = factor.matrixL().solve(At);
        Vector psi = A * x;
        psi.noalias() += X.transpose() * factor.matrixL().solve(b);
        P = Q;
        P.noalias() += X.transpose() * X;
        const Eigen::LLT<Square> inverse(P);
        if (inverse.info() != Eigen::Success) return false;
        W = inverse.solve(Square::Identity());
        if (tolerance > 0) {
            if (!(EIGENVALUES ? root_of_eigenvalues() : root_of_meshkal())) return false;
            W.diagonal().array() -= theta;
        }
        x = weight[0] * psi;
        for (int l = 1; l < SLOTS; l++) x += weight[l] * Eigen::Map<const Vector>(psis[l]);
        return true;
    }
};

// A function object would not pass for the C function pointers of the interface: one static filter for each type.
template <typename T, int N, bool EIGENVALUES> struct Engine {
    static Filter<T, N, EIGENVALUES> &filter() {
        static Filter<T, N, EIGENVALUES> one;
        return one;
    }
    static int start(const bench_case *c) { return filter().start(c); }
    static int run(const bench_case *c, int steps) {
        const auto &d = data<T>(c);
        auto &f = filter();
        bool good = true;
        for (int t = 0; t < steps; t++) {
            const unsigned turn = f.turn++ % BENCH_MESSAGES;
            good &= f.step(d.y[turn], d.psi[turn]);
        }
        return good;
    }
    static void read(double *theta, double *x) {
        *theta = static_cast<double>(filter().theta);
        for (int i = 0; i < N; i++) x[i] = static_cast<double>(filter().x(i));
    }
};

template <typename T, int N, bool EIGENVALUES> constexpr bench_engine row() {
    using E = Engine<T, N, EIGENVALUES>;
    return {EIGENVALUES ? "Eigen" : "Eigen + mk root", N, 8 * static_cast<int>(sizeof(T)), E::start, E::run, E::read};
}

const bench_engine engines[] = {
    row<float, 4, true>(),   row<float, 6, true>(),   row<float, 9, true>(),   row<float, 17, true>(),
    row<double, 4, true>(),  row<double, 6, true>(),  row<double, 9, true>(),  row<double, 17, true>(),
    row<float, 4, false>(),  row<float, 6, false>(),  row<float, 9, false>(),  row<float, 17, false>(),
    row<double, 4, false>(), row<double, 6, false>(), row<double, 9, false>(), row<double, 17, false>(),
};

} // namespace

const bench_engine *bench_eigen(int *count) {
    *count = static_cast<int>(sizeof engines / sizeof *engines);
    return engines;
}
