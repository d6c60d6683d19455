/* SPDX-License-Identifier: MIT */

#define OWN (BITS == 64 ? 1 : 0)
#define NEAR (BITS == 64 ? 1e-9 : 1e-3)

static void V(reading)(V(bench_t) * b, int slot, uint32_t step, const double *y, mk_status_t status) {
    wire_t wire;
    wire_plain(&wire, 1, OWN, 0, 10u + (unsigned)slot, MODEL, step, b->rows[slot], y);
    assert_int_equal(V(give)(b, wire.bytes, wire.length), status);
}

static void V(model_of)(int number, int *rows, double C[M * N], double R[M * M]) {
    REAL c[M * N], r[3];
    *rows = V(sensor)(number, c, r);
    for (int i = 0; i < M * N; i++) C[i] = (double)c[i];
    R[0] = (double)r[0];
    if (*rows == 2) {
        R[1] = R[2] = (double)r[1];
        R[3] = (double)r[2];
    }
}

/* e' (C V C' + R)^-1 e from the information matrix that the node carries. */
static double V(distance)(const V(bench_t) * b, int slot, const double *y) {
    double C[M * N], R[M * M], packed[6], W[N * N], E[N * N], E_inverse[M * M], e[M], sum = 0.0;
    int rows;
    V(model_of)(b->nodes[slot], &rows, C, R);
    for (int i = 0; i < 6; i++) packed[i] = (double)b->node.filter.W[i];
    unpack(N, packed, W);
    reference_inverse(N, W, E);
    double S[M * M];
    for (int r = 0; r < rows; r++) {
        e[r] = y[r];
        for (int j = 0; j < N; j++) e[r] -= C[r * N + j] * (double)b->node.filter.x[j];
        for (int s = 0; s < rows; s++) {
            S[r * rows + s] = R[r * rows + s];
            for (int i = 0; i < N; i++)
                for (int j = 0; j < N; j++) S[r * rows + s] += C[r * N + i] * E[i * N + j] * C[s * N + j];
        }
    }
    reference_inverse(rows, S, E_inverse);
    for (int r = 0; r < rows; r++)
        for (int s = 0; s < rows; s++) sum += e[r] * E_inverse[r * rows + s] * e[s];
    return sum;
}

/* Each slot by itself; a threshold of 0 is none. */
static void V(thresholds)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    generator_t g = {11};
    uint32_t all = 0, close = 0, expected[SLOTS] = {0};
    MK_T(mk_gate_record) record[SLOTS];
    memset(record, 0, sizeof record);
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.gate = &b.gate;
    b.gate.record = record;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    for (uint32_t t = 0; t < 300; t++) {
        unsigned refused = 0, used = 0, none = 0;
        for (int l = 0; l < SLOTS; l++) {
            double y[M];
            REAL own[M];
            for (int r = 0; r < M; r++) {
                own[r] = (REAL)(4.0 * draw_normal(&g));
                y[r] = (double)own[r];
            }
            const double distance = V(distance)(&b, l, y);
            /* On either side of the exact value, as near as rounding allows, or anywhere. */
            const int side = draw_below(&g, 4);
            const double limit = side == 0 ? distance * (1.0 + NEAR) : side == 1 ? distance * (1.0 - NEAR) : side == 2 ? 0.0 : draw_uniform(&g, 0.1, 12.0);
            b.threshold[l] = (REAL)limit;
            if (side < 2) close++;
            if (draw_chance(&g, 0.2)) {
                none++;
                continue;
            }
            if (l == 0) assert_int_equal(UNIT(measure)(&b.node, own), MK_OK);
            else V(reading)(&b, l, t, y, MK_OK);
            const int over = limit > 0.0 && distance > limit;
            if (side == 3 && fabs(distance / limit - 1.0) < NEAR) b.threshold[l] = (REAL)0.0, used++;
            else refused += (unsigned)over, used += (unsigned)!over, expected[l] += (uint32_t)over;
        }
        all += refused;
        assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
        assert_int_equal(b.node.filter.core.measurements, used);
        assert_int_equal(b.node.node.gated, refused);
        assert_int_equal(b.node.node.counts[MK_ERROR_GATED], all);
        for (int l = 0; l < SLOTS; l++) assert_int_equal(record[l].rejected, expected[l]);
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
    }
    for (int l = 0; l < SLOTS; l++) assert_true(record[l].accepted > 50 && record[l].inflated == 0);
    assert_true(all > 200 && close > 300);
    assert_int_equal(b.node.node.reinitialised, 0);
}

