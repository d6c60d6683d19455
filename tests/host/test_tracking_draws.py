# SPDX-License-Identifier: MIT
"""Truth and readings that `meshkal draw` makes follow the laws of the scenario. Seeds are fixed: a statistic either passes or does not, and every
interval is one that a right program leaves once in 10 000 seeds."""
import csv
import json
import math

import numpy as np
import pytest
import scipy.linalg
import scipy.stats

LEVEL = 1e-4


def diagonal(*values):
    return [[value if i == j else 0.0 for j in range(len(values))] for i, value in enumerate(values)]


def read(path, columns):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == columns.split(",")
    return np.array([[float(cell) for cell in row] for row in rows[1:]]).reshape(-1, len(rows[0]))


@pytest.fixture
def draw(run, tmp_path):
    """draw(scenario, *options) -> truth (steps + 1, n), {(step, node): z}, summary"""
    def call(scenario, *options):
        path, dt = tmp_path / "s.json", scenario["model"].get("dt_s", 1.0)
        path.write_text(json.dumps(scenario))
        run("draw", path, "--truth", tmp_path / "x.csv", "--measurements", tmp_path / "y.csv", "--json", tmp_path / "j.json", *options)
        x, y = read(tmp_path / "x.csv", "t,state,value"), read(tmp_path / "y.csv", "t,node,row,value")
        n, start = len(scenario["model"]["x0"]), scenario["model"].get("start_s", 0.0)
        truth = x[:, 2].reshape(-1, n)
        assert np.array_equal(x[:, 1].reshape(-1, n), np.tile(np.arange(n), (len(truth), 1)))
        np.testing.assert_allclose(x[::n, 0], start + dt * np.arange(len(truth)), rtol=1e-15, atol=1e-12)
        readings = {}
        for t, node, row, value in y:
            z = readings.setdefault((round((t - start) / dt), int(node)), [])
            assert len(z) == row
            z.append(value)
        return truth, {key: np.array(z) for key, z in readings.items()}, json.loads((tmp_path / "j.json").read_text())
    return call


def within(statistic, law):
    """Two-sided, at LEVEL."""
    low, high = law.ppf([LEVEL / 2, 1 - LEVEL / 2])
    assert low <= statistic <= high, f"{statistic} is not within {low} .. {high}"


def assert_normal(values, covariance):
    """Rows are independent draws of N(0, covariance): law of every entry, variances and correlations, successive rows unrelated."""
    covariance = np.atleast_2d(covariance)
    white = scipy.linalg.solve_triangular(np.linalg.cholesky(covariance), np.asarray(values).T, lower=True).T
    count, n = white.shape
    within((white**2).sum(), scipy.stats.chi2(count * n))
    for i in range(n):
        assert scipy.stats.kstest(white[:, i], "norm").pvalue > LEVEL
        within((white[:-1, i] * white[1:, i]).sum() / math.sqrt(count - 1), scipy.stats.norm())
        for j in range(i):
            within((white[:, i] * white[:, j]).sum() / math.sqrt(count), scipy.stats.norm())


STILL = {"model": {"motion": "constant-velocity", "states": ["px", "vx", "py", "vy"], "Q": diagonal(0, 0, 0, 0), "x0": [3.0, 0.0, 4.0, 0.0],
                   "P0": diagonal(1, 1, 1, 1)},
         "nodes": [{"sensor": "range", "position_m": [0.0, 0.0], "R": [[0.04]], "loss": 0.2, "fault": {"probability": 0.1, "sigma": 3.0}},
                   {"sensor": "range-bearing", "position_m": [10.0, 4.0], "R": [[0.5, 0.1], [0.1, 0.1]], "fault": {"probability": 0.25, "sigma": [2.0, 0.0]}},
                   {"sensor": "none"}],
         "edges": [], "reading_loss": 0.15, "steps": 20000, "seed": 11}


