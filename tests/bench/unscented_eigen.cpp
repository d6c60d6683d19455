/* SPDX-License-Identifier: MIT */
// Unscented and extended filters in textbook form, in Eigen with fixed sizes: P is carried, its Cholesky factor gives the sigma points, drawn
// again before the update; P -= K S K'. The models are known to the compiler.
#include <Eigen/Dense>
#include <cmath>

#include "unscented.h"

namespace {

constexpr int M = SCENE_ROWS;

template <typename T, int N> struct Filter {
    using Square = Eigen::Matrix<T, N, N>;
    using Vector = Eigen::Matrix<T, N, 1>;
    using Reading = Eigen::Matrix<T, M, 1>;
    using Points = Eigen::Matrix<T, N, 2 * N + 1>;

    Square P0, Q, P;
    Vector x0, x;
    Reading z[SCENE_STEPS], position[3];
    T dt, variance, spread, mean_weight, covariance_weight, weight;
    bool bearings, extended;
    int turn;

    bool start(const scene_t *scene, int filter) {
        if (filter > FILTER_EXTENDED) return false;
        for (int i = 0; i < N; i++) {
            x0(i) = T(scene->x0[i]);
            for (int j = 0; j <= i; j++) {
                P0(i, j) = P0(j, i) = T(scene->P0[SCENE_PACKED(i) + j]);
                Q(i, j) = Q(j, i) = T(scene->Q[SCENE_PACKED(i) + j]);
            }
        }
        for (int r = 0; r < M; r++)
            for (int d = 0; d < 3; d++) position[r](d) = T(scene->position[r][d]);
        for (int t = 0; t < SCENE_STEPS; t++)
            for (int r = 0; r < M; r++) z[t](r) = T(scene->z[t][r]);
        const double alpha = filter == FILTER_SCALED ? SCENE_ALPHA : 1.0, lambda = alpha * alpha * 3.0 - N;
        spread = T(N + lambda);
        weight = T(0.5 / (N + lambda));
        mean_weight = T(lambda / (N + lambda));
        covariance_weight = filter == FILTER_SCALED ? mean_weight + T(1.0 - alpha * alpha + SCENE_BETA) : mean_weight;
        dt = T(scene->dt);
        variance = T(scene->variance);
        bearings = scene->bearings;
        extended = filter == FILTER_EXTENDED;
        turn = 0;
        return true;
    }

    template <typename X> Vector moved(const X &from) const {
        Vector to;
        for (int i = 0; i < N; i += 2) {
            to(i) = from(i) + dt * from(i + 1);
            to(i + 1) = from(i + 1);
        }
        return to;
    }

    template <typename X> Reading seen(const X &from) const {
        Reading to;
        for (int r = 0; r < M; r++) {
            if (bearings) to(r) = std::atan2(from(2) - position[r](1), from(0) - position[r](0));
            else {
                T sum = 0;
                for (int d = 0; 2 * d < N; d++) sum += (from(2 * d) - position[r](d)) * (from(2 * d) - position[r](d));
                to(r) = std::sqrt(sum);
            }
        }
        return to;
    }

    bool draw(Points &X) const {
        const Eigen::LLT<Square> factor(P);
        if (factor.info() != Eigen::Success) return false;
        const Square L = std::sqrt(spread) * Square(factor.matrixL());
        X.col(0) = x;
        for (int j = 0; j < N; j++) {
            X.col(1 + j) = x + L.col(j);
            X.col(1 + N + j) = x - L.col(j);
        }
        return true;
    }

    template <typename Y> Eigen::Matrix<T, Y::RowsAtCompileTime, 1> mean(const Y &points) const {
        return mean_weight * points.col(0) + weight * points.template rightCols<2 * N>().rowwise().sum();
    }

    template <typename X, typename Y> Eigen::Matrix<T, X::RowsAtCompileTime, Y::RowsAtCompileTime> covariance(const X &a, const Y &b) const {
        return covariance_weight * a.col(0) * b.col(0).transpose() + weight * a.template rightCols<2 * N>() * b.template rightCols<2 * N>().transpose();
    }

    bool unscented(const Reading &reading) {
        Points X, Y;
        Eigen::Matrix<T, M, 2 * N + 1> Z;
        if (!draw(X)) return false;
        for (int k = 0; k <= 2 * N; k++) Y.col(k) = moved(X.col(k));
        x = mean(Y);
        Y.colwise() -= x;
        P = covariance(Y, Y) + Q;
        if (!draw(X)) return false;
        for (int k = 0; k <= 2 * N; k++) Z.col(k) = seen(X.col(k));
        const Reading expected = mean(Z);
        Z.colwise() -= expected;
        X.colwise() -= x;
        Eigen::Matrix<T, M, M> S = covariance(Z, Z);
        S.diagonal().array() += variance;
        return gain(S, covariance(X, Z), reading - expected);
    }

    bool gain(const Eigen::Matrix<T, M, M> &S, const Eigen::Matrix<T, N, M> &cross, const Reading &innovation) {
        const Eigen::LLT<Eigen::Matrix<T, M, M>> factor(S);
        if (factor.info() != Eigen::Success) return false;
        const Eigen::Matrix<T, N, M> K = factor.solve(cross.transpose()).transpose();
        x.noalias() += K * innovation;
        P.noalias() -= K * S * K.transpose();
        return true;
    }

    bool extend(const Reading &reading) {
        Square A = Square::Identity();
        for (int i = 0; i < N; i += 2) A(i, i + 1) = dt;
        x = moved(x);
        P = A * P * A.transpose() + Q;
        Eigen::Matrix<T, M, N> H = Eigen::Matrix<T, M, N>::Zero();
        for (int r = 0; r < M; r++) {
            if (bearings) {
                const T u = x(0) - position[r](0), v = x(2) - position[r](1), inverse = T(1) / (u * u + v * v);
                H(r, 0) = -v * inverse;
                H(r, 2) = u * inverse;
            } else {
                T sum = 0;
                for (int d = 0; 2 * d < N; d++) sum += (x(2 * d) - position[r](d)) * (x(2 * d) - position[r](d));
                const T inverse = T(1) / std::sqrt(sum);
                for (int d = 0; 2 * d < N; d++) H(r, 2 * d) = (x(2 * d) - position[r](d)) * inverse;
            }
        }
        const Eigen::Matrix<T, N, M> cross = P * H.transpose();
        Eigen::Matrix<T, M, M> S = H * cross;
        S.diagonal().array() += variance;
        return gain(S, cross, reading - seen(x));
    }

    bool run(int steps) {
        bool good = true;
        for (int t = 0; t < steps; t++) {
            const int at = turn++ % SCENE_STEPS;
            if (at == 0) {
                x = x0;
                P = P0;
            }
            good &= extended ? extend(z[at]) : unscented(z[at]);
        }
        return good;
    }
};

// A function object would not pass for the C function pointers of the interface: one static filter for each type.
template <typename T, int N> struct Engine {
    static Filter<T, N> &filter() {
        static Filter<T, N> one;
        return one;
    }
    static int start(const scene_t *scene, int kind) { return filter().start(scene, kind); }
    static int run(int steps) { return filter().run(steps); }
    static void read(double *x, double *P) {
        for (int i = 0; i < N; i++) {
            x[i] = double(filter().x(i));
            for (int j = 0; j <= i; j++) P[SCENE_PACKED(i) + j] = double(filter().P(i, j));
        }
    }
};

template <typename T, int N> constexpr contender_t row() {
    return {"Eigen, textbook form", N, 8 * int(sizeof(T)), Engine<T, N>::start, Engine<T, N>::run, Engine<T, N>::read};
}

const contender_t contenders[] = {row<float, 4>(), row<double, 4>(), row<float, 6>(), row<double, 6>()};

} // namespace

const contender_t *scene_eigen(int *count) {
    *count = static_cast<int>(sizeof contenders / sizeof *contenders);
    return contenders;
}
