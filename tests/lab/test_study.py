# SPDX-License-Identifier: MIT
"""The study on real input, tools/lab-temperature/study.py.

What needs the simulator is skipped without build/meshkal, unless MESHKAL_REQUIRED=1; the rest always runs.
"""
import csv
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

ROOT = Path(__file__).resolve().parents[2]
STUDY = ROOT / "tools" / "lab-temperature" / "study.py"
DATA = STUDY.with_name("temperature.csv")
MESHKAL = Path(os.environ.get("MESHKAL", ROOT / "build" / "meshkal"))
needs_meshkal = pytest.mark.skipif(not MESHKAL.exists() and os.environ.get("MESHKAL_REQUIRED") != "1",
                                   reason="no build/meshkal")
ROBUST = {"rkfc": "kfc", "rkfdu": "kfd", "rkfdnu": "kfd", "rkfdnu2": "kfd"}
PHI, Q_LEVEL, Q_SLOPE, R = 0.6, 0.05, 0.3, 1.5      # truth of the synthetic tables

spec = importlib.util.spec_from_file_location("study", STUDY)
study = importlib.util.module_from_spec(spec)
spec.loader.exec_module(study)


def run(*args, cwd=None):
    return subprocess.run([sys.executable, str(STUDY), *map(str, args)], capture_output=True, text=True, timeout=300, cwd=cwd)


def draw(rng, motes, steps):
    """A table drawn from the model, its offsets, and the level."""
    level, slope = np.empty(steps), rng.normal(0, (Q_SLOPE / (1 - PHI ** 2)) ** 0.5)
    level[0] = 20
    for t in range(1, steps):
        level[t] = level[t - 1] + slope + rng.normal(0, Q_LEVEL ** 0.5)
        slope = PHI * slope + rng.normal(0, Q_SLOPE ** 0.5)
    offset = rng.normal(0, 1.5, motes)
    offset -= offset.mean()
    return level + offset[:, None] + rng.normal(0, R ** 0.5, (motes, steps)), offset, level


def write(path, table):
    np.savetxt(path, table, delimiter=",", fmt="%.4f")
    return path


def fake_meshkal(path, body):
    """A program in the simulator's place, to see what the study makes of its answers."""
    path.write_text("#!%s\nimport sys\nout = sys.argv[sys.argv.index('--json') + 1]\n%s\n" % (sys.executable, body))
    path.chmod(0o755)
    return path


# The fit


def test_likelihood_is_that_of_the_joint_normal():
    """The scalar recursion against the density of all means at once, written from the model's covariance."""
    rng = np.random.default_rng(1)
    n, r = 12, rng.uniform(0.02, 0.4, 12)
    y = np.cumsum(rng.normal(size=n)) + 20
    # y[t] - y[0] = sum of slopes and level noises + v[t] - v[0]; conditioning on y[0] with a flat prior of the level.
    lag = np.abs(np.subtract.outer(np.arange(n - 1), np.arange(n - 1)))
    increments = Q_SLOPE / (1 - PHI ** 2) * PHI ** lag + Q_LEVEL * np.eye(n - 1)
    add = np.tril(np.ones((n - 1, n - 1)))
    cov = add @ increments @ add.T + np.diag(r[1:]) + r[0]
    expected = multivariate_normal(np.full(n - 1, y[0]), cov).logpdf(y[1:])
    assert study.filter_mean(y, r, PHI, Q_LEVEL, Q_SLOPE)[0] == pytest.approx(expected, rel=1e-10)


def test_one_synthetic_day_gives_parameters_inside_their_intervals():
    """Forty drawn first days. Each bound is a quantile that all forty pass with probability above 0.999."""
    rng, ratios = np.random.default_rng(2), []
    for _ in range(40):
        table, offset, _ = draw(rng, 50, study.DAY)
        fitted = study.fit(table)
        freedom = 49 * 47
        assert chi2.ppf(1e-6, freedom) < fitted["R"] / R * freedom < chi2.ppf(1 - 1e-6, freedom)
        assert np.abs(fitted["offsets"] - offset).max() < 5.7 * (R / study.DAY) ** 0.5        # 2000 normal offsets
        mean, r = table.mean(axis=0), np.full(study.DAY, fitted["R"] / 50)
        at_truth = study.filter_mean(mean, r, PHI, Q_LEVEL, Q_SLOPE)[0]
        ratios.append(2 * (fitted["log_likelihood"] - at_truth))
    # Likelihood ratio: never negative (else the search stopped short of the truth), and at most chi-squared(3); on
    # the edge of the parameters' range it is smaller, so only the upper side is an interval. 1.15 is for 47 steps.
    assert min(ratios) > -1e-6
    assert np.mean(ratios) < 1.15 * 3 + 3.3 * (6 / len(ratios)) ** 0.5
    assert max(ratios) < chi2.ppf(1 - 1e-3 / len(ratios), 3) * 1.15
    # The tolerance is the same statement for one step: about one day in twenty lies outside.
    assert np.mean(np.array(ratios) > study.fit_tolerance(study.DAY - 1) * (study.DAY - 1)) < 0.2


