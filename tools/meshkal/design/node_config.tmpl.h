/* SPDX-License-Identifier: MIT */
/* Numbers are computed in float64 and rounded once, so that a float32 node differs from a float64 one by that rounding only. */

static MK_REAL *MK_F(put)(MK_REAL *next, const double *values, int count) {
    for (int i = 0; i < count; i++) next[i] = (MK_REAL)values[i];
    return next + count;
}

void MK_F(mk_model_put)(const mk_scenario_t *s, MK_REAL *model) {
    const int n = s->n, np = MK_PACKED(n);
    MK_REAL *next = MK_F(put)(model, s->A, n * n);
    next = MK_F(put)(next, s->Q, np);
    next = MK_F(put)(next, s->input, n);
    next = MK_F(put)(next, s->x0, n);
    (void)MK_F(put)(next, s->P0, np);
}

void MK_F(mk_sensor_put)(int n, const mk_sensor_t *sensor, MK_REAL *numbers, double *work) {
    const int rows = sensor->rows;
    double *F = work, *S = F + rows * n, *R_inverse = S + MK_PACKED(n);
    mk_sensor_matrices(n, sensor, F, S, R_inverse);
    MK_REAL *next = MK_F(put)(numbers, sensor->C, rows * n);
    next = MK_F(put)(next, F, rows * n);
    next = MK_F(put)(next, S, MK_PACKED(n));
    (void)MK_F(put)(next, R_inverse, MK_PACKED(rows));
}

void MK_F(mk_config_open)(MK_F_T(mk_rkfd_config) * config, int n, int m, int slots, double tolerance, const MK_REAL *model, const MK_REAL *room,
                          const uint8_t *rows) {
    const int np = MK_PACKED(n);
    config->n = (uint16_t)n;
    config->m = (uint16_t)m;
    config->slots = (uint16_t)slots;
    config->A = model;
    config->Q = config->A + n * n;
    config->input = config->Q + np;
    config->x0 = config->input + n;
    config->P0 = config->x0 + n;
    config->rows = rows;
    config->weight = room;
    config->C = config->weight + slots;
    config->F = config->C + slots * m * n;
    config->S = config->F + slots * m * n;
    config->R_inverse = config->S + slots * np;
    config->tolerance = (MK_REAL)tolerance;
    config->steady = NULL;
}

/* Copies `used` numbers and makes zeros of the rest: rows that a sensor lacks. */
static void MK_F(copy_padded)(MK_REAL *to, const MK_REAL *from, int used, int count) {
    memcpy(to, from, (size_t)used * sizeof *to);
    for (int i = used; i < count; i++) to[i] = MK_R(0.0);
}

void MK_F(mk_config_slot)(int n, int m, int slots, int l, const MK_REAL *numbers, int used, MK_REAL *room, uint8_t *rows) {
    const int np = MK_PACKED(n), mp = MK_PACKED(m);
    MK_REAL *const C = room + slots, *const F = C + slots * m * n, *const S = F + slots * m * n, *const R_inverse = S + slots * np;
    MK_F(copy_padded)(C + l * m * n, numbers, used * n, m * n);
    MK_F(copy_padded)(F + l * m * n, numbers + used * n, used * n, m * n);
    memcpy(S + l * np, numbers + 2 * used * n, (size_t)np * sizeof *S);
    MK_F(copy_padded)(R_inverse + l * mp, numbers + 2 * used * n + np, MK_PACKED(used), mp);
    rows[l] = (uint8_t)used;
}

void MK_F(mk_config_weights)(const double *weight, int slots, MK_REAL *room) { (void)MK_F(put)(room, weight, slots); }

void MK_F(mk_config_make)(MK_F_T(mk_rkfd_config) * config, const mk_scenario_t *s, const mk_topology_t *topology, int e, double tolerance) {
    const int n = s->n, m = mk_topology_rows(topology, s, e), first = topology->first[e], slots = topology->first[e + 1] - first;
    const size_t model = MK_MODEL_NUMBERS((size_t)n), room = MK_CONFIG_NUMBERS((size_t)n, (size_t)m, (size_t)slots);
    MK_REAL *block = mk_allocate((model + room + MK_SENSOR_NUMBERS((size_t)n, (size_t)m)) * sizeof *block + (size_t)slots, 1);
    MK_REAL *const numbers = block + model + room;
    uint8_t *const rows = (uint8_t *)(numbers + MK_SENSOR_NUMBERS(n, m));
    double *work = mk_allocate(MK_SENSOR_NUMBERS((size_t)n, (size_t)m), sizeof *work);
    memset(config, 0, sizeof *config);
    MK_F(mk_model_put)(s, block);
    MK_F(mk_config_open)(config, n, m, slots, tolerance, block, block + model, rows);
    MK_F(mk_config_weights)(topology->weight + first, slots, block + model);
    for (int l = 0; l < slots; l++) {
        const mk_sensor_t *sensor = &s->sensor[topology->slot[first + l]];
        MK_F(mk_sensor_put)(n, sensor, numbers, work);
        MK_F(mk_config_slot)(n, m, slots, l, numbers, sensor->rows, block + model, rows);
    }
    free(work);
}

void MK_F(mk_config_free)(MK_F_T(mk_rkfd_config) * config) {
    MK_REAL *block;
    memcpy(&block, &config->A, sizeof block); /* A comes first in the block; the member is const for everybody else */
    free(block);
}

void MK_F(mk_node_config_make)(MK_F_T(mk_node_config) * config, const mk_scenario_t *s, const mk_topology_t *topology, int k, double tolerance) {
    const int first = topology->first[k], slots = topology->first[k + 1] - first;
    uint16_t *const nodes = mk_allocate((size_t)slots, sizeof *nodes);
    for (int l = 0; l < slots; l++) nodes[l] = (uint16_t)topology->slot[first + l];
    memset(config, 0, sizeof *config);
    MK_F(mk_config_make)(&config->filter, s, topology, k, tolerance);
    config->nodes = nodes;
    config->model = mk_scenario_model(s);
    config->catch_up = MK_CATCH_UP;
    config->numbers = MK_BITS == 32 ? MK_NUMBERS_F32 : MK_NUMBERS_F64;
}

void MK_F(mk_node_config_free)(MK_F_T(mk_node_config) * config) {
    uint16_t *nodes;
    memcpy(&nodes, &config->nodes, sizeof nodes);
    free(nodes);
    MK_F(mk_config_free)(&config->filter);
}
