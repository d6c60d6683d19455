# SPDX-License-Identifier: MIT
"""Networks of every kind: no truth, one node, a centre, many nodes; the scene, the network graph and the blueprint."""

import time

import numpy as np
import pytest
from readback import convert
from scipy.spatial.transform import Rotation
from synthetic import Log


def blueprint_text(recording) -> str:
    """All that the blueprint says, as one text."""
    out = []
    for chunk in recording.reader.stream(store=recording.reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.split(":")[-1] in ("display_name", "space_origin", "query"):
                out += [str(value) for row in batch.column(name).to_pylist() if row for value in row]
    return "\n".join(out)


def test_scene_positions(tmp_path):
    log = Log(nodes=3, steps=5, position_states=(2, 0, 1), positions="3d")
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    estimate = log.arrays["estimate"][0].reshape(5, 3, 4)
    shown = np.array(recording.rows("scene/estimates", "Points3D:positions")[2])
    np.testing.assert_allclose(shown, estimate[:, :, [2, 0, 1]], rtol=1e-6)
    truth = np.array(recording.rows("scene/truth", "Points3D:positions")[2])
    np.testing.assert_allclose(truth[:, 0], log.arrays["truth"][0][:, [2, 0, 1]], rtol=1e-6)
    # Axes and orientation together must give the covariance back.
    sizes = np.array(recording.rows("scene/ellipsoids_3_sigma", "Ellipsoids3D:half_sizes")[2])
    turns = Rotation.from_quat(np.array(recording.rows("scene/ellipsoids_3_sigma", "Ellipsoids3D:quaternions")[2]).reshape(-1, 4)).as_matrix()
    shown_covariance = np.einsum("mij,mj,mkj->mik", turns, (sizes.reshape(-1, 3) / 3) ** 2, turns)
    rows, columns = np.tril_indices(3)
    np.testing.assert_allclose(shown_covariance[:, rows, columns], log.arrays["position_covariance"][0].reshape(-1, 6), atol=1e-5)
    centers = np.array(recording.rows("scene/ellipsoids_3_sigma", "Ellipsoids3D:centers")[2])
    np.testing.assert_array_equal(centers, shown)
    (sensors,) = recording.rows("scene/sensors", "Points3D:positions", static=True)[2]
    np.testing.assert_allclose(sensors, log.positions_m, rtol=1e-6)
    assert "scene/ellipsoids_3_sigma" in recording.entities()


def test_two_coordinates_lie_in_a_plane(tmp_path):
    log = Log(nodes=3, steps=5, position_states=(1, 0))
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    shown = np.array(recording.rows("scene/estimates", "Points3D:positions")[2])
    assert (shown[:, :, 2] == 0).all()
    np.testing.assert_allclose(shown[:, :, 0], log.arrays["estimate"][0].reshape(5, 3, 4)[:, :, 1], rtol=1e-6)


def test_truth_unknown_for_a_step_is_not_drawn_there(tmp_path):
    log = Log(nodes=3, steps=5)
    log.arrays["truth"][0, 2, 0] = np.nan
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert [len(row) for row in recording.rows("scene/truth", "Points3D:positions")[2]] == [1, 1, 0, 1, 1]
    assert [len(row[0]) for row in recording.rows("scene/truth_trail", "LineStrips3D:strips")[2]] == [1, 2, 2, 3, 4]


def test_no_positions_no_scene(tmp_path):
    log = Log(nodes=3, steps=5, position_states=None, positions=None)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert not [e for e in recording.entities() if e.startswith("scene")]
    assert "Position" not in blueprint_text(recording)
    assert len(recording.rows("network/nodes", "Points2D:positions", static=True)[2][0]) == 3


def drawn_links(recording, log, path="network/links"):
    """The strips as pairs of nodes; -1 is the centre."""
    (places,) = recording.rows("network/nodes", "Points2D:positions", static=True)[2]
    number = {tuple(place): k if k < log.header["nodes"] else -1 for k, place in enumerate(places)}
    return [tuple(number[tuple(end)] for end in strip) for strip in recording.rows(path, "LineStrips2D:strips", static=True)[2][0]]


def test_network_picture(tmp_path):
    log = Log(nodes=4, steps=5)
    log.header["slots"] = [[0, 1], [1, 0, 2], [2, 1], [3]]
    log._draw(np.random.default_rng(1), False, True)
    error = np.geomspace(1e-3, 1e3, 20).reshape(1, 5, 4)
    log.arrays["error"] = error
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert drawn_links(recording, log) == [(0, 1), (1, 2)]
    (positions,) = recording.rows("network/nodes", "Points2D:positions", static=True)[2]
    np.testing.assert_allclose(positions, log.positions_m * (1, -1), rtol=1e-6)
    painted = np.array(recording.rows("network/nodes", "Points2D:colors")[2])
    red, blue = painted >> 24, painted >> 8 & 0xFF
    assert painted.shape == (5, 4)
    assert blue[0, 0] > red[0, 0] and red[-1, -1] > blue[-1, -1]
    # All are named, and so have their numbers at the rings.
    assert recording.rows("network/nodes", "Points2D:labels", static=True)[2] == [[""] * 4]
    assert [sorted(row) for row in recording.rows("network/named", "Points2D:labels", static=True)[2]] == [["node 0 (best)", "node 1", "node 2", "node 3 (worst)"]]
    low, high = np.percentile(20 * np.log10(error), [10, 90])
    assert f"blue {low:.0f} dB or less, red {high:.0f} dB or more" in recording.summary()
    assert recording.rows("network/scale/labels", "Points2D:labels", static=True)[2][0][::2] == [f"{low:.1f} dB or less", f"{high:.1f} dB or more"]


def test_one_way_links_are_drawn_with_direction(tmp_path):
    log = Log(nodes=3, steps=3)
    log.header["slots"] = [[0, 1], [1], [2, 1]]
    log._draw(np.random.default_rng(1), False, True)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert "network/links" not in recording.entities()
    (origins,) = recording.rows("network/links_one_way", "Arrows2D:origins", static=True)[2]
    (vectors,) = recording.rows("network/links_one_way", "Arrows2D:vectors", static=True)[2]
    places = log.positions_m * (1, -1)
    np.testing.assert_allclose(origins, places[[1, 1]], rtol=1e-6)
    np.testing.assert_allclose(vectors, 0.94 * (places[[0, 2]] - places[[1, 1]]), rtol=1e-5)


def test_without_truth(tmp_path):
    log = Log(nodes=4, steps=9, truth=False)
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    entities = recording.entities()
    assert remarks == []
    assert not [e for e in entities if e.startswith("error_db") or e.endswith("truth") or "truth_" in e]
    for quantity in ("theta", "nis_ratio"):
        assert len(recording.series(f"{quantity}/node/3")) == 9
    assert recording.series("state/0/estimates").shape == (9, 4)
    painted = np.array(recording.rows("network/nodes", "Points2D:colors")[2])
    assert painted.shape == (9, 4) and len(np.unique(painted)) > 4
    said = blueprint_text(recording)
    assert "no truth" in said and "error_db" not in said
    assert "no truth in the log" in recording.summary()


@pytest.mark.parametrize("truth", [True, False])
def test_one_node(tmp_path, truth):
    log = Log(nodes=1, steps=1, truth=truth)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("theta/node/0"), log.arrays["theta"][0, :, 0])


