/* SPDX-License-Identifier: MIT */
/* meshkal/monitor.h: start, an epoch, the schemes. */

static mk_status_t MK_F(mk_monitor_check)(int m, int places, int window, const MK_F_T(mk_monitor_config) * config) {
    if (!config || m < 1 || places < 1 || window < 1 || m > MK_MONITOR_ROWS || places > MK_MONITOR_ROWS / m) return MK_ERROR_ARGUMENT;
    if (config->m != m || config->places != places || config->window != window) return MK_ERROR_SHAPE;
    if (!config->threshold || config->scheme > MK_MONITOR_EXCLUDE) return MK_ERROR_ARGUMENT;
    if (!MK_F(mk_all_finite)(m * places, config->threshold)) return MK_ERROR_NOT_FINITE;
    for (int i = 0; i < m * places; i++)
        if (!(config->threshold[i] > MK_R(0.0))) return MK_ERROR_ARGUMENT;
    if (config->scheme == MK_MONITOR_IMPROVED) {
        if (!MK_F(mk_all_finite)(1, &config->jump)) return MK_ERROR_NOT_FINITE;
        if (!(config->jump > MK_R(0.0))) return MK_ERROR_ARGUMENT;
    }
    if (config->scheme == MK_MONITOR_EXCLUDE) {
        if (!config->zero || !config->back) return MK_ERROR_ARGUMENT;
        const MK_REAL single[4] = {config->separation, config->evidence, config->level, config->slope};
        if (!MK_F(mk_all_finite)(4, single) || !MK_F(mk_all_finite)(m, config->zero) || !MK_F(mk_all_finite)(m, config->back))
            return MK_ERROR_NOT_FINITE;
        for (int i = 0; i < 4; i++)
            if (!(single[i] >= MK_R(0.0))) return MK_ERROR_ARGUMENT;
        for (int i = 0; i < m; i++)
            if (!(config->zero[i] > MK_R(0.0) && config->back[i] >= MK_R(0.0))) return MK_ERROR_ARGUMENT;
        if (!(config->evidence > MK_R(0.0)) || config->most < 1) return MK_ERROR_ARGUMENT;
    }
    return MK_OK;
}

static void MK_F(mk_monitor_reset)(const MK_F_T(mk_monitor_view) * view) {
    MK_F_T(mk_monitor) *const core = view->core;
    MK_F(mk_monitor_empty)(view);
    for (int p = 0; p < core->config->places; p++) {
        if (view->sensor[p].faulty) view->sensor[p].until = core->epoch;
        view->sensor[p].used = view->sensor[p].faulty = 0;
        view->sensor[p].w = view->sensor[p].ratio = MK_R(0.0);
    }
    core->rctm = core->aime = core->rctm_ratio = core->aime_ratio = MK_R(0.0);
    core->rows = core->window_rows = core->faulty = core->quiet = core->waited = 0;
    core->alarm = core->ended = core->unresolved = 0;
    core->rho = core->median = MK_R(1.0);
    for (int i = 0; i < 3; i++) core->rhos[i] = MK_R(1.0);
}

mk_status_t MK_F(mk_monitor_start)(int m, int places, int window, const MK_F_T(mk_monitor_view) * view,
                                   const MK_F_T(mk_monitor_config) * config) {
    const mk_status_t status = MK_F(mk_monitor_check)(m, places, window, config);
    const int N = m * places;
    if (status != MK_OK) return status;
    memset(view->core, 0, sizeof *view->core);
    memset(view->sensor, 0, (size_t)places * sizeof *view->sensor);
    memset(view->fault, 0, (size_t)N * sizeof *view->fault);
    memset(view->information, 0, (size_t)((window + 1) * MK_AT(N, 0)) * sizeof *view->information);
    memset(view->v, 0, (size_t)((window + 1) * N) * sizeof *view->v);
    memset(view->seen, 0, (size_t)window * sizeof *view->seen);
    view->core->config = config;
    MK_F(mk_monitor_reset)(view);
    return MK_OK;
}