def test_noise_faults_and_losses(draw):
    truth, readings, summary = draw(STILL)
    steps = STILL["steps"]
    assert np.array_equal(truth, np.tile([3.0, 0.0, 4.0, 0.0], (steps + 1, 1)))
    faulty = {tuple(fault) for fault in summary["faults"]}
    assert faulty <= set(readings) and summary["readings"] == len(readings) and summary["out_of_range"] == 0
    there = np.array([[(t, k) in readings for k in (0, 1)] for t in range(1, steps + 1)])
    # Node 1 has no losses of its own: what it lacks is lost together, and then node 0 lacks it, too.
    together = ~there[:, 1]
    assert not there[together, 0].any() and summary["steps_lost"] == together.sum() and summary["lost"] == (~there).sum()
    within(together.sum(), scipy.stats.binom(steps, 0.15))
    left = steps - together.sum()
    within(left - there[:, 0].sum(), scipy.stats.binom(left, 0.2))
    within((together[1:] & together[:-1]).sum() / (steps - 1), scipy.stats.norm(0.15**2, math.sqrt(0.15**2 * (1 + 2 * 0.15) / (steps - 1))))
    clean = []
    for k, rate, position, R, sigma in ((0, 0.1, [5.0], [[0.04]], [3.0]), (1, 0.25, [7.0, math.pi], [[0.5, 0.1], [0.1, 0.1]], [2.0, 0.0])):
        error = {t: readings[t, k] - position for t in range(1, steps + 1) if (t, k) in readings}
        if k == 1:  # west of the sensor: bearings lie on both sides of the seam
            assert all(-math.pi <= readings[key][1] <= math.pi for key in readings if key[1] == 1)
            assert min(readings[key][1] for key in readings if key[1] == 1) < -3 and max(readings[key][1] for key in readings if key[1] == 1) > 3
            error = {t: [e[0], math.remainder(e[1], 2 * math.pi)] for t, e in error.items()}
        hit = [e for t, e in error.items() if (t, k) in faulty]
        within(len(hit), scipy.stats.binom(len(error), rate))
        clean.append({t: e for t, e in error.items() if (t, k) not in faulty})
        assert_normal(list(clean[k].values()), R)
        assert_normal(hit, np.array(R) + np.diag(np.square(sigma)))
    # Noises and faults of the two nodes are independent.
    assert_normal([[*clean[0][t], *clean[1][t]] for t in clean[0] if t in clean[1]], scipy.linalg.block_diag([[0.04]], [[0.5, 0.1], [0.1, 0.1]]))
    both = there.all(axis=1)
    within(sum((t, 0) in faulty and (t, 1) in faulty for t in range(1, steps + 1)), scipy.stats.binom(both.sum(), 0.1 * 0.25))


def moved(motion, x, dt):
    """Independent of the library: the exponential of the system matrix."""
    n = len(x)
    names = motion["states"]
    A = np.zeros((n, n))
    for axis in "xyz":
        if f"p{axis}" in names:
            A[names.index(f"p{axis}"), names.index(f"v{axis}")] = 1.0
    if motion["motion"] == "constant-turn":
        omega, vx, vy = x[names.index("omega")], names.index("vx"), names.index("vy")
        A[vx, vy], A[vy, vx] = -omega, omega
    return scipy.linalg.expm(A * dt) @ x


def noise(motion, dt):
    names = motion["states"]
    Q = np.zeros((len(names), len(names)))
    for i, axis in enumerate("xyz"):
        if f"p{axis}" in names:
            q = np.broadcast_to(motion["acceleration_psd"], 3)[i] if np.ndim(motion["acceleration_psd"]) == 0 else motion["acceleration_psd"][i]
            p, v = names.index(f"p{axis}"), names.index(f"v{axis}")
            Q[np.ix_([p, v], [p, v])] = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    if motion["motion"] == "constant-turn":
        Q[names.index("omega"), names.index("omega")] = motion["turn_rate_psd"] * dt
    return Q


