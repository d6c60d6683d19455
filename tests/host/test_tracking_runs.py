# SPDX-License-Identifier: MIT
"""meshkal simulate on tracking scenarios: every filter beside NumPy on the readings of its own log, figures beside the log, options, errors."""
import json
import math
import pathlib
import subprocess

import logs
import numpy as np
import pytest
import scipy.stats
from tracking_filters import Model, Robust, Transform, Unscented

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


def instants(header, steps):
    """dt and {slot of estimator 0 or node: reading} of every step; arrived ones only for a centre."""
    before = header["start_s"]
    first = np.concatenate([[0], np.cumsum(header["rows"])])
    for step in steps:
        t = step["time_s"][0]
        z = {k: step["measurements"][first[k]:first[k + 1]] for k in range(header["nodes"]) if step["measuring"][k]}
        yield t - before, z
        before = t


def assert_close(step, x, P, tolerance):
    """Estimate, trace and position covariance of estimator 0."""
    n = len(x)
    scale = np.sqrt(np.diag(P))
    np.testing.assert_array_less(np.abs(step["estimate"][:n] - x), tolerance * (scale + np.abs(x)), f"step {step['step']}")
    assert abs(step["trace_covariance"][0] - np.trace(P)) < 10 * tolerance * np.trace(P), f"step {step['step']}"


# --- beside NumPy ------------------------------------------------------------------------------------------------------------

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


LINEAR_ROWS = ([1.0, 0.5, 0.0, 0.2], [0.0, 1.0, 1.0, 0.0], [-0.5, 1.0, 0.0, 2.0])
LINEAR = changed(PLANE, nodes=[{"sensor": "plugin", "name": "linear", "parameters": a, "R": [[0.5 + k]]} for k, a in enumerate(LINEAR_ROWS)],
                 edges=[[0, 1], [1, 2], [0, 2]], weights="uniform")


@pytest.mark.parametrize("name, options", [
    ("ekf", ()), ("ukf", ()), ("iukf", ()), ("pukf", ()), ("mpukf", ("--rule", "none")), ("duif", ("--iterations", "200")),
    ("duif", ("--iterations", "200", "--protocol", "ratio")), ("duif", ("--iterations", "200", "--protocol", "perron")), ("kcf", ()), ("rekfd", ())])
def test_linear_models_give_the_kalman_filter(simulate, linear_sensors, name, options):
    """On a complete graph: kcf and rekfd hear every sensor, and all nodes agree."""
    header, steps, *_ = simulate(LINEAR, name, "--models", linear_sensors, *options)
    model = Model(LINEAR, {k: np.array(a) for k, a in enumerate(LINEAR_ROWS)})
    x, P = model.x0, model.P0
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        A = np.array([model.move(e, dt) for e in np.eye(4)]).T
        x, P = A @ x, A @ P @ A.T + model.noise(dt)
        H, R, y = np.array([LINEAR_ROWS[k] for k in z]), np.diag([model.R[k][0, 0] for k in z]), np.concatenate(list(z.values()))
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        x, P = x + K @ (y - H @ x), (np.eye(4) - K @ H) @ P
        for e in range(header["estimators"]):
            np.testing.assert_allclose(step["estimate"].reshape(-1, 4)[e], x, rtol=1e-9, atol=1e-9)
            assert step["trace_covariance"][e] == pytest.approx(np.trace(P), rel=1e-9)


@pytest.mark.parametrize("scenario", [PLANE, TURN, changed(TURN, tracking__transform={"kind": "cubature"})], ids=["plane", "turn", "cubature"])
def test_ukf(simulate, scenario):
    header, steps, *_ = simulate(scenario, "ukf", "--loss", "0.1")
    model = Model(scenario)
    f = Unscented(model, Transform(model.n, scenario["tracking"]["transform"]))
    used = 0
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        z = {k: reading for k, reading in z.items() if step["measurements_arrived"][k]}
        f.predict(dt)
        f.update(z)
        used += len(z)
        assert_close(step, f.x, f.P, 1e-8)
    assert used > 60


FAULTY = changed(PLANE, nodes=ranges((0, 0), (100, 0), (50, 90), fault={"probability": 0.1, "sigma": 20.0}), seed=54,
                 tracking__gate={"significance": 1e-3, "sensor": False, "stacked": True}, reading_loss=0.1)