mk_status_t MK_F(mk_monitor_restart)(const MK_F_T(mk_monitor_view) * view) {
    if (!view->core->config) return MK_ERROR_ORDER;
    MK_F(mk_monitor_reset)(view);
    return MK_OK;
}

int MK_F(mk_monitor_faulty)(const MK_F_T(mk_monitor_view) * view, uint16_t id) {
    const int place = view->core->config ? MK_F(mk_monitor_find)(view, id) : -1;
    return place >= 0 && view->sensor[place].faulty;
}

/* A fault is over. */
static void MK_F(mk_monitor_mend)(const MK_F_T(mk_monitor_view) * view, int place) {
    view->sensor[place].faulty = 0;
    view->sensor[place].until = view->core->epoch;
    view->core->faulty--;
}

mk_status_t MK_F(mk_monitor_clear)(const MK_F_T(mk_monitor_view) * view, uint16_t id) {
    if (!view->core->config) return MK_ERROR_ORDER;
    const int place = MK_F(mk_monitor_find)(view, id);
    if (place < 0 || !view->sensor[place].faulty) return MK_ERROR_ARGUMENT;
    MK_F(mk_monitor_mend)(view, place);
    return MK_OK;
}

/* --- an epoch ------------------------------------------------------------------------------------------------------------- */

/* What the call must be; *failed: the sensor at which it is not. */
static mk_status_t MK_F(mk_monitor_arguments)(const MK_F_T(mk_monitor_config) * config, int sensors, const uint16_t *id, const uint8_t *rows,
                                              const MK_REAL *r, const MK_REAL *S, int *failed) {
    if (sensors < 0 || sensors > INT16_MAX / config->m || (sensors > 0 && (!id || !rows))) return MK_ERROR_ARGUMENT;
    for (int l = 0; l < sensors; l++) {
        *failed = l;
        if (rows[l] > config->m || (rows[l] && (!r || !S))) return MK_ERROR_ARGUMENT;
        for (int k = 0; k < l && rows[l]; k++)
            if (rows[k] && id[k] == id[l]) return MK_ERROR_ARGUMENT;
    }
    for (int l = 0, i = 0; l < sensors; l++) {
        *failed = l;
        for (int end = i + rows[l]; i < end; i++)
            if (!MK_F(mk_all_finite)(1, r + i) || !MK_F(mk_all_finite)(i + 1, S + MK_AT(i, 0))) return MK_ERROR_NOT_FINITE;
    }
    *failed = sensors;
    return MK_OK;
}

/* Packed covariance of one sensor of the reading. */
static void MK_F(mk_monitor_block)(const mk_reading_t *reading, int k, const MK_REAL *S, MK_REAL *block) {
    const int rows = reading->sensor[k].rows, from = reading->sensor[k].from;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j <= i; j++) block[MK_AT(i, j)] = S[MK_AT(from + i, from + j)];
}

/* Z := S^-1 and v := S^-1 r of the rows that count, q := r' S^-1 r. Behind those rows in v: the innovations of sensors held faulty, with unit
   variance. Returns OK, or NOT_POSITIVE_DEFINITE and the sensor. spare: a number a row. */