MOTIONS = [
    {"motion": "constant-velocity", "states": ["px", "py", "vx", "vy"], "dt_s": 1.5, "acceleration_psd": 0.3, "x0": [1, 2, 3, 4], "P0": diagonal(1, 1, 1, 1)},
    {"motion": "constant-velocity", "states": ["vz", "px", "py", "vy", "pz", "vx"], "dt_s": 0.25, "acceleration_psd": [0.1, 0.2, 0.3], "x0": [0] * 6,
     "P0": diagonal(1, 1, 1, 1, 1, 1)},
    {"motion": "constant-turn", "states": ["omega", "px", "py", "vx", "vy"], "dt_s": 0.5, "acceleration_psd": 0.01, "turn_rate_psd": 1e-4,
     "x0": [0.3, 0, 0, 10, 0], "P0": diagonal(1, 1, 1, 1, 1)},
    {"motion": "constant-turn", "states": ["px", "vx", "py", "vy", "pz", "vz", "omega"], "acceleration_psd": [0.01, 0.01, 0.1], "turn_rate_psd": 1e-5,
     "x0": [0, 10, 0, 0, 100, 1, -0.1], "P0": diagonal(*[1] * 7)},
]


@pytest.mark.parametrize("motion", MOTIONS, ids=range(len(MOTIONS)))
def test_motion_and_its_noise(draw, motion):
    scenario = {"model": motion, "nodes": [{"sensor": "none"}], "edges": [], "steps": 2000, "seed": 5}
    truth, readings, summary = draw(scenario)
    dt = motion.get("dt_s", 1.0)
    Q = noise(motion, dt)
    np.testing.assert_allclose(summary["Q"], Q, rtol=1e-14)
    assert not readings and np.array_equal(truth[0], motion["x0"])
    w = np.array([after - moved(motion, before, dt) for before, after in zip(truth[:-1], truth[1:])])
    assert_normal(w, Q)


def test_explicit_noise(draw):
    Q = np.array([[2.0, 0.5, 0.0, 0.1], [0.5, 1.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.4], [0.1, 0.0, 0.4, 1.0]])
    motion = {"motion": "constant-velocity", "states": ["px", "py", "vx", "vy"], "Q": Q.tolist(), "dt_s": 2.0, "x0": [0] * 4, "P0": diagonal(1, 1, 1, 1)}
    truth, _, summary = draw({"model": motion, "nodes": [{"sensor": "none"}], "edges": [], "steps": 2000})
    assert np.array_equal(summary["Q"], Q)
    assert_normal([b - moved(motion, a, 2.0) for a, b in zip(truth[:-1], truth[1:])], Q)


@pytest.mark.parametrize("start", [None, "estimate", "truth"])
def test_start(draw, start):
    """The estimate or the truth is drawn from N(x0, P0), once a run."""
    P0 = np.array([[4.0, 1.0, 0.0, 0.0], [1.0, 2.0, 0.0, 0.5], [0.0, 0.0, 1.0, 0.0], [0.0, 0.5, 0.0, 9.0]])
    motion = {"motion": "constant-velocity", "states": ["px", "py", "vx", "vy"], "acceleration_psd": 1.0, "x0": [1.0, 2.0, 3.0, 4.0], "P0": P0.tolist()}
    scenario = {"model": motion | ({"start": start} if start else {}), "nodes": [{"sensor": "none"}], "edges": [], "steps": 1}
    drawn = []
    for number in range(150):
        truth, _, summary = draw(scenario, "--run", number)
        fixed, other = (truth[0], summary["estimate"]) if start != "truth" else (summary["estimate"], truth[0])
        assert np.array_equal(fixed, motion["x0"])
        drawn.append(np.array(other) - motion["x0"])
    assert_normal(drawn, P0)


def bearing(d):
    return [math.atan2(d[1], d[0])] + ([math.atan2(d[2], math.hypot(d[0], d[1]))] if len(d) == 3 else [])


