/* SPDX-License-Identifier: MIT */
// An EKF update of 17 states with 8 rows of 8 sensors (GNSS/INS, spec 3.4), plain and with Student's row weights (meshkal/weights.h), beside the textbook
// form in Eigen with fixed sizes: S, gain, and with weights P in Joseph form. First that they agree, then ns an update, medians of rounds in which all
// take turns. Each update starts from the same prior; its cost, 153 numbers copied, is in all of them. One reading in eight is an outlier.
//
//   usage: weights [--rounds N]        Exit status 1 if two disagree, never for a time.
#include <Eigen/Dense>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <vector>

#include <meshkal/unrolled.h>

namespace {

constexpr int N = 17, M = 8, PRIORS = 16;

template <typename T> struct Case {
    Eigen::Matrix<T, N, N> P;
    Eigen::Matrix<T, M, N> H;
    Eigen::Matrix<T, M, 1> z;
    T R;
};

template <typename T> Case<T> draw(unsigned seed) {
    std::mt19937 source(seed);
    std::normal_distribution<double> normal;
    Case<T> c;
    Eigen::Matrix<double, N, N> G;
    for (int i = 0; i < N * N; i++) G(i) = normal(source);
    c.P = (G * G.transpose() / N + 0.1 * Eigen::Matrix<double, N, N>::Identity()).cast<T>();
    for (int i = 0; i < M * N; i++) c.H(i) = T(normal(source));
    c.R = T(2.5 * 2.5);
    for (int r = 0; r < M; r++) c.z(r) = T((r == int(seed) % M ? 60.0 : 5.0) * normal(source));
    return c;
}

template <typename T> T igg3(T u, T k0, T k1) {
    u = std::abs(u);
    return u <= k0 ? T(1) : u > k1 ? T(0) : k0 / u * ((k1 - u) / (k1 - k0)) * ((k1 - u) / (k1 - k0));
}

template <typename T> struct Eigens {
    Eigen::Matrix<T, N, 1> x;
    Eigen::Matrix<T, N, N> P;
    void update(const Case<T> &c, const T *k0, const T *k1) {
        const Eigen::Matrix<T, N, M> cross = c.P * c.H.transpose();
        Eigen::Matrix<T, M, M> S = c.H * cross;
        S.diagonal().array() += c.R;
        const Eigen::LLT<Eigen::Matrix<T, M, M>> factor(S);
        Eigen::Matrix<T, N, M> K = factor.solve(cross.transpose()).transpose();
        if (!k0) {
            x.noalias() = K * c.z;
            P = c.P;
            P.noalias() -= K * cross.transpose();
            return;
        }
        const Eigen::Matrix<T, M, 1> u = c.z.array() / S.diagonal().array().sqrt();
        for (int j = 0; j < M; j++) {
            const T mean = (u.sum() - u(j)) / (M - 1);
            T squares = 0;
            for (int i = 0; i < M; i++) squares += i == j ? T(0) : (u(i) - mean) * (u(i) - mean);
            K.col(j) *= igg3(T((u(j) - mean) / std::sqrt(squares / (M - 2) * (1 + T(1) / (M - 1)))), k0[M - 1], k1[M - 1]);
        }
        x.noalias() = K * c.z;
        const Eigen::Matrix<T, N, N> rest = Eigen::Matrix<T, N, N>::Identity() - K * c.H;
        P.noalias() = rest * c.P * rest.transpose();
        P.noalias() += c.R * K * K.transpose();
    }
};

template <typename T> struct Row {
    const T *h;
};

template <typename T> mk_status_t function(const void *context, T, int count, const T *x, T *y) {
    const T *const h = static_cast<const Row<T> *>(context)->h;
    for (int k = 0; k < count; k++) {
        y[k] = 0;
        for (int i = 0; i < N; i++) y[k] += h[i] * x[k * N + i];
    }
    return MK_OK;
}

template <typename T> mk_status_t slope(const void *context, T, const T *, T *J) {
    std::memcpy(J, static_cast<const Row<T> *>(context)->h, N * sizeof(T));
    return MK_OK;
}

MK_UNSCENTED(shared_f32, f32, 17, 1, 8);
MK_UNSCENTED(shared_f64, f64, 17, 1, 8);
MK_UNSCENTED_UNROLLED(unrolled_f32, f32, 17, 1, 8);
MK_UNSCENTED_UNROLLED(unrolled_f64, f64, 17, 1, 8);

// The names of one type of filter.
#define FILTER(name, real, T, Sensor, Config, Weights)                                                                         \
    struct name##_bench {                                                                                                      \
        using real_type = T;                                                                                                   \
        name##_t filter[PRIORS];                                                                                               \
        T H[PRIORS][M][N], P0[MK_PACKED(N)], A[N * N], x0[N], R[1];                                                            \
        Row<T> row[PRIORS][M];                                                                                                 \
        Sensor sensor[PRIORS][M];                                                                                              \
        Config config[PRIORS];                                                                                                 \
        Weights weights;                                                                                                       \
        T L[PRIORS][MK_PACKED(N)], k0[M], k1[M];                                                                               \
        bool make(const Case<T> *cases, bool weighted) {                                                                       \
            bool good = mk_weight_thresholds_##real(MK_STATISTIC_STUDENT, 0.1, M, k0) == MK_OK &&                              \
                        mk_weight_thresholds_##real(MK_STATISTIC_STUDENT, 0.01, M, k1) == MK_OK;                               \
            weights = {k0, k1, nullptr, nullptr, MK_STATISTIC_STUDENT};                                                        \
            std::memset(x0, 0, sizeof x0);                                                                                     \
            std::memset(A, 0, sizeof A);                                                                                       \
            R[0] = cases[0].R;                                                                                                 \
            for (int p = 0; p < PRIORS; p++) {                                                                                 \
                for (int i = 0; i < N; i++)                                                                                    \
                    for (int j = 0; j <= i; j++) P0[MK_PACKED(i) + j] = cases[p].P(i, j);                                      \
                for (int r = 0; r < M; r++) {                                                                                  \
                    for (int i = 0; i < N; i++) H[p][r][i] = cases[p].H(r, i);                                                 \
                    row[p][r].h = H[p][r];                                                                                     \
                    sensor[p][r] = {{function<T>, slope<T>, &row[p][r], nullptr}, R, 1};                                       \
                }                                                                                                              \
                Config &c = config[p];                                                                                         \
                std::memset(&c, 0, sizeof c);                                                                                  \
                c.n = N, c.m = 1, c.slots = M, c.transition.A = A, c.sensor = sensor[p], c.x0 = x0, c.P0 = P0;                 \
                c.increments = 1, c.update = MK_UPDATE_EXTENDED, c.weights = weighted ? &weights : nullptr;                    \
                good = good && name##_start(&filter[p], &c) == MK_OK;                                                          \
                std::memcpy(L[p], filter[p].L, sizeof L[p]);                                                                   \
            }                                                                                                                  \
            return good;                                                                                                       \
        }                                                                                                                      \
        bool update(const Case<T> *cases, int p) {                                                                             \
            std::memcpy(filter[p].L, L[p], sizeof L[p]);                                                                       \
            std::memset(filter[p].x, 0, sizeof filter[p].x);                                                                   \
            for (int r = 0; r < M; r++) name##_put(&filter[p], r, &cases[p].z(r));                                             \
            return name##_update(&filter[p]) == MK_OK;                                                                         \
        }                                                                                                                      \
        T covariance(int p, T *P) { return name##_covariance(&filter[p], P) == MK_OK ? T(0) : T(NAN); }                        \
    };
FILTER(shared_f32, f32, float, mk_sensor_f32_t, mk_unscented_config_f32_t, mk_row_weights_f32_t)
FILTER(shared_f64, f64, double, mk_sensor_f64_t, mk_unscented_config_f64_t, mk_row_weights_f64_t)
FILTER(unrolled_f32, f32, float, mk_sensor_f32_t, mk_unscented_config_f32_t, mk_row_weights_f32_t)
FILTER(unrolled_f64, f64, double, mk_sensor_f64_t, mk_unscented_config_f64_t, mk_row_weights_f64_t)

template <typename F> double time_of(F &&one) {
    const int turns = 4;
    const auto begin = std::chrono::steady_clock::now();
    for (int k = 0; k < turns; k++)
        for (int p = 0; p < PRIORS; p++) one(p);
    return std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin).count() / (turns * PRIORS);
}

