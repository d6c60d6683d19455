# SPDX-License-Identifier: MIT
"""Navigation logs: states and errors in their units, weights, the sky, the flight, and comparison of filters."""

import numpy as np
import pytest
from readback import Recording, command, convert
from scipy.stats import chi2
from synthetic_monitor import NUMBERS, NavigationLog, add_monitor
from test_kinds import blueprint_text

STEPS = 30
BLUE, RED, GREY = 0x4287F5FF, 0xFF5838FF, 0x808080FF
# First state, unit, components.
GROUPS = {
    "attitude": (0, 1e3, ("roll", "pitch", "heading")), "velocity": (3, 1.0, ("east", "north", "up")), "position": (6, 1.0, ("east", "north", "up")),
    "gyro_bias": (9, 180 / np.pi * 3600, ("right", "forward", "up")), "accelerometer_bias": (12, 1e6 / 9.80665, ("right", "forward", "up")),
    "clock_bias": (15, 1.0, ("clock_bias",)), "clock_drift": (16, 1.0, ("clock_drift",)),
}


@pytest.fixture(scope="module", params=["float64", "float32"])
def made(request, tmp_path_factory):
    log = add_monitor(NavigationLog(steps=STEPS, real=request.param), "exclude")
    recording, remarks = convert(log.data(), tmp_path_factory.mktemp("r") / "run.rrd")
    assert remarks == []
    return log, recording


def stored(log, key: str) -> np.ndarray:
    values = log.arrays[key][0]
    return values.astype(np.dtype(log.type_of(key)))


def test_epochs_have_their_own_times(made):
    log, recording = made
    steps, times, _ = recording.rows("nis_ratio/centre", "Scalars:scalars")
    assert steps.tolist() == list(range(1, STEPS + 1)) and times.tolist() == [(11 + k) * 10**9 for k in range(STEPS)]


def test_states_and_errors(made):
    log, recording = made
    truth, estimate = stored(log, "truth"), stored(log, "estimate")
    for group, (first, unit, names) in GROUPS.items():
        for i, name in enumerate(names):
            x, xh = truth[:, first + i], estimate[:, first + i]
            error = xh - x + (2 * np.pi if (group, name) == ("attitude", "heading") else 0.0)  # -3.14 is beyond 3.14, not far away
            np.testing.assert_allclose(recording.series(f"navigation/estimate/{group}/{name}"), unit * xh, rtol=1e-14)
            np.testing.assert_allclose(recording.series(f"navigation/error/{group}/{name}"), unit * error, rtol=1e-9, atol=1e-12 * unit)
    np.testing.assert_allclose(recording.series("position_error/centre"), stored(log, "error")[:, 0], rtol=1e-12)
    np.testing.assert_array_equal(recording.series("nees/centre"), stored(log, "nees")[:, 0])
    for name, value in (("lower", chi2.ppf(0.025, 17)), ("upper", chi2.ppf(0.975, 17)), ("expected", 17.0)):
        np.testing.assert_allclose(recording.series(f"nees/band/{name}"), value, rtol=1e-12)


def test_sigma_of_the_position(made):
    log, recording = made
    variance = stored(log, "position_covariance").astype(np.float64)[:, [0, 2, 5]]
    for i, axis in enumerate(("east", "north", "up")):
        np.testing.assert_allclose(recording.series(f"navigation/sigma/{axis}/upper"), 3 * np.sqrt(variance[:, i]), rtol=1e-12)
        np.testing.assert_allclose(recording.series(f"navigation/sigma/{axis}/lower"), -3 * np.sqrt(variance[:, i]), rtol=1e-12)


def test_weights_and_innovations(made):
    log, recording = made
    arrived = log.arrays["measurements_arrived"][0] > 0
    for k, number in enumerate(NUMBERS):
        for quantity in ("weight", "weight_statistic", "innovation"):
            expected = np.where(arrived[:, k], stored(log, quantity)[:, k], np.nan)
            np.testing.assert_array_equal(recording.series(f"{quantity}/satellite/{number}"), expected)
        np.testing.assert_array_equal(recording.series(f"weight_map/satellite/{number}"), number)
    assert not arrived[:4, 2].any()