@pytest.mark.parametrize("positions", ["2d", None])
def test_central_filter(tmp_path, positions):
    log = Log(nodes=5, steps=8, filter="rkfc", positions=positions)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("theta/centre"), log.arrays["theta"][0, :, 0])
    np.testing.assert_allclose(recording.series("error_db/centre"), recording.series("error_db/network/rms"), rtol=1e-9)
    expected = (log.arrays["measurements_arrived"][0] == 0).sum(axis=1)
    np.testing.assert_array_equal(recording.series("missing_measurements/centre"), expected)
    entities = recording.entities()
    assert not [e for e in entities if e.startswith("missing_estimates") or e == "theta/node/0"]
    assert "measurement/node/4" in entities
    assert drawn_links(recording, log) == [(k, -1) for k in range(5)]
    painted = np.array(recording.rows("network/nodes", "Points2D:colors")[2])
    assert painted.shape == (8, 6) and (painted[:, :5] == painted[0, 0]).all() and len(np.unique(painted[:, 5])) > 2


def test_blueprint_draws_each_node_of_a_small_network(tmp_path):
    said = blueprint_text(convert(Log(nodes=8, steps=3).data(), tmp_path / "run.rrd")[0])
    for wanted in ("error_db", "theta", "tolerance", "scene", "network", "summary", "/faults/**", "/events/**", "$origin/node/**", "Error of each node, dB"):
        assert wanted in said, wanted


def test_many_nodes_are_quick_and_summed_up(tmp_path):
    log = Log(nodes=1000, steps=50)
    data = log.data()
    start = time.perf_counter()
    recording, _ = convert(data, tmp_path / "run.rrd")
    assert time.perf_counter() - start < 10.0
    np.testing.assert_array_equal(recording.series("theta/node/999"), log.arrays["theta"][0, :, 999])
    assert recording.series("state/0/estimates").shape == (50, 1000)
    said = blueprint_text(recording)
    assert "$origin/network/band" in said and "$origin/node/**" not in said


def test_recording_id_names_the_run(tmp_path):
    def made(run=0, real="float64", **changes):
        log = Log(nodes=2, steps=3, runs=2, real=real)
        log.header.update(changes)
        return convert(log.data(), tmp_path / "run.rrd", run)[0].reader.recordings()[0].recording_id

    first = made()
    assert made() == first
    others = [made(run=1), made(seed=8), made(real="float32"), made(filter="kfd"), made(loss=0.5), made(program="meshkal 0.0.1")]
    assert len({first, *others}) == 7