double median(std::vector<double> &values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

template <typename Shared, typename Unrolled> bool run(int rounds, double limit) {
    using T = typename Shared::real_type;
    static Case<T> cases[PRIORS];
    static Shared shared;
    static Unrolled unrolled;
    static Eigens<T> eigen;
    for (int p = 0; p < PRIORS; p++) cases[p] = draw<T>(unsigned(p + 1));
    for (int weighted = 0; weighted < 2; weighted++) {
        double apart = 0;
        int rows = 0;
        std::vector<double> times[3];
        if (!shared.make(cases, weighted) || !unrolled.make(cases, weighted)) return false;
        const T *const k0 = weighted ? shared.k0 : nullptr, *const k1 = shared.k1;
        for (int p = 0; p < PRIORS; p++) {
            T P[MK_PACKED(N)];
            if (!shared.update(cases, p) || !unrolled.update(cases, p) || shared.covariance(p, P) != 0) return false;
            if (std::memcmp(shared.filter[p].L, unrolled.filter[p].L, sizeof shared.filter[p].L) != 0) return false;
            eigen.update(cases[p], k0, k1);
            rows += shared.filter[p].core.weighted_rows;
            for (int i = 0; i < N; i++) {
                apart = std::max(apart, double(std::abs(shared.filter[p].x[i] - eigen.x(i)) / std::sqrt(eigen.P(i, i))));
                for (int j = 0; j <= i; j++)
                    apart = std::max(apart, double(std::abs(P[MK_PACKED(i) + j] - eigen.P(i, j)) / std::sqrt(eigen.P(i, i) * eigen.P(j, j))));
            }
        }
        bool good = apart < limit;
        for (int round = 0; round < rounds; round++) {
            times[0].push_back(time_of([&](int p) { good &= shared.update(cases, p); }));
            times[1].push_back(time_of([&](int p) { good &= unrolled.update(cases, p); }));
            times[2].push_back(time_of([&](int p) { eigen.update(cases[p], k0, k1); }));
        }
        std::printf("| float%d | %s | %.1f | %.0f | %.0f | %.0f | %.1e |\n", int(8 * sizeof(T)), weighted ? "Student's weights" : "plain", double(rows) / PRIORS,
                    median(times[0]), median(times[1]), median(times[2]), apart);
        if (!good) return std::fprintf(stderr, "weights: Meshkal and Eigen differ by %.1e standard deviations, or an update fails\n", apart), false;
    }
    return true;
}

} // namespace

int main(int count, char **arguments) {
    const int rounds = count == 3 && std::strcmp(arguments[1], "--rounds") == 0 ? std::atoi(arguments[2]) : 200;
    if (rounds < 1) return 2;
    std::printf("EKF update, 17 states, 8 rows: ns (medians). With weights Eigen computes P in Joseph form; difference in standard deviations.\n\n"
                "| numbers | gain | rows with a weight below 1 | Meshkal shared | unrolled | Eigen | difference |\n|---|---|---|---|---|---|---|\n");
    return !(run<shared_f32_bench, unrolled_f32_bench>(rounds, 1e-3) && run<shared_f64_bench, unrolled_f64_bench>(rounds, 1e-10));
}