/* A reading that was gated has not come, bit for bit; also one too large for its square to be a number. */
static void V(as_if_not_heard)(void **unused) {
    (void)unused;
    static V(bench_t) a, b;
    V(bench_start)(&a, 10, 11, 12, 13);
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.gate = &b.gate;
    for (int l = 0; l < SLOTS; l++) b.threshold[l] = (REAL)1e4;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    for (uint32_t t = 0; t < 20; t++) {
        const double good[M] = {0.5, -0.25}, far[M] = {t % 2 ? 1e6 : 3e38, 1.0};
        V(reading)(&a, 1, t, good, MK_OK);
        V(reading)(&b, 1, t, good, MK_OK);
        V(reading)(&a, 3, t, good, MK_OK);
        V(reading)(&b, 3, t, good, MK_OK);
        V(reading)(&b, 2, t, far, MK_OK);
        V(step)(&a);
        V(step)(&b);
        assert_int_equal(b.node.node.counts[MK_ERROR_GATED], t + 1);
        assert_memory_equal(&a.node.filter.x, &b.node.filter.x, sizeof a.node.filter.x);
        assert_memory_equal(&a.node.filter.W, &b.node.filter.W, sizeof a.node.filter.W);
    }
    assert_int_equal(b.node.node.gated_steps, 0);
}

/* A filter that is wrong: after more than `patience` steps in which most were refused its covariance is opened and they are taken. */
static void V(way_back)(void **unused) {
    (void)unused;
    static V(bench_t) b, plain;
    const double y[M] = {300.0, 300.0}, near[M] = {0.0, 0.0};
    for (int patience = 0; patience < 4; patience++) {
        V(bench_make)(&b, 10, 11, 12, 13);
        b.config.gate = &b.gate;
        b.gate.patience = (uint16_t)patience;
        for (int l = 0; l < SLOTS; l++) b.threshold[l] = (REAL)20.0;
        assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
        uint32_t t = 0;
        /* Steps without readings neither count nor end the row; a step in which half was good ends it. */
        V(reading)(&b, 1, t, y, MK_OK);
        V(step)(&b), t++;
        assert_int_equal(b.node.node.gated_steps, 1);
        V(step)(&b), t++;
        assert_int_equal(b.node.node.gated_steps, 1);
        V(reading)(&b, 1, t, y, MK_OK);
        V(reading)(&b, 2, t, near, MK_OK);
        V(step)(&b), t++;
        assert_int_equal(b.node.node.gated_steps, 0);
        assert_int_equal(b.node.node.reinitialised, 0);
        for (int i = 0; i < 20; i++, t++) {
            REAL x[N];
            memcpy(x, b.node.filter.x, sizeof x);
            V(reading)(&b, 1, t, y, MK_OK);
            V(reading)(&b, 3, t, y, MK_OK);
            const uint32_t before = b.node.node.reinitialised;
            assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
            if (b.node.node.reinitialised > before) {
                /* x stays, W is that of the start, the readings are used. */
                V(bench_make)(&plain, 10, 11, 12, 13);
                memcpy(plain.x0, x, sizeof x);
                assert_int_equal(UNIT(start)(&plain.node, &plain.config), MK_OK);
                V(reading)(&plain, 1, 0, y, MK_OK);
                V(reading)(&plain, 3, 0, y, MK_OK);
                assert_int_equal(UNIT(incremental)(&plain.node), MK_OK);
                assert_memory_equal(plain.node.filter.psi, b.node.filter.psi, sizeof x);
                assert_memory_equal(plain.node.filter.W, b.node.filter.W, sizeof b.node.filter.W);
                assert_int_equal(b.node.filter.core.measurements, 2);
                assert_int_equal(b.node.node.gated, 0);
                assert_int_equal(b.node.node.gated_steps, 0);
                assert_int_equal(i, patience);
                break;
            }
            assert_int_equal(b.node.filter.core.measurements, 0);
            assert_int_equal(b.node.node.gated, 2);
            assert_int_equal(b.node.node.gated_steps, i + 1);
            assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        }
        assert_int_equal(b.node.node.reinitialised, patience > 0);
    }
}

