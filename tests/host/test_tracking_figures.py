# SPDX-License-Identifier: MIT
"""Tracking runs: figures beside the log, lost messages, threads, precisions, options, and what cannot be."""
import csv
import json
import math

import logs
import numpy as np
import pytest
import scipy.stats
from tracking_cases import FAULTY, LINEAR, PLANE, assert_close, changed, diagonal, instants, linear_sensors, ranges, simulate  # noqa: F401
from tracking_filters import Model, Transform, Unscented


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
    """nees, position_covariance, variance and trace belong to one matrix: of a filter in NumPy."""
    header, steps, *_ = simulate(PLANE, "ukf")
    f = Unscented(Model(PLANE), Transform(4, PLANE["tracking"]["transform"]))
    for step, (dt, z) in zip(steps, instants(header, steps), strict=True):
        f.predict(dt)
        f.update(z)
        d = step["truth"] - f.x
        assert step["nees"][0] == pytest.approx(d @ np.linalg.solve(f.P, d), rel=1e-6)
        np.testing.assert_allclose(step["position_covariance"], f.P[[0, 1, 1], [0, 0, 1]], rtol=1e-7)
        np.testing.assert_allclose(step["variance"], np.diag(f.P), rtol=1e-7)
        assert step["trace_covariance"][0] == sum(step["variance"].tolist())
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
    assert "kind" not in header and len(header) == 20
    assert list(steps[0]) == ("run step truth measurements measurements_arrived estimates_arrived estimate error variance trace_covariance position_covariance "
                              "innovation innovation_variance theta tolerance nis nis_rows faults").split()


def test_drawn_run_as_a_recording(run, simulate, tmp_path):
    """What draw writes and simulate reads gives the numbers of the drawn run, truth in every state but where lines are cut out."""
    _, drawn, f, _ = simulate(PLANE, "duif")
    (tmp_path / "s.json").write_text(json.dumps(PLANE))
    run("draw", tmp_path / "s.json", "--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv")
    whole = changed(PLANE, model__start=None, model__start_s=0.0)
    header, steps, g, summary = simulate(whole, "duif", "--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv")
    assert (header["source"], summary["instants_with_truth"], summary["readings"]) == ("recorded", 60, 180)
    for a, b in zip(drawn, steps, strict=True):
        for key in ("estimate", "truth", "measurements", "nees", "error", "disagreement"):
            np.testing.assert_allclose(a[key], b[key], rtol=1e-10, atol=1e-12)
    assert g["position_rmse"] == pytest.approx(f["position_rmse"], rel=1e-10) and g["counts"] == f["counts"]
    with open(tmp_path / "x.csv", newline="") as file:
        rows = list(csv.reader(file))
    kept = [row for row in rows if row[0] == "t" or (row[1] in "01" and float(row[0]) > 40)]
    (tmp_path / "x.csv").write_text("".join(",".join(row) + "\n" for row in kept))
    _, steps, g, _ = simulate(whole, "duif", "--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv")
    assert np.isnan(steps[38]["truth"]).all() and np.isnan(steps[38]["nees"]).all() and g["velocity_rmse"] is None
    # Of the half of what has truth: NEES of the positions.
    d = np.array([s["truth"][:2] - s["estimate"].reshape(3, 4)[:, :2] for s in steps[50:]])
    P = np.array([s["position_covariance"] for s in steps[50:]]).reshape(-1, 3, 3)[..., [0, 1, 1, 2]].reshape(-1, 3, 2, 2)
    assert g["nees"] == pytest.approx(np.einsum("tei,teij,tej->te", d, np.linalg.inv(P), d).mean(), rel=1e-8)
    square = d**2
    assert g["position_rmse"] == pytest.approx(math.sqrt(np.mean(square) * 2), rel=1e-10)
