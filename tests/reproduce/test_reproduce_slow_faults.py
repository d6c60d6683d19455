# SPDX-License-Identifier: MIT
"""make reproduce, slowly growing faults: what it writes, that its numbers are the program's, that every statement can fail; the clairvoyant
test."""

import copy
import dataclasses
import io
import json
import shutil
import subprocess

import cbor2
import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy import stats
from tool import BATCHES, MESHKAL, command, shows_something, tables


@pytest.fixture(scope="module")
def batch(slow):
    from slow_faults.batches import load

    found, errors = load(slow[0], range(BATCHES[0], BATCHES[-1] + 1))
    assert not errors
    return found[0]


@pytest.fixture(scope="module")
def base(slow):
    return json.loads((slow[0] / "draws" / "seed-1" / "scenario.json").read_text())


def outcomes(batch):
    from slow_faults.properties import PROPERTIES
    from statements import evaluate

    return {o.property.text: o for o in evaluate(PROPERTIES, [batch])}


def test_succeeds_and_prints_the_table(slow):
    folder, done = slow
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    assert (folder / "table.md").read_text() in done.stdout


def test_recording_holds_the_run(slow):
    entities = {chunk.entity_path for chunk in RrdReader(slow[0] / "slow-faults.rrd").stream()}
    assert len(entities) > 20


@pytest.mark.parametrize("name", ["alarms", "innovation", "statistic", "ratio", "ends", "roc"])
def test_figures_show_something(slow, name):
    shows_something(slow[0] / f"{name}.png")


def test_runs_are_seven_a_draw(batch):
    assert batch.runs == 7 * len(BATCHES)
    assert all(len(watched.alarm) == batch.runs for watched in batch.of.values())


@pytest.mark.parametrize(("scheme", "monitor"), [("ekf", "aime"), ("rekf-t", "aime-improved"), ("rekf-t", "exclude")])
def test_numbers_are_those_of_the_program_s_summary(slow, batch, tmp_path, scheme, monitor):
    """Read here from the log, there from --json."""
    from slow_faults.batches import Case

    case = Case(scheme, monitor, (0.15, 299))
    scenario, result = slow[0] / "draws" / "seed-1" / f"{case.file}-scenario.json", tmp_path / "result.json"
    options = ("--filter", scheme, "--monitor", monitor, "--runs", str(batch.runs), "--seed", "1", "--json", result)
    subprocess.run([MESHKAL, "simulate", scenario, *options], check=True, capture_output=True)
    item = json.loads(result.read_text())["filters"][0]
    watched, said = batch.of[case], item["monitor"]
    np.testing.assert_array_equal(watched.alarm, said["alarm_s"])
    first = [next((end for end in ends if end > alarm), np.nan) for ends, alarm in zip(said["ends_s"], said["alarm_s"])]
    np.testing.assert_array_equal(watched.end, first)
    np.testing.assert_array_equal(watched.false, said["false_alarms"])
    np.testing.assert_allclose(watched.mean_innovation, item["innovation_over_time"], rtol=1e-9, atol=1e-9)


def test_ratios_decide_as_the_program_does(batch):
    """With the program's own eta, the decisions found in the ratios are the program's."""
    from slow_faults.batches import ETA, FAULTS, plain, unending

    for fault in FAULTS:
        np.testing.assert_array_equal(batch.of[unending(fault)].ends[ETA], batch.of[plain("rekf-t", fault)].end)


def test_table_holds_the_published_values(slow):
    rows = tables(slow[1].stdout)
    published = {name: cells[0] for name, cells in rows.items() if cells[0] != "-" and name.startswith(("alarm, s:", "gain over"))}
    assert published == {
        "alarm, s: EKF + AIME, 0.10 m/s": "235",
        "alarm, s: REKF-N + AIME, 0.10 m/s": "231",
        "alarm, s: REKF-t + improved AIME, 0.10 m/s": "229",
        "gain over EKF, s: REKF-N, 0.10 m/s": "4",
        "gain over EKF, s: REKF-N, 0.15 m/s": "3",
        "gain over EKF, s: REKF-N, 0.25 m/s": "1",
        "gain over EKF, s: REKF-t, 0.10 m/s": "6",
        "gain over EKF, s: REKF-t, 0.15 m/s": "5",
        "gain over EKF, s: REKF-t, 0.25 m/s": "3",
    }


