/* SPDX-License-Identifier: MIT */
/* What takes the time of an update of meshkal/unscented.h: readings stacked and linearised, and used. */

struct MK_F(mk_unscented_kernels);

/* An update under way. "Stacked": the rows of the sensors that are used, in the order of slots. */
typedef struct {
    const MK_F_T(mk_unscented_view) *view;
    const MK_F_T(mk_unscented_config) *config;
    const struct MK_F(mk_unscented_kernels) *kernels;
    int n, m, slots;
    int rows, stacked_rows;          /* stacked, now and when they were judged together */
    int present, beyond;             /* sensors with a reading; those beyond the gate, refused or inflated */
    int back;                        /* the gate's way back was taken: L0 is that of P0 */
    MK_REAL *factor;                 /* slots: what the gate says of a sensor, 0 where there is nothing to use */
    MK_REAL *d2, together;           /* slots: and why; of all together, negative if they were not judged */
    MK_REAL nis;
    const MK_F_T(mk_row_weights) *weights; /* null: none */
    uint16_t weighted_rows, unused_rows; /* rows with a weight below 1, and with 0 */
    MK_F_T(mk_linear) linear;        /* stacked */
    MK_REAL *e;                      /* innovations, stacked */
    MK_REAL *noise;                  /* R as the gate inflates it, packed and stacked */
    MK_REAL *L0;                     /* prior factor */
    MK_REAL *x, *L;                  /* result */
    MK_REAL *one, *mean;             /* m each */
    MK_REAL *points, *results;       /* of linearising; the rest has its place and does not outlive it: */
    MK_REAL *S;                      /* packed and stacked, scratch */
    MK_REAL *B, *b;                  /* rows x n and rows, scratch */
    MK_REAL *scratch;                /* 2 n */
    MK_REAL *trial_x, *trial_L;
} MK_F_T(mk_updating);

/* The two kernels, so that one control flow serves those of any dimensions and those compiled for literal ones. */
typedef struct MK_F(mk_unscented_kernels) {
    mk_status_t (*stack)(MK_F_T(mk_updating) * u, const MK_REAL *x, const MK_REAL *L);
    MK_REAL (*absorb)(MK_F_T(mk_updating) * u, int first, int rows, MK_REAL scale, MK_REAL *L, MK_REAL *x);
} MK_F_T(mk_unscented_kernels);

/* Stacks the sensors that are used, linearised over x and L. */
MK_KERNEL mk_status_t MK_F(mk_inline_stack)(int n, int m, int slots, MK_F_T(mk_updating) * u, const MK_REAL *x, const MK_REAL *L) {
    const MK_F_T(mk_unscented_config) *const config = u->config;
    const int extended = config->update == MK_UPDATE_EXTENDED;
    const MK_F_T(mk_weights) weights = MK_F(mk_weigh)(&config->transform);
    int first = 0, drawn = 0;
    for (int l = 0; l < slots; l++) {
        if (!(u->factor[l] > MK_R(0.0))) continue;
        const MK_F_T(mk_sensor) *const sensor = config->sensor + l;
        const MK_F_T(mk_space) *const space = sensor->model.space;
        const int rows = m == 1 ? 1 : sensor->rows;
        const MK_F_T(mk_linear) part = {u->linear.D + first * n, u->linear.U + first * n, u->linear.mu + first, u->linear.epsilon + first, n, 1};
        mk_status_t status;
        u->view->core->failed = (uint16_t)l;
        if (extended) {
            status = MK_F(mk_extend)(n, rows, &sensor->model, MK_R(0.0), x, L, u->results, &part, u->mean);
        } else {
            if (!drawn) MK_F(mk_draw)(n, weights.c, x, L, u->points);
            drawn = !(space && space->mean); /* which spoils them */
            status = MK_F(mk_linearise)(n, rows, &sensor->model, config->one_at_a_time, &weights, MK_R(0.0), u->points, u->results, u->one, &part, u->mean);
        }
        if (status != MK_OK) return status;
        MK_F(mk_space_difference)(space, rows, u->view->z + l * m, u->mean, u->e + first);
        if (!MK_F(mk_all_finite)(rows, u->e + first)) return MK_ERROR_NOT_FINITE;
        first += rows;
    }
    u->rows = first;
    u->view->core->failed = (uint16_t)slots;
    return MK_OK;
}

