/* SPDX-License-Identifier: MIT */
/*
 * Example of own models (meshkal/plugin.h): a sensor of received signal strength and a vehicle that steers.
 *
 *     cc -std=c99 -O2 -ffp-contract=off -shared -fPIC -I include -I src -I port/host tools/meshkal/examples/own_models.c -o own_models.so
 *     meshkal draw vehicle.json --models own_models.so --measurements readings.csv
 *
 * signal-strength   1 row, dBm: z = s - 10 eta log10(r), r the distance in m; parameters s (dBm at 1 m) and eta (2 in free space).
 *                   Not defined at r = 0
 * vehicle           states px, py (m), heading (rad), speed (m/s), curvature (1/m), in this order; heading turns by speed times curvature;
 *                   the heading is wrapped. Parameters: densities of the random walks of speed (m^2/s^3) and curvature (1/(m^2 s))
 */
#include <math.h>
#include <meshkal/angle.h>
#include <meshkal/plugin.h>

enum { PX, PY, HEADING, SPEED, CURVATURE, STATES };

#define MK_BITS 32
#include <meshkal/real.h>
#include "own_models.tmpl.h"
#undef MK_BITS

#define MK_BITS 64
#include <meshkal/real.h>
#include "own_models.tmpl.h"
#undef MK_BITS

static const mk_plugin_model_t models[] = {
    {.name = "signal-strength", .kind = MK_PLUGIN_SENSOR, .size = 1, .parameters = 2,
     .f32 = {.function = strength_f32, .jacobian = strength_jacobian_f32},
     .f64 = {.function = strength_f64, .jacobian = strength_jacobian_f64}},
    {.name = "vehicle", .kind = MK_PLUGIN_MOTION, .size = STATES, .parameters = 2,
     .f32 = {.function = vehicle_f32, .jacobian = vehicle_jacobian_f32, .difference = vehicle_difference_f32, .noise = vehicle_noise_f32},
     .f64 = {.function = vehicle_f64, .jacobian = vehicle_jacobian_f64, .difference = vehicle_difference_f64, .noise = vehicle_noise_f64}},
};

static const mk_plugin_t table = {MK_PLUGIN_VERSION, sizeof models / sizeof models[0], models};

const mk_plugin_t *meshkal_plugin(void) { return &table; }
