# SPDX-License-Identifier: MIT
"""Files of own models: the example is right, and a file that is not is named with what is wrong."""
import csv
import json
import math
import pathlib
import subprocess

import numpy as np
import pytest
import scipy.integrate

ROOT = pathlib.Path(__file__).resolve().parents[2]
COMPILE = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-shared", "-fPIC",
           *(f"-I{ROOT}/{folder}" for folder in ("include", "src", "port/host"))]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """built(text or path of a C file) -> shared object"""
    def call(source):
        folder = tmp_path_factory.mktemp("own")
        if not isinstance(source, pathlib.Path):
            (folder / "own.c").write_text(source)
            source = folder / "own.c"
        subprocess.run([*COMPILE, source, "-o", folder / "own.so"], check=True)
        return folder / "own.so"
    return call


@pytest.fixture(scope="module")
def example(built):
    return built(ROOT / "tools" / "meshkal" / "examples" / "own_models.c")


def diagonal(*values):
    return [[value if i == j else 0.0 for j in range(len(values))] for i, value in enumerate(values)]


VEHICLE = {
    "model": {"motion": "plugin", "name": "vehicle", "parameters": [1e-4, 1e-9], "states": ["px", "py", "heading", "speed", "curvature"], "dt_s": 0.5,
              "x0": [0.0, 0.0, 3.0, 10.0, 0.02], "P0": diagonal(1, 1, 0.1, 1, 1e-4)},
    "nodes": [{"sensor": "plugin", "name": "signal-strength", "parameters": [-40.0, 2.5], "position_m": [3.0, -70.0], "R": [[1e-16]], "range_limit_m": 90.0},
              {"sensor": "range", "position_m": [0.0, 0.0], "R": [[1e-16]]}],
    "edges": [[0, 1]], "steps": 60}


def test_example(run, tmp_path, example):
    """The vehicle drives as the differential equation says, and the sensors hear it."""
    (tmp_path / "s.json").write_text(json.dumps(VEHICLE))
    run("draw", tmp_path / "s.json", "--models", example, "--truth", tmp_path / "x.csv", "--measurements", tmp_path / "y.csv", "--json", tmp_path / "j.json")
    with open(tmp_path / "x.csv", newline="") as file:
        truth = np.array([float(row["value"]) for row in csv.DictReader(file)]).reshape(-1, 5)
    assert np.allclose(json.loads((tmp_path / "j.json").read_text())["Q"], diagonal(0, 0, 0, 1e-4 * 0.5, 1e-9 * 0.5), rtol=1e-14, atol=0)
    assert (abs(truth[:, 2]) <= math.pi).all() and (abs(np.diff(truth[:, 2])) > 5).any(), "the heading passes the seam"
    for before, after in zip(truth[:-1], truth[1:]):
        def rate(_, x):
            return [x[3] * math.cos(x[2]), x[3] * math.sin(x[2]), x[3] * x[4], 0.0, 0.0]
        wanted = scipy.integrate.solve_ivp(rate, (0, 0.5), before, rtol=1e-11, atol=1e-12).y[:, -1]
        assert np.allclose(after[:2], wanted[:2], atol=1e-8) and abs(math.remainder(after[2] - wanted[2], 2 * math.pi)) < 1e-9
        assert 0 < abs(after[3] - before[3]) < 0.05 and 0 < abs(after[4] - before[4]) < 2e-4
    with open(tmp_path / "y.csv", newline="") as file:
        readings = {(round(float(row["t"]) / 0.5), int(row["node"])): float(row["value"]) for row in csv.DictReader(file)}
    assert sum(key[1] == 1 for key in readings) == 60
    for t in range(1, 61):
        r = math.hypot(truth[t, 0] - 3.0, truth[t, 1] + 70.0)
        assert ((t, 0) in readings) == (r <= 90.0)
        if r <= 90.0:
            assert abs(readings[t, 0] - (-40.0 - 25.0 * math.log10(r))) < 1e-6
        assert abs(readings[t, 1] - math.hypot(*truth[t, :2])) < 1e-6
    assert {key[1] for key in readings} == {0, 1}


@pytest.mark.parametrize("change,message", [
    ({}, "model.name: motion vehicle is an own model: give its file with --models FILE.so"),
    ({"model": {"name": "car"}}, "model.name: no motion called car in the file of --models; there: vehicle"),
    ({"model": {"name": "signal-strength"}}, "model.name: no motion called signal-strength in the file of --models; there: vehicle"),
    ({"model": {"parameters": [1.0]}}, "model.name: vehicle needs 2 parameters, the scenario has 1"),
    ({"model": {"states": ["px", "py", "a", "b"], "x0": [0.0] * 4, "P0": diagonal(1, 1, 1, 1)}}, "model.name: vehicle has 5 states, the scenario has 4"),
    ({"nodes": {"name": "sonar"}}, "nodes[0].name: no sensor called sonar in the file of --models; there: signal-strength"),
    ({"nodes": {"R": diagonal(1, 1)}}, "nodes[0].name: signal-strength has 1 rows, the scenario has 2"),
    ({"nodes": {"parameters": []}}, "nodes[0].name: signal-strength needs 2 parameters, the scenario has 0"),
])
def test_scenario_and_file_differ(refused, tmp_path, example, change, message):
    scenario = VEHICLE | {"model": VEHICLE["model"] | change.get("model", {}), "nodes": [VEHICLE["nodes"][0] | change.get("nodes", {}), VEHICLE["nodes"][1]]}
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    options = ("--models", example) if change else ()
    assert refused(tmp_path, "draw", "{}/s.json", "--truth", "{}/x.csv", *options) == message


