/* SPDX-License-Identifier: MIT */
/* The functions of precision_t for one REAL; node.c includes this once for each. */

#define PACKED_N MK_PACKED(LARGEST_N)
#define PACKED_M MK_PACKED(LARGEST_M)
/* Three packed matrices more than any contract asks for: what a kernel writes beyond its work is another test's matter. */
#define WORK (MK_RKFD_WORK(LARGEST_N, LARGEST_M) + 3 * PACKED_N)

typedef struct {
    TYPE(mk_rkfd) core;
    TYPE(mk_rkfd_config) config;
    REAL x[LARGEST_N], W[PACKED_N], y[LARGEST_STACK], psi[LARGEST_SLOTS * LARGEST_N], work[WORK];
    uint8_t have_y[LARGEST_SLOTS], have_psi[LARGEST_SLOTS];
    REAL A[LARGEST_N * LARGEST_N], Q[PACKED_N], r[LARGEST_N], x0[LARGEST_N], P0[PACKED_N], weight[LARGEST_SLOTS];
    uint8_t rows[LARGEST_SLOTS];
    REAL C[LARGEST_STACK * LARGEST_N], F[LARGEST_STACK * LARGEST_N], S[LARGEST_SLOTS * PACKED_N];
    REAL R_inverse[LARGEST_SLOTS * PACKED_M];
    TYPE(mk_rkfd_steady) steady;
    REAL Phi[LARGEST_N * LARGEST_N], G[LARGEST_STACK * LARGEST_N], limit[PACKED_N];
} TYPE(unit_node);

static void NAME(convert)(int count, const double *from, REAL *to) {
    for (int i = 0; i < count; i++) to[i] = (REAL)from[i];
}

static void NAME(widen)(int count, const REAL *from, double *to) {
    for (int i = 0; i < count; i++) to[i] = (double)from[i];
}

static void NAME(convert_packed)(int n, const double *full, REAL *to) {
    double packed[PACKED_N];
    pack(n, full, packed);
    NAME(convert)(MK_PACKED(n), packed, to);
}

static TYPE(mk_rkfd_view) NAME(view)(TYPE(unit_node) * f) {
    TYPE(mk_rkfd_view) view;
    view.core = &f->core;
    view.x = f->x;
    view.W = f->W;
    view.y = f->y;
    view.psi = f->psi;
    view.have_y = f->have_y;
    view.have_psi = f->have_psi;
    view.work = f->work;
    return view;
}

static mk_status_t NAME(node_sensor)(node_t *node, const model_t *model, int slot) {
    TYPE(unit_node) *const f = (void *)node;
    const int n = model->n, m = model->m, rows = model->rows[slot];
    REAL R[PACKED_M], *const C = f->C + slot * m * n;
    for (int i = 0; i < m * n; i++) C[i] = (REAL)0.0;
    NAME(convert)(rows * n, model->C[slot], C);
    NAME(convert_packed)(rows, model->R[slot], R);
    f->rows[slot] = (uint8_t)rows;
    return NAME(mk_rkfd_sensor)(n, m, rows, C, R, f->F + slot * m * n, f->S + slot * MK_PACKED(n),
                                f->R_inverse + slot * MK_PACKED(m), f->work);
}

static node_t *NAME(node_make)(const model_t *model) {
    TYPE(unit_node) *const f = calloc(1, sizeof *f);
    if (!f) abort();
    const int n = model->n;
    NAME(convert)(n * n, model->A, f->A);
    NAME(convert)(n, model->r, f->r);
    NAME(convert)(n, model->x0, f->x0);
    NAME(convert)(model->slots, model->weight, f->weight);
    NAME(convert_packed)(n, model->Q, f->Q);
    NAME(convert_packed)(n, model->P0, f->P0);
    for (int l = 0; l < model->slots; l++)
        if (NAME(node_sensor)((node_t *)f, model, l) != MK_OK) abort();
    f->config.n = (uint16_t)n;
    f->config.m = (uint16_t)model->m;
    f->config.slots = (uint16_t)model->slots;
    f->config.A = f->A;
    f->config.Q = f->Q;
    f->config.input = f->r;
    f->config.x0 = f->x0;
    f->config.P0 = f->P0;
    f->config.weight = f->weight;
    f->config.rows = f->rows;
    f->config.C = f->C;
    f->config.F = f->F;
    f->config.S = f->S;
    f->config.R_inverse = f->R_inverse;
    f->config.tolerance = (REAL)model->tolerance;
    return (node_t *)f;
}