static mk_status_t MK_F(mk_monitor_inform)(const mk_reading_t *reading, const MK_F_T(mk_watched) * sensor, const MK_REAL *r, const MK_REAL *S,
                                           MK_REAL *Z, MK_REAL *v, MK_REAL *q, MK_REAL *spare, int *failed) {
    MK_REAL *z = v + reading->rows;
    for (int k = 0; k < reading->sensors; k++) {
        const int rows = reading->sensor[k].rows;
        if (!sensor[reading->sensor[k].place].faulty) continue;
        *failed = reading->sensor[k].index;
        MK_F(mk_monitor_block)(reading, k, S, Z);
        for (int i = 0; i < rows; i++) z[i] = r[reading->sensor[k].from + i];
        if (!MK_F(mk_whiten)(0, rows, Z, 0, z)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
        z += rows;
    }
    const int n = reading->rows;
    for (int i = 0; i < n; i++) {
        const int from = reading->row[i].from;
        *failed = reading->sensor[reading->row[i].sensor].index;
        spare[i] = r[from];
        for (int j = 0; j <= i; j++) Z[MK_AT(i, j)] = S[MK_AT(from, reading->row[j].from)];
        if (!MK_F(mk_ldl_row)(i, Z)) return MK_ERROR_NOT_POSITIVE_DEFINITE;
    }
    *q = MK_F(mk_monitor_square)(n, Z, spare);
    for (int i = 0; i < n; i++) v[i] = spare[i];
    MK_F(mk_ldl_backward)(n, Z, v);
    MK_F(mk_ldl_invert)(n, Z);
    return MK_OK;
}

/* Test ratio. */
static MK_REAL MK_F(mk_monitor_ratio)(const MK_F_T(mk_monitor_config) * config, int rows, MK_REAL q) {
    return rows ? MK_F(mk_monitor_limit)(q / config->threshold[rows - 1]) : MK_R(0.0);
}

static uint8_t MK_F(mk_monitor_refuses)(const MK_F_T(mk_monitor_config) * config, int rows, MK_REAL q) {
    return rows && q >= config->threshold[rows - 1];
}

/* The published decision that a fault is over (spec 3.3), after the alarm of this epoch is known. */
static void MK_F(mk_monitor_improve)(const MK_F_T(mk_monitor_view) * view, int by_aime) {
    MK_F_T(mk_monitor) *const core = view->core;
    MK_REAL *const rhos = core->rhos;
    const MK_REAL least = MK_R(0.1), q_R = core->rctm > least ? core->rctm : least;
    core->rho = by_aime && core->alarm ? core->aime / q_R : MK_R(1.0);
    rhos[0] = rhos[1];
    rhos[1] = rhos[2];
    rhos[2] = core->rho;
    const MK_REAL low = rhos[0] < rhos[1] ? rhos[0] : rhos[1], high = rhos[0] < rhos[1] ? rhos[1] : rhos[0];
    core->median = rhos[2] < low ? low : rhos[2] > high ? high : rhos[2];
    if (core->quiet) core->quiet--;
    if (!by_aime || !core->alarm || core->epoch - core->alarm_since < 2 || !(core->rho - core->median > core->config->jump)) return;
    core->ended = 1;
    core->ends++;
    core->alarm = 0;
    core->quiet = core->config->window;
    MK_F(mk_monitor_empty)(view);
}

/* Which faults are over. z: innovations of unit variance of the sensors held faulty, in the order of the reading. */
static void MK_F(mk_monitor_end)(const MK_F_T(mk_monitor_view) * view, const mk_reading_t *reading, const MK_REAL *z) {
    MK_F_T(mk_monitor) *const core = view->core;
    const MK_F_T(mk_monitor_config) *const config = core->config;
    uint32_t read = 0;
    for (int k = 0; k < reading->sensors; k++) {
        const int place = reading->sensor[k].place, rows = reading->sensor[k].rows;
        if (!view->sensor[place].faulty) continue;
        read |= UINT32_C(1) << place;
        if (MK_F(mk_fault_over)(config, z, view->sensor + place, view->fault + place * config->m)) {
            MK_F(mk_monitor_mend)(view, place);
            core->ended = 1;
            core->ends++;
        }
        z += rows;
    }
    for (int p = 0; p < config->places; p++) {
        if (read >> p & 1u) continue;
        if (view->sensor[p].faulty && view->sensor[p].begun) MK_F(mk_fault_predict)(config, config->m, view->fault + p * config->m);
        if (!view->sensor[p].faulty) view->sensor[p].ratio = MK_R(0.0);
    }
}

/* This sensor is held faulty from here on, with these offsets in units of standard deviations; rows 0: they are not known, as it was not read. */
static void MK_F(mk_monitor_hold)(const MK_F_T(mk_monitor_view) * view, int place, int rows, const MK_REAL *level) {
    MK_F_T(mk_watched) *const sensor = view->sensor + place;
    const int m = view->core->config->m;
    MK_F_T(mk_fault) *const fault = view->fault + place * m;
    sensor->faulty = 1;
    sensor->begun = rows > 0;
    sensor->evidence = sensor->ratio = MK_R(0.0);
    sensor->speaking = sensor->counted = 0;
    sensor->since = view->core->epoch;
    sensor->faults++;
    view->core->faulty++;
    memset(fault, 0, (size_t)m * sizeof *fault);
    MK_F(mk_fault_begin)(view->core->config->window, m, rows, level, fault);
}

/* In alarm: who is it. Z, v_new: of this epoch, in the order of the reading; I, v: sums over the window, spoilt; rows: what it holds. work: a packed
   matrix and two vectors. */
static void MK_F(mk_monitor_exclude)(const MK_F_T(mk_monitor_view) * view, const mk_reading_t *reading, uint32_t rows, const MK_REAL *S,
                                     const MK_REAL *Z, const MK_REAL *v_new, MK_REAL *I, MK_REAL *v, MK_REAL *b, MK_REAL *work) {
    MK_F_T(mk_monitor) *const core = view->core;
    const MK_F_T(mk_monitor_config) *const config = core->config;
    const int m = config->m;
    const int force = config->patience && core->waited >= config->patience;
    const int N = m * config->places;
    uint32_t suspects = 0;
    int sure = 0;
    /* The window, then this epoch: a leap is not an offset of the whole window, which leaves its rows apart where S is not the same in all its epochs. */
    for (int now = 0; now < 2 && !sure; now++) {
        if (now) {
            if (!MK_F(mk_monitor_refuses)(config, core->rows, core->rctm)) break;
            for (int i = 0; i < MK_AT(N, 0); i++) I[i] = MK_R(0.0);
            for (int i = 0; i < N; i++) v[i] = MK_R(0.0);
            MK_F(mk_monitor_add)(reading, Z, v_new, I, v);
        }
        const uint32_t found = MK_F(mk_monitor_isolate)(config, config->most - core->faulty, force && !now, now ? reading->seen : rows,
                                                        now ? core->rctm : core->aime, I, v, b, work, &sure);
        if (found) suspects = found;
    }
    core->unresolved = suspects == 0;
    if (!suspects) return;
    for (int p = 0; p < config->places; p++) {
        int count = 0;
        if (!(suspects >> p & 1u)) continue;
        for (int k = 0; k < reading->sensors; k++) {
            if (reading->sensor[k].place != p) continue;
            count = reading->sensor[k].rows;
            MK_F(mk_monitor_block)(reading, k, S, work);
            (void)MK_F(mk_whiten)(0, count, work, 0, b + p * m); /* a part of what has been factored above */
        }
        MK_F(mk_monitor_hold)(view, p, count, b + p * m);
    }
    MK_F(mk_monitor_empty)(view);
}

/* What is said of the epoch, and what follows from it. Z, v_new: of this epoch, behind whose rows in v_new those of sensors held faulty; I, v: sums over
   the window of the rows `held`, spoilt. b, work: a vector; a packed matrix and a vector. */
static void MK_F(mk_monitor_decide)(const MK_F_T(mk_monitor_view) * view, const mk_reading_t *reading, const MK_REAL *S, int by_aime, uint32_t held,
                                    const MK_REAL *Z, const MK_REAL *v_new, MK_REAL *I, MK_REAL *v, MK_REAL *b, MK_REAL *work) {
    MK_F_T(mk_monitor) *const core = view->core;
    const MK_F_T(mk_monitor_config) *const config = core->config;
    const int was = core->alarm, by_rctm = config->scheme == MK_MONITOR_RCTM || !by_aime;
    core->rctm_ratio = MK_F(mk_monitor_ratio)(config, core->rows, core->rctm);
    core->aime_ratio = MK_F(mk_monitor_ratio)(config, core->window_rows, core->aime);
    core->alarm = MK_F(mk_monitor_refuses)(config, by_rctm ? core->rows : core->window_rows, by_rctm ? core->rctm : core->aime);
    if (core->alarm && !was) {
        core->alarm_since = core->epoch;
        core->alarms++;
    }
    for (int p = 0; p < config->places; p++)
        (void)MK_F(mk_monitor_statistic)(held & mk_rows_of(config->m, p, config->m), I, v, 0, 0, work, &view->sensor[p].w);
    core->ended = core->unresolved = 0;
    if (config->scheme == MK_MONITOR_IMPROVED) MK_F(mk_monitor_improve)(view, by_aime);
    if (config->scheme == MK_MONITOR_EXCLUDE) {
        MK_F(mk_monitor_end)(view, reading, v_new + reading->rows);
        if (core->alarm) MK_F(mk_monitor_exclude)(view, reading, held, S, Z, v_new, I, v, b, work);
        core->waited = core->unresolved ? (uint16_t)(core->waited + (core->waited < UINT16_MAX)) : 0;
    }
}

mk_status_t MK_F(mk_monitor_watch)(const MK_F_T(mk_monitor_view) * view, int sensors, const uint16_t *id, const uint8_t *rows, const MK_REAL *r,
                                   const MK_REAL *S) {
    MK_F_T(mk_monitor) *const core = view->core;
    const MK_F_T(mk_monitor_config) *const config = core->config;
    if (!config) return MK_ERROR_ORDER;
    const int N = config->m * config->places, packed = MK_AT(N, 0), window = config->window, by_aime = !core->quiet;
    MK_REAL *const Z = view->work, *const I = Z + packed, *const work = I + packed;
    MK_REAL *const v_new = work + packed + N, *const v = v_new + N, *const b = v + N;
    MK_REAL q_R = MK_R(0.0), q_A = MK_R(0.0);
    mk_reading_t reading;
    int failed = 0;

    mk_status_t status = MK_F(mk_monitor_arguments)(config, sensors, id, rows, r, S, &failed);
    if (status == MK_OK) {
        MK_F(mk_monitor_seat)(view, sensors, id, rows, &reading);
        status = MK_F(mk_monitor_inform)(&reading, view->sensor, r, S, Z, v_new, &q_R, work, &failed);
    }
    if (status != MK_OK) {
        core->failed = (uint16_t)failed;
        core->rejected++;
        return status;
    }
    const MK_REAL *const I_older = MK_F(mk_monitor_older)(view, view->information, packed);
    const MK_REAL *const v_older = MK_F(mk_monitor_older)(view, view->v, N);
    const uint32_t held = by_aime ? reading.seen | reading.remaining : 0;
    for (int i = 0; i < packed; i++) I[i] = core->back ? view->information[window * packed + i] : MK_R(0.0);
    for (int i = 0; i < N; i++) v[i] = core->back ? view->v[window * N + i] : MK_R(0.0);
    MK_F(mk_monitor_add)(&reading, Z, v_new, I, v);
    const int window_rows = MK_F(mk_monitor_statistic)(held, I, v, I_older, v_older, work, &q_A);
    core->failed = (uint16_t)sensors;
    if (!(q_R <= MK_LARGEST && q_A <= MK_LARGEST && MK_F(mk_all_finite)(packed, I) && MK_F(mk_all_finite)(N, v))) {
        core->rejected++;
        return MK_ERROR_NOT_FINITE;
    }

    core->epoch++;
    core->rctm = q_R;
    core->aime = q_A;
    core->rows = reading.rows;
    core->window_rows = (uint16_t)window_rows;
    MK_F(mk_monitor_settle)(view, id, &reading);
    if (by_aime) MK_F(mk_monitor_push)(view, &reading, Z, v_new, I, v);
    if (I_older) {
        MK_F(mk_row_sum)(packed, I_older, I);
        MK_F(mk_row_sum)(N, v_older, v);
    }
    MK_F(mk_monitor_decide)(view, &reading, S, by_aime, held, Z, v_new, I, v, b, work);
    MK_F(mk_monitor_turn)(view);
    return MK_OK;
}