def change(make, **changes):
    """Of each case that `make` names, fields of what was watched."""

    def apply(batch):
        for case in make:
            watched = batch.of[case]
            batch.of[case] = dataclasses.replace(watched, **{name: f(getattr(watched, name)) for name, f in changes.items()})

    return apply


def tampered():
    from slow_faults.batches import FAULTS, RATES, ours, plain

    ramps = [(rate, 299) for rate in RATES]
    late = {"end": lambda end: end + 3}

    def hits(batch):
        """All exact, whatever the bound."""
        for fault in FAULTS:
            change([ours(fault)], end=lambda end, last=fault[1]: np.full_like(end, last + 1))(batch)
            blind = dataclasses.replace(batch.limit[fault].known, signature=np.zeros((400, 12, 8)))
            batch.limit[fault] = dataclasses.replace(batch.limit[fault], known=blind)

    return [
        ("REKF-N alarms before EKF at every rate", change([plain("rekf-n", (0.25, 299))], alarm=lambda a: a + 10)),
        ("REKF-t alarms before EKF at every rate", change([plain("rekf-t", (0.15, 299))], alarm=lambda a: a + 10)),
        ("gains smaller at 0.25 than at 0.10 m/s", change([plain("rekf-t", (0.25, 299))], alarm=lambda a: a - 10)),
        ("gains shrink from rate to rate", change([plain("rekf-n", (0.15, 299))], alarm=lambda a: a + 5)),
        ("EKF, REKF-t: no alarm in the 150 epochs before the fault", change([ours(FAULTS[4])], false=lambda f: f + np.eye(len(f))[0])),
        ("REKF-N: no alarm in the 150 epochs before the fault", change([plain("rekf-n", FAULTS[0])], false=lambda f: f + np.eye(len(f))[0])),
        ("innovation of satellite 1 at 299 s, 0.15 m/s: EKF near 9 m", change([plain("ekf", (0.15, 299))], mean_innovation=lambda m: m + 4)),
        ("the same: REKF-t in 20 .. 22.5 m", change([plain("rekf-t", (0.15, 299))], mean_innovation=lambda m: m - 4)),
        ("after the end EKF + AIME alarms for 30 s and more", change([plain("ekf", (0.10, 299))], after=lambda a: 0 * a + 29)),
        ("the improved scheme does not", change([plain("rekf-t", (0.10, 299))], after=lambda a: 0 * a + 30)),
        ("ours: end within 2 epochs in 90 % at every rate", change([ours((0.25, 299))], **late)),
        ("ours: early ends below 1 % at every rate", change([ours((0.15, 299))], end=lambda end: np.where(np.arange(len(end)) == 0, 280, end))),
        ("ours: no fewer ends within 2 epochs than the published rule, every fault", change([ours(f) for f in ramps], **late)),
        ("ours: ends not better than the bound", hits),
        ("ours: exact ends not better than the bound", hits),
        ("ours: another satellite held faulty in fewer than 1 %", change([ours(FAULTS[3])], wrong=lambda w: w + np.eye(len(w))[0])),
    ]


TAMPERED = range(16)


@pytest.mark.parametrize("i", TAMPERED)
def test_every_property_can_fail(batch, i):
    text, apply = tampered()[i]
    copied = copy.deepcopy(batch)
    if text != "gains shrink from rate to rate":  # a claim of means: not of a few runs
        assert outcomes(copied)[text].failed == []
    apply(copied)
    assert outcomes(copied)[text].failed == [1]


def test_no_property_is_left_untampered(batch):
    from slow_faults.properties import PROPERTIES
    from statements import OPEN

    assert len(tampered()) == len(TAMPERED)
    assert {p.text for p in PROPERTIES if p.kind != OPEN} == {text for text, _ in tampered()}


def test_violated_property_and_missing_case_are_the_exit_status(slow, tmp_path):
    folder = shutil.copytree(slow[0], tmp_path / "copy")
    path = folder / "draws" / "seed-1" / "ekf-aime-0.15-299.json"
    content = json.loads(path.read_text())
    content["alarm"] = [160.0 for _ in content["alarm"]]
    path.write_text(json.dumps(content))
    done = command("slow-faults", "--out", folder, "--draws", 2, "--report-only", cwd=folder)
    assert done.returncode == 1
    assert tables(done.stdout)["REKF-t alarms before EKF at every rate"][1:4:2] == ["**0 of 1**", "all"]
    path.unlink()
    done = command("slow-faults", "--out", folder, "--draws", 2, "--report-only", cwd=folder)
    assert done.returncode == 1
    assert "- seed 1: cannot read" in done.stdout


