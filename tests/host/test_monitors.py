# SPDX-License-Identifier: MIT
"""Faults in a scenario and monitors of its estimators: statistics and exclusions against NumPy, what the summary says against the log."""
import json
import math

import numpy as np
import pytest
from logs import log
from scipy import stats
from scipy.linalg import block_diag

FAULT = {"node": 2, "row": 1, "from_s": 3.0, "to_s": 12.0, "rate": 1.5, "step": 0.5}
STEPS = 180                   # 18 s
SCHEMES = ("rctm", "aime", "aime-improved", "exclude")


@pytest.fixture(scope="module")
def scenario(run):
    made = json.loads(run("scenario", "projectile", "--nodes", 8, "--seed", 2).stdout)
    return made | {"faults": [FAULT], "steps": STEPS}


@pytest.fixture(scope="module")
def path(scenario, tmp_path_factory):
    place = tmp_path_factory.mktemp("monitors") / "faulty.json"
    place.write_text(json.dumps(scenario))
    return place


@pytest.fixture(scope="module")
def logged(run, path):
    def call(*arguments):
        return log(run("simulate", path, "--out", "-", *arguments).stdout)
    return call


def summary(run, path, tmp_path, *arguments):
    place = tmp_path / "summary.json"
    run("simulate", path, "--json", place, *arguments)
    return json.loads(place.read_text())


# --- faults ------------------------------------------------------------------------------------------------------------------

def test_faults_are_added(run, scenario, tmp_path, logged):
    """Of two on one row the sum; the log says what was added; the rest of the run is the same draw."""
    second = {"node": 2, "row": 1, "from_s": 5.0, "step": -2.0}
    third = {"node": 0, "from_s": 4.0, "to_s": 4.1, "rate": 7.0}
    path, calm = tmp_path / "three.json", tmp_path / "none.json"
    path.write_text(json.dumps(scenario | {"faults": [FAULT, second, third]}))
    calm.write_text(json.dumps(scenario | {"faults": []}))
    _, faulty, _ = log(run("simulate", path, "--out", "-").stdout)
    _, without, _ = log(run("simulate", calm, "--out", "-").stdout)
    first = np.cumsum([0] + [len(n["C"]) for n in scenario["nodes"]])
    for t, (a, b) in enumerate(zip(faulty, without)):
        s = t * 0.1
        wanted = np.zeros(first[-1])
        if 30 < t <= 120:
            wanted[first[2] + 1] += 0.5 + 1.5 * (s - 3.0)
        if t > 50:
            wanted[first[2] + 1] -= 2.0
        if t == 41:
            wanted[first[0]] = 0.7
        assert np.allclose(a["fault"], wanted, atol=1e-12)
        assert np.array_equal(a["measurements"], b["measurements"] + a["fault"])
        assert np.array_equal(a["truth"], b["truth"]) and "fault" not in b


def test_a_fault_after_the_end_is_named(run, scenario, path, tmp_path):
    late = tmp_path / "late.json"
    late.write_text(json.dumps(scenario | {"faults": [FAULT, FAULT | {"from_s": 17.9, "to_s": 30.0}, FAULT | {"from_s": 18.0, "to_s": 30.0}]}))
    for options in ((), ("--monitor", "exclude")):
        assert [line for line in run("simulate", late, *options).stdout.decode().splitlines() if line.startswith("faults[")] == [
            "faults[2] begins at 18 s: after the last step, 17.9 s"]
        assert b"faults[" not in run("simulate", path, *options).stdout


def test_faults_in_recorded_readings(run, scenario, tmp_path):
    """NaN stays NaN; with one row missing the reading is none, with a fault or without."""
    readings = tmp_path / "y.csv"
    readings.write_text("t,node,row,value\n" + "".join(f"{t},{k},{r},{t + k}\n" for t in range(60) for k in (2, 3) for r in (0, 1) if t != 40))
    path = tmp_path / "faulty.json"
    path.write_text(json.dumps(scenario))
    _, found, _ = log(run("simulate", path, "--measurements", readings, "--out", "-").stdout)
    row = sum(len(n["C"]) for n in scenario["nodes"][:2]) + 1
    for t, item in enumerate(found):
        added = 0.5 + 1.5 * (0.1 * t - 3.0) if 30 < t else 0.0
        assert np.isclose(item["measurements"][row], t + 2 + added) if t != 40 else np.isnan(item["measurements"][row])


