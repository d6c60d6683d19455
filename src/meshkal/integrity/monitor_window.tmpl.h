/* SPDX-License-Identifier: MIT */
/*
 * The sums of meshkal/monitor.h. Ring of `window` entries: newer epochs stand at 0 .. back - 1, each by itself, with their sum in the entry behind
 * the ring; of the `front` older ones, entry i >= window - front holds the sum of epochs i .. window - 1. When the newer ones fill the
 * ring they become older ones: so a full window has an older epoch, and what it will hold without its oldest is known before anything is written.
 */

/* Sums over the older epochs of the window as they will be when the oldest of a full one has left; null: none. */
static const MK_REAL *MK_F(mk_monitor_older)(const MK_F_T(mk_monitor_view) * view, const MK_REAL *sums, int size) {
    const MK_F_T(mk_monitor) *const core = view->core;
    const int window = core->config->window, front = core->front - (core->front + core->back == window);
    return front > 0 ? sums + (window - front) * size : 0;
}

/* Rows of the window, without its oldest epoch where it is full. */
static uint32_t MK_F(mk_monitor_remaining)(const MK_F_T(mk_monitor_view) * view) {
    const MK_F_T(mk_monitor) *const core = view->core;
    const int window = core->config->window, full = core->front + core->back == window;
    uint32_t rows = 0;
    for (int i = 0; i < window; i++)
        if (i < core->back || i >= window - core->front + full) rows |= view->seen[i];
    return rows;
}

/* L := factor of the rows `set` of A + B, packed; B null: of A. A row that the others determine as far as rounding lets that be told has no pivot: it
   adds nothing to what is solved with L. Returns the number of rows that do. */
static int MK_F(mk_monitor_factor)(uint32_t set, const MK_REAL *A, const MK_REAL *B, MK_REAL *L) {
    int n = 0, good = 0;
    for (int i = 0; i < MK_MONITOR_ROWS; i++) {
        if (!(set >> i & 1u)) continue;
        MK_REAL *const row = L + MK_AT(n, 0);
        for (int j = 0, k = 0; j <= i; j++)
            if (set >> j & 1u) row[k++] = B ? A[MK_AT(i, j)] + B[MK_AT(i, j)] : A[MK_AT(i, j)];
        if (MK_F(mk_ldl_row)(n, L)) good++;
        else row[n] = MK_R(0.0);
        n++;
    }
    return good;
}

static MK_REAL MK_F(mk_monitor_limit)(MK_REAL ratio) { return ratio <= MK_LARGEST ? ratio : MK_LARGEST; }

/* e' S^-1 e, L being the factor of S; e := L^-1 e. */
static MK_REAL MK_F(mk_monitor_square)(int n, const MK_REAL *L, MK_REAL *e) {
    MK_REAL sum = MK_R(0.0);
    MK_F(mk_ldl_forward)(n, 1, L, e);
    for (int i = 0; i < n; i++) sum += e[i] * e[i] * L[MK_AT(i, i)];
    return sum;
}

/* q := v' I^-1 v of the rows `set` of v + v2 and I + I2, or of v and I alone. Returns its degrees of freedom. work: the numbers of I and v. */
static int MK_F(mk_monitor_statistic)(uint32_t set, const MK_REAL *I, const MK_REAL *v, const MK_REAL *I2, const MK_REAL *v2,
                                      MK_REAL *work, MK_REAL *q) {
    const int n = mk_rows_count(set), good = MK_F(mk_monitor_factor)(set, I, I2, work);
    MK_REAL *const e = work + MK_AT(n, 0);
    for (int i = 0, k = 0; k < n; i++)
        if (set >> i & 1u) e[k++] = v2 ? v[i] + v2[i] : v[i];
    *q = MK_F(mk_monitor_square)(n, work, e);
    return good;
}

/* Information Z, v of the rows of the reading, in its order, joins the sums I_sum, v_sum over the newer epochs. */
static void MK_F(mk_monitor_add)(const mk_reading_t *reading, const MK_REAL *Z, const MK_REAL *v, MK_REAL *I_sum, MK_REAL *v_sum) {
    for (int i = 0; i < reading->rows; i++) {
        const int a = reading->row[i].number;
        v_sum[a] += v[i];
        for (int j = 0; j <= i; j++) {
            const int b = reading->row[j].number;
            I_sum[MK_PLACE(a, b)] += Z[MK_AT(i, j)];
        }
    }
}