def test_noise_is_somebodys(run, refused, tmp_path, built):
    """An own motion that does not bring Q needs the scenario's; the scenario's wins where there are both."""
    quiet = built(TABLE % ("MK_PLUGIN_VERSION, 1", '.name = "own", .kind = MK_PLUGIN_MOTION, .f64 = {.function = same}'))
    scenario = {"model": {"motion": "plugin", "name": "own", "states": ["a"], "x0": [0.0], "P0": [[1.0]]}, "nodes": [{"sensor": "none"}], "edges": [], "steps": 3}
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    assert refused(tmp_path, "draw", "{}/s.json", "--models", quiet) == 'model: key "Q" is missing: the own model own does not bring its noise'
    scenario["model"]["Q"] = [[4.0]]
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    run("draw", tmp_path / "s.json", "--models", quiet, "--json", tmp_path / "j.json")
    assert json.loads((tmp_path / "j.json").read_text())["Q"] == [[4.0]]


TABLE = """#include <meshkal/plugin.h>
#include <stddef.h>
#include <string.h>
mk_status_t same(const void *context, mk_f64_t dt, int count, const mk_f64_t *x, mk_f64_t *y);
mk_status_t same(const void *context, mk_f64_t dt, int count, const mk_f64_t *x, mk_f64_t *y) {
    const mk_plugin_context_f64_t *const c = context;
    (void)dt;
    memcpy(y, x, sizeof *x * (size_t)(count * c->n));
    return MK_OK;
}
void mean(const void *context, int count, const mk_f64_t *weight, const mk_f64_t *y, mk_f64_t *mean);
void mean(const void *context, int count, const mk_f64_t *weight, const mk_f64_t *y, mk_f64_t *mean) { (void)context, (void)count, (void)weight, *mean = *y; }
static const mk_plugin_t table = {%s, (const mk_plugin_model_t[2]){{%s}}};
const mk_plugin_t *meshkal_plugin(void) { return &table; }
"""
GOOD = '.name = "own", .kind = MK_PLUGIN_MOTION, .f64 = {.function = same}'
BAD_TABLES = [
    ("MK_PLUGIN_VERSION + 1, 1", GOOD, "made for version 2 of meshkal/plugin.h, not 1: compile it again"),
    ("MK_PLUGIN_VERSION, 0", GOOD, "its table has no models"),
    ("MK_PLUGIN_VERSION, 1", GOOD.replace('"own"', '""'), "own model 0 has no name"),
    ("MK_PLUGIN_VERSION, 1", GOOD.replace('"own"', "NULL"), "own model 0 has no name"),
    ("MK_PLUGIN_VERSION, 1", GOOD.replace("MK_PLUGIN_MOTION", "7"), "own model own: kind 7 is neither MK_PLUGIN_MOTION nor MK_PLUGIN_SENSOR"),
    ("MK_PLUGIN_VERSION, 1", GOOD + ", .size = 65", "own model own: size is 65: must be 0 (any) to 64"),
    ("MK_PLUGIN_VERSION, 1", GOOD.replace("MOTION", "SENSOR"), "own model own: size is 0: must be 1 to 64"),
    ("MK_PLUGIN_VERSION, 1", GOOD + ", .parameters = -1", "own model own: parameters is -1"),
    ("MK_PLUGIN_VERSION, 1", '.name = "own", .kind = MK_PLUGIN_MOTION', "own model own: f64.function is null: truth is drawn from it"),
    ("MK_PLUGIN_VERSION, 1", GOOD.replace("= same", "= same, .mean = mean"), "own model own has a mean but no difference"),
    ("MK_PLUGIN_VERSION, 2", GOOD + "}, {" + GOOD, "own model own stands twice in the table"),
]


@pytest.mark.parametrize("head,model,message", BAD_TABLES, ids=range(len(BAD_TABLES)))
def test_bad_table(refused, tmp_path, built, head, model, message):
    file = built(TABLE % (head, model))
    (tmp_path / "s.json").write_text(json.dumps(VEHICLE))
    assert refused(tmp_path, "draw", "{}/s.json", "--models", file) == f"{file}: {message}"


def test_bad_file(refused, tmp_path, built):
    (tmp_path / "s.json").write_text(json.dumps(VEHICLE))
    (tmp_path / "text.so").write_text("no machine code")
    assert "none.so: cannot open shared object file" in refused(tmp_path, "draw", "{}/s.json", "--models", "{}/none.so")
    assert "text.so: " in refused(tmp_path, "draw", "{}/s.json", "--models", "{}/text.so")
    empty = built("int nothing;")
    assert refused(tmp_path, "draw", "{}/s.json", "--models", empty) == f"{empty}: has no function meshkal_plugin (meshkal/plugin.h)"
    null = built("#include <stddef.h>\n#include <meshkal/plugin.h>\nconst mk_plugin_t *meshkal_plugin(void) { return NULL; }")
    assert refused(tmp_path, "draw", "{}/s.json", "--models", null) == f"{null}: meshkal_plugin returned no table"


def test_file_in_the_working_folder(run, tmp_path, example):
    """A name without a folder is a file here, not one of the system's libraries."""
    (tmp_path / "s.json").write_text(json.dumps(VEHICLE))
    (tmp_path / "own.so").write_bytes(example.read_bytes())
    run("draw", "s.json", "--models", "own.so", cwd=tmp_path)


def test_header_alone():
    """Users may write C++."""
    for language, standard in (("c", "c99"), ("c++", "c++17")):
        subprocess.run(["gcc", "-x", language, f"-std={standard}", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only",
                        f"-I{ROOT}/include", f"-I{ROOT}/port/host", "-"], input=b"#include <meshkal/plugin.h>\n", check=True)