@pytest.mark.parametrize("rule", ["none", "innovation", "mahalanobis"])
def test_mpukf_with_its_gate(simulate, rule):
    header, steps, summary, _ = simulate(FAULTY, "mpukf", "--rule", rule, "--increments", "7")
    model = Model(FAULTY)
    f = Unscented(model, Transform(4, FAULTY["tracking"]["transform"]))
    gated = fired = 0
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        f.predict(dt)
        took = f.update(z, 1e-3, 7, rule)
        gated += took < 0
        fired += 0 < took < 7
        assert_close(step, f.x, f.P, 1e-8)
        assert set(step["decision"][step["measuring"] == 1]) <= {2 if took < 0 else 1} and not step["decision"][step["measuring"] == 0].any()
        assert (step["gate_stacked_ratio"][0] > 1) == (took < 0)
    assert gated > 3 and summary["counts"]["rejected"] == sum((s["decision"] == 2).sum() for s in steps)
    assert summary["counts"]["rule_fired"] == fired and (rule == "none" or fired > 0)


@pytest.mark.parametrize("scenario, paper", [(PLANE, False), (PLANE, True), (TURN, False)], ids=["plane", "paper's information", "turn"])
def test_duif_with_many_iterations_is_the_centralised_information_filter(simulate, scenario, paper):
    header, steps, _, summary = simulate(changed(scenario, tracking__consensus={"information": "paper" if paper else "residual"}), "duif", "--iterations", "200")
    assert (summary["iterations"], summary["protocol"]) == (200, "metropolis")
    model = Model(scenario)
    f = Unscented(model, Transform(model.n, scenario["tracking"]["transform"]))
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        f.predict(dt)
        parts = [f.information(k, reading, not paper) for k, reading in z.items()]
        if parts:
            f.inform(sum(s for s, _ in parts), sum(S for _, S in parts))
        for e in range(header["estimators"]):
            assert_close({"step": step["step"], "estimate": step["estimate"].reshape(-1, model.n)[e], "trace_covariance": step["trace_covariance"][e:]}, f.x, f.P,
                         1e-8)
        assert step["disagreement"][0] < 1e-7 and step["consensus_disagreement"][-1] < 1e-9


def slots_of(header):
    first = np.concatenate([[0], np.cumsum([len(s) for s in header["slots"]])])
    return [(e, slots, int(first[e])) for e, slots in enumerate(header["slots"])]


@pytest.mark.parametrize("scenario, c", [(PLANE, 0.0), (PLANE, 0.05), (TURN, 0.02)], ids=["plane", "plane robust", "turn robust"])
def test_rekfd(simulate, scenario, c):
    header, steps, *_ = simulate(scenario, "rekfd", "--tolerance", c, "--loss", "0.2")
    model = Model(scenario)
    nodes = [Robust(model) for _ in range(header["nodes"])]
    degree = [len(s) for s in header["slots"]]
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        for e, slots, first in slots_of(header):
            theta = nodes[e].predict(dt, c)
            assert step["theta"][e] == pytest.approx(theta, rel=1e-6, abs=1e-12)
            nodes[e].correct({k: z[k] for i, k in enumerate(slots) if step["measurements_arrived"][first + i]})
        psi = [node.x for node in nodes]
        for e, slots, first in slots_of(header):
            heard = [k for i, k in enumerate(slots) if step["estimates_arrived"][first + i]]
            nodes[e].x = sum(degree[k] * psi[k] for k in heard) / sum(degree[k] for k in heard)
            assert_close({"step": step["step"], "estimate": step["estimate"].reshape(-1, model.n)[e], "trace_covariance": step["trace_covariance"][e:]},
                         nodes[e].x, nodes[e].V, 1e-7)