static mk_status_t NAME(node_start)(node_t *node) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    return NAME(mk_rkfd_start)(f->config.n, f->config.m, f->config.slots, &view, &f->config);
}

static void NAME(node_give_steady)(node_t *node, const steady_t *steady) {
    TYPE(unit_node) *const f = (void *)node;
    const int n = f->config.n, m = f->config.m;
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++) f->Phi[j * n + i] = (REAL)steady->Phi[i * n + j];
        for (int l = 0; l < f->config.slots; l++)
            for (int r = 0; r < m; r++) f->G[(l * m + r) * n + j] = r < f->rows[l] ? (REAL)steady->G[l][j * f->rows[l] + r] : (REAL)0.0;
    }
    NAME(convert_packed)(n, steady->W, f->limit);
    f->steady.Phi = f->Phi;
    f->steady.G = f->G;
    f->steady.W = f->limit;
    f->steady.theta = (REAL)steady->theta;
    f->steady.trace_P = (REAL)steady->trace_P;
    f->steady.close = (REAL)steady->close;
    f->steady.period = (uint16_t)steady->period;
    f->config.steady = &f->steady;
}

static mk_status_t NAME(node_restart)(node_t *node) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    return NAME(mk_rkfd_restart)(f->config.n, f->config.slots, &view, f->x0, f->P0);
}

static mk_status_t NAME(node_put)(node_t *node, int slot, const double *values, int is_innovation) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    REAL y[LARGEST_M] = {(REAL)0.0};
    NAME(convert)(f->rows[slot], values, y);
    return NAME(mk_rkfd_put)(f->config.n, f->config.m, &view, slot, y, is_innovation);
}

static mk_status_t NAME(node_predict)(node_t *node, int slot, double *e, double *variance) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    REAL innovation[LARGEST_M] = {(REAL)0.0}, packed[PACKED_M] = {(REAL)0.0};
    const mk_status_t status = NAME(mk_rkfd_predict)(f->config.n, f->config.m, &view, slot, innovation, packed);
    double wide[PACKED_M];
    NAME(widen)(f->config.m, innovation, e);
    NAME(widen)(MK_PACKED(f->config.m), packed, wide);
    unpack(f->config.m, wide, variance);
    return status;
}

static mk_status_t NAME(node_innovations)(node_t *node, double *r, double *S, uint8_t *rows) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    REAL innovation[LARGEST_STACK], packed[MK_PACKED(LARGEST_STACK)];
    double wide[MK_PACKED(LARGEST_STACK)];
    int count = 0;
    for (int i = 0; i < WORK; i++) f->work[i] = (REAL)7.0;
    const mk_status_t status = NAME(mk_rkfd_innovations)(f->config.n, f->config.m, f->config.slots, &view, innovation, packed, rows);
    for (int i = MK_RKFD_INNOVATIONS_WORK(f->config.n, f->config.m); i < WORK; i++)
        if (!(f->work[i] == (REAL)7.0)) abort(); /* beyond its work */
    if (status != MK_OK) return status;
    for (int l = 0; l < f->config.slots; l++) count += rows[l];
    NAME(widen)(count, innovation, r);
    NAME(widen)(MK_PACKED(count), packed, wide);
    unpack(count, wide, S);
    return status;
}

static mk_status_t NAME(node_drop)(node_t *node, int slot) {
    const TYPE(mk_rkfd_view) view = NAME(view)((void *)node);
    return NAME(mk_rkfd_drop)(&view, slot);
}