/* (psi_l - psi)' W (psi_l - psi). */
static void V(estimates)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    generator_t g = {3};
    wire_t wire;
    uint32_t all = 0;
    V(bench_make)(&b, 10, 11, 12, 13);
    b.config.gate = &b.gate;
    b.gate.estimate = (REAL)1.0;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    for (uint32_t t = 0; t < 200; t++) {
        unsigned kept = 1;
        const REAL y[M] = {(REAL)draw_normal(&g), (REAL)draw_normal(&g)};
        assert_int_equal(UNIT(measure)(&b.node, y), MK_OK);
        assert_int_equal(UNIT(incremental)(&b.node), MK_OK);
        for (int l = 1; l < SLOTS; l++) {
            double psi[N], packed[6], W[N * N], square = 0.0, wanted = 0.0;
            for (int i = 0; i < 6; i++) packed[i] = (double)b.node.filter.W[i];
            unpack(N, packed, W);
            for (int i = 0; i < N; i++) psi[i] = draw_normal(&g);
            for (int i = 0; i < N; i++)
                for (int j = 0; j < N; j++) square += psi[i] * W[i * N + j] * psi[j];
            /* Scaled to lie close to the threshold, on one side or the other. */
            const int far = draw_chance(&g, 0.4), absurd = far && draw_chance(&g, 0.2);
            wanted = sqrt((far ? 1.0 + 2.0 * NEAR : 1.0 - 2.0 * NEAR) / square);
            for (int i = 0; i < N; i++) psi[i] = absurd ? 1e38 : (double)(REAL)((double)b.node.filter.psi[i] + wanted * psi[i]);
            wire_plain(&wire, 2, OWN, 0, 10u + (unsigned)l, MODEL, t, N, psi);
            V(taken)(&b, wire.bytes, wire.length);
            kept += !far;
        }
        assert_int_equal(UNIT(diffuse)(&b.node), MK_OK);
        assert_int_equal(b.node.filter.core.estimates, kept);
        assert_int_equal(b.node.node.gated, 4 - kept);
        all += 4 - kept;
        assert_int_equal(b.node.node.counts[MK_ERROR_GATED], all);
        for (int i = 0; i < N; i++) assert_true(fabs((double)b.node.filter.x[i]) < 100.0);
    }
    assert_true(all > 150);
}

static double V(decode)(int format, const uint8_t *bytes, int i) {
    float single;
    double wide;
    uint16_t two;
    memcpy(&single, bytes + 4 * i, 4);
    memcpy(&wide, bytes + 8 * i, 8);
    memcpy(&two, bytes + 2 * i, 2);
    if (format != 2) return format ? wide : (double)single;
    const int exponent = two >> 10 & 31;
    const double value = exponent ? ldexp(1024 + (two & 1023), exponent - 25) : ldexp(two & 1023, -24);
    return two & 0x8000u ? -value : value;
}

/* What is sent as (G, z): G'G = C' R^-1 C and G'z = C' R^-1 y. */
static void V(square_root)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    generator_t g = {4};
    for (int number = 10; number < 14; number++)
        for (int format = 0; format <= 2; format++) {
            double C[M * N], R[M * M], R_inverse[M * M], y[M];
            REAL own[M];
            uint8_t bytes[UNIT(frame_max) + 64] = {0};
            int rows;
            if (BITS == 32 && format == 1) continue;
            V(bench_make)(&b, number, 21, 22, 23);
            b.config.numbers = (uint8_t)format;
            b.config.with_model = 1;
            assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
            V(model_of)(number, &rows, C, R);
            for (int r = 0; r < M; r++) y[r] = (double)(own[r] = (REAL)draw_normal(&g));
            assert_int_equal(UNIT(measure)(&b.node, own), MK_OK);
            const size_t count = (size_t)rows * (N + 1), length = UNIT(frame)(&b.node, 1, bytes);
            assert_int_equal(length, 16 + count * (format == 1 ? 8 : format ? 2 : 4));
            assert_int_equal(bytes[1], 1 | format << 2 | 16);
            reference_inverse(rows, R, R_inverse);
            const double rounding = format == 2 ? 0x1p-10 : format == 1 ? 1e-14 : 1e-6;
            for (int i = 0; i < N; i++)
                for (int j = 0; j <= N; j++) { /* column N: z beside y */
                    double found = 0.0, exact = 0.0, size = 0.0;
                    for (int r = 0; r < rows; r++) {
                        const double left = V(decode)(format, bytes + 12, r * N + i),
                                     right = V(decode)(format, bytes + 12, j < N ? r * N + j : rows * N + r);
                        found += left * right;
                        size += fabs(left * right);
                        for (int s = 0; s < rows; s++) exact += C[r * N + i] * R_inverse[r * rows + s] * (j < N ? C[s * N + j] : y[s]);
                    }
                    assert_true(fabs(found - exact) <= 3.0 * rounding * (size + 1e-3));
                }
        }
}