/* The window without its oldest epoch, if it is full, and with this one: Z and v as above; I_sum, v_sum: the newer epochs with it. */
static void MK_F(mk_monitor_push)(const MK_F_T(mk_monitor_view) * view, const mk_reading_t *reading, const MK_REAL *Z, const MK_REAL *v,
                                  const MK_REAL *I_sum, const MK_REAL *v_sum) {
    MK_F_T(mk_monitor) *const core = view->core;
    const int window = core->config->window, N = core->config->m * core->config->places, packed = MK_AT(N, 0);
    MK_REAL *const I_new = view->information + core->back * packed, *const v_new = view->v + core->back * N;
    if (core->front + core->back == window) core->front--;
    for (int i = 0; i < packed; i++) I_new[i] = MK_R(0.0);
    for (int i = 0; i < N; i++) v_new[i] = MK_R(0.0);
    MK_F(mk_monitor_add)(reading, Z, v, I_new, v_new);
    view->seen[core->back++] = reading->seen;
    MK_F(mk_row_copy)(packed, I_sum, view->information + window * packed);
    MK_F(mk_row_copy)(N, v_sum, view->v + window * N);
    core->held = (uint16_t)(core->front + core->back);
}

/* Where the newer epochs fill the ring they become the older ones. The oldest leaves next: nobody asks for the sum with it. */
static void MK_F(mk_monitor_turn)(const MK_F_T(mk_monitor_view) * view) {
    MK_F_T(mk_monitor) *const core = view->core;
    const int window = core->config->window, N = core->config->m * core->config->places, packed = MK_AT(N, 0);
    if (core->back < window) return;
    for (int i = window - 2; i > 0; i--) {
        MK_F(mk_row_sum)(packed, view->information + (i + 1) * packed, view->information + i * packed);
        MK_F(mk_row_sum)(N, view->v + (i + 1) * N, view->v + i * N);
    }
    core->front = core->back;
    core->back = 0;
}

static void MK_F(mk_monitor_empty)(const MK_F_T(mk_monitor_view) * view) { view->core->front = view->core->back = view->core->held = 0; }

/* --- places --------------------------------------------------------------------------------------------------------------- */

/* Where a sensor has been, or -1. A place that is free still knows who was there last: if nobody came since, he has his old one. */
static int MK_F(mk_monitor_find)(const MK_F_T(mk_monitor_view) * view, uint16_t id) {
    const int places = view->core->config->places;
    for (int used = 1; used >= 0; used--)
        for (int p = 0; p < places; p++)
            if (view->sensor[p].id == id && view->sensor[p].used == used) return p;
    return -1;
}

/* Who of the call is watched, and at which place. */
static void MK_F(mk_monitor_seat)(const MK_F_T(mk_monitor_view) * view, int sensors, const uint16_t *id, const uint8_t *rows,
                                  mk_reading_t *reading) {
    const int m = view->core->config->m, places = view->core->config->places;
    const uint32_t remaining = MK_F(mk_monitor_remaining)(view);
    int reader[MK_MONITOR_ROWS];
    reading->seen = 0;
    reading->remaining = remaining;
    reading->crowded = reading->sensors = reading->rows = 0;
    for (int p = 0; p < places; p++) reader[p] = -1;
    for (int l = 0; l < sensors; l++) {
        const int p = rows[l] ? MK_F(mk_monitor_find)(view, id[l]) : -1;
        if (p >= 0) reader[p] = l;
    }
    for (int l = 0, from = 0; l < sensors; from += rows[l++]) {
        if (!rows[l]) continue;
        int place = -1;
        for (int p = 0; p < places && place < 0; p++)
            if (reader[p] == l) place = p;
        for (int p = 0; p < places && place < 0; p++)
            if (reader[p] < 0 && !view->sensor[p].faulty && !(remaining & mk_rows_of(m, p, m))) place = p;
        if (place < 0) {
            reading->crowded++;
            continue;
        }
        const uint8_t k = reading->sensors++;
        reader[place] = l;
        reading->sensor[k].from = (uint16_t)from;
        reading->sensor[k].index = (uint16_t)l;
        reading->sensor[k].place = (uint8_t)place;
        reading->sensor[k].rows = rows[l];
        if (view->sensor[place].faulty) continue;
        reading->seen |= mk_rows_of(m, place, rows[l]);
        for (int r = 0; r < rows[l]; r++) {
            const uint8_t i = reading->rows++;
            reading->row[i].from = (uint16_t)(from + r);
            reading->row[i].number = (uint8_t)(place * m + r);
            reading->row[i].sensor = k;
        }
    }
}

/* Those who were seated are there, and those of whom nothing is left are gone. */
static void MK_F(mk_monitor_settle)(const MK_F_T(mk_monitor_view) * view, const uint16_t *id, const mk_reading_t *reading) {
    const int m = view->core->config->m, places = view->core->config->places;
    for (int p = 0; p < places; p++) {
        MK_F_T(mk_watched) *const sensor = view->sensor + p;
        if (!sensor->faulty && !(reading->remaining & mk_rows_of(m, p, m))) sensor->used = 0;
    }
    for (int k = 0; k < reading->sensors; k++) {
        MK_F_T(mk_watched) *const sensor = view->sensor + reading->sensor[k].place;
        if (sensor->id != id[reading->sensor[k].index]) memset(sensor, 0, sizeof *sensor);
        sensor->id = id[reading->sensor[k].index];
        sensor->rows = reading->sensor[k].rows;
        sensor->used = 1;
    }
    view->core->crowded += (uint32_t)reading->crowded;
}
