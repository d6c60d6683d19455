/* SPDX-License-Identifier: MIT */
/* What estimator e of a snapshot says before its step: of networks, and of the one that a node daemon is. */

static void MK_F(mk_look_before)(const mk_scenario_t *s, const MK_F_T(mk_rkfd_view) * view, int e, mk_snapshot_t *snapshot) {
    const size_t n = (size_t)s->n, at = (size_t)e;
    const int *position = s->position_states, positions = s->position_count;
    MK_REAL *estimate = snapshot->estimate, *variance = snapshot->variance, *trace = snapshot->trace_covariance, *block = snapshot->position_covariance;
    MK_REAL V[MK_PACKED(MK_LARGEST_STATE)];
    memcpy(estimate + at * n, view->x, n * sizeof *estimate);
    /* W is the inverse of a positive definite matrix that the step has just factored, or of P0: it inverts. */
    if (MK_F(mk_rkfd_covariance)(s->n, view, V) != MK_OK) memset(V, 0, sizeof V);
    trace[e] = MK_R(0.0);
    variance += at * n;
    for (int i = 0; i < s->n; i++) {
        variance[i] = V[MK_AT(i, i)];
        trace[e] += variance[i];
    }
    block += at * (size_t)MK_PACKED(positions);
    for (int i = 0; i < positions; i++)
        for (int j = 0; j <= i; j++) {
            const int a = position[i], b = position[j];
            *block++ = V[a > b ? MK_AT(a, b) : MK_AT(b, a)];
        }
}

/* With the readings of the step, before it. Its own sensors are those of its first slots. */
static void MK_F(mk_look_innovations)(const MK_F_T(mk_rkfd_view) * view, int e, mk_snapshot_t *snapshot) {
    const MK_F_T(mk_rkfd_config) *const config = view->core->config;
    MK_REAL *innovation = snapshot->innovation, *variance = snapshot->innovation_variance;
    MK_REAL r[MK_LARGEST_STATE], S[MK_PACKED(MK_LARGEST_STATE)];
    for (int l = 0, at = snapshot->own_first[e]; at < snapshot->own_first[e + 1]; at += config->rows[l++]) {
        const int known = view->have_y[l] && MK_F(mk_rkfd_predict)(config->n, config->m, view, l, r, S) == MK_OK;
        for (int i = 0; i < config->rows[l]; i++) {
            innovation[at + i] = known ? r[i] : (MK_REAL)NAN;
            variance[at + i] = known ? S[MK_AT(i, i)] : (MK_REAL)NAN;
        }
    }
}
