/* SPDX-License-Identifier: MIT */

static const char MK_F(full)[] =
    "{" MODEL("") NODES ", \"tracking\": {\"transform\": {\"kind\": \"scaled\", \"alpha\": 0.5, \"beta\": 2.5, \"kappa\": 1},"
    " \"increments\": 7, \"rule\": \"mahalanobis\", \"gate\": {\"significance\": 0.01, \"policy\": \"inflate\", \"patience\": 4, \"filters\": [\"mpukf\", \"ekf\"]}}}";

static MK_F_T(mk_models) * MK_F(open)(const scene_t *scene, const mk_plugin_t *plugin) {
    mk_error_t error = {""};
    MK_F_T(mk_models) *models = MK_F(mk_models_open)(&scene->s, plugin, &error);
    if (!models) fail_msg("%s", error.text);
    return models;
}

static void MK_F(near)(MK_REAL given, double wanted) {
    if (!(fabs((double)given - wanted) <= 4.0 * (double)MK_EPSILON * (fabs(wanted) + 1.0))) fail_msg("%.17g, not %.17g", (double)given, wanted);
}

static void MK_F(models)(void **state) {
    (void)state;
    scene_t scene;
    mk_error_t error;
    open_scene(&scene, MK_F(full));
    MK_F_T(mk_models) *models = MK_F(open)(&scene, NULL);
    const MK_REAL x[4] = {MK_R(3.0), MK_R(5.0), MK_R(-1.0), MK_R(2.0)};
    MK_REAL y[4], J[8];
    assert_int_equal(models->n, 4);
    assert_int_equal(models->m, 2);
    assert_int_equal(models->slots, 4);
    MK_F(near)(models->transform.spread, 0.25 * 5.0);
    MK_F(near)(models->transform.correction, 2.25);
    const mk_status_t moved = models->transition.model.function(models->transition.model.context, MK_R(0.5), 1, x, y);
    assert_int_equal(moved, MK_OK);
    MK_F(near)(y[0], 2.5);
    MK_F(near)(y[1], 6.0);
    static const double wanted[4][2] = {{5.8309518948453, 0}, {3.605551275463989, 0.9827937232473290}, {3, 0}, {-6.0, 0}};
    static const int rows[4] = {1, 2, 1, 1};
    for (int k = 0; k < 4; k++) {
        const MK_F_T(mk_sensor) *sensor = &models->sensor[k];
        assert_int_equal(sensor->rows, rows[k]);
        assert_int_equal(sensor->model.function(sensor->model.context, MK_R(0.0), 1, x, y), MK_OK);
        for (int r = 0; r < rows[k]; r++) MK_F(near)(y[r], wanted[k][r]);
        assert_int_equal(sensor->model.jacobian(sensor->model.context, MK_R(0.0), x, J), MK_OK);
        assert_int_equal(sensor->model.space != NULL, k == 1);
    }
    MK_F(near)(models->sensor[1].R[1], 0.5);
    const MK_REAL a[2] = {MK_R(5.0), MK_R(3.0)}, b[2] = {MK_R(1.0), MK_R(-3.0)};
    models->sensor[1].model.space->difference(models->sensor[1].model.space->context, a, b, y);
    MK_F(near)(y[0], 4.0);
    MK_F(near)(y[1], 6.0 - 6.283185307179586);
    /* scipy.stats.chi2.isf(0.01, r) */
    static const double quantile[8] = {6.63489660102122, 9.21034037197618, 11.3448667301444, 13.2767041359876, 15.086272469389, 16.8118938297709, 18.4753069065824, 20.0902350296632};
    const double close = MK_BITS == 32 ? 1e-6 : 1e-12;
    for (int r = 0; r < 8; r++) assert_true(fabs((double)models->gate.stacked[r] / quantile[r] - 1.0) < close);
    for (int r = 0; r < 2; r++) assert_true(fabs((double)models->gate.sensor[r] / quantile[r] - 1.0) < close);
    assert_true(MK_F(mk_models_differentiable)(models, &error));
    MK_F(mk_models_close)(models);
    close_scene(&scene);
}

/* Q at other steps: from the densities again, or in proportion. */
static void MK_F(noise)(void **state) {
    (void)state;
    scene_t scene;
    mk_error_t error;
    MK_REAL Q[10];
    open_scene(&scene, plain);
    MK_F_T(mk_models) *models = MK_F(open)(&scene, NULL);
    assert_true(MK_F(mk_models_noise)(models, 0.25, Q, &error));
    MK_F(near)(Q[0], 0.5 * 0.25 * 0.25 * 0.25 / 3);
    MK_F(near)(Q[MK_PACKED(2) + 0], 0.5 * 0.25 * 0.25 / 2); /* (vx, px) */
    MK_F(near)(Q[MK_PACKED(3) - 1], 0.5 * 0.25);
    MK_F(near)(models->transition.Q[0], 0.5 / 3);
    assert_false(MK_F(mk_models_noise)(models, -1.0, Q, &error));
    assert_non_null(strstr(error.text, "the noise Q of a step of -1 s cannot be had: MK_ERROR_ARGUMENT"));
    MK_F(mk_models_close)(models);
    close_scene(&scene);
    open_scene(&scene, "{\"model\": {\"motion\": \"constant-velocity\", \"states\": [\"px\", \"py\", \"vx\", \"vy\"], \"dt_s\": 2, \"x0\": [0, 0, 0, 0], "
                       "\"P0\": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], \"Q\": [[4, 1, 0, 0], [1, 4, 0, 0], [0, 0, 4, 0], [0, 0, 0, 0]]}, " NODES "}");
    models = MK_F(open)(&scene, NULL);
    assert_true(MK_F(mk_models_noise)(models, 0.5, Q, &error));
    MK_F(near)(Q[0], 1.0);
    MK_F(near)(Q[1], 0.25);
    MK_F(near)(models->transition.Q[0], 4.0);
    MK_F(mk_models_close)(models);
    close_scene(&scene);
}

