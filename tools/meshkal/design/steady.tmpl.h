/* SPDX-License-Identifier: MIT */

/* How far W is from the limit, in the measure of `close`; infinite if that cannot be said. */
static double MK_F(distance)(int n, const MK_REAL *W, const MK_REAL *limit) {
    double largest = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            const double scale = sqrt((double)limit[MK_AT(i, i)] * (double)limit[MK_AT(j, j)]);
            const double relative = fabs((double)W[MK_AT(i, j)] - (double)limit[MK_AT(i, j)]) / scale;
            if (!(relative <= largest)) largest = relative;
        }
    return isfinite(largest) ? largest : (double)INFINITY;
}

/* How near the filter can be trusted to stay when every reading comes: its own steps, for W does not depend on what the readings say. From the
   limit on: the furthest that rounding drives it, once that has stopped growing. From its start: the nearest that it comes, once it has come as
   near as `close` or comes no nearer. Infinite if a step fails. */
static double MK_F(try_steps)(const MK_F_T(mk_rkfd_config) * config, const MK_REAL *limit, int from_limit, double close) {
    const int n = config->n, m = config->m, slots = config->slots;
    MK_F_T(mk_rkfd) core;
    MK_REAL *x = mk_allocate((size_t)(n + MK_PACKED(n) + slots * (m + n) + m + n) + MK_RKFD_WORK((size_t)n, (size_t)m), sizeof *x);
    uint8_t *have = mk_allocate(2 * (size_t)slots, 1);
    MK_REAL *const W = x + n, *const y = W + MK_PACKED(n), *const psi = y + slots * m, *const zeros = psi + slots * n;
    const MK_F_T(mk_rkfd_view) view = {&core, x, W, y, psi, have, have + slots, zeros + m + n};
    double reached = from_limit ? 0.0 : (double)INFINITY, before = reached;
    mk_status_t status = MK_F(mk_rkfd_start)(n, m, slots, &view, config);
    if (from_limit && status == MK_OK) memcpy(W, limit, (size_t)MK_PACKED(n) * sizeof *W);
    for (int t = 0, end = TRIAL_FIRST; t < end && status == MK_OK; t++) {
        memset(x, 0, (size_t)n * sizeof *x);
        for (int l = 0; l < slots && status == MK_OK; l++) status = MK_F(mk_rkfd_put)(n, m, &view, l, zeros, 0);
        if (status == MK_OK) status = MK_F(mk_rkfd_incremental)(n, m, slots, &view, zeros);
        if (status == MK_OK) status = MK_F(mk_rkfd_diffuse)(n, slots, &view);
        const double now = MK_F(distance)(n, W, limit);
        reached = from_limit ? fmax(reached, now) : fmin(reached, now);
        if (!from_limit && reached <= close) break;
        if (t + 1 < end || 2 * end > TRIAL_LAST || (from_limit ? reached <= 1.1 * before : reached >= 0.9 * before)) continue;
        before = reached;
        end *= 2;
    }
    free(x);
    free(have);
    return status == MK_OK ? reached : (double)INFINITY;
}

int MK_F(mk_steady_make)(MK_F_T(mk_rkfd_steady) * steady, MK_REAL *numbers, const MK_F_T(mk_rkfd_config) * config, const mk_scenario_t *s,
                         const mk_topology_t *topology, int e, double tolerance, double close, const char **why) {
    const int n = config->n, m = config->m, slots = config->slots, count = MK_STEADY_NUMBERS(n, m, slots);
    double *limit = mk_allocate((size_t)count, sizeof *limit), theta, trace_P;
    const int found = find_limit(s, topology, e, m, tolerance, limit, &theta, &trace_P);
    for (int i = 0; i < count && found; i++) numbers[i] = (MK_REAL)limit[i];
    free(limit);
    *why = "its recursion does not converge";
    if (!found) return 0;
    steady->Phi = numbers;
    steady->G = steady->Phi + n * n;
    steady->W = steady->G + slots * m * n;
    steady->theta = (MK_REAL)theta;
    steady->trace_P = (MK_REAL)trace_P;
    steady->period = MK_STEADY_PERIOD;
    const double kept = fmax(close, 4.0 * MK_F(try_steps)(config, steady->W, 1, close)), reached = MK_F(try_steps)(config, steady->W, 0, kept);
    const double least = reached <= kept ? kept : 4.0 * reached;
    steady->close = (MK_REAL)least;
    *why = "in this precision its recursion does not stay near its limit";
    return least <= MK_MOST_CLOSE;
}
