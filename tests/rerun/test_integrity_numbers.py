# SPDX-License-Identifier: MIT
"""Logs with monitors: what series, lanes, marks, events and the summary say is what the log says."""

import numpy as np
import pytest
from readback import convert
from scipy.stats import chi2
from synthetic import Log
from synthetic_monitor import FALSE_ALARM, NUMBERS, NavigationLog, add_monitor
from synthetic_tracking import TrackingLog
from test_kinds import blueprint_text

STEPS = 30
SCHEMES = ["rctm", "aime", "aime-improved", "exclude"]
KINDS = {
    "network": lambda: Log(nodes=6, steps=STEPS),
    "centre": lambda: Log(nodes=6, steps=STEPS, filter="rkfc", real="float32"),
    "tracking": lambda: TrackingLog(sensors=("range", "range", "range-bearing", "none"), steps=STEPS, filter="rekfd"),
    "navigation": lambda: NavigationLog(steps=STEPS),
}


@pytest.fixture(scope="module", params=[(kind, scheme) for kind in KINDS for scheme in SCHEMES], ids="-".join)
def made(request, tmp_path_factory):
    kind, scheme = request.param
    log = add_monitor(KINDS[kind](), scheme)
    recording, remarks = convert(log.data(), tmp_path_factory.mktemp("r") / "run.rrd")
    assert remarks == []
    return log, recording


def paths(log) -> list[str]:
    return ["centre"] if log.header["estimators"] == 1 else [f"node/{k}" for k in range(log.header["nodes"])]


def sensor(log, k: int) -> str:
    return f"satellite/{NUMBERS[k]}" if "satellites" in log.header else f"node/{k}"


def seconds(log) -> np.ndarray:
    return log.arrays["time_s"][0, :, 0] if "time_s" in log.arrays else np.arange(STEPS) * log.header["dt_s"]


def heard(log) -> list[tuple[int, int, int]]:
    """Place, estimator and node of slots whose nodes have sensors."""
    flat = [(e, node) for e, slots in enumerate(log.header["slots"]) for node in slots]
    return [(i, e, node) for i, (e, node) in enumerate(flat) if log.header["rows"][node]]


def lane(recording, entity: str) -> list[tuple[int, str]]:
    steps, _, values = recording.rows(entity, "StateChange:state")
    return [(int(step), value[0]) for step, value in zip(steps, values)]


def test_statistics_and_ratios(made):
    log, recording = made
    a = {key: values[0] for key, values in log.arrays.items()}
    stored = np.float32 if log.real == "float32" else np.float64
    for e, path in enumerate(paths(log)):
        np.testing.assert_array_equal(recording.series(f"monitor_statistic/threshold/{path}"), a["monitor_threshold"][:, e].astype(stored))
        for key in ("rctm", "aime"):
            value = a[f"monitor_{key}"][:, e].astype(stored)
            np.testing.assert_array_equal(recording.series(f"monitor_statistic/{key}/{path}"), value)
            threshold = chi2.isf(FALSE_ALARM, a[f"monitor_{key}_rows"][:, e])
            np.testing.assert_allclose(recording.series(f"monitor_ratio/{key}/{path}"), value / threshold, rtol=1e-10)
    ratio = a["monitor_aime"].astype(stored) / chi2.isf(FALSE_ALARM, a["monitor_aime_rows"])
    if len(paths(log)) > 1:
        for name, percent in (("tenth_percentile", 10), ("median", 50), ("ninetieth_percentile", 90), ("largest", 100)):
            np.testing.assert_allclose(recording.series(f"monitor_ratio/aime/network/{name}"), np.percentile(ratio, percent, axis=1), rtol=1e-10)
    np.testing.assert_array_equal(recording.series("monitor_ratio/threshold"), np.ones(STEPS))


def test_alarms_and_ends_are_marked(made):
    log, recording = made
    tested = "rctm" if log.header["monitor"] == "rctm" else "aime"
    marked = 0
    for e, path in enumerate(paths(log)):
        for what, values in (("alarm", None), ("ended", 1.0)):
            at = np.flatnonzero(log.arrays[f"monitor_{what}"][0, :, e])
            marked += len(at)
            steps, _, _ = recording.rows(f"monitor_ratio/{what}/{path}", "Scalars:scalars")
            assert (steps - log.first_step).tolist() == at.tolist()
            if len(at):
                expected = recording.series(f"monitor_ratio/{tested}/{path}")[at] if values is None else values
                np.testing.assert_array_equal(recording.series(f"monitor_ratio/{what}/{path}"), expected)
    assert marked >= 8