@pytest.mark.parametrize("policy", ["skip", "inflate"])
def test_gate_of_rekfd(simulate, policy):
    """Each reading by itself, at the prediction: left out, or with its innovation variance times the test ratio."""
    scenario = changed(FAULTY, tracking__gate={"significance": 0.01, "stacked": False, "policy": policy}, reading_loss=None)
    header, steps, f, _ = simulate(scenario, "rekfd")
    model = Model(scenario)
    nodes, beyond = [Robust(model) for _ in range(3)], 0
    degree, threshold = [len(s) for s in header["slots"]], scipy.stats.chi2.isf(0.01, 1)
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        for e, slots, first in slots_of(header):
            nodes[e].predict(dt, 0.0)
            used, noise = {}, {}
            for i, k in enumerate(slots):
                C = model.jacobian(lambda x, k=k: model.see(k, x), nodes[e].x)
                E = (C @ nodes[e].V @ C.T + 1)[0, 0]
                ratio = (z[k] - model.see(k, nodes[e].x))[0]**2 / E / threshold
                assert step["gate_ratio"][first + i] == pytest.approx(ratio, rel=1e-6)
                assert step["decision"][first + i] == (1 if ratio <= 1 else 2 if policy == "skip" else 3)
                beyond += ratio > 1
                if ratio <= 1 or policy == "inflate":
                    used[k], noise[k] = z[k], np.array([[ratio * E - (E - 1) if ratio > 1 else 1.0]])
            model.R = [noise.get(k) for k in range(3)]
            nodes[e].correct(used)
        psi = [node.x for node in nodes]
        for e, slots, _ in slots_of(header):
            nodes[e].x = sum(degree[k] * psi[k] for k in slots) / sum(degree[k] for k in slots)
            assert_close({"step": step["step"], "estimate": step["estimate"].reshape(-1, 4)[e], "trace_covariance": step["trace_covariance"][e:]},
                         nodes[e].x, nodes[e].V, 1e-7)
    assert beyond > 10 and f["counts"]["rejected" if policy == "skip" else "inflated"] == beyond


def test_decisions_of_both_gates(simulate):
    """Each sensor first, then what is left together: what the ratios in the log say is what became of the readings."""
    scenario = changed(FAULTY, tracking__gate={"significance": 0.05})
    for name in ("ukf", "duif"):
        _, steps, f, _ = simulate(scenario, name)
        alone = together = 0
        for step in steps:
            for e in range(len(step["gate_stacked_ratio"])):
                slots = range(3) if name == "ukf" else [[0, 2, 5][e]]
                for slot in slots:
                    beyond, stacked = step["gate_ratio"][slot] > 1, step["gate_stacked_ratio"][e] > 1
                    assert step["decision"][slot] == (0 if not step["measurements_arrived"][slot] else 2 if beyond or stacked else 1)
                    alone += beyond
                    together += stacked and not beyond
                assert step["nis_rows"][e] == sum(step["decision"][slot] == 1 for slot in slots)
        assert alone > 5 and (together > 0 or name == "duif") and f["counts"]["rejected"] >= alone


@pytest.mark.parametrize("name", ["ukf", "duif", "kcf", "rekfd"])
def test_way_back(simulate, tmp_path, name):
    """An estimate that starts far from the truth and sure of itself: the gate refuses everything until P := P0, and again, until it finds back."""
    sure = changed(PLANE, model__P0=diagonal(1, 1, 0.1, 0.1), model__start=None, tracking__gate={"significance": 1e-4, "patience": 3}, edges=[[0, 1], [0, 2], [1, 2]],
                   model__acceleration_psd=1e-4)
    path = [np.array([26 + t, 40 + 0.6 * t]) for t in range(1, 61)]
    (tmp_path / "y.csv").write_text("t,node,row,value\n" + "".join(f"{t},{k},0,{float(np.linalg.norm(p - node['position_m']))!r}\n"
                                                                  for t, p in enumerate(path, 1) for k, node in enumerate(sure["nodes"])))
    _, steps, f, _ = simulate(sure, name, "--measurements", tmp_path / "y.csv")
    far, near = (np.linalg.norm(steps[t]["estimate"][:2] - path[t]) for t in (1, 59))
    assert f["counts"]["reinitialised"] >= 1 and far > 5 and near < 1
    _, _, f, _ = simulate(changed(sure, tracking__gate={"significance": 1e-4}), name, "--measurements", tmp_path / "y.csv")
    assert f["counts"]["reinitialised"] == 0


