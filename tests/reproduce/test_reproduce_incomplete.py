# SPDX-License-Identifier: MIT
"""make reproduce, tracking with incomplete measurements: what it writes, and that every statement can fail."""

import copy
import json
import math
import shutil
import subprocess

import cbor2
import numpy as np
import pytest
from scipy import stats
from rerun.chunk import RrdReader
from tool import BATCHES, MESHKAL, command, shows_something, tables


@pytest.fixture(scope="module")
def batches(incomplete):
    from incomplete_measurements.batches import load

    found, errors = load(incomplete[0], range(BATCHES[0], BATCHES[-1] + 1))
    assert not errors
    return found


def outcomes(batches):
    from incomplete_measurements.properties import PROPERTIES
    from statements import evaluate

    return {o.property.text: o for o in evaluate(PROPERTIES, batches)}


def test_succeeds_and_prints_the_table(incomplete):
    folder, done = incomplete
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    assert (folder / "table.md").read_text() in done.stdout


@pytest.mark.parametrize("name", ["log-mse", "comparison", "time", "policies"])
def test_figures_show_something(incomplete, name):
    shows_something(incomplete[0] / f"{name}.png")


def test_recording_holds_the_run(incomplete):
    entities = {chunk.entity_path for chunk in RrdReader(incomplete[0] / "incomplete-measurements.rrd").stream()}
    assert len(entities) > 20


def test_table_numbers_are_the_errors_of_every_run(incomplete, batches, tmp_path):
    """The published metric, from truth and estimates in the log of all runs of a batch."""
    folder, done = incomplete
    scenario = folder / "draws" / "seed-1" / "published-scenario.json"
    rows = tables(done.stdout)
    for name, row in (("pukf", "PUKF"), ("iukf-literal", "IUKF as published")):
        log = tmp_path / f"{name}.cbor"
        subprocess.run([MESHKAL, "simulate", scenario, "--filter", name, "--runs", "60", "--seed", "1", "--out", log], check=True, capture_output=True)
        squares = np.zeros((60, 2))
        with log.open("rb") as stream:
            decoder = cbor2.CBORDecoder(stream)
            decoder.decode()
            while "end" not in (item := decoder.decode()):
                error = np.frombuffer(item["estimate"].value) - np.frombuffer(item["truth"].value)
                squares[item["step"] - 1] += (error[0] ** 2 + error[2] ** 2, error[1] ** 2 + error[3] ** 2)
        expected = np.log(squares / 60).mean(axis=0)
        item = batches[0].of["published"][name]
        np.testing.assert_allclose([item["mean_log_mse_position"], item["mean_log_mse_velocity"]], expected, rtol=1e-12)
        median, spread = rows[f"position, ln: {row}"][1:3]
        values = [b.of["published"][name]["mean_log_mse_position"] for b in batches]
        assert median == f"{np.median(values):.3f}"
        low, high = (f"{limit(values):.3f}" for limit in (min, max))
        assert spread == (low if low == high else f"{low} .. {high}")


def test_table_holds_the_published_values(incomplete):
    rows = tables(incomplete[1].stdout)
    published = {name: cells[0] for name, cells in rows.items() if cells[0].replace(".", "").lstrip("-").isdigit() and len(cells) == 4}
    assert published == {
        "position, ln: IUKF as published": "-4.372",
        "position, ln: PUKF": "-4.981",
        "position, ln: MPUKF": "-5.191",
        "velocity, ln: IUKF as published": "-7.894",
        "velocity, ln: PUKF": "-8.592",
        "velocity, ln: MPUKF": "-8.787",
        "time, ratio to PUKF: IUKF as published": "0.808",
        "time, ratio to PUKF: PUKF": "1",
        "time, ratio to PUKF: MPUKF": "0.692",
    }


def test_claim_that_fails_is_printed_with_its_seed_and_is_no_failure(incomplete, batches):
    """A lost target makes MPUKF worse than PUKF: its gate refuses for ever."""
    kind, holds, number, seeds = tables(incomplete[1].stdout)["position error of MPUKF below PUKF"]
    assert (kind, holds, seeds) == ("claim", "**1 of 2**", "2")
    second = batches[1].of["published"]
    assert second["mpukf"]["targets_lost"] > 0
    assert f"{second['pukf']['mean_log_mse_position'] - second['mpukf']['mean_log_mse_position']:.3g}" in number
    assert incomplete[1].returncode == 0


def test_faults_and_losses_are_drawn_as_published(batches):
    """Binomial counts within 5 standard deviations; the gate is the only filter's that rejects."""
    item = batches[0].of["published"]
    readings = item["pukf"]["counts"]["accepted"]
    whole = 60 * 60 * 3
    # Lost all three together with probability 0.1.
    assert abs(readings - 0.9 * whole) < 5 * 3 * math.sqrt(60 * 60 * 0.09)
    assert item["pukf"]["counts"]["rejected"] == 0 < item["mpukf"]["counts"]["rejected"]
    own = batches[0].of["own model, gate"]["mpukf"]["counts"]
    # Good vectors beyond a gate of 0.001.
    vectors = own["rejected"] / 3
    low, high = stats.binom.ppf([1e-5, 1 - 1e-5], round((own["accepted"] + own["rejected"]) / 3), 1e-3)
    # More when the filter is lost: the mean covers transients too.
    assert low <= vectors <= 3 * high


def shift(variant, name, key, amount):
    def apply(batch):
        batch.of[variant][name][key] += amount

    return apply


def fire(variant, share):
    def apply(batch):
        counts = batch.of[variant]["mpukf"]["counts"]
        counts["rule_fired"] = share * counts["updates"]

    return apply


