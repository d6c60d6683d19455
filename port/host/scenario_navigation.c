/* SPDX-License-Identifier: MIT */
#include "scenario_navigation.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define DEGREE (PI / 180.0)
#define DEGREE_AN_HOUR (DEGREE / 3600.0)
#define MICRO_G (1e-6 * 9.80665)
/* Steps of the inertial unit between two epochs. */
enum { MOST_SAMPLES = 100000 };

static const char *const model_keys[] = {"navigation", NULL};
static const char *const keys[] = {"dt_s", "imu_hz", "start_s", "speed_m_s", "heading_deg", "position_m", "gravity_m_s2", "maneuvers", "gyro_bias_deg_h",
                                   "accelerometer_bias_ug", "angle_random_walk_deg_sqrt_h", "velocity_random_walk_ug_sqrt_hz", "clock_sf_m2_s",
                                   "clock_sg_m2_s3", "initial_sd", "biases", "estimate", "satellite_range_m", "weights", NULL};
static const char *const sd_keys[] = {"attitude_rad", "velocity_m_s", "position_m", "gyro_bias_deg_h", "accelerometer_bias_ug", "clock_bias_m",
                                      "clock_drift_m_s", NULL};
static const char place[] = "model.navigation";
static const char positive[] = "a number above 0", not_negative[] = "a number, 0 or above", number[] = "a number";

/* Member `name` of the object at `key` as three numbers times `unit`; missing: as they are. */
static int read_three(mk_reader_t *reader, json_t *object, const char *key, const char *name, double unit, double *three) {
    json_t *value = json_object_get(object, name);
    char at[120];
    if (!value) return 1;
    (void)snprintf(at, sizeof at, "%.60s.%.50s", key, name);
    if (!mk_read_vector(reader, value, at, 3, three)) return 0;
    for (int i = 0; i < 3; i++) three[i] *= unit;
    return 1;
}

static int read_maneuver(mk_reader_t *reader, json_t *value, const char *at, const mk_navigation_t *nav, mk_maneuver_t *m) {
    static const char *const known[] = {"turn_deg", "climb_m", "from_s", "to_s", NULL};
    char place_of_climb[80];
    if (!mk_read_keys(reader, value, at, known)) return 0;
    const int turns = json_object_get(value, "turn_deg") != NULL;
    m->climbs = !turns;
    if (turns == (json_object_get(value, "climb_m") != NULL)) return mk_read_bad(reader, at, "needs one of turn_deg and climb_m");
    if (!mk_read_member(reader, value, at, "from_s", 1) || !mk_read_member(reader, value, at, "to_s", 1) ||
        !mk_read_between(reader, value, at, turns ? "turn_deg" : "climb_m", -1e6, 1e6, "a number, 1e6 at most", &m->amount) ||
        !mk_read_between(reader, value, at, "from_s", -DBL_MAX, DBL_MAX, number, &m->from_s) ||
        !mk_read_between(reader, value, at, "to_s", -DBL_MAX, DBL_MAX, number, &m->to_s))
        return 0;
    if (!(m->to_s > m->from_s)) return mk_read_bad(reader, at, "to_s must be above from_s, %g", m->from_s);
    if (turns) m->amount *= DEGREE;
    (void)snprintf(place_of_climb, sizeof place_of_climb, "%.60s.climb_m", at);
    return turns || 2.0 * fabs(m->amount) / (m->to_s - m->from_s) <= 0.5 * nav->speed ||
           mk_read_bad(reader, place_of_climb, "is steeper than 30 degrees at %g m/s: climb less, or longer", nav->speed);
}

static int read_maneuvers(mk_reader_t *reader, json_t *object, mk_navigation_t *nav) {
    json_t *list = json_object_get(object, "maneuvers");
    if (!list) return 1;
    if (!json_is_array(list) || json_array_size(list) > 1000) return mk_read_bad(reader, "model.navigation.maneuvers", "must be an array, of 1000 at most");
    nav->maneuvers = (int)json_array_size(list);
    nav->maneuver = mk_allocate((size_t)nav->maneuvers + 1, sizeof *nav->maneuver);
    for (int i = 0; i < nav->maneuvers; i++) {
        mk_maneuver_t *const m = &nav->maneuver[i];
        char at[64];
        (void)snprintf(at, sizeof at, "model.navigation.maneuvers[%d]", i);
        if (!read_maneuver(reader, json_array_get(list, (size_t)i), at, nav, m)) return 0;
        for (int j = 0; j < i; j++)
            if (nav->maneuver[j].climbs == m->climbs && nav->maneuver[j].from_s < m->to_s && m->from_s < nav->maneuver[j].to_s)
                return mk_read_bad(reader, at, "overlaps maneuver %d, which %s, too", j, m->climbs ? "climbs" : "turns");
    }
    return 1;
}