def test_weights_are_colours(made):
    log, recording = made
    weight, arrived = stored(log, "weight"), log.arrays["measurements_arrived"][0] > 0
    for k, number in enumerate(NUMBERS):
        shown = np.array(recording.rows(f"weight_map/satellite/{number}", "SeriesLines:colors")[2])[:, 0]
        assert (shown[arrived[:, k] & (weight[:, k] == 1.0)] == BLUE).all() and (shown[arrived[:, k] & (weight[:, k] == 0.0)] == RED).all()
        assert (shown[~arrived[:, k]] == GREY).all()
        between = arrived[:, k] & (weight[:, k] > 0.0) & (weight[:, k] < 1.0)
        assert between.any() and not np.isin(shown[between], (BLUE, RED, GREY)).any()
    sky = recording.rows("sky/satellites", "Points2D:colors")[2]
    assert sky[5][1] == RED and len(sky[0]) == 4 and len(sky[4]) == 5


def test_sky(made):
    log, recording = made
    places = recording.rows("sky/satellites", "Points2D:positions")[2]
    labels = recording.rows("sky/satellites", "Points2D:labels")[2]
    known = np.isfinite(log.arrays["azimuth_deg"][0])
    for t in range(STEPS):
        assert labels[t] == [str(NUMBERS[k]) for k in np.flatnonzero(known[t])]
        x, y = np.array(places[t], dtype=np.float64).T
        np.testing.assert_allclose(90 - np.hypot(x, y), log.arrays["elevation_deg"][0, t, known[t]], atol=1e-4)
        # North is up, where y of a picture is negative, and east right.
        np.testing.assert_allclose(np.rad2deg(np.arctan2(x, -y)) % 360, log.arrays["azimuth_deg"][0, t, known[t]] % 360, atol=1e-4)
    (rings,) = recording.rows("sky/rings", "LineStrips2D:strips", static=True)[2]
    assert [round(float(np.hypot(*ring[7]))) for ring in rings[:3]] == [90, 60, 30]
    (names,) = recording.rows("sky/names", "Points2D:labels", static=True)[2]
    (letters,) = recording.rows("sky/names", "Points2D:positions", static=True)[2]
    assert names[:4] == ["N", "E", "S", "W"] and letters[0][1] < -90 and letters[1][0] > 90
    # Only the last satellite moves.
    (trails,) = recording.rows("sky/trails", "LineStrips2D:strips", static=True)[2]
    assert len(trails) == 1 and len(trails[0]) == STEPS
    np.testing.assert_allclose(trails[0][-1], places[-1][4], atol=1e-4)


def test_the_one_held_faulty_is_crossed_out(made):
    log, recording = made
    held = log.arrays["excluded"][0, :, 1] > 0
    assert held.any()
    crosses = recording.rows("sky/held_faulty", "LineStrips2D:strips")[2]
    rings = recording.rows("sky/held_faulty/ring", "LineStrips2D:strips")[2]
    places = recording.rows("sky/satellites", "Points2D:positions")[2]
    for t in range(STEPS):
        assert [len(crosses[t]), len(rings[t])] == ([2, 1] if held[t] else [0, 0])
        if held[t]:
            np.testing.assert_allclose(np.mean(crosses[t], axis=(0, 1)), places[t][1], atol=1e-4)
            radius = np.linalg.norm(np.array(rings[t][0]) - places[t][1], axis=1)
            np.testing.assert_allclose(radius, radius[0], rtol=1e-3)


def test_flight(made):
    log, recording = made
    for entity, key in (("scene/truth", "truth"), ("scene/estimates", "estimate")):
        shown = np.array(recording.rows(entity, "Points3D:positions")[2])[:, 0]
        np.testing.assert_allclose(shown, stored(log, key)[:, 6:9], rtol=1e-5, atol=1e-6)
    ((path,),) = recording.rows("scene/estimate_path", "LineStrips3D:strips", static=True)[2]
    np.testing.assert_allclose(path, stored(log, "estimate")[:, 6:9], rtol=1e-5, atol=1e-6)
    assert not [name for name in recording.entities() if name.startswith(("network", "scene/sensors"))]