def slow(batch):
    batch.ns["mpukf"] = 1.01 * batch.ns["pukf"] + batch.ns["iukf-literal"]


def fail(batch):
    batch.of["policy: inflate"]["mpukf"]["failures"] = {"MK_ERROR_MODEL": 1.0}


POSITION, VELOCITY = "mean_log_mse_position", "mean_log_mse_velocity"
TAMPERED = [
    ("position error of MPUKF below PUKF", shift("published", "mpukf", POSITION, 4)),
    ("position error of PUKF below IUKF as published", shift("published", "pukf", POSITION, 1)),
    ("velocity error of MPUKF below PUKF", shift("published", "mpukf", VELOCITY, 1)),
    ("velocity error of PUKF below IUKF as published", shift("published", "pukf", VELOCITY, 2)),
    ("MPUKF the fastest of the three", slow),
    ("one gate for both: PUKF and MPUKF the same to three digits", shift("one gate", "mpukf", VELOCITY, 0.02)),
    ("one gate, no rule: MPUKF is PUKF", shift("no rule", "mpukf", POSITION, -1e-9)),
    ("the literal rule ends fewer than 1 % of the updates", fire("published", 0.011)),
    ("no update failed, in any filter and variant", fail),
]


@pytest.mark.parametrize(("text", "change"), TAMPERED, ids=[t[0] for t in TAMPERED])
def test_every_property_can_fail(batches, text, change):
    first = copy.deepcopy(batches[0])
    # Time is the machine's.
    first.ns.update({"iukf-literal": 100.0, "pukf": 110.0, "mpukf": 90.0})
    assert outcomes([first])[text].failed == []
    change(first)
    assert outcomes([first])[text].failed == [1]


def test_no_property_is_left_untampered():
    from incomplete_measurements.properties import PROPERTIES
    from statements import OPEN

    assert {p.text for p in PROPERTIES if p.kind != OPEN} == {text for text, _ in TAMPERED}


def test_violated_property_is_the_exit_status(incomplete, tmp_path):
    folder = shutil.copytree(incomplete[0], tmp_path / "copy")
    path = folder / "draws" / "seed-2" / "published-pukf.json"
    content = json.loads(path.read_text())
    content["filters"][0]["mean_log_mse_position"] = 0.0
    path.write_text(json.dumps(content))
    (folder / "draws" / "seed-1" / "time.json").unlink()
    done = command("incomplete-measurements", "--out", folder, "--draws", 2, "--report-only", cwd=folder)
    assert done.returncode == 1
    assert "1 batch could not be computed" in done.stdout
    assert "- seed 1: cannot read" in done.stdout
    assert tables(done.stdout)["position error of PUKF below IUKF as published"][1:4:2] == ["**0 of 1**", "all"]


# What covariances are worth


def law(seed, scale, batches=30, runs=50, steps=60):
    """NEES of a filter whose covariance is scale times too small: chi-square, steps alike but independent runs."""
    random = np.random.default_rng(seed)
    low, high = stats.chi2.ppf([0.025, 0.975], 4 * runs) / runs
    items = []
    for _ in range(batches):
        means = scale * random.chisquare(4, (runs, steps)).mean(axis=0)
        items.append({"nees": means.mean(), "nees_steps_inside": ((means >= low) & (means <= high)).mean()})
    return items


def test_verdict_follows_the_law():
    from tracking import nees_verdict

    verdicts = [nees_verdict(law(seed, 1.0))[-1] for seed in range(200)]
    wrong = sum(v != "consistent" for v in verdicts)
    # 5 in 100 by the interval's own law.
    assert stats.binom.ppf(1e-4, 200, 0.05) <= wrong <= stats.binom.ppf(1 - 1e-4, 200, 0.05)
    assert nees_verdict(law(1, 1.1))[-1].startswith("over-confident by ")
    assert 8 < float(nees_verdict(law(1, 1.1))[-1].split()[2]) < 12
    assert nees_verdict(law(1, 3.0))[-1].startswith("over-confident, ")
    assert nees_verdict(law(1, 0.9))[-1].startswith("cautious by ")
    assert nees_verdict(law(1, 1.0, batches=1))[-1] == "unknown: one batch"
    heavy = law(1, 1.0)
    for i, item in enumerate(heavy):
        item["nees"] *= 1000.0 if i == 0 else 1.0
        item["nees_steps_inside"] = 0.7 + 0.01 * (i % 3)
    assert nees_verdict(heavy)[-1] == "not consistent: rarely in its band"


def test_intervals_cover_as_they_say():
    from tracking import interval, share

    random = np.random.default_rng(3)
    hits = 0
    for _ in range(1000):
        mean, half = interval(random.standard_normal(8) + 5.0)
        hits += abs(mean - 5.0) <= half
    assert stats.binom.ppf(1e-4, 1000, 0.95) <= hits <= stats.binom.ppf(1 - 1e-4, 1000, 0.95)
    for count in (0, 1, 7, 240):
        exact = stats.binomtest(count, 240).proportion_ci(0.95, method="exact")
        np.testing.assert_allclose(share(count, 240), (exact.low, exact.high), rtol=1e-9)
    assert interval([2.0]) == (2.0, math.inf)


def test_verdict_of_the_literal_filter(incomplete):
    """Thirty full updates instead of one: thirty times the information of the readings."""
    lines = [line for line in incomplete[1].stdout.splitlines() if line.startswith("| own model: no faults, no gate")]
    cells = {line.split("|")[2].strip(): [c.strip() for c in line.split("|")[3:]] for line in lines}
    assert set(cells) == {"EKF", "UKF", "IUKF", "IUKF as published", "PUKF", "MPUKF"}
    assert cells["IUKF as published"][3].startswith("over-confident, 16")
