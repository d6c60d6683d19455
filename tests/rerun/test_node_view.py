# SPDX-License-Identifier: MIT
"""The view of single nodes, the log of events and the first lines of the summary, each number against the log."""

import numpy as np
import pytest
from readback import convert
from scipy import stats
from synthetic import Log
from synthetic_monitor import NavigationLog, add_monitor
from synthetic_tracking import TrackingLog
from test_departures import healthy

from meshkal_rerun.numbers.nodes import state_names

NAMES = {"all arrived": (1, 1), "estimate missing": (1, 0), "reading missing": (0, 1), "nothing": (0, 0)}


def states_of_lane(recording, path: str, steps: int) -> list[str]:
    """In each step, from the changes that were sent."""
    at, _, changes = recording.rows(path, "StateChange:state")
    assert len(set(at)) == len(at) and at[0] == 0
    out = [changes[np.searchsorted(at, t, side="right") - 1][0] for t in range(steps)]
    assert all(a != b for a, b in zip(changes, changes[1:]))  # only where it changes
    return out


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    log = Log(nodes=5, steps=40, rows=(2, 1, 0, 1, 1))
    log.arrays["measurements_arrived"] = np.asarray(log.arrays["measurements_arrived"], dtype=float)
    recording, remarks = convert(log.data(), tmp_path_factory.mktemp("r") / "run.rrd")
    assert remarks == []
    return log, recording


def test_bands_are_three_sigma_of_the_logged_variance(made):
    log, recording = made
    estimate, truth = log.arrays["estimate"][0].reshape(40, 5, 4), log.arrays["truth"][0]
    variance = log.arrays["variance"][0].reshape(40, 5, 4)
    for k in range(5):
        for i in range(4):
            np.testing.assert_allclose(recording.series(f"node/{k}/error/{i}"), estimate[:, k, i] - truth[:, i], rtol=1e-12)
            band = np.sqrt(np.array(recording.rows(f"node/{k}/band/{i}", "Measurements:variances")[2])[:, 0])
            np.testing.assert_allclose(band, 3.0 * np.sqrt(variance[:, k, i]), rtol=1e-12)
            about = recording.rows(f"node/{k}/estimate/{i}", "Measurements:values")[2]
            np.testing.assert_array_equal(np.array(about)[:, 0], estimate[:, k, i])
            band = np.array(recording.rows(f"node/{k}/estimate/{i}", "Measurements:variances")[2])[:, 0]
            np.testing.assert_allclose(band, 9.0 * variance[:, k, i], rtol=1e-12)


def test_innovations_of_the_own_sensor(made):
    log, recording = made
    first = np.cumsum([0, 2, 1, 0, 1, 1])
    for k, rows in enumerate(log.header["rows"]):
        for i in range(rows):
            column = first[k] + i
            np.testing.assert_array_equal(recording.series(f"node/{k}/innovation/{i}"), log.arrays["innovation"][0, :, column])
            path = f"node/{k}/innovation_band/{i}"
            middle, band = (np.array(recording.rows(path, f"Measurements:{what}")[2])[:, 0] for what in ("values", "variances"))
            np.testing.assert_allclose(band + middle, 9.0 * log.arrays["innovation_variance"][0, :, column], rtol=1e-12)  # NaN: no reading
    assert not any(path.startswith("node/2/innovation") for path in recording.entities())


def test_test_quantity_over_the_quantile_of_chi_square(made):
    log, recording = made
    nis, rows = log.arrays["nis"][0], log.arrays["nis_rows"][0]
    for k in range(5):
        outer = stats.chi2.isf(1e-3, rows[:, k])
        np.testing.assert_allclose(recording.series(f"node/{k}/test/ratio"), nis[:, k] / outer, rtol=1e-9)
        np.testing.assert_allclose(recording.series(f"node/{k}/test/inner_limit"), stats.chi2.isf(0.05, rows[:, k]) / outer, rtol=1e-9)


def test_lanes_of_arrivals(made):
    log, recording = made
    first = np.cumsum([0, *map(len, log.header["slots"])])
    for k, slots in enumerate(log.header["slots"]):
        for l, node in enumerate(slots):
            at = first[k] + l
            reading, estimate = (log.arrays[f"{key}_arrived"][0, :, at] > 0 for key in ("measurements", "estimates"))
            if l == 0:
                if log.header["rows"][k]:
                    expected = ["used" if there else "no reading" for there in reading]
                    assert states_of_lane(recording, f"node/{k}/lanes/own_sensor", 40) == expected
                continue
            if not log.header["rows"][node]:
                reading = np.ones(40, dtype=bool)  # a node without sensor sends no reading
            said = states_of_lane(recording, f"node/{k}/lanes/from_node/{node}", 40)
            assert [NAMES[state] for state in said] == list(zip(reading, estimate)) or not log.header["rows"][node]