def test_summary_and_views(made):
    log, recording = made
    said = recording.summary()
    error = log.arrays["estimate"][0] - log.arrays["truth"][0]
    assert f"| position RMSE | {np.sqrt((error[:, 6:9] ** 2).sum(axis=1).mean()):.4g} m |" in said
    assert f"| clock drift RMSE | {np.sqrt((error[:, 16] ** 2).mean()):.4g} m/s |" in said
    counts = np.bincount(log.arrays["decision"].astype(int).ravel(), minlength=4)
    assert f"| readings used, with less weight, not | {counts[1]}, {counts[3]}, {counts[2]} |" in said
    assert "| satellites | 1, 3, 7, 12, 31 |" in said and "Student" in said
    views = blueprint_text(recording).split("\n")
    assert {"Flight", "Navigation", "Integrity", "sky", "weight_map", "innovation", "navigation/error/clock_bias", "nees"} <= set(views)
    assert "network" not in views


def test_without_truth_monitor_and_weights(tmp_path):
    log = NavigationLog(truth=False, filter="ekf")
    del log.arrays["innovation"]
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    entities = recording.entities()
    assert not [name for name in entities if name.startswith(("navigation/error", "weight", "innovation", "monitor", "integrity", "sky/held", "nees"))]
    assert "navigation/estimate/clock_bias/clock_bias" in entities and "no truth in the log" in recording.summary()
    views = blueprint_text(recording)
    assert "navigation/error" not in views and "navigation/estimate/velocity" in views and "weight" not in views.split("\n") and "Integrity" not in views
    colours = recording.rows("sky/satellites", "Points2D:colors")[2]
    assert {c for row in colours for c in row} == {BLUE}


def test_a_satellite_without_a_reading_is_grey(tmp_path):
    log = NavigationLog(filter="ekf")
    log.arrays["measurements_arrived"][0, 9, 3] = 0
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    colours = recording.rows("sky/satellites", "Points2D:colors")[2]
    assert colours[9] == [BLUE, BLUE, BLUE, GREY, BLUE]


def test_filters_are_compared(tmp_path):
    logs = {"rekf-t": add_monitor(NavigationLog(), "exclude"), "ekf": NavigationLog(filter="ekf")}
    logs["ekf"].arrays["estimate"] = logs["ekf"].arrays["estimate"] + 2.0
    for name, log in logs.items():
        (tmp_path / f"{name}.cbor").write_bytes(log.data())
    done = command(*(tmp_path / f"{name}.cbor" for name in logs), "-o", tmp_path / "run.rrd")
    assert done.returncode == 0 and done.stderr == b""
    recording = Recording(tmp_path / "run.rrd")
    error = [np.linalg.norm((log.arrays["estimate"] - log.arrays["truth"])[0, :, 6:9], axis=1) for log in logs.values()]
    np.testing.assert_allclose(recording.series("position_error/compared/ekf"), error[1], rtol=1e-12)
    ours, theirs = (np.sqrt((e**2).mean()) for e in error)
    assert f"| position RMSE against ekf | {ours:.4g} m / {theirs:.4g} m" in recording.summary()


def test_kinds_are_not_mixed(tmp_path):
    from synthetic_tracking import TrackingLog

    for name, log in (("a", NavigationLog()), ("b", TrackingLog(filter="ekf"))):
        (tmp_path / f"{name}.cbor").write_bytes(log.data())
    done = command(tmp_path / "a.cbor", tmp_path / "b.cbor", "-o", tmp_path / "run.rrd")
    assert done.returncode == 2 and b"is not the log of a navigation scenario" in done.stderr and not (tmp_path / "run.rrd").exists()


@pytest.mark.parametrize(("change", "message"), [
    (lambda log: log.header.update(states=16), "header: states is missing or wrong"),
    (lambda log: log.header.update(satellites=[1, 1, 2, 3, 4]), "header: satellites is missing or wrong"),
    (lambda log: log.header.update(filter="duif"), "header: filter is missing or wrong"),
    (lambda log: log.arrays.pop("azimuth_deg"), "azimuth_deg is missing"),
    (lambda log: log.arrays["time_s"].__setitem__((0, 0, 0), np.nan), "time_s is not finite"),
])
def test_what_is_wrong_is_named(tmp_path, change, message):
    from meshkal_log.reader import LogError

    log = NavigationLog()
    log.arrays["time_s"] = log.arrays["time_s"].copy()
    change(log)
    with pytest.raises(LogError, match=message):
        convert(log.data(), tmp_path / "run.rrd")
