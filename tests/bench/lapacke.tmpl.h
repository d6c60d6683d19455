/* SPDX-License-Identifier: MIT */
/* The step in LAPACKE and CBLAS, once for each precision: REAL, DATA (member of bench_case), L(name) (LAPACKE), B(name) (CBLAS),
   F(name). Column order, lower triangles; the _work interfaces, which allocate nothing and check nothing. */

typedef struct {
    int n;
    REAL A[BENCH_N * BENCH_N], At[BENCH_N * BENCH_N], Q[BENCH_N * BENCH_N], W[BENCH_N * BENCH_N], S[BENCH_SLOTS][BENCH_N * BENCH_N];
    REAL x[BENCH_N], theta;
    unsigned turn;
} F(filter);

static F(filter) F(one);

static void F(unpack)(int n, const REAL *packed, REAL *full) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) full[i * n + j] = full[j * n + i] = packed[BENCH_PACKED(i) + j];
}

static int F(start)(const bench_case *c) {
    F(filter) *const f = &F(one);
    const int n = c->n;
    f->n = n;
    f->turn = 0;
    f->theta = (REAL)0;
    for (int i = 0; i < n; i++) {
        f->x[i] = c->DATA.x0[i];
        for (int j = 0; j < n; j++) f->A[i + j * n] = f->At[i * n + j] = c->DATA.A[i * n + j];
    }
    F(unpack)(n, c->DATA.Q, f->Q);
    F(unpack)(n, c->DATA.P0, f->W);
    for (int l = 0; l < BENCH_SLOTS; l++) F(unpack)(n, c->DATA.S + l * BENCH_PACKED(n), f->S[l]);
    return L(potrf_work)(LAPACK_COL_MAJOR, 'L', n, f->W, n) == 0 && L(potri_work)(LAPACK_COL_MAJOR, 'L', n, f->W, n) == 0;
}

/* theta from the eigenvalues, by Newton's method from the root of the last step. */
static int F(root)(F(filter) * f, REAL *P, REAL tolerance) {
    REAL lambda[BENCH_N], work[34 * BENCH_N];
    const int n = f->n;
    if (L(syev_work)(LAPACK_COL_MAJOR, 'N', 'L', n, P, n, lambda, work, 34 * BENCH_N) != 0) return 0;
    const REAL pole = (REAL)1 / lambda[n - 1];
    REAL low = (REAL)0, high = pole, trial = f->theta > low && f->theta < pole ? f->theta : pole / (REAL)2;
    for (int k = 0; k < 100; k++) {
        REAL product = (REAL)1, sum = (REAL)0, squares = (REAL)0;
        for (int i = 0; i < n; i++) {
            const REAL kept = (REAL)1 - trial * lambda[i], t = trial * lambda[i] / kept;
            product *= kept;
            sum += t;
            squares += t * t;
        }
        const REAL step = (tolerance - ((REAL)log((double)product) + sum)) / (squares / trial), next = trial + step;
        if (step > (REAL)0) low = trial;
        else high = trial;
        if ((step < (REAL)0 ? -step : step) < CLOSE * trial) {
            f->theta = next;
            return 1;
        }
        trial = next > low && next < high ? next : (low + high) / (REAL)2;
    }
    return 0;
}

static int F(step)(F(filter) * f, const bench_case *c, unsigned turn) {
    const int n = f->n, all = n * n;
    const REAL one = (REAL)1, zero = (REAL)0;
    REAL Y[BENCH_N * BENCH_N], X[BENCH_N * BENCH_N], P[BENCH_N * BENCH_N], b[BENCH_N] = {zero}, psi[BENCH_N];
    for (int i = 0; i < all; i++) Y[i] = f->W[i];
    for (int l = 0; l < BENCH_SLOTS; l++) {
        const REAL *const C = c->DATA.C + l * BENCH_M * n, *const Fl = c->DATA.F + l * BENCH_M * n;
        REAL e[BENCH_M];
        for (int i = 0; i < all; i++) Y[i] += f->S[l][i];
        for (int r = 0; r < BENCH_M; r++) e[r] = c->DATA.y[turn][l][r];
        B(gemv)(CblasColMajor, CblasTrans, n, BENCH_M, -one, C, n, f->x, 1, one, e, 1);
        B(gemv)(CblasColMajor, CblasNoTrans, n, BENCH_M, one, Fl, n, e, 1, one, b, 1);
    }
    /* Y = L L', X = L^-1 A', P = X' X + Q, psi = A x + X' L^-1 b */
    if (L(potrf_work)(LAPACK_COL_MAJOR, 'L', n, Y, n) != 0) return 0;
    for (int i = 0; i < all; i++) X[i] = f->At[i], P[i] = f->Q[i];
    B(trsm)(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, n, n, one, Y, n, X, n);
    B(trsv)(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, n, Y, n, b, 1);
    B(syrk)(CblasColMajor, CblasLower, CblasTrans, n, n, one, X, n, one, P, n);
    B(gemv)(CblasColMajor, CblasNoTrans, n, n, one, f->A, n, f->x, 1, zero, psi, 1);
    B(gemv)(CblasColMajor, CblasTrans, n, n, one, X, n, b, 1, one, psi, 1);
    for (int i = 0; i < all; i++) f->W[i] = P[i];
    if (L(potrf_work)(LAPACK_COL_MAJOR, 'L', n, f->W, n) != 0 || L(potri_work)(LAPACK_COL_MAJOR, 'L', n, f->W, n) != 0) return 0;
    if (c->DATA.tolerance[0] > zero) {
        if (!F(root)(f, P, c->DATA.tolerance[0])) return 0;
        for (int i = 0; i < n; i++) f->W[i * n + i] -= f->theta;
    }
    for (int i = 0; i < n; i++) f->x[i] = c->DATA.weight[0] * psi[i];
    for (int l = 1; l < BENCH_SLOTS; l++)
        for (int i = 0; i < n; i++) f->x[i] += c->DATA.weight[l] * c->DATA.psi[turn][l][i];
    return 1;
}

static int F(run)(const bench_case *c, int steps) {
    int good = 1;
    for (int t = 0; t < steps; t++) good &= F(step)(&F(one), c, F(one).turn++ % BENCH_MESSAGES);
    return good;
}

static void F(read)(double *theta, double *x) {
    *theta = (double)F(one).theta;
    for (int i = 0; i < F(one).n; i++) x[i] = (double)F(one).x[i];
}
