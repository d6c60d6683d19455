# SPDX-License-Identifier: MIT
"""Scenarios, runs and own models that the tests of tracking runs share. Fixtures: import them by name."""
import json
import pathlib
import subprocess

import logs
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def diagonal(*values):
    return [[float(value) if i == j else 0.0 for j in range(len(values))] for i, value in enumerate(values)]


def ranges(*places, **more):
    return [{"sensor": "range", "position_m": list(map(float, place)), "R": [[1.0]], **more} for place in places]


# The truth is drawn, so that the estimate starts at x0.
PLANE = {"model": {"motion": "constant-velocity", "states": ["px", "py", "vx", "vy"], "acceleration_psd": 0.01, "x0": [10.0, 20.0, 1.0, 0.6],
                   "P0": diagonal(25, 25, 1, 1), "start": "truth"},
         "nodes": ranges((0, 0), (100, 0), (50, 90)), "edges": [[0, 1], [1, 2]], "steps": 60, "seed": 4,
         "tracking": {"transform": {"kind": "julier", "kappa": -1.0}}}
TURN = {"model": {"motion": "constant-turn", "states": ["px", "vx", "py", "vy", "omega"], "acceleration_psd": 0.02, "turn_rate_psd": 1e-4, "dt_s": 0.5,
                  "x0": [-30.0, 3.0, 5.0, 1.0, 0.1], "P0": diagonal(4, 1, 4, 1, 0.01), "start": "truth"},
        "nodes": [{"sensor": "range-bearing", "position_m": [0.0, 0.0], "R": [[0.5, 0.01], [0.01, 1e-3]]},
                  {"sensor": "bearing", "position_m": [20.0, 8.0], "R": [[2e-3]]}, {"sensor": "none", "position_m": [0.0, 40.0]},
                  {"sensor": "range-rate", "position_m": [10.0, -60.0], "R": [[0.1]], "loss": 0.3}],
        "edges": [[0, 1], [1, 2], [2, 3], [0, 2]], "steps": 60, "seed": 3,
        "tracking": {"transform": {"kind": "scaled", "alpha": 0.7, "beta": 2.0, "kappa": 0.5}}}


def changed(scenario, **changes):
    """A copy with dotted keys (tracking__gate) replaced, or removed where None."""
    copy = json.loads(json.dumps(scenario))
    for key, value in changes.items():
        *path, last = key.split("__")
        place = copy
        for name in path:
            place = place.setdefault(name, {})
        if value is None:
            place.pop(last)
        else:
            place[last] = value
    return copy


FAULTY = changed(PLANE, nodes=ranges((0, 0), (100, 0), (50, 90), fault={"probability": 0.1, "sigma": 20.0}), seed=54,
                 tracking__gate={"significance": 1e-3, "sensor": False, "stacked": True}, reading_loss=0.1)

LINEAR_ROWS = ([1.0, 0.5, 0.0, 0.2], [0.0, 1.0, 1.0, 0.0], [-0.5, 1.0, 0.0, 2.0])
LINEAR = changed(PLANE, nodes=[{"sensor": "plugin", "name": "linear", "parameters": a, "R": [[0.5 + k]]} for k, a in enumerate(LINEAR_ROWS)],
                 edges=[[0, 1], [1, 2], [0, 2]], weights="uniform")


@pytest.fixture
def simulate(run, tmp_path):
    """simulate(scenario, filter, *options) -> header, steps, summary of the filter, whole summary"""
    def call(scenario, name, *options):
        (tmp_path / "s.json").write_text(json.dumps(scenario))
        run("simulate", tmp_path / "s.json", "--filter", name, "--out", tmp_path / "l.cbor", "--json", tmp_path / "j.json", *options)
        header, steps, end = logs.log((tmp_path / "l.cbor").read_bytes())
        summary = json.loads((tmp_path / "j.json").read_text())
        assert end == {"end": "complete", "items": len(steps)} and header["kind"] == "tracking"
        return header, steps, summary["filters"][0], summary
    return call


@pytest.fixture(scope="module")
def linear_sensors(tmp_path_factory):
    """Own models: z = a' x, a the parameters."""
    folder = tmp_path_factory.mktemp("linear")
    part = "\n".join(f"""
static mk_status_t h_{r}(const void *context, mk_{r}_t dt, int count, const mk_{r}_t *x, mk_{r}_t *y) {{
    const mk_plugin_context_{r}_t *c = context;
    (void)dt;
    for (int i = 0; i < count; i++, x += c->n) {{
        y[i] = 0;
        for (int j = 0; j < c->n; j++) y[i] += c->parameter[j] * x[j];
    }}
    return MK_OK;
}}
static mk_status_t J_{r}(const void *context, mk_{r}_t dt, const mk_{r}_t *x, mk_{r}_t *J) {{
    const mk_plugin_context_{r}_t *c = context;
    (void)dt; (void)x;
    for (int j = 0; j < c->n; j++) J[j] = c->parameter[j];
    return MK_OK;
}}""" for r in ("f32", "f64"))
    (folder / "linear.c").write_text(f"""#include <meshkal/plugin.h>
{part}
static const mk_plugin_model_t models[] = {{{{"linear", MK_PLUGIN_SENSOR, 1, 4, {{h_f32, J_f32, 0, 0, 0}}, {{h_f64, J_f64, 0, 0, 0}}}},
    {{"rough", MK_PLUGIN_SENSOR, 1, 4, {{h_f32, 0, 0, 0, 0}}, {{h_f64, 0, 0, 0, 0}}}}}};
static const mk_plugin_t table = {{MK_PLUGIN_VERSION, 2, models}};
const mk_plugin_t *meshkal_plugin(void) {{ return &table; }}
""")
    subprocess.run(["gcc", "-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC", f"-I{ROOT}/include", f"-I{ROOT}/port/host", folder / "linear.c",
                    "-o", folder / "linear.so"], check=True)
    return folder / "linear.so"


def instants(header, steps):
    """dt and {slot of estimator 0 or node: reading} of every step; arrived ones only for a centre."""
    before = header["start_s"]
    first = np.concatenate([[0], np.cumsum(header["rows"])])
    for step in steps:
        t = step["time_s"][0]
        z = {k: step["measurements"][first[k]:first[k + 1]] for k in range(header["nodes"]) if step["measuring"][k]}
        yield t - before, z
        before = t


def assert_close(step, x, P, tolerance, e=0):
    """Estimate, diagonal and trace of the covariance of estimator e."""
    estimate = step["estimate"].reshape(-1, len(x))[e]
    scale = np.sqrt(np.diag(P))
    np.testing.assert_array_less(np.abs(estimate - x), tolerance * (scale + np.abs(x)), f"step {step['step']}")
    variance = step["variance"].reshape(-1, len(x))[e]
    np.testing.assert_array_less(np.abs(variance - np.diag(P)), 10 * tolerance * np.diag(P), f"step {step['step']}")
    assert abs(step["trace_covariance"][e] - np.trace(P)) < 10 * tolerance * np.trace(P), f"step {step['step']}"


def slots_of(header):
    first = np.concatenate([[0], np.cumsum([len(s) for s in header["slots"]])])
    return [(e, slots, int(first[e])) for e, slots in enumerate(header["slots"])]