def test_of_each_slot(made):
    log, recording = made
    central = log.header["estimators"] == 1
    drawn = ["isolation"] + ["end_ratio"] * (log.header["monitor"] == "exclude")
    for i, e, node in heard(log):
        for quantity in drawn:
            path = f"{quantity}/{sensor(log, node)}" if central else f"{quantity}/{paths(log)[e]}/sensor/{node}"
            stored = log.arrays[quantity][0, :, i].astype("f4" if log.real == "float32" else "f8")
            np.testing.assert_array_equal(recording.series(path), stored)
    assert ("end_ratio/decision" in recording.entities()) == (len(drawn) == 2)


def test_rho(made):
    log, recording = made
    if log.header["monitor"] != "aime-improved":
        assert not [name for name in recording.entities() if name.startswith("monitor_rho")]
        return
    stored = np.float32 if log.real == "float32" else np.float64
    for e, path in enumerate(paths(log)):
        for key in ("rho", "median"):
            np.testing.assert_array_equal(recording.series(f"monitor_rho/{key}/{path}"), log.arrays[f"monitor_{key}"][0, :, e].astype(stored))
    if len(paths(log)) == 1:
        # Twice the window: the scenario does not say.
        limit = log.arrays["monitor_median"][0, :, 0].astype(stored) + 10.0
        np.testing.assert_allclose(recording.series("monitor_rho/limit"), limit, rtol=1e-6)


def test_lanes(made):
    log, recording = made
    first = log.first_step
    begin, end = STEPS // 3 + first, 2 * STEPS // 3 + first
    assert lane(recording, f"integrity/injected/{sensor(log, 1)}") == [(first, "no fault"), (begin, "fault"), (end, "no fault")]
    assert f"integrity/injected/{sensor(log, 0)}" not in recording.entities()
    hears = [e for i, e, node in heard(log) if node == 1]
    for e, path in enumerate(paths(log)):
        said = lane(recording, f"integrity/alarm/{path}")
        alarms = [(first, "no alarm"), (begin + 2, "alarm"), (end, "no alarm")]
        assert said == (alarms if e in hears else [(first, "no alarm")][: len(paths(log)) == 1])
    held = lane(recording, f"integrity/held/{sensor(log, 1)}")
    expected = [(first, "in use"), (begin + 2, "held faulty"), (end, "in use")]
    assert held == (expected if log.header["monitor"] == "exclude" else [])