def test_faults_of_a_tracking_scenario(run, tmp_path):
    scenario = json.loads(run("scenario", "incomplete-measurements").stdout)
    fault = {"node": 1, "from_s": 5.0, "to_s": 9.0, "rate": 2.0, "step": 1.0}
    items = {}
    for name, faults in (("none", []), ("one", [fault])):
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps(scenario | {"faults": faults}))
        items[name] = log(run("simulate", path, "--filter", "ekf", "--steps", 20, "--out", "-").stdout)[1]
    for a, b in zip(items["one"], items["none"]):
        t = a["time_s"][0]
        on = 5.0 < t <= 9.0
        wanted = np.zeros(len(a["measurements"]))
        wanted[1] = 1.0 + 2.0 * (t - 5.0) if on else 0.0
        added = a["measurements"] - b["measurements"]
        assert np.allclose(added[~np.isnan(added)], wanted[~np.isnan(added)], atol=1e-9)
        assert np.allclose(a["fault"], wanted, atol=1e-9) and "fault" not in b
        assert a["faulty"][1] == (b["faulty"][1] or on and not np.isnan(a["measurements"][1]))


def test_a_fault_at_its_very_ends(run, tmp_path):
    """0.1 x 3 is more than 0.3: the step at which a fault begins has none of it, the one at which it ends has."""
    one = {"model": {"A": [[0.9]], "Q": [[0.2]], "dt_s": 0.1}, "nodes": [{"C": [[1.0]], "R": [[0.5]]}], "edges": [],
           "faults": [{"node": 0, "from_s": 0.3, "to_s": 0.6, "step": 1.0}]}
    path = tmp_path / "one.json"
    path.write_text(json.dumps(one))
    _, items, _ = log(run("simulate", path, "--steps", 10, "--out", "-").stdout)
    assert [item["fault"][0] for item in items] == [0, 0, 0, 0, 1, 1, 1, 0, 0, 0]


# --- against NumPy -----------------------------------------------------------------------------------------------------------

