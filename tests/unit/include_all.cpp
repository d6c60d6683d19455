/* SPDX-License-Identifier: MIT */
/* Every public header in C++17, and both ways of declaring a filter and a node in both precisions: it compiles, links, and takes a step. */
#include <meshkal/angle.h>
#include <meshkal/base.h>
#include <meshkal/consensus.h>
#include <meshkal/duif.h>
#include <meshkal/extended.h>
#include <meshkal/frame.h>
#include <meshkal/gamma.h>
#include <meshkal/gate.h>
#include <meshkal/model.h>
#include <meshkal/monitor.h>
#include <meshkal/node.h>
#include <meshkal/quantile.h>
#include <meshkal/record.h>
#include <meshkal/rkfd.h>
#include <meshkal/tracking.h>
#include <meshkal/unscented.h>
#include <meshkal/unrolled.h>

#include <cstdint>
#include <type_traits>

namespace {

MK_RKFD(shared_f32, f32, 2, 1, 1);
MK_RKFD(shared_f64, f64, 2, 1, 1);
MK_EXTENDED(shared_f32, f32, 2, 1, 1);
MK_EXTENDED(shared_f64, f64, 2, 1, 1);
MK_RKFD_UNROLLED(unrolled_f32, f32, 2, 1, 1);
MK_RKFD_UNROLLED(unrolled_f64, f64, 2, 1, 1);
MK_NODE(node_f32, f32, 2, 1, 1);
MK_NODE(node_f64, f64, 2, 1, 1);
MK_NODE_UNROLLED(quick_f32, f32, 2, 1, 1);
MK_NODE_UNROLLED(quick_f64, f64, 2, 1, 1);

MK_CONSENSUS(consensus_f32, f32, 2, 2);
MK_CONSENSUS(consensus_f64, f64, 2, 2);
MK_DUIF(duif_f32, f32, 2, 1, 1);
MK_DUIF(duif_f64, f64, 2, 1, 1);

static_assert(std::is_standard_layout<shared_f32_t>::value && std::is_trivially_copyable<shared_f32_t>::value, "plain C structs");
static_assert(std::is_standard_layout<unrolled_f64_t>::value && std::is_trivially_copyable<unrolled_f64_t>::value, "plain C structs");

MK_UNSCENTED(tracker_f32, f32, 2, 1, 2);
MK_UNSCENTED(tracker_f64, f64, 2, 1, 2);
static_assert(std::is_standard_layout<tracker_f32_t>::value && std::is_trivially_copyable<tracker_f64_t>::value, "plain C structs");

template <typename T> struct constants {
    T A[4] = {1, T(0.125), 0, 1}, Q[3] = {T(0.25), 0, T(0.25)}, x0[2] = {0, 0}, P0[3] = {1, 0, 1}, weight[1] = {1};
    T C[2] = {1, 0}, R[1] = {1}, F[2], S[3], R_inverse[1], work[3];
    std::uint8_t rows[1] = {1};
};

#define STEP(name, real)                                                                                                       \
    [] {                                                                                                                       \
        static constants<mk_##real##_t> k;                                                                                     \
        static name##_t filter;                                                                                                \
        mk_##real##_t y[1] = {2}, psi[2] = {0, 0}, V[3], e[1], E[1];                                                           \
        bool good = mk_rkfd_sensor_##real(2, 1, 1, k.C, k.R, k.F, k.S, k.R_inverse, k.work) == MK_OK;                          \
        const name##_config_t config = {2,      1,   1,   k.A, k.Q, nullptr,     k.x0,                 k.P0, k.weight,         \
                                        k.rows, k.C, k.F, k.S, k.R_inverse, mk_##real##_t(0.02), nullptr};                     \
        good = good && name##_start(&filter, &config) == MK_OK && name##_put_measurement(&filter, 0, y) == MK_OK;              \
        good = good && name##_put_innovation(&filter, 0, y) == MK_ERROR_REPEATED && name##_predict(&filter, 0, e, E) == MK_OK; \
        good = good && name##_incremental(&filter, nullptr) == MK_OK && name##_put_estimate(&filter, 1, psi) != MK_OK;         \
        good = good && name##_intermediate(&filter)[0] > 0 && name##_diffuse(&filter) == MK_OK;                                \
        good = good && name##_estimate(&filter)[0] > 0 && name##_covariance(&filter, V) == MK_OK && V[0] > 0;                  \
        good = good && name##_set_tolerance(&filter, 0) == MK_OK && name##_restart(&filter, k.x0, k.P0) == MK_OK;              \
        return good;                                                                                                           \
    }()

#define EXTENDED(name, real)                                                                                                   \
    [] {                                                                                                                       \
        static constants<mk_##real##_t> k;                                                                                     \
        static name##_t filter;                                                                                                \
        const mk_##real##_t z[1] = {2};                                                                                        \
        const mk_model_##real##_t sees = {[](const void *, mk_##real##_t, int, const mk_##real##_t *x, mk_##real##_t *y) {     \
                                              y[0] = x[0];                                                                     \
                                              return MK_OK;                                                                    \
                                          },                                                                                   \
                                          [](const void *, mk_##real##_t, const mk_##real##_t *, mk_##real##_t *J) {           \
                                              J[0] = 1;                                                                        \
                                              J[1] = 0;                                                                        \
                                              return MK_OK;                                                                    \
                                          },                                                                                   \
                                          nullptr, nullptr};                                                                   \
        const mk_sensor_##real##_t sensor = {sees, k.R, 1};                                                                    \
        static mk_##real##_t A[4], Q[3];                                                                                       \
        const mk_transition_##real##_t transition = {{nullptr, nullptr, nullptr, nullptr}, k.A, k.Q};                          \
        const name##_extended_t model = {&transition, &sensor, A, Q, k.C, k.F, k.S, k.R_inverse};                              \
        const name##_config_t config = {2,      1,   1,   A,   Q,   nullptr,     k.x0,                 k.P0, k.weight,         \
                                        k.rows, k.C, k.F, k.S, k.R_inverse, mk_##real##_t(0.02), nullptr};                     \
        return name##_start(&filter, &config) == MK_OK && name##_observe(&filter, &model, 0, z) == MK_OK &&                    \
               name##_correct(&filter, &model) == MK_OK && name##_diffuse(&filter) == MK_OK && name##_estimate(&filter)[0] == 1 && \
               name##_propagate(&filter, &model, 1, nullptr) == MK_OK && filter.core.theta > 0;                                \
    }()

