# SPDX-License-Identifier: MIT
"""Tracking logs: the scene, its parts that need not be there, the blueprint."""

import io
import time

import numpy as np
import pytest
from readback import convert
from scipy.spatial.transform import Rotation
from synthetic_tracking import TrackingLog
from test_kinds import blueprint_text

GREEN, RED, YELLOW, GREY = 0x58B368FF, 0xFF4D40FF, 0xF5B83DFF, 0x7F8C9AFF


def lines(recording, entity: str, *, static: bool = False) -> list:
    return [np.array(row) for row in recording.rows(entity, "LineStrips3D:strips", static=static)[2]]


def test_range_limits_are_rings(tmp_path):
    log = TrackingLog()
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    (rings,) = lines(recording, "scene/range_limits", static=True)
    assert len(rings) == 4  # the relay has no sensor
    for ring, position, limit in zip(rings, log.positions_m, log.limits):
        np.testing.assert_allclose(np.linalg.norm(ring[:, :2] - position, axis=1), limit, rtol=1e-5)
        np.testing.assert_array_equal(ring[:, 2], 0.0)
        np.testing.assert_allclose(ring[0], ring[-1], atol=1e-4)
    assert len(recording.rows("scene/sensors", "Points3D:positions", static=True)[2][0]) == 4


def test_range_limits_are_spheres_in_space(tmp_path):
    log = TrackingLog(dimensions=3, sensors=("range", "bearing", "range-bearing"))
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    (centers,) = recording.rows("scene/range_limits", "Ellipsoids3D:centers", static=True)[2]
    (half,) = recording.rows("scene/range_limits", "Ellipsoids3D:half_sizes", static=True)[2]
    np.testing.assert_allclose(centers, log.positions_m, rtol=1e-6)
    np.testing.assert_allclose(half, np.repeat(log.limits[:, None], 3, axis=1), rtol=1e-6)


def test_no_limits_no_rings(tmp_path):
    log = TrackingLog(sensors=("bearing",) * 3, limits=False)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert "scene/range_limits" not in recording.entities() and "scene/readings" in recording.entities()
    log = TrackingLog()
    del log.scenario["nodes"][1]["range_limit_m"]
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert len(lines(recording, "scene/range_limits", static=True)[0]) == 3


@pytest.mark.parametrize("dimensions", [2, 3])
def test_readings_say_how_far_and_where(tmp_path, dimensions):
    kinds = ("range", "bearing", "range-bearing", "range-rate", "tdoa")
    log = TrackingLog(sensors=kinds, dimensions=dimensions, filter="ekf", steps=20)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    drawn = lines(recording, "scene/readings")
    points = recording.rows("scene/measuring", "Points3D:positions")[2]
    y, truth = log.arrays["measurements"][0], log.arrays["truth"][0][:, :dimensions]
    first = np.concatenate([[0], np.cumsum(log.header["rows"])])
    seen = set()
    for t in range(20):
        at = np.flatnonzero(log.arrays["measuring"][0, t])
        assert len(drawn[t]) == len(points[t]) == len(at)
        for (start, end), point, k in zip(drawn[t], points[t], at):
            np.testing.assert_allclose(start[:dimensions], log.positions_m[k], rtol=1e-6)
            np.testing.assert_array_equal(start, np.float32(point))
            arrow, towards = (end - start)[:dimensions], truth[t] - log.positions_m[k]
            reading = y[t, first[k] : first[k + 1]]
            length = reading[0] if kinds[k] in ("range", "range-bearing") else np.linalg.norm(towards)
            np.testing.assert_allclose(np.linalg.norm(arrow), length, rtol=1e-4)
            if "bearing" in kinds[k]:
                angles = reading[1:] if kinds[k] == "range-bearing" else reading
                shown = [np.arctan2(arrow[1], arrow[0])] + ([np.arctan2(arrow[2], np.hypot(*arrow[:2]))] if dimensions == 3 else [])
                # Angles beyond a quarter turn of elevation are the same direction by other numbers: compare directions.
                level = np.cos(angles[1]) if dimensions == 3 else 1.0
                wanted = [level * np.cos(angles[0]), level * np.sin(angles[0])] + ([np.sin(angles[1])] if dimensions == 3 else [])
                np.testing.assert_allclose(arrow / np.linalg.norm(arrow), wanted, atol=1e-4)
                assert len(shown) == dimensions - 1
            else:
                np.testing.assert_allclose(arrow / np.linalg.norm(arrow), towards / np.linalg.norm(towards), atol=1e-3)
            seen.add(kinds[k])
    assert seen == set(kinds)