def test_kcf(simulate):
    header, steps, *_ = simulate(PLANE, "kcf", "--loss", "0.2")
    model = Model(PLANE)
    nodes = [Unscented(model, Transform(4, PLANE["tracking"]["transform"])) for _ in range(3)]
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        parts = []
        for k, node in enumerate(nodes):
            node.predict(dt)
            parts.append((*node.information(k, z[k]), node.x.copy()))
        for e, slots, first in slots_of(header):
            heard = [parts[k] for i, k in enumerate(slots) if step["estimates_arrived"][first + i]]
            gamma = 1 / 3 / (1 + np.linalg.norm(nodes[e].P))
            pull = gamma * nodes[e].P @ sum(x - nodes[e].x for _, _, x in heard)
            nodes[e].inform(sum(s for s, _, _ in heard), sum(S for _, S, _ in heard))
            nodes[e].x = nodes[e].x + pull
            assert_close({"step": step["step"], "estimate": step["estimate"].reshape(-1, 4)[e], "trace_covariance": step["trace_covariance"][e:]},
                         nodes[e].x, nodes[e].P, 1e-8)


def test_recorded_readings_at_any_times(simulate, tmp_path):
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.exponential(0.7, 80)) + 100
    lines = ["t,node,row,value"]
    for i, t in enumerate(times):
        for k in range(3):
            if rng.random() < 0.5 or k == i % 3:
                d = np.array([10 + (t - 100), 20 + 0.6 * (t - 100)]) - PLANE["nodes"][k]["position_m"]
                lines.append(f"{t!r},{k},0,{math.hypot(*d) + rng.normal()!r}".replace("np.float64(", "").replace(")", ""))
    rng.shuffle(lines[1:])
    (tmp_path / "y.csv").write_text("\n".join(lines) + "\n")
    header, steps, summary, whole = simulate(changed(PLANE, model__start=None, model__start_s=99.5), "ukf", "--measurements", tmp_path / "y.csv")
    assert header["source"] == "recorded" and whole["readings"] == len(lines) - 1 and len(steps) == 80 and "truth" not in steps[0]
    assert summary["position_rmse"] is None and summary["nees"] is None
    model = Model(PLANE)
    f = Unscented(model, Transform(4, PLANE["tracking"]["transform"]))
    for t, step, (dt, z) in zip(times, steps, instants(header, steps), strict=True):
        assert step["time_s"][0] == t
        f.predict(dt)
        f.update(z)
        assert_close(step, f.x, f.P, 1e-8)
    # With a limit of steps the rest is left out.
    _, fewer, *_ = simulate(changed(PLANE, model__start=None, model__start_s=99.5), "rekfd", "--measurements", tmp_path / "y.csv", "--steps", "7")
    assert [s["time_s"][0] for s in fewer] == list(times[:7])


