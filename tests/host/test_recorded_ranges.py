# SPDX-License-Identifier: MIT
"""meshkal simulate --measurements on recorded ranges (recorded_ranges.py): what one can expect of the filters, and of files as they come."""
import json

import logs
import numpy as np
import pytest
import recorded_ranges as ranges
from recorded_ranges import GATE, INFLATE, judge


@pytest.fixture
def track(run, tmp_path):
    """track(recording, filter, *options, gate, scenario) -> summary of the filter, whole summary; track.log() -> header, steps of the last one."""
    def call(recording, name, *options, gate=None, scenario=None, truth=True, log=False):
        ranges.write(tmp_path, recording)
        scenario = scenario or ranges.scenario(recording, **({"gate": gate} if gate else {}))
        (tmp_path / "scenario.json").write_text(json.dumps(scenario))
        given = ("--truth", tmp_path / "truth.csv") if truth else ()
        run("simulate", tmp_path / "scenario.json", "--measurements", tmp_path / "ranges.csv", *given, "--filter", name, "--json", tmp_path / "j",
            *(("--out", tmp_path / "l") if log else ()), *options)
        whole = json.loads((tmp_path / "j").read_text())
        return whole["filters"][0] if name != "all" else {f["filter"]: f for f in whole["filters"]}, whole

    call.log = lambda: logs.log((tmp_path / "l").read_bytes())[:2]
    return call


# --- the recordings themselves -----------------------------------------------------------------------------------------------

def test_recordings_are_what_they_say():
    taken = [ranges.record(seed, dimensions=2 + seed % 2) for seed in range(20)]
    share = np.concatenate([r.outlier for r in taken]).mean()
    assert 0.07 < share < 0.13
    for r in taken:
        grid = r.truth_t - 0.0037
        at = np.stack([np.interp(r.t, grid, r.truth[:, i]) for i in range(r.truth.shape[1])], 1)
        error = r.value - np.linalg.norm(at - r.anchors[r.anchor], axis=1)
        assert np.abs(error[~r.outlier].std() / ranges.SIGMA - 1) < 0.1 and (error[r.outlier] > -0.4).all() and error[r.outlier].mean() > 0.8
        speed = np.linalg.norm(np.diff(r.truth[:, :2], axis=0), axis=1) * ranges.CAPTURE
        assert speed.max() < 1.55 and np.diff(r.t).max() > 1 and len(r.order) > len(r.t) and (np.diff(r.t[r.order]) < 0).any()
    clean, dirty = (ranges.record(3, outliers=share) for share in (0.0, 0.1))
    assert not clean.outlier.any() and np.array_equal(clean.t, dirty.t) and np.array_equal(clean.value[~dirty.outlier], dirty.value[~dirty.outlier])


# --- what to expect ----------------------------------------------------------------------------------------------------------

@pytest.mark.once
@pytest.mark.parametrize("real, name, gate, worse, worst", [
    ("float64", "ukf", GATE, 1.25, 0.25), ("float32", "ukf", GATE, 1.25, 0.25), ("float64", "duif", GATE, 1.3, 0.25), ("float64", "ekf", GATE, 2.2, 0.8),
    ("float64", "mpukf", GATE, 2.0, 0.6), ("float64", "rekfd", GATE, 1.8, 0.6), ("float64", "ukf", INFLATE, 1.6, 0.45), ("float64", "ekf", INFLATE, 2.0, 0.6),
    ("float64", "rekfd", INFLATE, 1.8, 0.5)])
def test_ten_per_cent_outliers(track, real, name, gate, worse, worst):
    """20 recordings: RMSE with outliers within `worse` of that without, each below `worst` metres, nobody lost for 5 s, gaps of up to 3 s included; without
    a gate it is four times as much."""
    with_gate, without, clean = [], [], []
    for seed in range(20):
        dirty = ranges.record(seed)
        with_gate.append(judge(track(dirty, name, "--real", real, gate=gate)[0]))
        clean.append(judge(track(ranges.record(seed, outliers=0.0), name, "--real", real)[0]))
        if seed < 5:
            without.append(judge(track(dirty, name, "--real", real)[0]))
    total = {key: np.sqrt((np.array(v)[:, 0]**2).mean()) for key, v in (("gate", with_gate), ("without", without), ("clean", clean))}
    assert total["gate"] < worse * total["clean"], total
    assert max(e for e, _ in with_gate) < worst and max(lost for _, lost in with_gate) < 5
    assert total["without"] > 4 * total["clean"] and total["without"] > 1.8 * total["gate"]


