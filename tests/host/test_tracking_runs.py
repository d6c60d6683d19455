# SPDX-License-Identifier: MIT
"""meshkal simulate on tracking scenarios: every filter beside NumPy, on the readings of its own log."""
import math

import numpy as np
import pytest
import scipy.stats
from tracking_cases import (FAULTY, LINEAR, LINEAR_ROWS, PLANE, TURN, assert_close, changed, diagonal, instants, linear_sensors, simulate,  # noqa: F401
                            slots_of)
from tracking_filters import Model, Robust, Transform, Unscented


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
            np.testing.assert_allclose(step["variance"].reshape(-1, 4)[e], np.diag(P), rtol=1e-9)
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
    consensus = {"information": "paper" if paper else "residual"}
    header, steps, _, summary = simulate(changed(scenario, tracking__consensus=consensus), "duif", "--iterations", "200")
    assert (summary["iterations"], summary["protocol"]) == (200, "metropolis")
    model = Model(scenario)
    f = Unscented(model, Transform(model.n, scenario["tracking"]["transform"]))
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        f.predict(dt)
        parts = [f.information(k, reading, not paper) for k, reading in z.items()]
        if parts:
            f.inform(sum(s for s, _ in parts), sum(S for _, S in parts))
        for e in range(header["estimators"]):
            assert_close(step, f.x, f.P, 1e-8, e)
        assert step["disagreement"][0] < 1e-7 and step["consensus_disagreement"][-1] < 1e-9


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
            assert_close(step, nodes[e].x, nodes[e].V, 1e-7, e)


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
            assert_close(step, nodes[e].x, nodes[e].V, 1e-7, e)
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
    sure = changed(PLANE, model__P0=diagonal(1, 1, 0.1, 0.1), model__start=None, tracking__gate={"significance": 1e-4, "patience": 3},
                   edges=[[0, 1], [0, 2], [1, 2]],
                   model__acceleration_psd=1e-4)
    path = [np.array([26 + t, 40 + 0.6 * t]) for t in range(1, 61)]
    (tmp_path / "y.csv").write_text("t,node,row,value\n" + "".join(f"{t},{k},0,{float(np.linalg.norm(p - node['position_m']))!r}\n"
                                                                  for t, p in enumerate(path, 1) for k, node in enumerate(sure["nodes"])))
    _, steps, f, _ = simulate(sure, name, "--measurements", tmp_path / "y.csv")
    far, near = (np.linalg.norm(steps[t]["estimate"][:2] - path[t]) for t in (1, 59))
    assert f["counts"]["reinitialised"] >= 1 and far > 5 and near < 1
    _, _, f, _ = simulate(changed(sure, tracking__gate={"significance": 1e-4, "patience": 0}), name, "--measurements", tmp_path / "y.csv")
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
            assert_close(step, nodes[e].x, nodes[e].P, 1e-8, e)


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