def test_events(made):
    log, recording = made
    steps, _, texts = recording.rows("integrity_events", "TextLog:text")
    said = [(int(step) - log.first_step, text[0]) for step, text in zip(steps, texts)]
    name, scheme = sensor(log, 1).replace("/", " "), log.header["monitor"]
    assert (STEPS // 3, f"injected fault of {name} begins") in said and (2 * STEPS // 3, f"injected fault of {name} is over") in said
    hears = sorted({e for i, e, node in heard(log) if node == 1})
    ratio = log.arrays["monitor_" + ("rctm" if scheme == "rctm" else "aime")][0] / log.arrays["monitor_threshold"][0]
    for e in hears:
        at = "" if len(paths(log)) == 1 else f" at node {e}"
        suspect = "" if scheme == "exclude" else f", most from {name}"
        assert (STEPS // 3 + 2, f"alarm{at}: test ratio {ratio[STEPS // 3 + 2, e]:.3g}{suspect}") in said
        assert (2 * STEPS // 3, f"no alarm any more{at}") in said
        assert ((STEPS // 3 + 2, f"{name} held faulty{at}") in said) == ((2 * STEPS // 3, f"{name} is used again{at}") in said) == (scheme == "exclude")
        assert ((2 * STEPS // 3, f"a fault declared over{at}") in said) == (scheme in ("aime-improved", "exclude"))
    each = 2 + 2 * (scheme == "exclude") + (scheme in ("aime-improved", "exclude"))
    assert len(said) == 2 + each * len(hears)


def test_summary(made):
    log, recording = made
    t, scheme, name = seconds(log), log.header["monitor"], sensor(log, 1).replace("/", " ")
    begin, alarm, last, end = t[STEPS // 3], t[STEPS // 3 + 2], t[2 * STEPS // 3 - 1], t[2 * STEPS // 3]
    said, hears = recording.summary(), len({e for i, e, node in heard(log) if node == 1})
    assert f"| injected fault | {name}: {begin:g} s to {last:g} s |" in said
    assert f"| time to alert | {alarm - begin:g} s after the first faulty epoch |" in said
    assert f"| monitor | {scheme}, window 5, false alarm 1e-06 |" in said
    several = len(paths(log)) > 1
    who = min(e for i, e, node in heard(log) if node == 1)
    by = f", by up to {hears} of {hears}" if several else ""
    assert (f"| held faulty | {name}: {alarm:g} s to {last:g} s{by} |" in said) == (scheme == "exclude")
    epochs = int(log.arrays["monitor_alarm"].sum())
    if several:
        nodes = len(paths(log))
        assert f"| alarms | {hears} at {hears} of {nodes} nodes |" in said and f"| first alarm | {alarm:g} s, node {who} |" in said
        assert f"| estimator epochs in alarm | {epochs} of {nodes * STEPS} |" in said
        assert (f"| first one declared over | {end:g} s, node {who} |" in said) == (scheme in ("aime-improved", "exclude"))
    else:
        assert f"| alarms | {alarm:g} s to {last:g} s |" in said and f"| epochs in alarm | {epochs} of {STEPS} |" in said
        assert (f"| faults declared over | {end:g} s |" in said) == (scheme in ("aime-improved", "exclude"))


def test_views(made):
    log, recording = made
    said = blueprint_text(recording).split("\n")
    assert {"Integrity", "monitor_ratio", "monitor_statistic", "isolation", "integrity", "integrity_events", "fault"} <= set(said)
    assert ("end_ratio" in said) == (log.header["monitor"] == "exclude") and ("monitor_rho" in said) == (log.header["monitor"] == "aime-improved")


def test_held_sensors_are_marked_in_graph_and_scene(tmp_path):
    log = add_monitor(Log(nodes=6, steps=STEPS), "exclude", faulty=1)
    # Of the five that hear node 1, two find it at step 12, one more at 13, the others at 14; node 5 is held by node 5 alone at step 15.
    excluded, places = np.zeros((1, STEPS, 30)), [i for i, e, node in heard(log) if node == 1]
    excluded[0, 12:20, places[:2]] = excluded[0, 13:20, places[2]] = excluded[0, 14:20, places[3:]] = 1
    excluded[0, 15, [i for i, e, node in heard(log) if node == 5 == e]] = 1
    log.arrays["excluded"] = excluded
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    steps, _, labels = recording.rows("network/held_faulty", "Points2D:labels")
    some, half, every = (f"\u00d7 faulty at {k} of 5" for k in (2, 3, 5))
    assert steps.tolist() == [12, 13, 14, 15, 16, 20]
    assert labels == [[some], [half], [every], [every, "\u00d7 faulty at 1 of 5"], [every], []]
    held = recording.rows("network/held_faulty", "Points2D:positions")[2]
    for row, nodes in zip(held, [*[[1]] * 3, [1, 5], [1], []]):
        np.testing.assert_allclose(np.reshape(row, (-1, 2)), log.positions_m[nodes, :2] * (1, -1), rtol=1e-6)
    crosses = recording.rows("network/held_faulty/cross", "LineStrips2D:strips")[2]
    assert [len(row) for row in crosses] == [2, 2, 2, 4, 2, 0]
    np.testing.assert_allclose(np.mean(crosses[0], axis=(0, 1)), held[0][0], rtol=1e-5)
    steps, _, shown = recording.rows("scene/held_faulty", "Points3D:positions")
    assert steps.tolist() == [12, 13, 14, 15, 16, 20] and [len(row) for row in shown] == [1, 1, 1, 2, 1, 0]
    np.testing.assert_allclose(np.array(shown[3])[:, :2], log.positions_m[[1, 5]], rtol=1e-6)
    assert recording.rows("scene/held_faulty", "Points3D:labels")[2] == labels
    crosses = recording.rows("scene/held_faulty/cross", "LineStrips3D:strips")[2]
    assert [len(row) for row in crosses] == [2, 2, 2, 4, 2, 0]
    np.testing.assert_allclose(np.mean(crosses[0], axis=(0, 1))[:2], log.positions_m[1], rtol=1e-5)
    held = lane(recording, "integrity/held/node/1")
    words = ["in use", "some hold it faulty", "half or more hold it faulty", "held faulty", "in use"]
    assert held == list(zip([0, 12, 13, 14, 20], words))
    assert lane(recording, "integrity/held/node/5") == [(0, "in use"), (15, "some hold it faulty"), (16, "in use")]
    colours = recording.rows("network/held_faulty", "Points2D:colors")[2]
    assert len({tuple(row) for row in colours[:3]}) == 3 and colours[2] == colours[4]


def test_many_nodes_are_summed_up(tmp_path):
    log = add_monitor(Log(nodes=130, steps=8), "exclude", faulty=3)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    largest = np.max([log.arrays["isolation"][0, :, i] for i, e, node in heard(log)], axis=0)
    np.testing.assert_array_equal(recording.series("isolation/network/all"), largest)
    assert not [name for name in recording.entities() if name.startswith(("isolation/node", "monitor_ratio/alarm", "integrity/alarm/node"))]
    assert [state for _, state in lane(recording, "integrity/alarm/network")] == ["no alarm", "some in alarm", "no alarm"]
    said = blueprint_text(recording)
    assert "$origin/aime/network/**" in said and "$origin/aime/**" not in said and "monitor_statistic" not in said


def test_a_window_without_rows_is_a_gap(tmp_path):
    log = add_monitor(Log(nodes=3, steps=STEPS), "aime")
    log.arrays["monitor_aime_rows"] = log.arrays["monitor_aime_rows"].copy()
    log.arrays["monitor_aime_rows"][0, :4, 0] = 0
    log.arrays["monitor_threshold"][0, :4, 0] = 0.0
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    for path in ("monitor_ratio/aime/node/0", "monitor_statistic/threshold/node/0"):
        assert np.isnan(recording.series(path)).tolist() == [True] * 4 + [False] * (STEPS - 4)


def test_the_jump_of_the_scenario(tmp_path):
    log = add_monitor(Log(nodes=3, steps=STEPS, filter="kfc"), "aime-improved")
    log.scenario["monitor"] = {"jump": 7.5}
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_allclose(recording.series("monitor_rho/limit"), log.arrays["monitor_median"][0, :, 0] + 7.5, rtol=1e-12)


def test_alarms_that_flicker_and_last(tmp_path):
    log = add_monitor(Log(nodes=3, steps=STEPS, filter="kfc", dt_s=1.0), "aime")
    log.arrays["monitor_alarm"] = np.isin(np.arange(STEPS), [2, 5, 6, 9, 12, 15, 28, 29])[None, :, None]
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert "| alarms | 2 s; 5 s to 6 s; 9 s; 12 s; and 2 more |" in recording.summary()
    # The fault is there from 10 s on.
    assert "| time to alert | 2 s after the first faulty epoch |" in recording.summary()


def test_batches_do_not_matter(tmp_path, monkeypatch):
    from meshkal_log import reader

    def said() -> tuple:
        log = add_monitor(Log(nodes=6, steps=STEPS), "exclude")
        recording, _ = convert(log.data(), tmp_path / "run.rrd")
        lanes = {name: lane(recording, name) for name in recording.entities() if name.startswith("integrity/")}
        return lanes, recording.rows("integrity_events", "TextLog:text")[2], recording.rows("network/held_faulty", "Points2D:labels")[2], \
            recording.summary()

    whole = said()
    monkeypatch.setattr(reader, "BATCH_STEPS", 4)
    assert said() == whole and len(whole[0]) > 2


@pytest.mark.parametrize("make", [lambda: Log(nodes=4, steps=6), lambda: TrackingLog(steps=6)])
def test_without_a_monitor_nothing_of_it(tmp_path, make):
    """Also where fields of one are in the log: without its name in the header they are unknown fields."""
    log = make()
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    add_monitor(log, "exclude")
    for key in ("monitor", "monitor_window", "monitor_false_alarm"):
        log.header.pop(key)
    del log.arrays["fault"]
    again, _ = convert(log.data(), tmp_path / "again.rrd")
    assert again.entities() == recording.entities() and again.summary() == recording.summary()
    assert not [name for name in recording.entities() if name.startswith(("monitor", "integrity", "isolation", "fault/", "network/held"))]
    assert "Integrity" not in blueprint_text(recording)


@pytest.mark.parametrize(("change", "message"), [
    (lambda log: log.header.update(monitor="glrt"), "header: monitor is missing or wrong"),
    (lambda log: log.header.update(monitor_false_alarm=1.0), "header: monitor_false_alarm is missing or wrong"),
    (lambda log: log.header.pop("monitor_window"), "header: monitor_window is missing or wrong"),
    (lambda log: log.arrays.pop("end_ratio"), "end_ratio is missing"),
    (lambda log: log.arrays.update(excluded=log.arrays["excluded"][..., :-1]), "excluded has 29 numbers instead of 30"),
])
def test_what_is_wrong_is_named(tmp_path, change, message):
    from meshkal_log.reader import LogError

    log = add_monitor(Log(nodes=6, steps=STEPS), "exclude")
    change(log)
    with pytest.raises(LogError, match=message):
        convert(log.data(), tmp_path / "run.rrd")
    assert not (tmp_path / "run.rrd").exists()


def test_monitors_make_runs_of_their_own(tmp_path):
    ids = set()
    for scheme in (None, *SCHEMES):
        log = Log(nodes=3, steps=STEPS)
        recording, _ = convert((add_monitor(log, scheme) if scheme else log).data(), tmp_path / "run.rrd")
        ids.add(recording.reader.recordings()[0].recording_id)
    assert len(ids) == 5