# --- figures -----------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", ["mpukf", "duif", "rekfd"])
def test_summary_is_what_the_log_says(simulate, name):
    T, runs, first = 30, 7, 11
    scenario = changed(FAULTY, steps=T, tracking__gate={"significance": 0.01, "policy": "inflate" if name == "duif" else "skip"})
    header, steps, f, _ = simulate(scenario, name, "--runs", runs, "--from-step", first, "--loss", "0.1", "--threads", "2")
    E = header["estimators"]
    assert [(s["run"], s["step"]) for s in steps] == [(r, t) for r in range(runs) for t in range(1, T + 1)]
    truth = np.array([s["truth"] for s in steps]).reshape(runs, T, 1, 4)
    estimate = np.array([s["estimate"] for s in steps]).reshape(runs, T, E, 4)
    square = (truth - estimate)**2
    position, velocity = square[..., :2].sum(-1), square[..., 2:].sum(-1)
    window = position[:, first - 1:]
    assert f["position_rmse"] == pytest.approx(math.sqrt(window.mean()), rel=1e-12)
    assert f["velocity_rmse"] == pytest.approx(math.sqrt(velocity[:, first - 1:].mean()), rel=1e-12)
    half = scipy.stats.t.ppf(0.975, runs - 1) * window.mean((1, 2)).std(ddof=1) / math.sqrt(runs)
    assert f["position_rmse_ci95"] == pytest.approx(half / 2 / math.sqrt(window.mean()), rel=1e-9)
    assert f["mean_log_mse_position"] == pytest.approx(np.log(position.mean((0, 2))).mean(), rel=1e-12)
    np.testing.assert_allclose(f["log_mse_velocity_over_time"], np.log(velocity.mean((0, 2))), rtol=1e-11)
    np.testing.assert_allclose(f["position_rmse_over_time"], np.sqrt(position.mean((0, 2))), rtol=1e-11)
    nees = np.array([s["nees"] for s in steps]).reshape(runs, T, E)
    np.testing.assert_allclose(f["nees_over_time"], nees.mean((0, 2)), rtol=1e-11)
    band = scipy.stats.chi2.ppf([0.025, 0.975], 4 * runs) / runs
    assert [f["nees_low"], f["nees_high"]] == pytest.approx(band, rel=1e-10)
    mean = nees[:, first - 1:].mean()
    assert f["nees"] == pytest.approx(mean, rel=1e-12)
    assert f["nees_verdict"] == ("inside" if band[0] <= mean <= band[1] else "over-confident" if mean > band[1] else "cautious")
    nis, rows = (sum(s[key].sum() for s in steps if s["step"] >= first) for key in ("nis", "nis_rows"))
    assert f["nis_ratio"] == pytest.approx(nis / rows, rel=1e-12)
    decisions = np.concatenate([s["decision"] for s in steps])
    for code, key in ((1, "accepted"), (2, "rejected"), (3, "inflated"), (4, "refused")):
        assert f["counts"][key] == (decisions == code).sum()
    assert f["counts"]["inflated" if name == "duif" else "rejected"] > 0
    reach = {"mpukf": range(3), "duif": [0, 2, 5], "rekfd": range(7)}[name]
    sensors = np.concatenate(header["slots"])
    wanted = sum(s["measuring"][sensors[list(reach)]].sum() for s in steps)
    assert f["counts"]["lost"] == wanted - sum(s["measurements_arrived"].sum() for s in steps)
    if E == 1:
        return
    apart = np.linalg.norm(estimate[:, :, :, None, :2] - estimate[:, :, None, :, :2], axis=-1).max((2, 3))
    np.testing.assert_allclose([s["disagreement"][0] for s in steps], apart.ravel(), rtol=1e-12)
    assert f["disagreement_largest"] == pytest.approx(apart[:, first - 1:].max(), rel=1e-12)
    assert f["disagreement_rms"] == pytest.approx(math.sqrt((apart[:, first - 1:]**2).mean()), rel=1e-12)
    np.testing.assert_allclose(f["node_position_rmse"], np.sqrt(window.mean((0, 1))), rtol=1e-11)


def test_covariances_of_the_log(simulate):
    """nees, position_covariance and trace belong to one matrix: of a filter in NumPy."""
    header, steps, *_ = simulate(PLANE, "ukf")
    f = Unscented(Model(PLANE), Transform(4, PLANE["tracking"]["transform"]))
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        f.predict(dt)
        f.update(z)
        d = step["truth"] - f.x
        assert step["nees"][0] == pytest.approx(d @ np.linalg.solve(f.P, d), rel=1e-6)
        np.testing.assert_allclose(step["position_covariance"], f.P[[0, 1, 1], [0, 0, 1]], rtol=1e-7)
        assert step["error"][0] == pytest.approx(np.linalg.norm(d), rel=1e-7)


def test_lost_messages(simulate):
    """Their number follows the binomial law; who loses what differs from node to node and run to run, not from filter to filter's data."""
    _, steps, *_ = simulate(PLANE, "duif", "--loss", "0.3", "--runs", "4")
    messages = np.array([s["messages_arrived"] for s in steps])
    links = [1, 3, 4, 6]
    low, high = scipy.stats.binom(messages.shape[0] * 10 * 4, 0.7).ppf([5e-5, 1 - 5e-5])
    assert not messages[:, [0, 2, 5]].any() and low <= messages[:, links].sum() <= high
    assert np.abs(np.corrcoef(messages[:, links].T) - np.eye(4)).max() < 4.5 / math.sqrt(len(steps))
    _, other, *_ = simulate(PLANE, "rekfd", "--loss", "0.3", "--runs", "4")
    for a, b in zip(steps, other, strict=True):
        assert np.array_equal(a["measurements"], b["measurements"]) and np.array_equal(a["truth"], b["truth"])
    arrived = np.array([s["measurements_arrived"] for s in other])[:, links]
    low, high = scipy.stats.binom(arrived.size, 0.7).ppf([5e-5, 1 - 5e-5])
    assert low <= arrived.sum() <= high