class Follower:
    """One estimator in NumPy: the covariance that it holds, its innovations, and what a monitor makes of them. From the log it takes
    the readings, its theta, and who was excluded."""

    def __init__(self, scenario, slots, window, tail):
        model = scenario["model"]
        self.A, self.Q, self.V = (np.array(model[k]) for k in ("A", "Q", "P0"))
        self.input, self.slots, self.window, self.tail = np.array(model["input"]), slots, window, tail
        self.C = [np.array(scenario["nodes"][k]["C"]) for k in slots]
        self.R = [np.array(scenario["nodes"][k]["R"]) for k in slots]
        self.held, self.epochs = set(), []

    def step(self, x, readings, excluded, theta):
        """readings by slot. Returns what the log must say, and psi of the step."""
        read = sorted(readings)
        good = [l for l in read if l not in self.held]
        found = {"rctm": 0.0, "rctm_rows": 0, "aime": 0.0, "aime_rows": 0, "isolation": np.zeros(len(self.slots))}
        information, vector = {}, {}
        if good:
            C, R = np.vstack([self.C[l] for l in good]), block_diag(*(self.R[l] for l in good))
            r = np.concatenate([readings[l] - self.C[l] @ x for l in good])
            Z = np.linalg.inv(C @ self.V @ C.T + R)
            names = [(l, i) for l in good for i in range(len(self.R[l]))]
            information = {(a, b): Z[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}
            vector = dict(zip(names, Z @ r))
            found |= {"rctm": r @ Z @ r, "rctm_rows": len(r)}
        self.epochs = [*self.epochs, (information, vector)][-self.window:]
        names = sorted({name for _, v in self.epochs for name in v})
        if names:
            I = np.array([[sum(m.get((a, b), 0.0) for m, _ in self.epochs) for b in names] for a in names])
            v = np.array([sum(w.get(a, 0.0) for _, w in self.epochs) for a in names])
            found |= {"aime": v @ np.linalg.solve(I, v), "aime_rows": len(names)}
            for l in {name[0] for name in names}:
                own = [i for i, name in enumerate(names) if name[0] == l]
                found["isolation"][l] = v[own] @ np.linalg.solve(I[np.ix_(own, own)], v[own])
        now = {l for l in range(len(self.slots)) if excluded[l]}
        if now - self.held:
            self.epochs = []
        self.held = now
        S, s = np.linalg.inv(self.V), np.zeros(len(x))
        for l in read:
            if l not in now:
                F = self.C[l].T @ np.linalg.inv(self.R[l])
                S, s = S + F @ self.C[l], s + F @ (readings[l] - self.C[l] @ x)
        M = np.linalg.inv(S)
        P = self.A @ M @ self.A.T + self.Q
        self.V = np.linalg.inv(np.linalg.inv(P) - theta * np.eye(len(x)))
        return found, self.A @ x + self.input + self.A @ M @ s


@pytest.mark.parametrize("options", [("--filter", "kfc", "--monitor", "exclude"), ("--filter", "kfd", "--monitor", "aime"),
                                     ("--filter", "kfd", "--monitor", "exclude", "--loss", 0.2),
                                     ("--filter", "rkfdnu2", "--monitor", "exclude", "--loss", 0.1, "--window", 4, "--false-alarm", 1e-4),
                                     ("--filter", "rkfdnu", "--monitor", "rctm", "--window", 1),
                                     ("--filter", "kfd", "--monitor", "exclude", "--real", "float32")])
def test_statistics_and_exclusions(scenario, logged, options):
    header, items, _ = logged(*options)
    window, tail, scheme = header["monitor_window"], header["monitor_false_alarm"], header["monitor"]
    close = {"rtol": 2e-3, "atol": 2e-3} if header["real"] == "float32" else {"rtol": 1e-8, "atol": 1e-8}
    slots, rows = header["slots"], np.cumsum([0, *header["rows"]])
    first = np.cumsum([0] + [len(s) for s in slots])
    weight = [np.array([len(slots[l]) if len(slots) > 1 else 1.0 for l in s]) for s in slots]
    followers = [Follower(scenario, s, window, tail) for s in slots]
    excluded = left_out = 0
    for t, item in enumerate(items):
        x = item["estimate"].reshape(len(slots), -1).astype(float)
        psi = []
        for k, follower in enumerate(followers):
            own = slice(first[k], first[k + 1])
            arrived = item["measurements_arrived"][own]
            readings = {l: item["measurements"][rows[j]:rows[j + 1]] for l, j in enumerate(slots[k]) if arrived[l]}
            for i, l in enumerate(slots[k] if len(slots) == 1 else slots[k][:1]):
                # Also of those that are left out, in this step or before.
                at, want = slice(rows[l], rows[l + 1]), np.full((2, rows[l + 1] - rows[l]), np.nan)
                if i in readings:
                    C = follower.C[i]
                    want = np.array([readings[i] - C @ x[k], np.diag(C @ follower.V @ C.T + follower.R[i])])
                    left_out += item["excluded"][own][i]
                assert np.allclose([item["innovation"][at], item["innovation_variance"][at]], want, **close, equal_nan=True), (t, k, l)
            found, after = follower.step(x[k], readings, item["excluded"][own], item["theta"][k])
            psi.append(after)
            for key in ("rctm", "aime"):
                assert item[f"monitor_{key}_rows"][k] == found[f"{key}_rows"]
                assert np.isclose(item[f"monitor_{key}"][k], found[key], **close), (t, k, key)
            assert np.allclose(item["isolation"][own], found["isolation"], **close)
            tested = "rctm" if scheme == "rctm" else "aime"
            limit = stats.chi2.isf(tail, found[f"{tested}_rows"]) if found[f"{tested}_rows"] else 0.0
            assert np.isclose(item["monitor_threshold"][k], limit, rtol=1e-6)
            if limit and abs(found[tested] / limit - 1) > 1e-3:
                assert item["monitor_alarm"][k] == (found[tested] >= limit)
        excluded += item["excluded"].sum()
        # Who was left out is not in the next estimate.
        if t + 1 == len(items):
            break
        after = items[t + 1]["estimate"].reshape(len(slots), -1)
        for k, s in enumerate(slots):
            if len(slots) == 1:
                assert np.allclose(after[0], psi[0], **close)
                continue
            w = weight[k] * item["estimates_arrived"][first[k]:first[k + 1]]
            assert np.allclose(after[k], sum(w[l] * psi[j] for l, j in enumerate(s)) / w.sum(), **close)
    assert (excluded > 50) == (left_out > 5) == (scheme == "exclude")


def test_improved(logged):
    """rho and its median by spec 3.3, from the statistics of the log."""
    _, items, _ = logged("--filter", "kfd", "--monitor", "aime-improved", "--window", 8)
    E = len(items[0]["monitor_rho"])
    ends = 0
    for k in range(E):
        rhos, quiet = [1.0, 1.0, 1.0], 0
        for item in items:
            alarm, q_R, q_A = (item[f"monitor_{key}"][k] for key in ("alarm", "rctm", "aime"))
            over = quiet == 0 and q_A >= stats.chi2.isf(8e-10, max(item["monitor_aime_rows"][k], 1))
            rho = q_A / max(q_R, 0.1) if over else 1.0
            rhos = [*rhos[1:], rho]
            assert np.isclose(item["monitor_rho"][k], rho) and np.isclose(item["monitor_median"][k], np.median(rhos))
            quiet = 8 if item["monitor_ended"][k] else max(quiet - 1, 0)
            assert not item["monitor_ended"][k] or (over and rho - np.median(rhos) > 16.0 and not alarm)
            ends += item["monitor_ended"][k]
    assert ends > 0


@pytest.mark.once
def test_law_of_the_centre(run, tmp_path):
    """A Kalman filter that hears all: its statistics are chi-square, epochs without common window independent."""
    path = tmp_path / "net.json"
    path.write_bytes(run("scenario", "projectile", "--nodes", 10, "--seed", 3).stdout)
    _, items, _ = log(run("simulate", path, "--filter", "kfc", "--steps", 20000, "--monitor", "aime", "--window", 5, "--out", "-").stdout)
    for key, apart in (("rctm", 1), ("aime", 5)):
        q = [item[f"monitor_{key}"][0] for item in items[4::apart]]
        assert {item["monitor_aime_rows"][0] for item in items} == {20}
        assert stats.kstest(q, "chi2", (20,)).pvalue > 1e-3


# --- the summary -------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("scheme", SCHEMES)
def test_summary_is_of_the_log(run, path, tmp_path, logged, scheme):
    options = ("--filter", "kfd", "--monitor", scheme, "--false-alarm", 1e-3)
    header, items, _ = logged(*options)
    whole = summary(run, path, tmp_path, *options)
    said = whole["filters"][0]["monitor"]
    assert (whole["monitor"], whole["monitor_window"], whole["monitor_false_alarm"]) == (scheme, 10, 1e-3)
    first = np.cumsum([0] + [len(s) for s in header["slots"]])
    alarm = np.array([item["monitor_alarm"] for item in items])
    excluded = np.array([item["excluded"] for item in items])
    E, before = alarm.shape[1], 31
    begun = np.diff(np.vstack([np.zeros((1, E), int), alarm]).astype(int), axis=0) > 0
    held = np.diff(np.vstack([np.zeros((1, first[-1]), int), excluded]).astype(int), axis=0)
    sensor = np.concatenate(header["slots"])
    assert said["clean_node_steps"] == before * E and said["epochs_refused"] == 0
    assert said["false_alarm_node_steps"] == alarm[:before].sum() and said["false_alarms_begun"] == begun[:before].sum()
    assert said["mistaken_exclusions"] == (held[:before] > 0).sum()
    assert said["wrong_exclusions"] == (held[before:, sensor != 2] > 0).sum() + (held[131:, sensor == 2] > 0).sum()
    k, n = alarm[:before].sum(), before * E
    interval = [stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0, stats.beta.ppf(0.975, k + 1, n - k)]
    assert np.allclose(said["false_alarm_rate_ci95"], interval, rtol=1e-8) and said["false_alarm_rate"] == k / n
    times = {"alarm": [], "isolated": [], "ended": []}
    early = 0
    for e, slots in enumerate(header["slots"]):
        if 2 not in slots:
            continue
        own = first[e] + slots.index(2)
        largest = np.array([np.argmax(item["isolation"][first[e]:first[e + 1]]) == slots.index(2) for item in items])
        isolated = excluded[:, own] if scheme == "exclude" else alarm[:, e] & largest
        declared = np.array([item["monitor_ended"][e] for item in items])
        ended = {"exclude": held[:, own] < 0, "aime-improved": declared}.get(scheme)
        for name, signal in (("alarm", alarm[:, e]), ("isolated", isolated)):
            on = np.flatnonzero(signal[31:121])
            times[name].append((on[0] + 1) * 0.1 if len(on) else math.inf)
        if ended is None:
            continue
        early += ended[31:121].sum()
        if excluded[120, own] if scheme == "exclude" else alarm[31:121, e].any():
            off = np.flatnonzero(ended[121:])
            times["ended"].append((off[0] + 1) * 0.1 if len(off) else math.inf)
    fault = said["faults"][0]
    assert {key: fault[key] for key in FAULT} == FAULT and fault["early_ends"] == early
    assert sum(map(math.isfinite, times["isolated"])) > 2
    for name, values in times.items():
        told = fault[name]
        assert (told["of"], told["estimators"]) == (len(values), sum(map(math.isfinite, values)))
        if values:
            wanted = [min(values), np.median(values) if all(map(math.isfinite, values)) else told["median_s"][0]]
            assert np.allclose([told["first_s"][0], told["median_s"][0]], wanted)


def test_error_before_during_and_after(run, path, tmp_path):
    said = summary(run, path, tmp_path, "--filter", "kfd", "--runs", 3)["filters"][0]
    msd = np.array(said["msd_over_time"])
    for phase, part in (("before", slice(15, 31)), ("during", slice(31, 121)), ("after", slice(121, None))):
        assert np.isclose(said["phase_msd"][phase][0], msd[part].mean())


def test_exclusion_helps(run, scenario, path, tmp_path):
    """The error is near that without a fault, and nothing but the exclusion changes the run."""
    calm = tmp_path / "calm.json"
    calm.write_text(json.dumps(scenario | {"faults": []}))
    good = np.mean(summary(run, calm, tmp_path, "--filter", "kfd", "--runs", 10)["filters"][0]["msd_over_time"][31:121])
    errors = {scheme: summary(run, path, tmp_path, "--filter", "kfd", "--runs", 10, "--monitor", scheme)["filters"][0]["phase_msd"]
              for scheme in ("none", *SCHEMES)}
    assert errors["none"] == errors["rctm"] == errors["aime"] == errors["aime-improved"]
    assert errors["exclude"]["before"] == errors["none"]["before"]
    assert errors["exclude"]["during"][0] < 1.2 * good < 0.5 * errors["none"]["during"][0]


# --- with everything else ----------------------------------------------------------------------------------------------------

def test_threads_and_resume(run, path, tmp_path):
    options = ("--filter", "kfd", "--monitor", "exclude", "--false-alarm", 0.05, "--loss", 0.1)
    one = summary(run, path, tmp_path, *options, "--runs", 6, "--threads", 1)["filters"][0]
    kept = tmp_path / "kept"
    for runs in (2, 6):
        two = summary(run, path, tmp_path, *options, "--runs", runs, "--threads", 2, "--resume", kept)["filters"][0]
    assert one["monitor"] == two["monitor"] and one["phase_msd"] == two["phase_msd"] and one["monitor"]["wrong_exclusions"] > 0
    for other in (("--monitor", "aime"), ("--window", 9), ("--false-alarm", 0.02)):
        said = run("simulate", path, *options[:2], *options[2:], *other, "--resume", kept, status=2).stderr.decode()
        assert "another campaign" in said and "monitor" in said


def test_threads_write_one_log(logged):
    options = ("--filter", "kfd", "--monitor", "exclude", "--loss", 0.1, "--runs", 3)
    assert str(logged(*options, "--threads", 1)) == str(logged(*options, "--threads", 3))


def test_frozen_gain_is_left(logged):
    """A step without an excluded reading is a full one."""
    _, items, _ = logged("--filter", "kfd", "--monitor", "exclude", "--frozen", 1e-2)
    header = logged("--filter", "kfd", "--steps", 1)[0]
    first = np.cumsum([0] + [len(s) for s in header["slots"]])
    frozen = 0
    for item in items:
        for k in range(len(first) - 1):
            assert not (item["frozen"][k] and item["excluded"][first[k]:first[k + 1]].any())
        frozen += item["frozen"].sum()
    assert frozen > 100


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_records_replay(run, path, tmp_path, real):
    """A node's record holds what its monitor dropped: it runs again without one."""
    records = tmp_path / "records"
    run("simulate", path, "--filter", "rkfdnu2", "--monitor", "exclude", "--loss", 0.1, "--real", real, "--record", records)
    for record in sorted(records.iterdir()):
        assert b"differences  none" in run("replay", record).stdout


def test_refusals(refused, run, scenario, path, tmp_path):
    def said(*arguments):
        return refused(tmp_path, "simulate", path, *arguments)
    assert said("--monitor", "best") == "--monitor best: must be none, rctm, aime, aime-improved or exclude"
    assert said("--window", 3) == "--window goes with --monitor"
    assert said("--false-alarm", 0.1, "--monitor", "none") == "--false-alarm goes with --monitor"
    for value in (0, 1, "nan", "1e-400", "x"):
        assert said("--monitor", "aime", "--false-alarm", value) == f"--false-alarm {value}: must be a probability, above 0 and below 1"
    for value in (0, 4097, 2.5, "ten"):
        assert said("--monitor", "aime", "--window", value) == f"--window {value}: must be an integer from 1 to 4096"
    large = tmp_path / "large.json"
    large.write_bytes(run("scenario", "projectile", "--nodes", 17).stdout)
    assert refused(tmp_path, "simulate", large, "--filter", "kfc", "--monitor", "aime", "--out", "{}/log") == \
        "--monitor: kfc hears 17 sensors of up to 2 rows; a monitor takes 32 rows: choose a distributed filter with --filter"
    star = tmp_path / "star.json"
    star.write_text(json.dumps(scenario | {"nodes": scenario["nodes"][:1] * 20, "edges": [[7, k] for k in range(20) if k != 7], "faults": []}))
    assert refused(tmp_path, "simulate", star, "--filter", "kfd", "--monitor", "aime") == \
        "--monitor: node 7 hears 20 sensors of up to 2 rows; a monitor takes 32 rows: fewer links"
    many = tmp_path / "many.json"
    many.write_text(json.dumps(scenario | {"faults": [FAULT] * 65}))
    assert refused(tmp_path, "simulate", many, "--monitor", "aime") == "--monitor: 65 faults in the scenario; at most 64 are followed"
    tracking = tmp_path / "tracking.json"
    tracking.write_bytes(run("scenario", "incomplete-measurements").stdout)
    assert "not for tracking" in refused(tmp_path, "simulate", tracking, "--monitor", "aime")