# What is made of a log


def log(**arrays):
    epochs = 418
    zeros = {"monitor_alarm": 1, "monitor_ended": 1, "excluded": 8, "monitor_aime": 1, "innovation": 8, "monitor_threshold": 1, "error": 1}
    made = {name: np.zeros((1, epochs, width)) for name, width in zeros.items()} | {
        name: np.zeros((1, epochs, 1)) for name in ("monitor_rho", "monitor_median") if "monitor_rho" in arrays
    }
    for name, spans in arrays.items():
        for column, first, last, value in spans:
            made[name][0, first - 1 : last, column] = value
    return made


def test_what_a_log_says():
    from slow_faults.batches import Case, measure, ours, plain, shares, unending

    fault = (0.15, 299)
    error = [(0, 1, 150, 9.0), (0, 151, 299, 2.0), (0, 300, 418, 9.0)]
    watched = measure(plain("ekf", fault), log(monitor_alarm=[(0, 140, 141, 1), (0, 151, 151, 1), (0, 200, 340, 1)], error=error))
    assert watched.position_m == 2.0
    assert (watched.alarm[0], watched.false[0], watched.after[0], np.isnan(watched.end[0])) == (151, 2, 41, True)
    # Before the alarm an end says nothing; one in time.
    watched = measure(plain("rekf-t", fault), log(monitor_alarm=[(0, 200, 301, 1)], monitor_ended=[(0, 180, 180, 1), (0, 302, 302, 1)]))
    assert watched.offset(299)[0] == 2
    # Excluded until 299; then another satellite is held as well.
    watched = measure(ours(fault), log(monitor_alarm=[(0, 200, 200, 1)], excluded=[(0, 200, 299, 1), (3, 310, 312, 1)]))
    assert (watched.alarm[0], watched.offset(299)[0], watched.wrong[0]) == (200, 0, 1)
    # The ratio counts from two epochs after an unbroken alarm on; of the fault's alarm.
    ratios = [(0, 120, 120, 50.0), (0, 200, 201, 50.0), (0, 212, 212, 50.0), (0, 250, 250, 15.0), (0, 300, 300, 50.0)]
    watched = measure(unending(fault), log(monitor_alarm=[(0, 110, 125, 1), (0, 200, 209, 1), (0, 211, 320, 1)], monitor_rho=ratios, monitor_median=[]))
    assert [watched.ends[eta][0] for eta in (14.0, 20.0)] == [250, 300]
    assert np.isnan(watched.ends[60.0][0])
    assert Case("ekf", "aime", fault).file == "ekf-aime-0.15-299"
    declared = shares(np.array([-3.0, -2, 0, 0, 2, 3, np.nan]))
    assert (declared.early, declared.near, declared.exact, declared.rest) == (1, 4, 2, 2)


def sequence(*items):
    out = io.BytesIO()
    for item in items:
        cbor2.dump(item, out)
    out.seek(0)
    return out


def test_logs_that_cannot_be_used():
    from program import ReproduceError
    from run_logs import every_run

    step = {"run": 0, "step": 1, "a": cbor2.CBORTag(86, np.arange(3.0).tobytes()), "b": cbor2.CBORTag(64, b"\1\2")}
    header, end = {"runs": 2, "steps": 1}, {"end": "complete"}
    found = every_run(sequence(header, step, step, end), ("a", "b", "missing"))
    np.testing.assert_array_equal(found["a"], [[[0, 1, 2]]] * 2)
    np.testing.assert_array_equal(found["b"], [[[1, 2]]] * 2)
    for items, said in (((header, step), "cannot be read"), ((), "cannot be read"), ((header, step, {"end": "interrupted"}), "was cut")):
        with pytest.raises(ReproduceError, match=said):
            every_run(sequence(*items), ("a",))


def test_what_the_program_says_of_its_failure(needs_program, tmp_path):
    from program import Program, ReproduceError
    from run_logs import every_run

    file = tmp_path / "no.json"
    with pytest.raises(ReproduceError, match=r"^meshkal simulate: .*no\.json"):
        Program(MESHKAL).reading(lambda stream: every_run(stream, ("a",)), "simulate", file, "--out", "-")