static int read_sd(mk_reader_t *reader, json_t *object, mk_navigation_t *nav) {
    static const char at[] = "model.navigation.initial_sd";
    static const int from[] = {MK_NAV_ATTITUDE, MK_NAV_VELOCITY, MK_NAV_POSITION, -1, -1, MK_NAV_CLOCK, MK_NAV_DRIFT};
    json_t *sd = mk_read_member(reader, object, place, "initial_sd", 1);
    if (!sd || !mk_read_keys(reader, sd, at, sd_keys)) return 0;
    for (int i = 0; sd_keys[i]; i++) {
        if (from[i] < 0) continue;
        double *const value = nav->sd + from[i];
        if (!mk_read_member(reader, sd, at, sd_keys[i], 1) || !mk_read_between(reader, sd, at, sd_keys[i], DBL_MIN, 1e9, positive, value)) return 0;
        if (from[i] < MK_NAV_GYRO) value[1] = value[2] = value[0];
    }
    for (int i = 0; i < 3; i++) {
        nav->sd[MK_NAV_GYRO + i] = fabs(nav->gyro_bias[i]);
        nav->sd[MK_NAV_ACCELEROMETER + i] = fabs(nav->accelerometer_bias[i]);
    }
    if (!read_three(reader, sd, at, "gyro_bias_deg_h", DEGREE_AN_HOUR, nav->sd + MK_NAV_GYRO) ||
        !read_three(reader, sd, at, "accelerometer_bias_ug", MICRO_G, nav->sd + MK_NAV_ACCELEROMETER))
        return 0;
    for (int i = MK_NAV_GYRO; i < MK_NAV_CLOCK; i++)
        if (!(nav->sd[i] > 0.0))
            return mk_read_bad(reader, at, "%s is not above 0 (it is the size of the bias itself where it is not given)",
                               i < MK_NAV_ACCELEROMETER ? "gyro_bias_deg_h" : "accelerometer_bias_ug");
    return 1;
}

static int read_weights(mk_reader_t *reader, json_t *object, mk_navigation_t *nav) {
    static const char at[] = "model.navigation.weights";
    static const char *const known[] = {"normal", "significance", NULL};
    json_t *weights = json_object_get(object, "weights"), *normal = json_object_get(weights, "normal"), *tail = json_object_get(weights, "significance");
    double k[2] = {2.0, 5.0};
    nav->significance[0] = 0.1;
    nav->significance[1] = 0.01;
    if (weights && !mk_read_keys(reader, weights, at, known)) return 0;
    if ((normal && !mk_read_vector(reader, normal, "model.navigation.weights.normal", 2, k)) ||
        (tail && !mk_read_vector(reader, tail, "model.navigation.weights.significance", 2, nav->significance)))
        return 0;
    nav->k0 = k[0];
    nav->k1 = k[1];
    if (!(k[0] > 0.0 && k[1] > k[0])) return mk_read_bad(reader, "model.navigation.weights.normal", "must be k0 and k1 with 0 < k0 < k1");
    const double *const p = nav->significance;
    if (!(p[1] > 0.0 && p[0] > p[1] && p[0] < 1.0))
        return mk_read_bad(reader, "model.navigation.weights.significance",
                           "must be those of k0 and k1, two-sided, between 0 and 1, the first one above the other");
    return 1;
}

static int read_times(mk_reader_t *reader, json_t *object, mk_scenario_t *s) {
    mk_navigation_t *const nav = s->navigation;
    double rate = 100.0;
    s->dt_s = 1.0;
    if (!mk_read_between(reader, object, place, "dt_s", 1e-6, 1e6, "a number of seconds from 1e-6 to 1e6", &s->dt_s) ||
        !mk_read_between(reader, object, place, "imu_hz", 1e-6, 1e6, "a number from 1e-6 to 1e6", &rate) ||
        !mk_read_between(reader, object, place, "start_s", -DBL_MAX, DBL_MAX, number, &nav->start_s))
        return 0;
    const double samples = rate * s->dt_s;
    nav->samples = (int)(fmin(samples, 1e9) + 0.5);
    if (nav->samples < 1 || nav->samples > MOST_SAMPLES || fabs(samples - nav->samples) > 1e-9 * samples)
        return mk_read_bad(reader, "model.navigation.imu_hz", "imu_hz times dt_s must be a whole number, from 1 to %d, not %.10g", MOST_SAMPLES, samples);
    nav->imu_s = s->dt_s / nav->samples;
    return 1;
}

static int read_estimate(mk_reader_t *reader, json_t *object, mk_navigation_t *nav) {
    static const char *const words[] = {"fixed", "drawn", NULL};
    json_t *estimate = json_object_get(object, "estimate"), *biases = json_object_get(object, "biases");
    nav->biases_are_drawn = biases ? mk_read_word(reader, biases, "model.navigation.biases", words) : 0;
    nav->has_estimate = estimate != NULL;
    return nav->biases_are_drawn >= 0 && (!estimate || mk_read_vector(reader, estimate, "model.navigation.estimate", MK_NAV_STATES, nav->estimate));
}