def test_lanes_of_faults_alarms_and_held_sensors(tmp_path):
    log = add_monitor(Log(nodes=6, steps=36), "exclude", faulty=1)
    log.arrays["measurements_arrived"] = np.ones_like(log.arrays["measurements_arrived"], dtype=float)
    log.arrays["faults"][0, 5:8, 3] = 8
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    fault, first = log.arrays["fault"][0, :, 1] != 0, np.cumsum([0, *map(len, log.header["slots"])])
    held = log.arrays["excluded"][0, :, first[1]] > 0
    expected = ["held faulty" if h else "faulty, as injected" if f else "used" for h, f in zip(held, fault)]
    assert states_of_lane(recording, "node/1/lanes/own_sensor", 36) == expected and {"held faulty", "faulty, as injected", "used"} == set(expected)
    alarm = log.arrays["monitor_alarm"][0, :, 1]
    assert states_of_lane(recording, "node/1/lanes/monitor", 36) == ["alarm" if a else "no alarm" for a in alarm]
    said = states_of_lane(recording, "node/2/lanes/from_node/1", 36)
    assert [s == "held faulty" for s in said] == held.tolist() and [s == "reading with a fault" for s in said] == (fault & ~held).tolist()
    assert states_of_lane(recording, "node/3/lanes/node_faults", 36) == ["no measurement at all" if 5 <= t < 8 else "none" for t in range(36)]
    assert "node/2/lanes/node_faults" not in recording.entities()


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """Node 7 of 12 from 12.0 s to 15.9 s, all of its neighbours but one silent since 11.8 s."""
    log = Log(nodes=12, steps=200)
    log.arrays["error"][0] = healthy(4, 12, 200)
    log.arrays["error"][0, 120:160, 7] += 40.0
    first = np.cumsum([0, *map(len, log.header["slots"])])
    for key in ("measurements_arrived", "estimates_arrived"):
        arrived = np.ones(log.arrays[key].shape)
        arrived[0, 118:160, first[7] + 1 : first[8] - 1] = 0
        log.arrays[key] = arrived
    recording, _ = convert(log.data(), tmp_path_factory.mktemp("r") / "run.rrd")
    return log, recording


def test_the_summary_says_who_when_why_and_where_to_look(planted):
    log, recording = planted
    said = recording.summary().split("| Result")[0]
    error = log.arrays["error"][0]
    assert f"node 7, RMS error {np.sqrt((error[:, 7] ** 2).mean()):.3g}, " in said
    ratio = error / np.median(error, axis=1)[:, None]
    assert "**When it went wrong:** node 7 from 12 s to 15.9 s, error up to " in said
    (peak,) = [t for t in range(120, 160) if f"error up to {error[t, 7]:.3g}, " in said and f"its usual, at {t / 10:g} s" in said]
    assert ratio[peak, 7] > 0.5 * ratio[120:160, 7].max()
    assert "**Why:** 3 of 4 neighbours silent since 11.8 s" in said
    assert "**Messages:** node 7: 3 of 4 neighbours silent from 11.8 s to 15.9 s" in said
    assert "tab Node, page 7, at 12 s" in said