def test_everything_lost(simulate):
    """A centre predicts; nodes of duif have their own readings and no factor N: what they have without any links."""
    _, steps, f, _ = simulate(PLANE, "ukf", "--loss", "1")
    model = Model(PLANE)
    for i, step in enumerate(steps):
        np.testing.assert_allclose(step["estimate"], model.move(model.x0, i + 1.0), rtol=1e-12)
    assert f["counts"]["accepted"] == 0 and f["counts"]["lost"] == 180 and all(s["faults"][0] == 1 | 8 for s in steps)
    _, deaf, f, _ = simulate(PLANE, "duif", "--loss", "1")
    assert f["counts"]["isolated"] == 180 and all((s["faults"] == 2).all() for s in deaf)
    _, none, *_ = simulate(PLANE, "duif", "--iterations", "0")
    _, alone, *_ = simulate(changed(PLANE, edges=[]), "duif")
    for a, b, c in zip(deaf, none, alone, strict=True):
        assert np.array_equal(a["estimate"], b["estimate"]) and np.array_equal(a["estimate"], c["estimate"])


def test_threads_and_order_change_nothing(run, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(changed(FAULTY, steps=20)))
    kept = []
    for threads in (1, 2, 3, 5):
        summaries = []
        for name in ("mpukf", "duif", "rekfd"):
            run("simulate", tmp_path / "s.json", "--filter", name, "--runs", "11", "--loss", "0.2", "--threads", threads, "--out", tmp_path / "l",
                "--json", tmp_path / "j", "--real", "float32")
            summary = json.loads((tmp_path / "j").read_text())
            for key in ("threads", "peak_memory_bytes"):
                summary.pop(key)
            for key in ("ns_per_step", "time_ratio_to_ukf"):
                summary["filters"][0].pop(key)
            summaries.append((summary, (tmp_path / "l").read_bytes()))
        kept.append(summaries)
    assert all(summaries == kept[0] for summaries in kept)
    # Without logs runs are taken in other portions; all filters at once say what each says alone.
    run("simulate", tmp_path / "s.json", "--filter", "all", "--runs", "11", "--loss", "0.2", "--threads", "2", "--json", tmp_path / "j", "--real", "float32")
    filters = {f["filter"]: f for f in json.loads((tmp_path / "j").read_text())["filters"]}
    assert list(filters) == ["ekf", "ukf", "iukf", "iukf-literal", "pukf", "mpukf", "duif", "kcf", "rekfd"]
    assert filters["ukf"]["time_ratio_to_ukf"] == 1 and all(f["time_ratio_to_ukf"] > 0 and f["ns_per_step"] > 0 for f in filters.values())
    for summary, _ in kept[0]:
        (alone,) = summary["filters"]
        both = filters[alone["filter"]]
        assert {key: both[key] for key in alone} == alone


@pytest.mark.parametrize("name", ["ekf", "ukf", "iukf", "pukf", "mpukf", "duif", "kcf", "rekfd"])
def test_single_precision(simulate, name):
    (_, double, *_), (header, single, *_) = (simulate(PLANE, name, "--real", real, "--tolerance", "0.01") for real in ("float64", "float32"))
    assert header["real"] == "float32"
    for a, b in zip(double, single, strict=True):
        assert a["estimate"].dtype == "f8" and b["estimate"].dtype == "f4" == b["trace_covariance"].dtype == b["nis"].dtype
        np.testing.assert_allclose(b["estimate"], a["estimate"], rtol=2e-4, atol=2e-3)
        assert not np.array_equal(b["estimate"], a["estimate"])


def test_nees_of_filters_on_their_own_model(simulate):
    """Nearly linear: the band of 300 runs holds at 19 of 20 steps."""
    far = changed(PLANE, nodes=ranges((-3000, 20), (40, 3000), (2000, -2500)), model__P0=diagonal(4, 4, 0.25, 0.25), steps=40)
    for name in ("ukf", "duif"):
        _, _, f, _ = simulate(far, name, "--runs", "300", "--from-step", "1", "--iterations", "60")
        assert f["nees_verdict"] == "inside" and f["nees_steps_inside"] >= 0.8 and f["nis_ratio"] == pytest.approx(1, abs=0.05)


