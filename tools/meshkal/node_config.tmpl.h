/* SPDX-License-Identifier: MIT */
/* Numbers are computed in float64 and rounded once, so that a float32 node differs from a float64 one by that rounding only. */

static const MK_REAL *MK_F(put)(MK_REAL **next, const double *values, int count) {
    MK_REAL *start = *next;
    for (int i = 0; i < count; i++) start[i] = (MK_REAL)values[i];
    *next += count;
    return start;
}

void MK_F(mk_config_make)(MK_F_T(mk_rkfd_config) * config, const mk_scenario_t *s, const mk_topology_t *topology, int e,
                          double tolerance) {
    const int n = s->n, m = mk_topology_rows(topology, s, e), np = MK_PACKED(n), mp = MK_PACKED(m);
    const int *slot = topology->slot + topology->first[e], slots = topology->first[e + 1] - topology->first[e];
    const size_t reals = (size_t)(n * n + 2 * np + 2 * n) + (size_t)slots * (size_t)(1 + 2 * m * n + np + mp);
    MK_REAL *next = mk_allocate(reals * sizeof *next + (size_t)slots, 1);
    MK_REAL *const start = next;
    double *sensor = mk_allocate((size_t)(m * n + np + mp), sizeof *sensor);
    double *F = sensor, *S = F + m * n, *R_inverse = S + np;
    memset(config, 0, sizeof *config);
    config->n = (uint16_t)n;
    config->m = (uint16_t)m;
    config->slots = (uint16_t)slots;
    config->tolerance = (MK_REAL)tolerance;
    /* A comes first: the block is freed by it. */
    config->A = MK_F(put)(&next, s->A, n * n);
    config->Q = MK_F(put)(&next, s->Q, np);
    config->input = MK_F(put)(&next, s->input, n);
    config->x0 = MK_F(put)(&next, s->x0, n);
    config->P0 = MK_F(put)(&next, s->P0, np);
    config->weight = MK_F(put)(&next, topology->weight + topology->first[e], slots);
    MK_REAL *const C_all = next, *const F_all = C_all + slots * m * n, *const S_all = F_all + slots * m * n;
    MK_REAL *const R_all = S_all + slots * np;
    uint8_t *const rows = (uint8_t *)(start + reals);
    for (int l = 0; l < slots; l++) {
        /* Rows that a sensor lacks stay zero. */
        const mk_sensor_t *node = &s->sensor[slot[l]];
        const int used = node->rows;
        mk_sensor_matrices(n, node, F, S, R_inverse);
        next = C_all + l * m * n;
        (void)MK_F(put)(&next, node->C, used * n);
        next = F_all + l * m * n;
        (void)MK_F(put)(&next, F, used * n);
        next = S_all + l * np;
        (void)MK_F(put)(&next, S, np);
        next = R_all + l * mp;
        (void)MK_F(put)(&next, R_inverse, MK_PACKED(used));
        rows[l] = (uint8_t)used;
    }
    config->C = C_all;
    config->F = F_all;
    config->S = S_all;
    config->R_inverse = R_all;
    config->rows = rows;
    free(sensor);
}

void MK_F(mk_config_free)(MK_F_T(mk_rkfd_config) * config) {
    MK_REAL *block;
    memcpy(&block, &config->A, sizeof block); /* the member is const for everybody else */
    free(block);
}