int mk_read_navigation(mk_reader_t *reader, json_t *model, mk_scenario_t *s) {
    mk_navigation_t *const nav = s->navigation = mk_allocate(1, sizeof *nav);
    json_t *object = json_object_get(model, "navigation");
    if (!mk_read_keys(reader, model, "model", model_keys) || !mk_read_keys(reader, object, place, keys)) return 0;
    nav->speed = 100.0;
    nav->gravity = 9.80665;
    nav->satellite_range = 2e7;
    if (!read_times(reader, object, s) || !mk_read_between(reader, object, place, "speed_m_s", DBL_MIN, 1e5, "above 0, 1e5 at most", &nav->speed) ||
        !mk_read_between(reader, object, place, "heading_deg", -360.0, 360.0, "from -360 to 360", &nav->heading) ||
        !mk_read_between(reader, object, place, "gravity_m_s2", DBL_MIN, 1e3, "above 0, 1000 at most", &nav->gravity) ||
        !read_three(reader, object, place, "position_m", 1.0, nav->position) || !read_maneuvers(reader, object, nav) ||
        !read_three(reader, object, place, "gyro_bias_deg_h", DEGREE_AN_HOUR, nav->gyro_bias) ||
        !read_three(reader, object, place, "accelerometer_bias_ug", MICRO_G, nav->accelerometer_bias) ||
        !mk_read_between(reader, object, place, "angle_random_walk_deg_sqrt_h", 0.0, 1e6, not_negative, &nav->angle_walk) ||
        !mk_read_between(reader, object, place, "velocity_random_walk_ug_sqrt_hz", 0.0, 1e9, not_negative, &nav->velocity_walk) ||
        !mk_read_between(reader, object, place, "clock_sf_m2_s", 0.0, 1e15, not_negative, &nav->clock_sf) ||
        !mk_read_between(reader, object, place, "clock_sg_m2_s3", 0.0, 1e15, not_negative, &nav->clock_sg) ||
        !mk_read_between(reader, object, place, "satellite_range_m", 1e3, 1e12, "from 1e3 to 1e12", &nav->satellite_range) ||
        !read_sd(reader, object, nav) || !read_weights(reader, object, nav) || !read_estimate(reader, object, nav))
        return 0;
    nav->heading *= DEGREE;
    nav->angle_walk *= DEGREE / 60.0;
    nav->velocity_walk *= MICRO_G;
    s->n = MK_NAV_STATES;
    s->Q = mk_allocate(MK_NAV_STATES * (MK_NAV_STATES + 1) / 2, sizeof *s->Q);
    s->P0 = mk_allocate(MK_NAV_STATES * (MK_NAV_STATES + 1) / 2, sizeof *s->P0);
    s->x0 = mk_allocate(MK_NAV_STATES, sizeof *s->x0);
    for (int i = 0; i < MK_NAV_STATES; i++) s->P0[i * (i + 1) / 2 + i] = nav->sd[i] * nav->sd[i];
    s->position_count = 3;
    for (int i = 0; i < 3; i++) s->position_states[i] = MK_NAV_POSITION + i;
    return 1;
}

int mk_read_satellite(mk_reader_t *reader, json_t *node, const char *at, mk_satellite_t *satellite, double *R) {
    static const char *const known[] = {"satellite", "elevation_deg", "azimuth_deg", "sigma_m", NULL};
    double elevation = 0.0, azimuth = 0.0, sigma = 0.0;
    if (!mk_read_keys(reader, node, at, known)) return 0;
    for (int i = 0; known[i]; i++)
        if (!mk_read_member(reader, node, at, known[i], 1)) return 0;
    if (!mk_read_integer(reader, node, at, "satellite", 1, 65535, &satellite->number) ||
        !mk_read_between(reader, node, at, "elevation_deg", -90.0, 90.0, "from -90 to 90", &elevation) ||
        !mk_read_between(reader, node, at, "azimuth_deg", -360.0, 360.0, "from -360 to 360", &azimuth) ||
        !mk_read_between(reader, node, at, "sigma_m", 1e-12, 1e9, "a number of metres from 1e-12 to 1e9", &sigma))
        return 0;
    satellite->elevation = elevation * DEGREE;
    satellite->azimuth = azimuth * DEGREE;
    *R = sigma * sigma;
    return 1;
}

int mk_check_navigation(mk_reader_t *reader, const mk_scenario_t *s) {
    char at[64];
    if (s->nodes > MK_NAV_SATELLITES) return mk_read_bad(reader, "nodes", "has %d satellites; at most %d", s->nodes, MK_NAV_SATELLITES);
    for (int k = 0; k < s->nodes; k++)
        for (int l = 0; l < k; l++) {
            if (s->navigation->satellite[k].number != s->navigation->satellite[l].number) continue;
            (void)snprintf(at, sizeof at, "nodes[%d].satellite", k);
            return mk_read_bad(reader, at, "is %d again, as in nodes[%d]", s->navigation->satellite[k].number, l);
        }
    return s->first[s->nodes] == s->nodes || mk_read_bad(reader, "edges", "must be []: satellites have no links");
}

void mk_navigation_free(mk_navigation_t *navigation) {
    if (!navigation) return;
    free(navigation->maneuver);
    free(navigation->satellite);
    free(navigation);
}
