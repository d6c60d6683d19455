/* SPDX-License-Identifier: MIT */
#include "scenario_published.h"

#include <stdio.h>
#include <string.h>

/* Spec 2.5: only N, R and dt are published; the rest are the settings that come closest. The gate is MPUKF's own there. */
static void print_incomplete(unsigned long long seed) {
    static const double place[3][2] = {{0, 0}, {2, 0}, {0, 2}};
    (void)printf("{\"name\": \"incomplete-measurements\",\n"
                 " \"model\": {\"motion\": \"constant-velocity\", \"states\": [\"px\", \"vx\", \"py\", \"vy\"], \"dt_s\": 1.0, \"acceleration_psd\": 1e-5,\n"
                 "  \"x0\": [3.0, 0.05, 3.0, 0.05], \"P0\": [[0.1, 0, 0, 0], [0, 1e-3, 0, 0], [0, 0, 0.1, 0], [0, 0, 0, 1e-3]], \"start\": \"estimate\"},\n"
                 " \"nodes\": [\n");
    for (int k = 0; k < 3; k++)
        (void)printf("  {\"sensor\": \"range\", \"position_m\": [%g, %g], \"R\": [[2e-3]], \"fault\": {\"probability\": 0.1, \"sigma\": 0.2}}%s\n",
                     place[k][0], place[k][1], k < 2 ? "," : "],");
    (void)printf(" \"edges\": [[0, 1], [0, 2]],\n"
                 " \"reading_loss\": 0.1,\n"
                 " \"tracking\": {\"transform\": {\"kind\": \"julier\", \"kappa\": -1}, \"increments\": 30, \"rule\": \"innovation\",\n"
                 "  \"gate\": {\"significance\": 1e-3, \"sensor\": false, \"stacked\": true, \"policy\": \"skip\", \"patience\": 0, \"filters\": [\"mpukf\"]}},\n"
                 " \"steps\": 60, \"seed\": %llu}\n",
                 seed);
}

/* Spec 4.3. */
static void print_distributed(unsigned long long seed, double range_limit) {
    static const double place[3][2] = {{0, 0}, {100, 0}, {50, 90}};
    (void)printf("{\"name\": \"distributed-unscented\",\n"
                 " \"model\": {\"motion\": \"constant-velocity\", \"states\": [\"px\", \"py\", \"vx\", \"vy\"], \"dt_s\": 1.0, \"acceleration_psd\": 0.01,\n"
                 "  \"x0\": [10.0, 20.0, 1.0, 0.6], \"P0\": [[25, 0, 0, 0], [0, 25, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], \"start\": \"estimate\"},\n"
                 " \"nodes\": [\n");
    for (int k = 0; k < 3; k++) {
        (void)printf("  {\"sensor\": \"range\", \"position_m\": [%g, %g], \"R\": [[1.0]]", place[k][0], place[k][1]);
        if (range_limit > 0.0) (void)printf(", \"range_limit_m\": %.17g", range_limit);
        (void)printf("}%s\n", k < 2 ? "," : "],");
    }
    (void)printf(" \"edges\": [[0, 1], [1, 2]],\n"
                 " \"tracking\": {\"transform\": {\"kind\": \"scaled\", \"alpha\": 1.0, \"beta\": 2.0, \"kappa\": 0.0},\n"
                 "  \"consensus\": {\"protocol\": \"metropolis\", \"iterations\": 10, \"information\": \"residual\"}},\n"
                 " \"tolerance\": 0.02, \"steps\": 80, \"seed\": %llu}\n",
                 seed);
}

/* Spec 3.4, with its fault of 0.15 m/s. */
static void print_gnss_ins(unsigned long long seed) {
    static const int elevation[8] = {75, 55, 48, 40, 33, 28, 22, 18}, azimuth[8] = {20, 110, 200, 290, 65, 155, 245, 335};
    (void)printf("{\"name\": \"gnss-ins\",\n"
                 " \"model\": {\"navigation\": {\"dt_s\": 1, \"imu_hz\": 100, \"speed_m_s\": 100,\n"
                 "  \"maneuvers\": [{\"turn_deg\": 45, \"from_s\": 100, \"to_s\": 118}, {\"climb_m\": 500, \"from_s\": 220, \"to_s\": 270},\n"
                 "   {\"turn_deg\": 45, \"from_s\": 330, \"to_s\": 348}],\n"
                 "  \"gyro_bias_deg_h\": [-0.0009, 0.0013, 0.0008], \"accelerometer_bias_ug\": [30, -45, 26],\n"
                 "  \"angle_random_walk_deg_sqrt_h\": 5e-4, \"velocity_random_walk_ug_sqrt_hz\": 10, \"clock_sf_m2_s\": 0.036, \"clock_sg_m2_s3\": 0.141,\n"
                 "  \"initial_sd\": {\"attitude_rad\": 1e-4, \"velocity_m_s\": 0.05, \"position_m\": 2, \"clock_bias_m\": 5, \"clock_drift_m_s\": 0.1},\n"
                 "  \"weights\": {\"normal\": [2.0, 5.0], \"significance\": [0.1, 0.01]}}},\n"
                 " \"nodes\": [\n");
    for (int k = 0; k < 8; k++)
        (void)printf("  {\"satellite\": %d, \"elevation_deg\": %d, \"azimuth_deg\": %d, \"sigma_m\": 2.5}%s\n", k + 1, elevation[k], azimuth[k], k < 7 ? "," : "],");
    (void)printf(" \"edges\": [],\n"
                 " \"faults\": [{\"node\": 0, \"from_s\": 150, \"to_s\": 299, \"rate\": 0.15}],\n"
                 " \"monitor\": {\"window\": 10, \"false_alarm\": 8e-10, \"jump\": 20},\n"
                 " \"steps\": 418, \"seed\": %llu}\n",
                 seed);
}

int mk_print_published(const char *kind, unsigned long long seed, double range_limit, mk_error_t *error) {
    if (strcmp(kind, "distributed-unscented") == 0) {
        print_distributed(seed, range_limit);
        return 1;
    }
    if (strcmp(kind, "incomplete-measurements") != 0 && strcmp(kind, "gnss-ins") != 0)
        return mk_fail(error, "scenario %s: must be projectile, incomplete-measurements, distributed-unscented or gnss-ins", kind);
    if (range_limit > 0.0) return mk_fail(error, "scenario %s: --range-limit is for another kind", kind);
    if (strcmp(kind, "gnss-ins") == 0) print_gnss_ins(seed);
    else print_incomplete(seed);
    return 1;
}