# --- what cannot be ----------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("options, message", [
    (("--filter", "rkfd"), "--filter rkfd: for a tracking scenario it must be one of ekf, ukf, iukf, iukf-literal, pukf, mpukf, duif, kcf, rekfd, all"),
    (("--filter", "all", "--out", "{}/l"), "--out: a log holds one filter"),
    (("--horizon", "10"), "--horizon is for linear scenarios"), (("--frozen", "1e-3"), "--frozen is for linear"), (("--resume", "{}/r"), "--resume is for linear"),
    (("--arrivals", "{}/a"), "--arrivals is for linear"), (("--record", "{}/d"), "--record is for linear"),
    (("--truth", "least-favourable"), "--truth least-favourable is for linear"), (("--truth", "{}/t.csv"), "a file goes with --measurements"),
    (("--rule", "nis"), "--rule nis: must be one of none, innovation, mahalanobis"), (("--protocol", "x"), "must be one of paper, perron, metropolis, ratio"),
    (("--gate", "2"), "--gate"), (("--gate", "0"), "--gate 0: must be between 0 and 1"), (("--from-step", "61"), "--from-step"), (("--real", "half"), "--real half"),
    (("--measurements", "{}/none.csv"), "none.csv"), (("--models", "{}/none.so"), "none.so")])
def test_refused_options(refused, tmp_path, options, message):
    (tmp_path / "s.json").write_text(json.dumps(PLANE))
    assert message in refused(tmp_path, "simulate", "{}/s.json", *options)


def test_options_of_tracking_are_refused_for_linear_scenarios(run, refused, tmp_path):
    (tmp_path / "s.json").write_bytes(run("scenario", "projectile", "--nodes", "3").stdout)
    assert "--iterations is for tracking scenarios" in refused(tmp_path, "simulate", "{}/s.json", "--iterations", "3")


def test_refused_scenarios(refused, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(changed(PLANE, model__P0=diagonal(1, 1, 0, 1))))
    assert "P0" in refused(tmp_path, "simulate", "{}/s.json", "--filter", "mpukf", "--out", "{}/l", "--json", "{}/j")
    # Positive definite, but not in float32.
    narrow = diagonal(1, 1, 1, 1)
    narrow[0][1] = narrow[1][0] = 1 - 1e-9
    (tmp_path / "s.json").write_text(json.dumps(changed(PLANE, model__P0=narrow)))
    assert "mpukf in float32: its configuration is refused (MK_ERROR_NOT_POSITIVE_DEFINITE)" in refused(
        tmp_path, "simulate", "{}/s.json", "--filter", "mpukf", "--real", "float32", "--out", "{}/l", "--json", "{}/j")


def test_own_models_without_derivative(run, refused, linear_sensors, tmp_path):
    nodes = json.loads(json.dumps(LINEAR["nodes"]))
    nodes[1]["name"] = "rough"
    (tmp_path / "s.json").write_text(json.dumps(changed(LINEAR, nodes=nodes)))
    for name in ("ekf", "rekfd"):
        message = refused(tmp_path, "simulate", "{}/s.json", "--filter", name, "--models", str(linear_sensors), "--out", "{}/l")
        assert message.startswith(f"{name} needs derivatives: ") and "nodes[1]" in message
    run("simulate", tmp_path / "s.json", "--filter", "all", "--models", linear_sensors, "--json", tmp_path / "j")
    summary = json.loads((tmp_path / "j").read_text())
    assert [f["filter"] for f in summary["filters"]] == ["ukf", "iukf", "iukf-literal", "pukf", "mpukf", "duif", "kcf"]
    assert sum(note.startswith("left out: ") for note in summary["notes"]) == 2


def test_networks_that_cannot_agree_are_named_and_run(run, tmp_path):
    places = ((0, 0), (100, 0), (50, 90), (0, 90), (90, 90))
    scenario = changed(PLANE, nodes=ranges(*places), edges=[[0, 1], [2, 3]], tracking__consensus={"protocol": "paper"}, steps=20)
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    for name in ("duif", "kcf", "rekfd", "all"):
        done = run("simulate", tmp_path / "s.json", "--filter", name, "--json", tmp_path / "j")
        notes = json.loads((tmp_path / "j").read_text())["notes"]
        assert any(note.startswith("node 4 has no links") for note in notes)
        assert any("3 parts, nodes 0 and 2 in different ones" in note for note in notes)
        assert any("no cycle of odd length" in note for note in notes) == (name in ("duif", "all"))
        assert all(note in done.stdout.decode() for note in notes)
    run("simulate", tmp_path / "s.json", "--filter", "ukf", "--json", tmp_path / "j")
    assert json.loads((tmp_path / "j").read_text())["notes"] == []