/* Element (r, s) of Omega: the residual of the linearisation. */
MK_KERNEL MK_REAL MK_F(mk_residual)(int n, const MK_F_T(mk_transform) * transform, MK_REAL half_w, const MK_F_T(mk_linear) * l, int r, int s) {
    const MK_REAL b = transform->correction, *const u = l->U + r * n, *const v = l->U + s * n;
    MK_REAL sum = MK_R(0.0);
    MK_UNROLL for (int j = 0; j < n; j++) sum += u[j] * v[j];
    return sum * half_w + b * l->mu[r] * l->mu[s] + (MK_R(1.0) + b) * (l->epsilon[r] * l->mu[s] + l->mu[r] * l->epsilon[s]) +
           (MK_R(2.0) + b) * l->epsilon[r] * l->epsilon[s];
}

/* The same of stacked rows; an update that needs no transform has none. */
MK_KERNEL MK_REAL MK_F(mk_stack_residual)(int n, const MK_F_T(mk_updating) * u, int r, int s) {
    const MK_F_T(mk_transform) *const transform = &u->config->transform;
    return u->config->update == MK_UPDATE_EXTENDED ? MK_R(0.0) : MK_F(mk_residual)(n, transform, MK_R(0.25) / transform->spread, &u->linear, r, s);
}

/* Element (r, s) of Omega + D D'. */
MK_KERNEL MK_REAL MK_F(mk_stack_spread)(int n, const MK_F_T(mk_updating) * u, int r, int s) {
    MK_REAL sum = MK_F(mk_stack_residual)(n, u, r, s);
    for (int i = 0; i < n; i++) sum += u->linear.D[r * n + i] * u->linear.D[s * n + i];
    return sum;
}

/* B, b := D, e of `rows` stacked rows from `first` with unit variance instead of scale noise + Omega. 1, or 0: that is not positive definite. */
MK_KERNEL int MK_F(mk_stack_whiten)(int n, MK_F_T(mk_updating) * u, int first, int rows, MK_REAL scale, int with_residual) {
    const MK_F_T(mk_transform) *const transform = &u->config->transform;
    const MK_REAL half_w = MK_R(0.25) / transform->spread;
    if (u->config->update == MK_UPDATE_EXTENDED) with_residual = 0; /* it needs no transform */
    for (int r = 0; r < rows; r++) {
        for (int s = 0; s <= r; s++) {
            u->S[MK_AT(r, s)] = scale * u->noise[MK_AT(first + r, first + s)];
            if (with_residual) u->S[MK_AT(r, s)] += MK_F(mk_residual)(n, transform, half_w, &u->linear, first + r, first + s);
        }
        u->b[r] = u->e[first + r];
        MK_F(mk_row_copy)(n, u->linear.D + (first + r) * n, u->B + r * n);
    }
    return MK_F(mk_whiten)(n, rows, u->S, u->B, u->b);
}

/* x, L := those given these rows, their noise times scale; L null: neither. Returns e' (scale noise + Omega + D D')^-1 e, or -1 if a variance is not
   positive definite. */
MK_KERNEL MK_REAL MK_F(mk_inline_absorb)(int n, MK_F_T(mk_updating) * u, int first, int rows, MK_REAL scale, MK_REAL *L, MK_REAL *x) {
    if (!MK_F(mk_stack_whiten)(n, u, first, rows, scale, 1)) return MK_R(-1.0);
    return MK_F(mk_shrink)(n, rows, u->B, u->b, L, x, u->scratch);
}
