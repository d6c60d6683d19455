/* SPDX-License-Identifier: MIT */
/* A type of MK_UNSCENTED with N states, sensors of up to M rows, SLOTS of them, beside the kernels with every array by itself on the heap: the same
   bits, whatever the update; and an object that is copied and moved about. Scratch memory has the size that the header states: the sanitizers see
   more than that. TAG names the type. */

#define OWN(name) JOIN(JOIN(TAG, PRECISION), name)
MK_UNSCENTED_OF(OWN(), PRECISION, N, M, SLOTS);

static void OWN(_typed)(void **unused) {
    (void)unused;
    for (int kind = 0; kind < 12; kind++) {
        generator_t g = {(uint64_t)kind * 31 + N};
        bent_t motion = {N, N, 0}, sensors[SLOTS];
        TYPE(mk_sensor) sensor[SLOTS];
        REAL Q[MK_PACKED(N)] = {0}, P0[MK_PACKED(N)] = {0}, x0[N], R[SLOTS][MK_PACKED(M)] = {{0}}, single[M], together[M * SLOTS];
        REAL z[M], s[N], S[MK_PACKED(N)];
        const TYPE(mk_gate) gate = {single, together, 2, (uint8_t)(kind % 2)};
        const TYPE(mk_transform) cubature = MK_TRANSFORM_CUBATURE(N), scaled = MK_TRANSFORM_SCALED(N, (REAL)0.5, (REAL)2.0, (REAL)1.0);
        REAL k0[M * SLOTS], k1[M * SLOTS], weight[2][M * SLOTS], statistic[2][M * SLOTS];
        TYPE(mk_row_weights) weights[2] = {{k0, k1, weight[0], statistic[0], (uint8_t)(kind % 2)}, {k0, k1, weight[1], statistic[1], (uint8_t)(kind % 2)}};
        TYPE(mk_unscented_config) config, twin;
        memset(&config, 0, sizeof config);
        memset(sensor, 0, sizeof sensor);
        for (int i = 0; i < N; i++) {
            Q[MK_PACKED(i + 1) - 1] = (REAL)(0.01 * i);
            P0[MK_PACKED(i + 1) - 1] = (REAL)(1.0 + i);
            x0[i] = (REAL)draw_normal(&g);
        }
        for (int l = 0; l < SLOTS; l++) {
            const bent_t made = {N, 1 + (M - 1 + l) % M, l};
            sensors[l] = made;
            for (int r = 0; r < M; r++) R[l][MK_PACKED(r + 1) - 1] = (REAL)0.5;
            sensor[l].model.function = NAME(bent_sensor);
            sensor[l].model.jacobian = NAME(bent_sensor_slope);
            sensor[l].model.context = &sensors[l];
            sensor[l].R = R[l];
            sensor[l].rows = (uint8_t)made.rows;
        }
        for (int r = 0; r < M; r++) single[r] = (REAL)(4 + 2 * r);
        for (int r = 0; r < M * SLOTS; r++) together[r] = (REAL)(3 + r);
        config.n = N;
        config.m = M;
        config.slots = SLOTS;
        config.transition.model.function = NAME(bent_motion);
        config.transition.model.jacobian = NAME(bent_motion_slope);
        config.transition.model.context = &motion;
        config.transition.Q = Q;
        config.sensor = sensor;
        config.x0 = x0;
        config.P0 = P0;
        config.transform = kind % 3 ? cubature : scaled;
        config.gate = kind < 6 ? NULL : &gate;
        config.increments = 3;
        config.update = (uint8_t)(kind % 6 % 5);
        config.rule = (uint8_t)(kind % 3);
        config.one_at_a_time = (uint8_t)(kind % 4 == 3);
        assert_int_equal(NAME(mk_weight_thresholds)(kind % 2, 0.5, M * SLOTS, k0), MK_OK);
        assert_int_equal(NAME(mk_weight_thresholds)(kind % 2, 0.1, M * SLOTS, k1), MK_OK);
        memset(weight, 0, sizeof weight);
        memset(statistic, 0, sizeof statistic);
        if (kind >= 5 && config.update <= MK_UPDATE_EXTENDED) config.weights = &weights[0];
        twin = config;
        if (twin.weights) twin.weights = &weights[1];

        OWN(_t) *f = calloc(1, sizeof *f);
        TYPE(mk_unscented_view) view;
        view.core = calloc(1, sizeof *view.core);
        view.x = calloc(N, sizeof(REAL));
        view.L = calloc(MK_PACKED(N), sizeof(REAL));
        view.z = calloc(M * SLOTS, sizeof(REAL));
        view.have = calloc(SLOTS, 1);
        view.record = calloc(SLOTS, sizeof *view.record);
        view.work = malloc(sizeof(REAL) * MK_UNSCENTED_WORK(N, M, SLOTS));
        assert_int_equal(OWN(_start)(f, &config), MK_OK);
        assert_int_equal(NAME(mk_unscented_start)(N, M, SLOTS, &view, &twin), MK_OK);
        int weighted = 0, most = 0;
        for (int step = 0; step < 60; step++) {
            const REAL dt = (REAL)draw_uniform(&g, 0.0, 1.0);
            assert_int_equal(OWN(_predict)(f, dt, step % 3 ? NULL : P0), MK_OK);
            assert_int_equal(NAME(mk_unscented_predict)(N, &view, dt, step % 3 ? NULL : P0), MK_OK);
            for (int l = 0; l < SLOTS; l++) {
                if (draw_chance(&g, 0.3)) continue;
                for (int r = 0; r < M; r++) z[r] = (REAL)(draw_normal(&g) * (draw_chance(&g, 0.1) ? 20.0 : 2.0));
                assert_int_equal(OWN(_put)(f, l, z), MK_OK);
                assert_int_equal(NAME(mk_unscented_put)(M, SLOTS, &view, l, z), MK_OK);
            }
            if (draw_chance(&g, 0.2)) {
                assert_int_equal(OWN(_drop)(f, 0), MK_OK);
                assert_int_equal(NAME(mk_unscented_drop)(SLOTS, &view, 0), MK_OK);
            }
            if (step % 5 == 2) {
                REAL e[2][M * SLOTS], E[2][MK_PACKED(M * SLOTS)], dx[N];
                uint8_t rows[2][SLOTS];
                memset(e, 0, sizeof e);
                memset(E, 0, sizeof E);
                for (int i = 0; i < N; i++) dx[i] = (REAL)(0.1 * draw_normal(&g));
                assert_int_equal(OWN(_move)(f, dx), MK_OK);
                assert_int_equal(NAME(mk_unscented_move)(N, &view, dx), MK_OK);
                assert_int_equal(OWN(_innovations)(f, e[0], E[0], rows[0]), MK_OK);
                assert_int_equal(NAME(mk_unscented_innovations)(N, M, SLOTS, &view, e[1], E[1], rows[1]), MK_OK);
                assert_memory_equal(e[0], e[1], sizeof e[0]);
                assert_memory_equal(E[0], E[1], sizeof E[0]);
                assert_memory_equal(rows[0], rows[1], sizeof rows[0]);
            }
            if (step % 10 == 9) {
                assert_int_equal(OWN(_contribution)(f, s, S), MK_OK);
                REAL s_kernel[N], S_kernel[MK_PACKED(N)];
                assert_int_equal(NAME(mk_unscented_contribution)(N, M, SLOTS, &view, 0, s_kernel, S_kernel), MK_OK);
                assert_memory_equal(s, s_kernel, sizeof s);
                assert_memory_equal(S, S_kernel, sizeof S);
                assert_int_equal(OWN(_inform)(f, (REAL)2.0, s, S), MK_OK);
                assert_int_equal(NAME(mk_unscented_inform)(N, &view, (REAL)2.0, s, S), MK_OK);
            } else {
                assert_int_equal(OWN(_update)(f), MK_OK);
                assert_int_equal(NAME(mk_unscented_update)(N, M, SLOTS, &view), MK_OK);
            }
            if (step == 40) {
                assert_int_equal(OWN(_restart)(f, x0, P0), MK_OK);
                assert_int_equal(NAME(mk_unscented_restart)(N, SLOTS, &view, x0, P0), MK_OK);
            }
            assert_memory_equal(OWN(_estimate)(f), view.x, sizeof f->x);
            assert_memory_equal(OWN(_root)(f), view.L, sizeof f->L);
            assert_memory_equal(f->have, view.have, sizeof f->have);
            assert_memory_equal(f->record, view.record, sizeof f->record);
            view.core->config = &config;
            assert_memory_equal(&f->core, view.core, sizeof f->core);
            view.core->config = &twin;
            assert_memory_equal(weight[0], weight[1], sizeof weight[0]);
            assert_memory_equal(statistic[0], statistic[1], sizeof statistic[0]);
            weighted += f->core.weighted_rows;
            if (f->core.nis_rows > most) most = f->core.nis_rows;
            REAL P[MK_PACKED(N)], P_kernel[MK_PACKED(N)];
            assert_int_equal(OWN(_covariance)(f, P), MK_OK);
            assert_int_equal(NAME(mk_unscented_covariance)(N, &view, P_kernel), MK_OK);
            assert_memory_equal(P, P_kernel, sizeof P);
            if (step % 7 == 3) { /* moved: nothing in the object points into it */
                OWN(_t) *const moved = malloc(sizeof *moved);
                memcpy(moved, f, sizeof *moved);
                memset(f, 0xA5, sizeof *f);
                free(f);
                f = moved;
            }
        }
        /* Student's weights begin with four rows. */
        assert_true(!config.weights || weighted > (M * SLOTS > 1 ? 10 : 0) || (kind % 2 == MK_STATISTIC_STUDENT && most < 4));
        free(f);
        free(view.core);
        free(view.x);
        free(view.L);
        free(view.z);
        free(view.have);
        free(view.record);
        free(view.work);
    }
}

#undef OWN
#undef N
#undef M
#undef SLOTS
#undef TAG