/* A step with neighbours that send their models is the step that has the models. */
static void V(foreign_step)(void **unused) {
    (void)unused;
    static V(bench_t) known, told, sender[SLOTS];
    generator_t g = {6};
    V(bench_start)(&known, 10, 11, 12, 13);
    V(bench_make)(&told, 10, 11, 12, 13);
    for (int l = 1; l <= 2; l++) {
        told.is_foreign[l] = 1;
        memset(told.C + l * M * N, 0, sizeof(REAL) * M * N);
        memset(told.F + l * M * N, 0, sizeof(REAL) * M * N);
        memset(told.S + l * 6, 0, sizeof(REAL) * 6);
        memset(told.R_inverse + l * 3, 0, sizeof(REAL) * 3);
    }
    told.config.foreign = &told.foreign;
    assert_int_equal(UNIT(start)(&told.node, &told.config), MK_OK);
    for (int l = 1; l < SLOTS; l++) {
        V(bench_make)(&sender[l], 10 + l, 10, 22, 23);
        sender[l].config.with_model = told.is_foreign[l];
        assert_int_equal(UNIT(start)(&sender[l].node, &sender[l].config), MK_OK);
    }
    for (uint32_t t = 0; t < 30; t++) {
        for (int l = 1; l < SLOTS; l++) {
            uint8_t bytes[UNIT(frame_max)];
            REAL own[M];
            double y[M];
            for (int r = 0; r < M; r++) y[r] = (double)(own[r] = (REAL)draw_normal(&g));
            assert_int_equal(UNIT(measure)(&sender[l].node, own), MK_OK);
            V(taken)(&told, bytes, UNIT(frame)(&sender[l].node, 1, bytes));
            V(reading)(&known, l, t, y, MK_OK);
            V(step)(&sender[l]);
        }
        assert_int_equal(UNIT(incremental)(&known.node), MK_OK);
        assert_int_equal(UNIT(incremental)(&told.node), MK_OK);
        assert_int_equal(told.node.filter.core.nis_rows, known.node.filter.core.nis_rows);
        const double most = BITS == 64 ? 1e-12 : 2e-4;
        assert_true(fabs((double)told.node.filter.core.nis / (double)known.node.filter.core.nis - 1.0) < most);
        assert_int_equal(UNIT(diffuse)(&known.node), MK_OK);
        assert_int_equal(UNIT(diffuse)(&told.node), MK_OK);
        for (int i = 0; i < N; i++) assert_true(fabs((double)told.node.filter.x[i] - (double)known.node.filter.x[i]) < most);
        for (int i = 0; i < 6; i++) assert_true(fabs((double)told.node.filter.W[i] - (double)known.node.filter.W[i]) < 10.0 * most);
    }
}

static void V(foreign_refused)(void **unused) {
    (void)unused;
    static V(bench_t) b;
    wire_t wire;
    const double values[8] = {1.0, 2.0, 3.0, 0.5, -1.0, 2.0, 7.0, 8.0}; /* trace of G'G: 19.25 */
    V(bench_make)(&b, 10, 11, 12, 13);
    b.is_foreign[1] = 1;
    b.foreign.limit = (REAL)19.25;
    b.config.foreign = &b.foreign;
    assert_int_equal(UNIT(start)(&b.node, &b.config), MK_OK);
    wire_plain(&wire, 1, OWN, 0, 11, MODEL, 0, 2, values);
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_TYPE, 0);
    wire_plain(&wire, 1, OWN, 16, 13, MODEL, 0, 8, values);
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_TYPE, 0);
    for (int count = 0; count < 20; count++) {
        const double many[20] = {0.0};
        if (count == 8) continue;
        wire_plain(&wire, 1, OWN, 16, 11, MODEL, 0, count, many);
        V(refused)(&b, wire.bytes, wire.length, MK_ERROR_LENGTH, 0);
    }
    for (int place = 0; place < 8; place++)
        for (int i = 0; i < 5; i++) {
            static const double bad[] = {(double)NAN, (double)INFINITY, 1e25, -1e25, 4.0};
            double changed[8];
            /* In z anything goes that is a number. */
            if (place >= 6 && i >= 2) continue;
            memcpy(changed, values, sizeof changed);
            changed[place] = bad[i];
            wire_plain(&wire, 1, OWN, 16, 11, MODEL, 0, 8, changed);
            V(refused)(&b, wire.bytes, wire.length, i < 2 ? MK_ERROR_NOT_FINITE : MK_ERROR_IMPLAUSIBLE, 1);
        }
    /* Without a limit only what is not a number any more. */
    b.foreign.limit = (REAL)0.0;
    double huge[8] = {0.0};
    huge[3] = BITS == 64 ? 1e200 : 1e20;
    wire_plain(&wire, 1, OWN, 16, 11, MODEL, 0, 8, huge);
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_IMPLAUSIBLE, 1);
    b.foreign.limit = (REAL)19.25;
    wire_plain(&wire, 1, OWN, 16, 11, MODEL, 0, 8, values);
    V(taken)(&b, wire.bytes, wire.length);
    /* A second one does not change the model of the first. */
    V(refused)(&b, wire.bytes, wire.length, MK_ERROR_REPEATED, 1);
    V(step)(&b);
}

#undef OWN
#undef NEAR
