/* SPDX-License-Identifier: MIT */
/* What all kinds of tracking filters share. */

struct MK_F(unit);
struct MK_F(node);
struct MK_F(extended_node);

typedef struct {
    const MK_F_T(mk_models) *models;
    const mk_track_setting_t *setting;
    mk_track_look_t look;
    int n, m, E, run;
    double own_count[MK_TRACK_COUNTS]; /* what the library's objects do not count */
    double Q_dt;                       /* the interval of Q, below 0: none yet */
    MK_REAL *Q, *z, *V, *x0;           /* packed n; m; packed n; n */
    double *owed;                      /* E: seconds that could not be predicted over */
    struct MK_F(unit) * unit;          /* central */
    struct MK_F(node) * node;          /* duif, kcf: E */
    struct MK_F(extended_node) * extended;
    mk_random_t *random;               /* E */
    const mk_reading_t **reading;      /* nodes: of the step, null where there is none */
    uint8_t *frames;                   /* duif, kcf: of an iteration, E x frame_most bytes */
    size_t *frame_length, frame_most;
    double *watched;                   /* E + 1 packed matrices */
} MK_F(tracker);

static const MK_REAL *MK_F(noise)(MK_F(tracker) * t, double dt, mk_error_t *error) {
    if (dt == t->Q_dt) return t->Q;
    if (!MK_F(mk_models_noise)(t->models, dt, t->Q, error)) return NULL;
    t->Q_dt = dt;
    return t->Q;
}

/* The rows of a reading, in this precision. */
static const MK_REAL *MK_F(rows_of)(MK_F(tracker) * t, const mk_reading_t *reading) {
    for (int r = 0; r < t->models->sensor[reading->node].rows; r++) t->z[r] = (MK_REAL)reading->z[r];
    return t->z;
}

static const mk_reading_t *const *MK_F(readings)(MK_F(tracker) * t, const mk_instant_t *instant) {
    for (int k = 0; k < t->models->slots; k++) t->reading[k] = NULL;
    for (int i = 0; i < instant->count; i++) t->reading[instant->reading[i].node] = &instant->reading[i];
    return t->reading;
}

static void MK_F(failed)(MK_F(tracker) * t, mk_status_t status) { t->own_count[MK_TRACK_FAILED + (int)status]++; }

/* The way of a prediction that may fail: over what is owed, too; then from P0; then later. The caller's attempts: */
typedef mk_status_t (*MK_F(attempt_t))(MK_F(tracker) * t, int e, MK_REAL dt, const MK_REAL *Q);

static int MK_F(predict_all)(MK_F(tracker) * t, double dt, MK_F(attempt_t) predict, MK_F(attempt_t) restart, mk_error_t *error) {
    for (int e = 0; e < t->E; e++) {
        const double span = t->owed[e] + dt;
        if (!(span > 0.0)) continue;
        const MK_REAL *Q = MK_F(noise)(t, span, error);
        if (!Q) return 0;
        mk_status_t status = predict(t, e, (MK_REAL)span, Q);
        if (status != MK_OK) {
            MK_F(failed)(t, status);
            status = restart(t, e, MK_R(0.0), Q);
            t->own_count[MK_TRACK_REINITIALISED] += status == MK_OK;
            if (status == MK_OK) status = predict(t, e, (MK_REAL)span, Q);
        }
        t->owed[e] = status == MK_OK ? 0.0 : span;
    }
    return 1;
}

/* What an update of a filter of meshkal/unscented.h made of the readings that had arrived in its slots, which begin at `first`. judged: how often
   the stacked gate had judged before. */
static uint32_t MK_F(judged)(const MK_F_T(mk_unscented) * core) { return core->stacked.accepted + core->stacked.rejected + core->stacked.inflated; }

static void MK_F(settle)(MK_F(tracker) * t, const MK_F_T(mk_unscented_view) * view, int e, int first, int slots, uint32_t judged) {
    const MK_F_T(mk_unscented) *const core = view->core;
    const MK_F_T(mk_gate) *const gate = core->config->gate;
    const int inflates = gate && gate->policy == MK_GATE_INFLATE;
    const int together = MK_F(judged)(core) != judged, beyond = together && core->stacked.ratio > MK_R(1.0);
    t->look.stacked_ratio[e] = together ? (double)core->stacked.ratio : 0.0;
    t->look.nis[e] = (double)core->nis;
    t->look.nis_rows[e] = core->nis_rows;
    for (int l = 0; l < slots; l++) {
        uint8_t *const decision = &t->look.decision[first + l];
        if (*decision != MK_READING_ACCEPTED) continue;
        const int alone = view->record[l].ratio > MK_R(1.0);
        t->look.ratio[first + l] = (double)view->record[l].ratio;
        *decision = (alone && !inflates) || (beyond && !inflates) ? MK_READING_REJECTED : alone || beyond ? MK_READING_INFLATED : MK_READING_ACCEPTED;
    }
}

/* After a step the decisions are counted. */
static void MK_F(count_decisions)(MK_F(tracker) * t) {
    static const int place[5] = {-1, MK_TRACK_ACCEPTED, MK_TRACK_REJECTED, MK_TRACK_INFLATED, MK_TRACK_REFUSED};
    const int slots = t->setting->topology.first[t->E];
    for (int i = 0; i < slots; i++)
        if (place[t->look.decision[i]] >= 0) t->own_count[place[t->look.decision[i]]]++;
}

static void MK_F(clear_look)(MK_F(tracker) * t) {
    const size_t E = (size_t)t->E, slots = (size_t)t->setting->topology.first[E];
    memset(t->look.decision, 0, 2 * slots);                              /* and arrived */
    memset(t->look.nis_rows, 0, (E + slots) * sizeof *t->look.nis_rows); /* and messages */
    memset(t->look.nis, 0, E * sizeof *t->look.nis);
    memset(t->look.stacked_ratio, 0, (E + slots) * sizeof *t->look.nis); /* and ratio */
}

static void MK_F(look_at)(MK_F(tracker) * t, int e, const MK_REAL *x, const MK_REAL *V) {
    const int packed = MK_PACKED(t->n);
    for (int i = 0; i < t->n; i++) t->look.estimate[e * t->n + i] = (double)x[i];
    for (int i = 0; i < packed; i++) t->look.covariance[e * packed + i] = (double)V[i];
}