def test_long_record_finds_the_truth():
    """4000 steps: bounds are four standard errors from the curvature of the likelihood at the truth."""
    mean = draw(np.random.default_rng(3), 50, 4000)[0].mean(axis=0)
    r, truth = np.full(4000, R / 50), np.array([PHI, Q_LEVEL, Q_SLOPE])

    def value(p):
        return -study.filter_mean(mean, r, *p)[0]

    h, curvature = np.diag([1e-3, 1e-3, 1e-3]), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            curvature[i, j] = (value(truth + h[i] + h[j]) - value(truth + h[i] - h[j])
                               - value(truth - h[i] + h[j]) + value(truth - h[i] - h[j])) / 4e-6
    error = np.sqrt(np.diag(np.linalg.inv(curvature)))
    assert np.all(np.abs(np.array(study.fit_process(mean, r)) - truth) < 4 * error)
    assert error[0] < 0.05 and error[2] < 0.05      # else the bound says nothing


def test_offsets_with_gaps_are_the_least_squares_solution():
    rng = np.random.default_rng(4)
    table = draw(rng, 8, 30)[0]
    table[rng.random(table.shape) < 0.3] = np.nan
    rows, columns = np.nonzero(np.isfinite(table))
    design = np.zeros((len(rows), 38))
    design[np.arange(len(rows)), rows] = 1
    design[np.arange(len(rows)), 8 + columns] = 1
    solution = np.linalg.lstsq(design, table[rows, columns], rcond=None)[0]
    residual = table[rows, columns] - design @ solution
    offset, r = study.fit_offsets(table)
    assert offset == pytest.approx(solution[:8] - solution[:8].mean(), abs=1e-9)
    assert r == pytest.approx(residual @ residual / (len(rows) - 37), rel=1e-9)


def test_only_day_one_is_used():
    """Other readings after day one change what is scored, but not one fitted number."""
    table = study.read_csv(DATA)
    with_other_days = np.hstack([table[:, :study.DAY], table[:, study.DAY:] * -3])
    assert study.fit(table[:, :study.DAY]) == study.fit(with_other_days[:, :study.DAY])


@pytest.mark.parametrize("motes, edges", [(3, 3), (4, 6), (5, 10), (6, 12), (50, 100)])
def test_ring(motes, edges):
    e = study.ring(motes)
    assert len(e) == edges == len({tuple(p) for p in e})
    assert all(0 <= i < j < motes and min(j - i, motes - j + i) <= 2 for i, j in e)


# Inputs and answers that are wrong


@pytest.mark.parametrize("text, word", [
    (None, "cannot read"), ("", "0 motes"), ("1,2,3\n4,5,6\n7,8,9\n", "two days"),
    ("ragged", "cells"), ("word", "not a number"), ("inf", "infinite"), ("empty column", "no reading"),
    ("silent mote", "row 2"), ("equal rows", "no noise"), ("binary", "cannot read")])
def test_malformed_input(tmp_path, text, word):
    path, table = tmp_path / "in.csv", draw(np.random.default_rng(5), 4, 96)[0]
    cells = [["%.2f" % v for v in row] for row in table]
    if text == "ragged":
        cells[2].pop()
    elif text in ("word", "inf"):
        cells[1][7] = "warm" if text == "word" else "inf"
    elif text == "empty column":
        for row in cells:
            row[60] = ""
    elif text == "silent mote":
        cells[1][:48] = ["nan"] * 48
    elif text == "equal rows":
        cells = [cells[0]] * 4
    if text == "binary":
        path.write_bytes(bytes(range(128, 256)))
    elif text is not None:
        path.write_text(text if text == "" or "," in text else "\n".join(map(",".join, cells)))
    r = run(path, "--meshkal", sys.executable, "--out", tmp_path / "out")
    assert r.returncode == 2 and "study.py: error: " in r.stderr and word in r.stderr
    assert "Traceback" not in r.stderr and r.stdout == ""


def test_missing_simulator(tmp_path):
    r = run("--meshkal", tmp_path / "none", "--out", tmp_path / "out")
    assert r.returncode == 2 and "no simulator at" in r.stderr and "Traceback" not in r.stderr


@pytest.mark.parametrize("body, word", [
    ("sys.exit('model refused')", "model refused"), ("", "no usable result"), ("open(out, 'w').write('{')", "no usable result"),
    ("open(out, 'w').write('[]')", "no usable result"), ("open(out, 'w').write('{\"filters\": []}')", "no error of the level"),
    ("open(out, 'w').write('{\"filters\": [{\"filter\": \"kfc\", \"state_rmse\": [null]}]}')", "no usable result")])
def test_simulator_that_misbehaves(tmp_path, body, word):
    meshkal = fake_meshkal(tmp_path / "meshkal", body)
    out = tmp_path / "out"
    out.mkdir()
    (out / "scenario-result.json").write_text('{"filters": "left over from an earlier run"}')
    r = run("--meshkal", meshkal, "--out", out)
    assert r.returncode == 2 and word in r.stderr and "Traceback" not in r.stderr and r.stdout == ""