def test_colours_tell_what_became_of_readings(tmp_path):
    log = TrackingLog(sensors=("range",) * 4, filter="ekf", steps=2)
    log.arrays["measuring"] = np.array([[[1, 1, 1, 1], [0, 1, 0, 0]]])
    log.arrays["measurements_arrived"] = np.array([[[1, 1, 1, 0], [0, 1, 0, 0]]])
    log.arrays["decision"] = np.array([[[1, 2, 3, 0], [0, 1, 0, 0]]])
    log.arrays["measurements"] = np.ones((1, 2, 4))
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    for entity, component in (("scene/measuring", "Points3D:colors"), ("scene/readings", "LineStrips3D:colors")):
        assert recording.rows(entity, component)[2] == [[GREEN, RED, YELLOW, GREY], [GREEN]]


def test_a_link_lights_up_when_a_message_arrived(tmp_path):
    log = TrackingLog(sensors=("range",) * 3, steps=3)
    log.header["slots"] = [[0, 1], [1, 0, 2], [2, 1]]
    for key in ("measurements_arrived", "decision", "gate_ratio", "estimates_arrived"):
        log.arrays[key] = np.zeros((1, 3, 7))
    messages = np.zeros((1, 3, 7), dtype=int)
    messages[0, 0, 1] = 4  # all from 1 to 0, none back
    messages[0, 2] = [0, 4, 0, 4, 4, 0, 4]
    log.arrays["messages_arrived"] = messages
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    (links,) = lines(recording, "scene/links", static=True)
    np.testing.assert_allclose(links[:, :, :2], log.positions_m[[[0, 1], [1, 2]]], rtol=1e-6)
    lit = lines(recording, "scene/messages")
    assert [len(row) for row in lit] == [1, 0, 2]
    np.testing.assert_allclose(lit[0][0, :, :2], log.positions_m[[0, 1]], rtol=1e-6)
    alpha = [[c & 0xFF for c in row] for row in recording.rows("scene/messages", "LineStrips3D:colors")[2]]
    assert alpha == [[158], [], [255, 255]]


def test_ellipsoids_are_the_covariances(tmp_path):
    log = TrackingLog(dimensions=3, sensors=("range",) * 3, steps=6)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    sizes = np.array(recording.rows("scene/ellipsoids_3_sigma", "Ellipsoids3D:half_sizes")[2]).reshape(-1, 3)
    turns = Rotation.from_quat(np.array(recording.rows("scene/ellipsoids_3_sigma", "Ellipsoids3D:quaternions")[2]).reshape(-1, 4)).as_matrix()
    rows, columns = np.tril_indices(3)
    shown = np.einsum("mij,mj,mkj->mik", turns, (sizes / 3) ** 2, turns)[:, rows, columns]
    np.testing.assert_allclose(shown, log.arrays["position_covariance"][0].reshape(-1, 6), atol=1e-5)