@pytest.mark.once
def test_three_dimensions(track):
    for seed in range(5):
        error, lost = judge(track(ranges.record(seed, dimensions=3), "ukf", gate=GATE)[0])
        assert error < 0.4 and lost < 5


@pytest.mark.once
def test_table(track, program, capsys, monkeypatch):
    """Each cell is what judge says of the filter run alone."""
    monkeypatch.setattr(ranges, "RECORDINGS", 2)
    ranges.print_table(program, "float64", 3, {"seconds": 10.0, "gaps": 0})
    rows = {row[1]: row[2:-1] for row in ([cell.strip() for cell in line.split("|")] for line in capsys.readouterr().out.splitlines())}
    assert rows[""] == ranges.FILTERS and len(rows) == 2 + len(ranges.POLICIES)
    for name, outliers, gate in ranges.POLICIES:
        made = [ranges.record(seed, seconds=10.0, gaps=0, **({} if outliers else {"outliers": 0.0})) for seed in (3, 4)]
        for filter_name in ("ukf", "rekfd"):
            error = np.array([judge(track(r, filter_name, gate=gate)[0])[0] for r in made])
            total, worst = rows[name][ranges.FILTERS.index(filter_name)].rstrip(")").split(" (")
            assert float(total) == pytest.approx(np.sqrt((error**2).mean()), rel=0.01) and float(worst) == pytest.approx(error.max(), rel=0.06)


def test_duif_is_the_centralised_filter(track):
    """One anchor measures at a time; ten iterations bring what it knows to all others."""
    r = ranges.record(2, seconds=20.0, gaps=0, outliers=0.0)
    central, duif = (track(r, name)[0] for name in ("ukf", "duif"))
    np.testing.assert_allclose(duif["position_rmse_over_time"], central["position_rmse_over_time"], rtol=0.03, atol=0.005)
    assert duif["disagreement_largest"] < 0.02


@pytest.mark.parametrize("name", ["ukf", "ekf", "rekfd"])
@pytest.mark.parametrize("policy", ["skip", "inflate"])
def test_way_back_though_one_reading_in_four_fits(track, name, policy):
    """Readings one at a time; the estimate starts 5 m off and sure of itself, where the ranges of one anchor in four are right by chance: what fits now and
    then does not keep the filter from seeing that it is wrong."""
    places = np.array([[0.0, 2.0], [9.0, 7.5], [10.0, 1.0], [5.5, 0.0]])
    target, start = np.array([8.0, 4.0]), np.array([3.0, 4.0])  # as far from the last one
    assert np.linalg.norm(target - places[3]) == np.linalg.norm(start - places[3])
    t = ranges.EPOCH + np.arange(400) / 20
    anchor = np.arange(400) % 4
    truth = np.tile(target, (len(t), 1))
    r = ranges.Recording(places, t, anchor, np.round(np.linalg.norm(target - places[anchor], axis=1), 3), np.zeros(400, bool), t, truth, np.arange(400))
    # All nodes hear each other.
    scenario = ranges.scenario(r, gate={"significance": 1e-4, "policy": policy, "patience": 10})
    scenario["model"] |= {"x0": [*start, 0.0, 0.0], "P0": np.diag([4.0, 4.0, 0.01, 0.01]).tolist(), "acceleration_psd": 1e-4}
    scenario["edges"] = [[a, b] for a in range(4) for b in range(a)]
    # Sure of itself: fed first with what it expects.
    early = ranges.EPOCH - 5 + np.arange(100) / 20
    first = np.arange(100) % 4
    r.t, r.anchor = np.concatenate([early, t]), np.concatenate([first, anchor])
    r.value = np.concatenate([np.round(np.linalg.norm(start - places[first], axis=1), 3), r.value])
    r.order = np.arange(500)
    f, _ = track(r, name, scenario=scenario)
    assert f["counts"]["reinitialised"] >= 1 and f["position_rmse_over_time"][-1] < 0.2
    scenario["tracking"]["gate"]["patience"] = 0
    f, _ = track(r, name, scenario=scenario)
    assert f["counts"]["reinitialised"] == 0 and (policy == "inflate" or f["position_rmse_over_time"][-1] > 1)