static mk_status_t MK_F(twice)(const void *context, MK_REAL dt, int count, const MK_REAL *x, MK_REAL *y) {
    const MK_F_T(mk_plugin_context) *const c = context;
    (void)dt;
    for (int i = 0; i < count; i++) y[i] = c->parameter[0] * x[c->n * i + 1] + c->site.position[1] + c->site.reference[0];
    return MK_OK;
}

/* What an own sensor sees of the scenario; what it lacks is named. */
static void MK_F(own)(void **state) {
    (void)state;
    static const mk_plugin_model_t other = {.name = "twice", .kind = MK_PLUGIN_SENSOR, .size = 1, .parameters = 1};
    mk_plugin_model_t model = other;
    const mk_plugin_t plugin = {MK_PLUGIN_VERSION, 1, &model};
    scene_t scene;
    mk_error_t error;
    model.f64.function = twice_f64;
    if (MK_BITS == 32) model.f32.function = twice_f32;
    if (!mk_scenario_load_any(&scene.s, put("s.json", "{" MODEL("") "\"nodes\": [{\"sensor\": \"none\"}, {\"sensor\": \"plugin\", \"name\": \"twice\", "
                                                      "\"parameters\": [3], \"position_m\": [10, 20], \"reference_m\": [100, 200], \"R\": [[9]]}], \"edges\": []}"),
                              &error))
        fail_msg("%s", error.text);
    MK_F_T(mk_models) *models = MK_F(open)(&scene, &plugin);
    const MK_REAL x[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    MK_REAL y[2];
    assert_int_equal(models->sensor[1].model.function(models->sensor[1].model.context, MK_R(0.0), 2, x, y), MK_OK);
    MK_F(near)(y[0], 126.0);
    MK_F(near)(y[1], 138.0);
    const MK_F_T(mk_plugin_context) *context = models->sensor[1].model.context;
    assert_int_equal(context->rows, 1);
    assert_int_equal(mk_motion_check(context->site.motion, MK_MOTION_VELOCITY), MK_OK);
    assert_false(MK_F(mk_models_differentiable)(models, &error));
    assert_string_equal(error.text, "nodes[1].name: the own model twice has no Jacobian, which this filter needs");
    MK_F(mk_models_close)(models);
    model.f32.function = NULL;
    mk_models_f32_t *none = mk_models_open_f32(&scene.s, &plugin, &error);
    assert_null(none);
    assert_string_equal(error.text, "nodes[1].name: twice has no float32 functions");
    mk_scenario_free(&scene.s);
}

/* Every filter's configuration is one that the library starts with, over all slots or one. */
static void MK_F(start)(void **state) {
    (void)state;
    static const char *const filters[] = MK_TRACKING_FILTERS;
    static const int update[] = {MK_UPDATE_EXTENDED,    MK_UPDATE_UNSCENTED, MK_UPDATE_ITERATED,  MK_UPDATE_ITERATED_LITERAL, MK_UPDATE_PROGRESSIVE,
                                 MK_UPDATE_PROGRESSIVE, MK_UPDATE_UNSCENTED, MK_UPDATE_UNSCENTED, MK_UPDATE_EXTENDED};
    static MK_REAL numbers[4 + 10 + 8], work[MK_UNSCENTED_WORK(4, 2, 4)];
    static MK_F_T(mk_gate_record) record[4];
    static uint8_t have[4];
    scene_t scene;
    open_scene(&scene, MK_F(full));
    MK_F_T(mk_models) *models = MK_F(open)(&scene, NULL);
    for (int i = 0; i < MK_TRACKING_FILTER_COUNT; i++)
        for (int slots = 1; slots <= 4; slots += 3) {
            MK_F_T(mk_unscented_config) config;
            MK_F_T(mk_unscented) core;
            const MK_F_T(mk_unscented_view) view = {&core, numbers, numbers + 4, numbers + 14, have, record, work};
            MK_F(mk_models_config)(models, filters[i], slots == 1 ? 2 : 0, slots, &config);
            assert_int_equal(config.update, update[i]);
            assert_int_equal(config.rule, strcmp(filters[i], "mpukf") == 0 ? MK_RULE_MAHALANOBIS : MK_RULE_NONE);
            assert_int_equal(config.gate != NULL, strcmp(filters[i], "mpukf") == 0 || strcmp(filters[i], "ekf") == 0);
            assert_int_equal(config.increments, 7);
            if (config.gate) assert_int_equal(config.gate->policy * 100 + config.gate->patience, MK_GATE_INFLATE * 100 + 4);
            assert_ptr_equal(config.sensor, models->sensor + (slots == 1 ? 2 : 0));
            assert_int_equal(MK_F(mk_unscented_start)(4, 2, slots, &view, &config), MK_OK);
            assert_int_equal(MK_F(mk_unscented_predict)(4, &view, MK_R(0.1), NULL), MK_OK);
        }
    MK_F(mk_models_close)(models);
    close_scene(&scene);
}