@pytest.mark.parametrize("filter_name", ["duif", "mpukf"])
def test_without_truth(tmp_path, filter_name):
    log = TrackingLog(sensors=("range", "bearing", "tdoa"), truth=False, filter=filter_name, steps=9)
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == []
    assert not [e for e in recording.entities() if e.startswith(("position_error", "error_db", "nees", "scene/truth"))]
    assert "no truth in the log" in recording.summary() and "NEES" not in recording.summary().split("**How")[0]
    said = blueprint_text(recording)
    assert "no truth, so no NEES" in said and "position_error" not in said and "nees" not in said
    # Where the reading says nothing, the mean estimate stands for the target.
    middle = log.arrays["estimate"][0].reshape(9, -1, 4).mean(axis=1)[:, :2]
    trail = lines(recording, "scene/estimate_trail")
    np.testing.assert_allclose(trail[-1][0][:, :2], middle, rtol=1e-5)
    np.testing.assert_allclose(lines(recording, "scene/estimate_path", static=True)[0][0][:, :2], middle, rtol=1e-5)
    shown, t = lines(recording, "scene/readings"), int(np.flatnonzero(log.arrays["measuring"][0, :, 2])[0])
    np.testing.assert_allclose(shown[t][-1][1][:2], middle[t], rtol=1e-4)


def test_truth_unknown_at_some_instants(tmp_path):
    log = TrackingLog(filter="ukf", steps=5)
    log.arrays["truth"][0, 2, 0] = np.nan
    log.arrays["nees"][0, 2] = np.nan
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert [len(row) for row in recording.rows("scene/truth", "Points3D:positions")[2]] == [1, 1, 0, 1, 1]
    assert np.isnan(recording.series("position_error/centre")).tolist() == [False, False, True, False, False]
    assert np.isnan(recording.series("nees/centre")).tolist() == [False, False, True, False, False]


def test_no_positions_no_scene(tmp_path):
    log = TrackingLog(positions=False, filter="ukf")
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert not [e for e in recording.entities() if e.startswith(("scene", "position_error"))]
    said = blueprint_text(recording)
    assert "error_db" in said and "decisions" in said and "nees" in said


def test_nobody_knows_where_the_sensors_are(tmp_path):
    log = TrackingLog(filter="duif", limits=False)
    for node in log.scenario["nodes"]:
        node.pop("position_m", None)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    entities = recording.entities()
    assert "scene/estimates" in entities and not {"scene/sensors", "scene/readings", "scene/messages", "scene/links"} & entities


def test_no_gate(tmp_path):
    log = TrackingLog(gate=False, filter="ekf")
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert not [e for e in recording.entities() if e.startswith("gate_ratio")]
    said = blueprint_text(recording)
    assert "no gate in this log" in said and "gate_ratio" not in said


def test_one_screen(tmp_path):
    said = blueprint_text(convert(TrackingLog(limits=True).data(), tmp_path / "run.rrd")[0])
    for origin in ("scene", "decisions", "position_error", "nees", "gate_ratio", "disagreement", "consensus", "/rejections/**", "summary", "network"):
        assert origin in said.split("\n"), origin


def test_many_nodes_are_quick_and_summed_up(tmp_path):
    log = TrackingLog(sensors=("range-bearing",) * 300, steps=30, filter="rekfd")
    data = log.data()
    start = time.perf_counter()
    recording, _ = convert(data, tmp_path / "run.rrd")
    assert time.perf_counter() - start < 20.0
    said = blueprint_text(recording)
    assert "$origin/network/band" in said and "$origin/node/**" not in said and "decisions" not in said.split("\n")
    assert not [e for e in recording.entities() if e.startswith("gate_ratio/node")]
    np.testing.assert_array_equal(recording.series("nees/node/299"), log.arrays["nees"][0, :, 299])


@pytest.mark.parametrize("truth", [True, False])
def test_all_sensors_are_in_sight(truth):
    """However many instants there are."""
    from meshkal_log.reader import LogReader
    from meshkal_log.scenario import parse_scenario
    from meshkal_rerun.recording.scene import viewpoint

    log = TrackingLog(sensors=("range",) * 4, steps=900, truth=truth, filter="ukf")
    log.scenario["nodes"][0]["position_m"] = [-500.0, 50.0]
    reader = LogReader(io.BufferedReader(io.BytesIO(log.data())))
    (batch,) = reader.batches(0)
    eye, target = viewpoint(parse_scenario(reader.header), batch)
    assert target[0] < -150 and np.linalg.norm(eye - target) > 500