# --- times -------------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("real", ["float64", "float32"])
@pytest.mark.parametrize("name", ["ukf", "duif", "rekfd"])
def test_epoch_times_cost_nothing(track, run, tmp_path, real, name):
    """Intervals are taken in double: the same estimates as with times from zero, but for the microsecond's rounding at 1.7e9 (2.4e-7 s)."""
    r = ranges.record(5, seconds=10.0, gaps=1)
    track(r, name, "--real", real, gate=GATE, log=True)
    _, epoch = track.log()
    r.t, r.truth_t = r.t - ranges.EPOCH, r.truth_t - ranges.EPOCH
    track(r, name, "--real", real, gate=GATE, log=True)
    _, zero = track.log()
    for a, b in zip(epoch, zero, strict=True):
        np.testing.assert_allclose(a["estimate"], b["estimate"], atol=1e-5 if real == "float64" else 1e-3)
        assert np.array_equal(a["decision"], b["decision"])


def test_instants_of_equal_time(track):
    """Anchors polled at once with one time stamp are one update."""
    r = ranges.record(1, seconds=10.0, gaps=0, missing=0.0)
    r.t = ranges.EPOCH + np.floor((r.t - ranges.EPOCH) * 10) / 10
    keep = np.unique(np.stack([r.t, r.anchor]), axis=1, return_index=True)[1]
    r.t, r.anchor, r.value, r.order = r.t[keep], r.anchor[keep], r.value[keep], np.arange(len(keep))
    f, whole = track(r, "ukf", gate=GATE)
    assert whole["steps"] == len(np.unique(r.t)) and whole["readings"] == len(keep) == sum(f["counts"][k] for k in ("accepted", "rejected"))


# --- files as they come ------------------------------------------------------------------------------------------------------

def test_order_repeats_line_ends_and_comments_change_nothing(run, tmp_path):
    r = ranges.record(7, seconds=10.0, gaps=0)
    ranges.write(tmp_path, r, gate=GATE)
    lines = ranges.lines(r)
    plain = [lines[0], *sorted(set(lines[1:]))]
    forms = {"plain": "\n".join(plain) + "\n", "file": "\n".join(lines) + "\n", "backwards": "\n".join([lines[0], *plain[:0:-1]]),
             "spreadsheet": "\ufeff" + "\r\n".join(plain) + "\r\n", "comments": "# 8 anchors\n" + "\n# noon\n\n".join(plain) + "\n"}
    kept = {}
    for form, text in forms.items():
        (tmp_path / "y.csv").write_bytes(text.encode())
        run("simulate", tmp_path / "scenario.json", "--measurements", tmp_path / "y.csv", "--truth", tmp_path / "truth.csv", "--out", tmp_path / "l",
            "--json", tmp_path / "j")
        summary = json.loads((tmp_path / "j").read_text())
        assert summary["lines_repeated"] == (len(lines) - len(plain) if form == "file" else 0)
        kept[form] = (tmp_path / "l").read_bytes(), summary["data_sha256"]
    assert len(lines) > len(plain) and all(k == kept["plain"] for k in kept.values())


def test_gaps_and_truth_are_reported(track, run, tmp_path):
    r = ranges.record(4)
    _, whole = track(r, "ukf")
    assert whole["notes"] == [] and whole["longest_gap_s"] == np.diff(r.t).max() and whole["duration_s"] == r.t[-1] - r.t[0]
    assert whole["from_step"] == whole["steps"] // 2 + 1
    for patience, notes in ((0, ["the gate has no way back"]), (1, [])):
        _, whole = track(r, "ukf", gate=GATE | {"patience": patience})
        assert [note[:24] for note in whole["notes"]] == notes
    # A stray time stamp.
    r.t[500] = 0.0
    _, whole = track(r, "ukf")
    (note,) = whole["notes"]
    assert "without a reading, from t = 0 on" in note and "a wrong time stamp?" in note