def test_files_for_the_simulator(tmp_path):
    """Gaps are left out, offsets are subtracted, truth is the mean of what is left, Q is divided and nothing else."""
    table = draw(np.random.default_rng(6), 7, 100)[0].round(4)
    table[3, 70] = np.nan
    scores = json.dumps({"filters": [{"filter": f, "state_rmse": [1.0, None]} for f in study.FILTERS]})
    meshkal = fake_meshkal(tmp_path / "meshkal", "open(out, 'w').write(%r)" % scores)
    r = run(write(tmp_path / "in.csv", table), "--meshkal", meshkal, "--out", tmp_path / "out")
    assert r.returncode == 0, r.stderr
    one, ten = (json.loads((tmp_path / "out" / n).read_text()) for n in ("scenario.json", "scenario-q10.json"))
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    offset = np.array(results["fitted"]["offsets"])
    assert np.array(one["model"]["Q"]) == pytest.approx(10 * np.array(ten["model"]["Q"]), rel=1e-12)
    for s in (one, ten):
        del s["model"]["Q"], s["name"]
    assert one == ten and one["steps"] == 52 and len(one["nodes"]) == 7
    clean = table[:, 48:] - offset[:, None]
    with open(tmp_path / "out" / "measurements.csv") as f:
        rows = list(csv.DictReader(f))
    assert len(rows) == 7 * 52 - 1
    for row in rows:
        assert row["row"] == "0" and float(row["value"]) == pytest.approx(clean[int(row["node"]), int(row["t"])], abs=1e-7)
    with open(tmp_path / "out" / "truth.csv") as f:
        truth = np.array([float(row["value"]) for row in csv.DictReader(f) if row["state"] == "0"])
    assert truth == pytest.approx(np.nanmean(clean, axis=0), abs=1e-7)
    all_steps = np.nanmean(table - offset[:, None], axis=0)
    assert results["baselines"]["persistence"] == pytest.approx(np.sqrt(np.mean(np.diff(all_steps)[47:] ** 2)), rel=1e-9)


# With the simulator


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    out = tmp_path_factory.mktemp("lab")
    r = run("--meshkal", MESHKAL, "--out", out)
    assert r.returncode == 0, r.stderr
    return r.stdout, json.loads((out / "results.json").read_text())


@needs_meshkal
def test_best_filter_beats_persistence(real):
    text, results = real
    best = min(results["filters"].values())
    assert set(results["filters"]) == set(results["filters_q10"]) == set(study.FILTERS)
    assert best < 0.9 * results["baselines"]["persistence"]      # a tenth: clearly, not by rounding
    assert best < results["baselines"]["constant_slope"]
    assert "which beats persistence" in text and all(f in text for f in study.FILTERS)


@needs_meshkal
@pytest.mark.parametrize("robust", ROBUST)
def test_robust_beats_plain_when_q_is_too_small(real, robust):
    wrong = real[1]["filters_q10"]
    assert wrong[robust] < 0.97 * wrong[ROBUST[robust]]


@needs_meshkal
def test_robust_central_filter_survives_a_wrong_q(real):
    """With Q / 10 the plain filter is worse than no filter; the robust one is still better."""
    assert real[1]["filters_q10"]["rkfc"] < real[1]["baselines"]["persistence"] < real[1]["filters_q10"]["kfc"]


@needs_meshkal
def test_neighbours_only_beat_what_they_hear(real):
    assert max(real[1]["filters"][f] for f in ("kfd", "rkfdu", "rkfdnu", "rkfdnu2")) < real[1]["baselines"]["neighbourhood"]


@needs_meshkal
def test_central_filter_is_the_kalman_filter_of_the_mean(tmp_path):
    """Other numbers of motes and days, and gaps. With one R for all, kfc must be the filter of the mean of what is there."""
    rng = np.random.default_rng(7)
    table = draw(rng, 12, study.DAY * 5)[0].round(4)
    table[rng.random(table.shape) < 0.05] = np.nan
    r = run(write(tmp_path / "in.csv", table), "--meshkal", MESHKAL, "--out", tmp_path / "out")
    assert r.returncode == 0, r.stderr
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["motes"] == 12 and results["steps"] == 192
    fitted = results["fitted"]
    table = table[:, study.DAY:] - np.array(fitted["offsets"])[:, None]
    a, c = np.array([[1, 1], [0, fitted["phi"]]]), np.array([1, 0])
    for key, divisor in (("filters", 1), ("filters_q10", 10)):
        q = np.diag([fitted["q_level"], fitted["q_slope"]]) / divisor
        x, p, errors = np.array(fitted["x0"]), np.array(fitted["P0"]), []
        for column in table.T:
            there = column[np.isfinite(column)]
            errors.append(there.mean() - x[0])
            gain = p @ c / (p[0, 0] + fitted["R"] / len(there))
            x, p = a @ (x + gain * errors[-1]), a @ (p - np.outer(gain, p[0])) @ a.T + q
        assert results[key]["kfc"] == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-6)