#define NODE(name, real)                                                                                                       \
    [] {                                                                                                                       \
        static constants<mk_##real##_t> k;                                                                                     \
        static name##_t node, other;                                                                                           \
        static name##_secure_t secure;                                                                                         \
        static std::uint8_t blob[name##_blob_max], frame[name##_frame_max], record[2000];                                      \
        static const std::uint16_t nodes[1] = {7};                                                                             \
        const mk_##real##_t y[1] = {2};                                                                                        \
        bool good = mk_rkfd_sensor_##real(2, 1, 1, k.C, k.R, k.F, k.S, k.R_inverse, k.work) == MK_OK;                          \
        name##_config_t config = {{2,      1,   1,   k.A, k.Q, nullptr,     k.x0,                 k.P0, k.weight,              \
                                   k.rows, k.C, k.F, k.S, k.R_inverse, mk_##real##_t(0.02), nullptr}, nodes, 1, 5, MK_NUMBERS_F32, 0, nullptr, nullptr}; \
        mk_recorder_t recorder = {record, sizeof record, 0, 0, 1};                                                             \
        good = good && name##_start(&node, &config) == MK_OK && name##_record(&node, &recorder) == MK_OK;                      \
        good = good && name##_measure(&node, y) == MK_OK && name##_frame(&node, MK_STAGE_MEASUREMENT, frame) == 20;            \
        good = good && name##_accept(&node, frame, 20) == MK_ERROR_STRANGER && name##_incremental(&node) == MK_OK;             \
        good = good && name##_intermediate(&node)[0] > 0 && name##_diffuse(&node) == MK_OK && name##_advance(&node, 3) == MK_OK; \
        const std::size_t length = name##_save(&node, blob);                                                                   \
        good = good && name##_restore(&other, &config, blob, length) == MK_OK && name##_estimate(&other)[0] == name##_estimate(&node)[0]; \
        good = good && name##_incremental_with(&other, k.x0) == MK_OK && name##_set_tolerance(&other, 0) == MK_OK;             \
        good = good && name##_restart(&other, k.x0, k.P0) == MK_OK && name##_secure(&other, &secure, nullptr, 0) == MK_ERROR_ARGUMENT; \
        return good && recorder.lost == 0;                                                                                     \
    }()

template <typename T> mk_status_t first(const void *, T, int count, const T *x, T *y) {
    for (int k = 0; k < count; k++) y[k] = x[2 * k];
    return MK_OK;
}

#define TRACKER(name, real)                                                                                                    \
    [] {                                                                                                                       \
        static constants<mk_##real##_t> k;                                                                                     \
        static const mk_##real##_t threshold[2] = {50, 50};                                                                    \
        static const mk_gate_##real##_t gate = {threshold, nullptr, 3, MK_GATE_SKIP};                                          \
        static const mk_sensor_##real##_t one = {{first<mk_##real##_t>, nullptr, nullptr, nullptr}, k.R, 1};                   \
        static const mk_sensor_##real##_t sensors[2] = {one, one};                                                             \
        static const name##_config_t config = {2, 1, 2, {{nullptr, nullptr, nullptr, nullptr}, k.A, k.Q}, sensors, k.x0, k.P0, MK_TRANSFORM_CUBATURE(2), \
                                               &gate, 1, MK_UPDATE_UNSCENTED, MK_RULE_NONE, 0};                       \
        static name##_t filter;                                                                                                \
        const mk_##real##_t z[1] = {2};                                                                                        \
        mk_##real##_t P[3], s[2], S[3];                                                                                        \
        bool good = name##_start(&filter, &config) == MK_OK && name##_predict(&filter, 1, nullptr) == MK_OK;                   \
        good = good && name##_put(&filter, 0, z) == MK_OK && name##_put(&filter, 1, z) == MK_OK && name##_drop(&filter, 1) == MK_OK; \
        good = good && name##_update(&filter) == MK_OK && name##_put(&filter, 1, z) == MK_OK;                                  \
        good = good && name##_contribution(&filter, s, S) == MK_OK && name##_inform(&filter, 1, s, S) == MK_OK;                \
        good = good && name##_covariance(&filter, P) == MK_OK && P[0] > 0 && name##_root(&filter)[0] > 0;                      \
        return good && name##_estimate(&filter)[0] > 1 && name##_restart(&filter, k.x0, k.P0) == MK_OK;                        \
    }()