def test_a_sensor_on_the_target(simulate, tmp_path):
    """Recorded, the estimate exactly on a sensor: its range has no derivative there and its bearing is nothing. Counted, and the rest is used."""
    nodes = [{"sensor": "range", "position_m": [10.0, 20.0], "R": [[1.0]]}, {"sensor": "range", "position_m": [100.0, 0.0], "R": [[1.0]]},
             {"sensor": "bearing", "position_m": [10.0, 20.0], "R": [[1e-4]]}]
    scenario = changed(PLANE, nodes=nodes, model__x0=[10.0, 20.0, 0.0, 0.0], model__start=None, edges=[[0, 1], [1, 2], [0, 2]])
    (tmp_path / "y.csv").write_text("t,node,row,value\n0,0,0,0.5\n0,1,0,91\n0,2,0,1\n1,1,0,92\n2,0,0,1.5\n2,1,0,92\n2,2,0,0.1\n")
    for name, refused in (("ekf", [4, 1, 4]), ("ukf", [1, 1, 4]), ("mpukf", [1, 1, 4])):
        _, steps, f, _ = simulate(scenario, name, "--measurements", tmp_path / "y.csv")
        assert list(steps[0]["decision"]) == refused and len(steps) == 3 and np.isfinite(steps[-1]["estimate"]).all(), name
        assert f["counts"]["refused"] == refused.count(4) and f["failures"] == {"MK_ERROR_DOMAIN": refused.count(4)}
        assert steps[0]["nis_rows"][0] == refused.count(1) and list(steps[2]["decision"]) == [1, 1, 1]
    _, steps, f, _ = simulate(scenario, "duif", "--measurements", tmp_path / "y.csv")
    assert list(steps[0]["decision"][[0, 3, 6]]) == [1, 1, 4] and f["failures"] == {"MK_ERROR_DOMAIN": 1}
    _, steps, f, _ = simulate(scenario, "rekfd", "--measurements", tmp_path / "y.csv")
    assert f["counts"]["refused"] == 6 and f["failures"] == {"MK_ERROR_DOMAIN": 6} and np.isfinite(steps[-1]["estimate"]).all()


def test_drawn_truth_on_a_sensor_fails_by_name(run, tmp_path):
    still = changed(PLANE, model={"motion": "constant-velocity", "states": ["px", "py", "vx", "vy"], "Q": diagonal(0, 0, 0, 0), "x0": [1.0, 2.0, 0.0, 0.0],
                                  "P0": diagonal(1, 1, 1, 1)}, nodes=[{"sensor": "bearing", "position_m": [1.0, 2.0], "R": [[1e-4]]}], edges=[])
    (tmp_path / "s.json").write_text(json.dumps(still))
    done = run("simulate", tmp_path / "s.json", status=1)
    assert b"run 0, step 1, node 0" in done.stderr and b"MK_ERROR_DOMAIN" in done.stderr


def test_log_on_standard_output(run, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(PLANE))
    done = run("simulate", tmp_path / "s.json", "--out", "-")
    header, steps, _ = logs.log(done.stdout)
    assert header["filter"] == "ukf" and len(steps) == 60 and b"ukf" in done.stderr


def test_lost_targets_are_counted(simulate):
    _, steps, f, _ = simulate(FAULTY, "ukf", "--runs", "5", "--lost-m", "0.8")
    last = [s for s in steps if s["step"] == 60]
    assert f["targets_lost"] == sum(np.linalg.norm(s["truth"][:2] - s["estimate"][:2]) > 0.8 for s in last)


def test_the_linear_path_is_as_it_was(run, tmp_path):
    """Its log has no key more, so that readers of linear logs see nothing new."""
    (tmp_path / "s.json").write_bytes(run("scenario", "projectile", "--nodes", "3").stdout)
    run("simulate", tmp_path / "s.json", "--steps", "5", "--out", tmp_path / "l")
    header, steps, _ = logs.log((tmp_path / "l").read_bytes())
    assert "kind" not in header and len(header) == 20 and len(steps[0]) == 15