static mk_status_t NAME(node_incremental)(node_t *node, const double *input) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    REAL r[LARGEST_N];
    if (input) NAME(convert)(f->config.n, input, r);
    return NAME(mk_rkfd_incremental)(f->config.n, f->config.m, f->config.slots, &view, input ? r : NULL);
}

static mk_status_t NAME(node_put_estimate)(node_t *node, int slot, const double *psi) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    REAL values[LARGEST_N];
    NAME(convert)(f->config.n, psi, values);
    return NAME(mk_rkfd_put_estimate)(f->config.n, &view, slot, values);
}

static mk_status_t NAME(node_diffuse)(node_t *node) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    return NAME(mk_rkfd_diffuse)(f->config.n, f->config.slots, &view);
}

static mk_status_t NAME(node_set_tolerance)(node_t *node, double c) {
    return NAME(mk_rkfd_set_tolerance)(&((TYPE(unit_node) *)(void *)node)->core, (REAL)c);
}

static mk_status_t NAME(node_see)(node_t *node, seen_t *seen) {
    TYPE(unit_node) *const f = (void *)node;
    const TYPE(mk_rkfd_view) view = NAME(view)(f);
    const int n = f->config.n;
    REAL V[PACKED_N] = {(REAL)0.0};
    double packed[PACKED_N];
    memset(seen, 0, sizeof *seen);
    const mk_status_t status = NAME(mk_rkfd_covariance)(n, &view, V);
    NAME(widen)(MK_PACKED(n), V, packed);
    unpack(n, packed, seen->V);
    NAME(widen)(MK_PACKED(n), f->W, seen->W);
    NAME(widen)(n, f->x, seen->x);
    NAME(widen)(n, f->psi, seen->psi);
    seen->theta = (double)f->core.theta;
    seen->trace_P = (double)f->core.trace_P;
    seen->nis = (double)f->core.nis;
    seen->nis_rows = f->core.nis_rows;
    seen->iterations = f->core.iterations;
    seen->measurements = f->core.measurements;
    seen->estimates = f->core.estimates;
    seen->steps = f->core.steps;
    seen->steps_since_measurement = f->core.steps_since_measurement;
    seen->rejected = f->core.rejected;
    seen->faults = f->core.faults;
    seen->steady = f->core.steady;
    seen->frozen = f->core.frozen;
    return status;
}

static int NAME(node_gamma_root)(int n, const double *packed_P, double c, double *theta) {
    REAL P[PACKED_N], work[MK_GAMMA_WORK(LARGEST_N)], root = (REAL)*theta;
    NAME(convert)(MK_PACKED(n), packed_P, P);
    const int evaluations = NAME(mk_gamma_root)(n, P, (REAL)c, &root, work);
    *theta = (double)root;
    return evaluations;
}

static int NAME(node_gamma)(int n, const double *packed_P, double theta, double *gamma, double *slope) {
    REAL P[PACKED_N], work[MK_GAMMA_WORK(LARGEST_N)], value = (REAL)*gamma, rise = slope ? (REAL)*slope : (REAL)0.0;
    NAME(convert)(MK_PACKED(n), packed_P, P);
    const int good = NAME(mk_gamma)(n, P, (REAL)theta, &value, slope ? &rise : NULL, work);
    *gamma = (double)value;
    if (slope) *slope = (double)rise;
    return good;
}

const precision_t PRECISION = {
    (sizeof(REAL) == sizeof(float)) ? "float32" : "float64",
    (double)EPSILON,
    NAME(node_make),
    NAME(node_start),
    NAME(node_give_steady),
    NAME(node_sensor),
    NAME(node_put),
    NAME(node_predict),
    NAME(node_innovations),
    NAME(node_drop),
    NAME(node_incremental),
    NAME(node_put_estimate),
    NAME(node_diffuse),
    NAME(node_set_tolerance),
    NAME(node_restart),
    NAME(node_see),
    NAME(node_gamma_root),
    NAME(node_gamma),
};

#undef PACKED_N
#undef PACKED_M
#undef WORK