@pytest.mark.parametrize("part", [slice(3000, None), slice(None, 2000)], ids=["late", "early"])
def test_truth_of_a_part(track, part):
    """Figures are of the second half of the instants that have truth."""
    r = ranges.record(6)
    r.truth_t, r.truth = r.truth_t[part], r.truth[part]
    f, whole = track(r, "ukf", gate=GATE, log=True)
    known = np.flatnonzero((r.t >= r.truth_t[0] - 0.005) & (r.t <= r.truth_t[-1] + 0.005))
    assert whole["instants_with_truth"] == len(known) and whole["from_step"] == known[len(known) // 2] + 1
    _, steps = track.log()
    window = np.array([s["error"][0] for s in steps[whole["from_step"] - 1:] if not np.isnan(s["truth"][0])])
    assert f["position_rmse"] == pytest.approx(np.sqrt((window**2).mean()), rel=1e-9)


def test_nees_of_the_states_that_truth_has(track):
    """Motion capture gives positions: NEES is theirs."""
    r = ranges.record(8, seconds=20.0, outliers=0.0)
    f, whole = track(r, "ukf", log=True)
    header, steps = track.log()
    assert whole["nees_states"] == 2 and len(steps[0]["nees"]) == 1
    for s in steps:
        P = s["position_covariance"][[0, 1, 1, 2]].reshape(2, 2)
        d = s["truth"][:2] - s["estimate"][:2]
        assert s["nees"][0] == pytest.approx(d @ np.linalg.solve(P, d), rel=1e-8)
    assert 1 < f["nees"] < 4 and f["nees_high"] == pytest.approx(7.3778, rel=1e-4)
    # Ranges one after another with 10 % outliers that no gate keeps out: the filter knows too much.
    dirty, _ = track(ranges.record(8, seconds=20.0), "ukf")
    gated, _ = track(ranges.record(8, seconds=20.0), "ukf", gate=GATE)
    assert dirty["nees_verdict"] == "over-confident" and dirty["nees"] > 5 * gated["nees"]


def test_anchors_on_a_line(track):
    """The mirror image is named, in the plane and under the ceiling, and not where there is none."""
    wall = [[x, 0.0] for x in (0.0, 3.0, 6.0, 9.0)]
    ceiling = [[x, y, 2.9] for x, y in ((0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0))]
    for places, words in ((wall, "on one line"), (ceiling, "in one plane"), (wall + [[3.0, 0.5]], None), (ceiling + [[6.0, 0.0, 1.5]], None)):
        _, whole = track(ranges.record(1, dimensions=len(places[0]), places=places, seconds=5.0, gaps=0), "ukf")
        assert [("mirror" in note, words in note) for note in whole["notes"]] == ([(True, True)] if words else [])


@pytest.mark.parametrize("change, truth, message", [
    (lambda t: t.replace(",", ";"), None, "y.csv:1: the header must be t,node,row,value, not t;node;row;value: columns are separated by commas"),
    (lambda t: t.replace("t,node,row,value", "timestamp,anchor,row,range"), None, "the header must be t,node,row,value, not timestamp,anchor,row,range"),
    (lambda t: t[t.index("\n") + 1:], None, "y.csv:1: the header must be t,node,row,value, not 17000000"),
    (lambda t: t + "1700000001.5,8,0,3\n", None, "node is 8: must be an integer from 0 to 7"),
    (lambda t: t + "1700000001.5,1,0,3\n1700000001.5,1,0,4\n", None, "a second value for the same place"),
    (None, lambda t: t.replace("170000000", "0"), "x.csv: no truth at any instant: it is for"), (None, lambda t: "t,state,value\n", "x.csv: no truth")])
def test_refused_files(refused, tmp_path, change, truth, message):
    r = ranges.record(7, seconds=5.0, gaps=0)
    ranges.write(tmp_path, r)
    same = lambda t: t
    (tmp_path / "y.csv").write_text((change or same)((tmp_path / "ranges.csv").read_text()))
    (tmp_path / "x.csv").write_text((truth or same)((tmp_path / "truth.csv").read_text()))
    assert message in refused(tmp_path, "simulate", "{}/scenario.json", "--measurements", "{}/y.csv", "--truth", "{}/x.csv", "--out", "{}/l", "--json", "{}/j")