def seen(node, p, v):
    d = p - np.array(node["position_m"])
    r = np.linalg.norm(d)
    return {"range": lambda: [r], "bearing": lambda: bearing(d), "range-bearing": lambda: [r, *bearing(d)], "range-rate": lambda: [d @ v / r],
            "tdoa": lambda: [r - np.linalg.norm(p - np.array(node.get("reference_m", p)))]}[node["sensor"]]()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_sensors(draw, dimensions):
    """Nearly without noise, every sensor reads what NumPy computes from the truth."""
    names = ["px", "vx", "py", "vy", "pz", "vz"][:2 * dimensions]
    random = np.random.default_rng(3)
    nodes = []
    for kind, rows in (("range", 1), ("bearing", dimensions - 1), ("range-bearing", dimensions), ("range-rate", 1), ("tdoa", 1)):
        nodes += [{"sensor": kind, "position_m": random.normal(0, 50, dimensions).tolist(), "R": diagonal(*[1e-18] * rows)}]
        nodes[-1] |= {"reference_m": random.normal(0, 50, dimensions).tolist()} if kind == "tdoa" else {}
    motion = {"motion": "constant-velocity", "states": names, "acceleration_psd": 1.0, "x0": [0.0, 1.0] * dimensions, "P0": diagonal(*[1] * 2 * dimensions)}
    truth, readings, _ = draw({"model": motion, "nodes": nodes, "edges": [], "steps": 50})
    assert len(readings) == 50 * len(nodes)
    for (t, k), z in readings.items():
        np.testing.assert_allclose(z, seen(nodes[k], truth[t, ::2], truth[t, 1::2]), atol=1e-8, rtol=1e-10)


def test_range_limit(draw, run):
    scenario = json.loads(run("scenario", "distributed-unscented", "--range-limit", 70).stdout)
    truth, readings, summary = draw(scenario)
    for t in range(1, scenario["steps"] + 1):
        for k, node in enumerate(scenario["nodes"]):
            assert ((t, k) in readings) == (np.linalg.norm(truth[t, :2] - node["position_m"]) <= 70)
    assert 20 < summary["out_of_range"] == 3 * scenario["steps"] - len(readings)


def test_draws_do_not_depend_on_one_another(draw):
    """Other sensors, losses and faults change neither the truth nor the readings that are there in both; seeds and runs change all."""
    base = STILL | {"model": MOTIONS[0], "steps": 100}
    truth, readings, _ = draw(base)
    fewer = base | {"nodes": [base["nodes"][0] | {"loss": 0.9}, {"sensor": "none"}], "reading_loss": 0.0}
    other_truth, other, _ = draw(fewer)
    assert np.array_equal(truth, other_truth)
    common = set(readings) & set(other)
    assert 3 < len(common) and all(np.array_equal(readings[key], other[key]) for key in common)
    shorter, _, _ = draw(base, "--steps", 40)
    assert np.array_equal(shorter, truth[:41])
    for options in (("--seed", 12), ("--run", 1)):
        other_truth, other, _ = draw(base, *options)
        assert not (other_truth[1:] == truth[1:]).any() and not any(np.array_equal(z, readings.get(key)) for key, z in other.items())
    same_truth, _, _ = draw(base, "--seed", 11, "--run", 0)
    assert np.array_equal(same_truth, truth)


def test_target_on_a_sensor(run, tmp_path):
    """A bearing of a target on the sensor is no number: named, and no file is left."""
    scenario = STILL | {"nodes": [{"sensor": "none"}, {"sensor": "bearing", "position_m": [3.0, 4.0], "R": [[1.0]]}], "reading_loss": 0}
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    done = run("draw", tmp_path / "s.json", "--measurements", tmp_path / "y.csv", "--truth", tmp_path / "x.csv", status=1)
    assert b"run 0, step 1, node 1: reading of the drawn truth: MK_ERROR_DOMAIN" in done.stderr and done.stdout == b""
    assert [p.name for p in tmp_path.iterdir()] == ["s.json"]
    # A range of 0 is a number.
    scenario["nodes"][1]["sensor"] = "range"
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    run("draw", tmp_path / "s.json")


def test_truth_beyond_all_numbers(run, tmp_path):
    scenario = STILL | {"model": MOTIONS[0] | {"x0": [1e308, 0.0, 1e308, 0.0]}, "nodes": [{"sensor": "none"}]}
    (tmp_path / "s.json").write_text(json.dumps(scenario))
    done = run("draw", tmp_path / "s.json", "--truth", tmp_path / "x.csv", status=1)
    assert b"motion of the drawn truth: MK_ERROR_NOT_FINITE" in done.stderr and not (tmp_path / "x.csv").exists()