def test_events_are_at_their_times(planted):
    _, recording = planted
    steps, times, texts = recording.rows("events/node/7", "TextLog:text")
    levels = recording.rows("events/node/7", "TextLog:level")[2]
    entries = [(int(step), text[0], level[0]) for step, text, level in zip(steps, texts, levels)]
    ((_, text, _),) = [entry for entry in entries if entry[0] == 120 and entry[2] == "ERROR"]
    assert text.startswith("node 7: error up to ") and ", until 15.9 s; 3 of 4 neighbours silent since 11.8 s" in text
    assert (118, "node 7: 3 of 4 neighbours silent, until 15.9 s", "WARN") in entries
    assert (159, "node 7: error as usual", "INFO") in entries
    assert [time // 100_000_000 for time in times] == steps.tolist()
    assert not [path for path in recording.entities() if path.startswith("events/") and path != "events/node/7"]
    states = states_of_lane(recording, "node/7/lanes/departure", 200)
    assert [state == "error departs" for state in states] == [120 <= t < 160 for t in range(200)]


def test_a_healthy_run_says_so(tmp_path):
    log = Log(nodes=6, steps=100)
    log.arrays["error"][0] = healthy(9, 6, 100)
    for key in ("measurements_arrived", "estimates_arrived"):
        log.arrays[key] = np.ones(log.arrays[key].shape)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert "**When it went wrong:** nobody departed from what is usual" in recording.summary() and "**Why:**" not in recording.summary()
    assert not [path for path in recording.entities() if path.startswith("events")]


def test_the_cause_of_an_injected_fault_is_named(tmp_path):
    log = add_monitor(Log(nodes=12, steps=90), "rctm", faulty=4)
    log.arrays["error"][0] = healthy(2, 12, 90)
    log.arrays["error"][0, 31:60, 5] += 40.0
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert "**Why:** sensor fault of node 4 since 3 s; alarm of its monitor" in recording.summary()


def test_only_named_nodes_of_a_large_network(tmp_path):
    log = Log(nodes=150, steps=30)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    shown = {path.split("/")[1] for path in recording.entities() if path.startswith("node/")}
    rms = np.sqrt((log.arrays["error"][0] ** 2).mean(axis=0))
    assert len(shown) == 5 and str(int(rms.argmax())) in shown


@pytest.mark.parametrize(
    "change", [{"nodes": 1}, {"filter": "rkfc"}, {"truth": False}, {"bands": False}, {"position_states": None}, {"real": "float32"}]
)
def test_other_logs(tmp_path, change):
    log = Log(**({"nodes": 4, "steps": 12} | change))
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == []
    at = "node/centre" if "filter" in change else "node/0"
    entities = recording.entities()
    assert f"{at}/test/ratio" in entities and f"{at}/estimate/3" in entities and (f"{at}/error/3" in entities) == ("truth" not in change)
    if "bands" in change:  # those of positions remain
        covariance = log.arrays["position_covariance"][0].reshape(12, 4, 3)
        for state, place in ((0, 0), (1, 2)):
            band = np.array(recording.rows(f"{at}/band/{state}", "Measurements:variances")[2])[:, 0]
            np.testing.assert_allclose(band, 9.0 * covariance[:, 0, place], rtol=1e-12)
        assert not np.array(recording.rows(f"{at}/band/3", "Measurements:variances")[2]).any()


def test_unknown_numbers(tmp_path):
    log = Log(nodes=4, steps=12)
    for key in ("estimate", "error", "nis", "variance", "truth", "innovation_variance"):
        log.arrays[key] = np.array(log.arrays[key])
        log.arrays[key][0, 3:6] = np.nan
        log.arrays[key][0, 7] = np.inf
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == [] and np.isnan(recording.series("node/0/error/0")[[3, 7]]).all()


@pytest.mark.parametrize("filter_name", ["duif", "rekfd", "ukf"])
def test_tracking(tmp_path, filter_name):
    log = TrackingLog(steps=30, filter=filter_name)
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == []
    at = "node/centre" if filter_name == "ukf" else "node/0"
    estimate, truth = log.arrays["estimate"][0].reshape(30, -1, 4), log.arrays["truth"][0]
    np.testing.assert_allclose(recording.series(f"{at}/error/1"), estimate[:, 0, 1] - truth[:, 1], rtol=1e-12)
    assert "**How good:** position RMSE" in recording.summary()


def test_navigation_has_its_own_view(tmp_path):
    recording, remarks = convert(NavigationLog(steps=60).data(), tmp_path / "run.rrd")
    assert remarks == [] and not [path for path in recording.entities() if path.startswith("node/")]
    assert "**How good:** position RMSE" in recording.summary() and "tab Navigation" in recording.summary()


def test_names_of_states():
    from meshkal_log.fields import Header
    from meshkal_log.scenario import Scenario

    header = Header(**{name: 0 for name in Header.__dataclass_fields__} | {"states": 4})
    scenario = Scenario("s", None, (2, 3), "", "")
    assert state_names(header, scenario) == ["state 0", "state 1", "state 2 (position x)", "state 3 (position y)"]
    scenario = Scenario("s", None, (0,), "", "", states=("px", "vx", "omega", "bias"))
    assert state_names(header, scenario) == ["px, m", "vx, m/s", "omega, rad/s", "bias"]