# The clairvoyant test


def test_model_is_the_filter_s(slow, base, tmp_path):
    """Covariance of the innovations: made here from the scenario's keys, and as the program's filter has it, in the log."""
    from run_logs import every_run
    from slow_faults import model

    steps = 418
    scenario = slow[0] / "draws" / "seed-1" / "scenario.json"
    done = subprocess.run([MESHKAL, "simulate", scenario, "--filter", "ekf", "--out", "-"], check=True, capture_output=True)
    packed = every_run(io.BytesIO(done.stdout), ("innovation_covariance",))["innovation_covariance"][0]
    S = np.zeros((steps, 8, 8))
    S[:, *np.tril_indices(8)] = packed
    H, R = model.sight(base)
    P, worst = model.initial(base), 0.0
    for t, (Phi, Q) in enumerate(zip(*model.transitions(base, steps))):
        P = Phi @ P @ Phi.T + Q
        expected = H @ P @ H.T + R
        worst = max(worst, np.abs(np.tril(expected) - S[t]).max() / np.abs(expected).max())
        P -= P @ H.T @ np.linalg.solve(expected, H @ P)
    # What is left: satellites at a finite distance.
    assert worst < 4e-5


def test_signature_is_that_of_the_joint_law(base):
    """The distance of "over since s" from "goes on" in all readings until t, from their joint covariance."""
    from slow_faults import clairvoyant, model

    begin, rate, s, last = 3.0, 0.7, 9, 11
    known = clairvoyant.known(base, 2, begin, rate, 7, 10)
    H, R = model.sight(base)
    Phi, Q = model.transitions(base, last)
    n, m = model.STATES, len(H)
    cross = np.zeros((last, last, n, n))
    P = model.initial(base)
    for i in range(last):
        P = Phi[i] @ P @ Phi[i].T + Q[i]
        cross[i, i] = P
        for j in range(i + 1, last):
            cross[j, i] = Phi[j] @ cross[j - 1, i]
    C = np.zeros((last * m, last * m))
    for i in range(last):
        for j in range(i + 1):
            block = H @ cross[i, j] @ H.T + (R if i == j else 0.0)
            C[i * m : (i + 1) * m, j * m : (j + 1) * m] = block
            C[j * m : (j + 1) * m, i * m : (i + 1) * m] = block.T
    f = np.zeros(last * m)
    for t in range(s, last + 1):
        f[(t - 1) * m + 2] = rate * (t - begin)
    np.testing.assert_allclose(clairvoyant.distance(known, s, 3), np.sqrt(f @ np.linalg.solve(C, f)), rtol=1e-8)


def test_bound_and_what_is_reached(base):
    from slow_faults import clairvoyant

    known = clairvoyant.known(base, 0, 150, 0.10, 230, 302)
    early = np.geomspace(1e-4, 0.5, 20)
    for exact in (False, True):
        curve = clairvoyant.bound(known, 300, early, exact=exact)
        assert np.all(np.diff(curve) >= 0) and np.all(curve <= 1)
    assert clairvoyant.bound(known, 300, np.array([0.01]), exact=True) < clairvoyant.bound(known, 300, np.array([0.01]), exact=False)
    # Neyman and Pearson, by simulation of the one number that decides.
    d, share = clairvoyant.distance(known, 300, 1), 0.01 / (300 - 2 - 230)
    draws = np.random.default_rng(5).standard_normal(200_000)
    power = np.mean(draws + d > stats.norm.isf(share))
    assert abs(power - clairvoyant.bound(known, 300, np.array([0.01]), exact=True)[0]) < 5 * np.sqrt(0.25 / len(draws))
    thresholds = np.linspace(1, 12, 12)
    missed, near, exact = clairvoyant.reached(known, 300, thresholds, runs=4000)
    assert np.all(np.diff(missed) <= 0) and np.all(exact <= near) and np.all(missed + near <= 1 + 1e-12)
    # Ratios have mean 1 while the fault goes on: no more than epochs / exp(threshold) early ends.
    assert np.all(missed <= (300 - 230) * np.exp(-thresholds) + 5 * np.sqrt(missed / 4000) + 1e-3)
    for reached, what in ((near, False), (exact, True)):
        limit = clairvoyant.bound(known, 300, np.maximum(missed, 1e-3), exact=what)
        assert np.all(reached <= limit + 4 * np.sqrt(0.25 / 4000))