#define CONSENSUS(name, real)                                                                                                  \
    [] {                                                                                                                       \
        static name##_t c;                                                                                                     \
        static const std::uint16_t degree[2] = {1, 1};                                                                         \
        const name##_config_t config = {2, 2, 1, 2, MK_CONSENSUS_METROPOLIS, 0, nullptr, degree};                              \
        const mk_##real##_t own[2] = {1, 2}, other[2] = {3, 4};                                                                \
        mk_##real##_t mean[2];                                                                                                 \
        bool good = name##_start(&c, &config) == MK_OK && name##_numbers(&config) == 2 && name##_begin(&c, own, 1) == MK_OK;   \
        good = good && name##_message(&c)[1] == 2 && name##_put(&c, 1, 0, other) == MK_OK && name##_iterate(&c) == MK_OK;      \
        good = good && name##_average(&c, mean) == MK_OK && mean[0] == 2 && mean[1] == 3;                                      \
        name##_reset(&c);                                                                                                      \
        return good && name##_average(&c, mean) == MK_ERROR_ORDER;                                                             \
    }()

#define DUIF(name, real)                                                                                                       \
    [] {                                                                                                                       \
        static constants<mk_##real##_t> k;                                                                                     \
        static name##_t node;                                                                                                  \
        static name##_secure_t secure;                                                                                         \
        static std::uint8_t frame[name##_frame_max];                                                                           \
        static const std::uint16_t nodes[1] = {7}, degree[1] = {0};                                                            \
        static mk_sensor_##real##_t sensor = {{first<mk_##real##_t>, nullptr, nullptr, nullptr}, k.R, 1};                      \
        static name##_config_t config = {};                                                                                    \
        mk_##real##_t z[1] = {2}, P[3];                                                                                        \
        config.filter.n = 2;                                                                                                   \
        config.filter.m = config.filter.slots = config.filter.increments = 1;                                                  \
        config.filter.transition.A = k.A;                                                                                      \
        config.filter.transition.Q = k.Q;                                                                                      \
        config.filter.sensor = &sensor;                                                                                        \
        config.filter.x0 = k.x0;                                                                                               \
        config.filter.P0 = k.P0;                                                                                               \
        config.filter.transform.spread = 3;                                                                                    \
        config.filter.transform.correction = -1;                                                                               \
        config.consensus = {5, 1, 1, 1, MK_CONSENSUS_METROPOLIS, 0, nullptr, degree};                                          \
        config.nodes = nodes;                                                                                                  \
        bool good = name##_start(&node, &config) == MK_OK && name##_secure(&node, &secure, nullptr, 0) == MK_ERROR_ARGUMENT;   \
        good = good && name##_predict(&node, 1, nullptr) == MK_OK && name##_measure(&node, z) == MK_OK;                        \
        good = good && name##_contribute(&node) == MK_OK && name##_frame(&node, frame) > 0 && name##_drop(&node) == MK_OK;     \
        good = good && name##_accept(&node, frame, 30) != MK_OK && name##_iterate(&node) == MK_OK && name##_fuse(&node) == MK_OK; \
        good = good && name##_estimate(&node)[0] > 0 && name##_root(&node)[0] > 0 && name##_covariance(&node, P) == MK_OK;     \
        return good && name##_advance(&node, 3) == MK_OK && name##_restart(&node, k.x0, k.P0) == MK_OK;                        \
    }()

template <typename T> bool gamma(int (*root)(int, const T *, T, T *, T *), int (*value)(int, const T *, T, T *, T *, T *)) {
    const T P[MK_PACKED(2)] = {2, 0, 1};
    T work[MK_GAMMA_WORK(2)], theta, found;
    return root(2, P, T(0.02), &theta, work) > 0 && value(2, P, theta, &found, nullptr, work) == 1;
}

#define TRACKING(real)                                                                                                         \
    [] {                                                                                                                       \
        static const mk_motion_t motion = {4, 2, {0, 2}, {1, 3}, 0};                                                           \
        static const mk_site_##real##_t mast = {&motion, {1, 0}, {}};                                                          \
        const mk_model_##real##_t moves = {mk_constant_velocity_##real, mk_constant_velocity_jacobian_##real, &motion, nullptr}; \
        const mk_space_##real##_t angles = {mk_bearing_difference_##real, nullptr, &motion};                                   \
        const mk_model_##real##_t sees = {mk_bearing_##real, mk_bearing_jacobian_##real, &mast, &angles};                      \
        const mk_##real##_t x[4] = {1, 0, 0, 1};                                                                               \
        mk_##real##_t later[4], y[1], sine, cosine;                                                                            \
        mk_sincos_##real(0, &sine, &cosine);                                                                                   \
        return mk_motion_check(&motion, MK_MOTION_VELOCITY) == MK_OK && cosine == 1 && mk_atan2_##real(sine, cosine) == 0 &&   \
               mk_wrap_##real(7) < 1 && moves.function(moves.context, 2, 1, x, later) == MK_OK && later[2] == 2 &&             \
               sees.function(sees.context, 0, 1, later, y) == MK_OK && y[0] > 1;                                               \
    }()

} // namespace

int main() {
    const bool good = STEP(shared_f32, f32) && STEP(shared_f64, f64) && STEP(unrolled_f32, f32) && STEP(unrolled_f64, f64) &&
                      EXTENDED(shared_f32, f32) && EXTENDED(shared_f64, f64) &&
                      NODE(node_f32, f32) && NODE(node_f64, f64) && NODE(quick_f32, f32) && NODE(quick_f64, f64) &&
                      CONSENSUS(consensus_f32, f32) && CONSENSUS(consensus_f64, f64) && DUIF(duif_f32, f32) && DUIF(duif_f64, f64) &&
                      gamma<float>(mk_gamma_root_f32, mk_gamma_f32) && gamma<double>(mk_gamma_root_f64, mk_gamma_f64) &&
                      TRACKING(f32) && TRACKING(f64) && TRACKER(tracker_f32, f32) && TRACKER(tracker_f64, f64) && mk_status_name(MK_OK)[0] == 'M';
    return good ? 0 : 1;
}
