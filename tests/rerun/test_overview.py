# SPDX-License-Identifier: MIT
"""What opens first: sums over the network, the nodes that are named, links over which nothing came, one colour for a node everywhere."""

import io

import numpy as np
import pytest
from readback import Recording, convert
from synthetic import Log
from synthetic_tracking import TrackingLog

NAMES = {"median": 50, "low": 5, "high": 95}


def decibels(x):
    return 20 * np.log10(x)


def worst(log, count=5):
    """The nodes of the largest RMS error."""
    return np.argsort(-np.sqrt((log.arrays["error"][0] ** 2).mean(axis=0)))[:count].tolist()


def plots(recording: Recording) -> dict[str, set[str]]:
    """Entities that each plot of the whole network asks for, as the viewer finds them in the recording, by the plot's origin."""
    views: dict[str, dict] = {}
    for chunk in recording.reader.stream(store=recording.reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.split(":")[-1] in ("display_name", "space_origin", "query", "class_identifier"):
                view = views.setdefault(chunk.entity_path.replace("/ViewContents", ""), {})
                view[name.split(":")[-1]] = [value for row in batch.column(name).to_pylist() if row for value in row]
    entities, out = recording.entities(), {}
    for view in views.values():
        (name,) = view.get("display_name", [""])
        if view.get("class_identifier") == ["TimeSeries"] and ": node " not in name:
            (origin,) = view["space_origin"]
            rules = [rule.strip().replace("$origin", origin) for text in view["query"] for rule in text.split("\n")]
            assert not [rule for rule in rules if rule.startswith("- ")]
            paths = {rule.removeprefix("+ ").strip("/") for rule in rules}
            shown = {e for e in entities for p in paths if e == p or (p.endswith("/**") and f"{e}/".startswith(p.removesuffix("**")))}
            out.setdefault(origin.strip("/"), shown)
    return out


@pytest.mark.parametrize("nodes", [1, 2, 5, 20, 150])
def test_quantiles_are_those_of_the_log(tmp_path, nodes):
    log = Log(nodes=nodes, steps=7)
    unknown = np.random.default_rng(5).random((7, nodes)) < 0.3
    unknown[2], unknown[3] = True, False
    for key in ("error", "theta", "tolerance"):
        log.arrays[key] = np.where(unknown, np.nan, log.arrays[key])
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    if nodes == 1:
        assert not [e for e in recording.entities() if e.endswith(("/low", "/high", "/median", "/band")) and not e.startswith("state")]
        return
    with np.errstate(all="ignore"), pytest.warns(RuntimeWarning):
        for name, percent in NAMES.items():
            expected = np.nanpercentile(log.arrays["error"][0], percent, axis=1)
            np.testing.assert_allclose(recording.series(f"error_db/network/{name}"), decibels(expected), rtol=1e-9, atol=1e-12)
            for key in ("theta", "tolerance"):
                expected = np.nanpercentile(log.arrays[key][0], percent, axis=1)
                np.testing.assert_allclose(recording.series(f"{key}/network/{name}"), expected, rtol=1e-12)


def test_the_band_lies_between_its_edges(tmp_path):
    recording, _ = convert(Log(nodes=20, steps=9).data(), tmp_path / "run.rrd")
    for key in ("error_db", "theta"):
        middle = np.array(recording.rows(f"{key}/network/band", "Measurements:values")[2])[:, 0]
        sigma = np.sqrt(np.array(recording.rows(f"{key}/network/band", "Measurements:variances")[2])[:, 0])
        np.testing.assert_allclose(middle - sigma, recording.series(f"{key}/network/low"), rtol=1e-9)
        np.testing.assert_allclose(middle + sigma, recording.series(f"{key}/network/high"), rtol=1e-9)


def test_quantiles_of_infinities():
    from meshkal_rerun.numbers.derive import quantiles

    values = np.array([[1.0, np.inf, np.inf, 2.0], [np.inf] * 4, [np.nan, np.nan, np.nan, 3.0], [np.nan] * 4])
    assert np.array(quantiles(values, (0.0, 0.5, 1.0))).T.tolist()[:3] == [[1.0, np.inf, np.inf], [np.inf] * 3, [3.0] * 3]
    assert np.isnan(quantiles(values, (0.05,))[0][3])


@pytest.mark.parametrize("nodes", [20, 1000])
def test_of_many_nodes_the_network_and_the_worst_are_drawn(tmp_path, nodes):
    log = Log(nodes=nodes, steps=6)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    drawn = plots(recording)
    expected = {f"error_db/network/{part}" for part in ("band", "rms", *NAMES)} | {f"error_db/node/{k}" for k in worst(log)}
    assert drawn["error_db"] == expected
    assert all(4 < len(drawn[key]) <= 12 for key in ("error_db", "theta", "tolerance", "trace_covariance"))
    assert max(map(len, (paths for origin, paths in drawn.items() if origin != "measurement"))) <= 12
    names = {k: recording.rows(f"error_db/node/{k}", "SeriesLines:names", static=True)[2] for k in worst(log)}
    said = ("worst", "2nd worst", "3rd worst", "4th worst", "5th worst")
    assert names == {k: [[f"node {k} ({what})"]] for k, what in zip(worst(log), said)}
    assert recording.rows("network/named", "Points2D:labels", static=True)[2] == [[f"node {k} ({what})" for k, what in zip(worst(log), said)]]


def test_of_few_nodes_each_is_drawn(tmp_path):
    recording, _ = convert(Log(nodes=8, steps=6).data(), tmp_path / "run.rrd")
    assert plots(recording)["error_db"] == {*(f"error_db/node/{k}" for k in range(8)), "error_db/network/rms"}


def test_nodes_that_are_asked_for(tmp_path):
    from meshkal_rerun import conversion

    log = Log(nodes=130, steps=6)
    conversion.convert({"log": io.BufferedReader(io.BytesIO(log.data()))}, tmp_path / "run.rrd", conversion.Wanted(nodes=(77,)))
    recording = Recording(tmp_path / "run.rrd")
    assert "error_db/node/77" in plots(recording)["error_db"] and "node 77" in recording.rows("network/named", "Points2D:labels", static=True)[2][0]
    np.testing.assert_array_equal(recording.series("tolerance/node/77"), log.arrays["tolerance"][0, :, 77])


@pytest.mark.parametrize("truth", [True, False])
def test_every_number_of_many_nodes_is_there(tmp_path, truth):
    """In an entity of its own, or, of what is seldom looked at by node, in one for all."""
    log = Log(nodes=130, steps=6, rows=2, truth=truth)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    a = {key: values[0] for key, values in log.arrays.items()}
    ratio = a["nis"] / a["nis_rows"]
    singles = {"theta": a["theta"]} | ({"error_db": decibels(a["error"])} if truth else {"nis_ratio": ratio})
    for key, values in singles.items():
        for k in range(130):
            np.testing.assert_allclose(recording.series(f"{key}/node/{k}"), values[:, k], rtol=1e-12)
    together = {"tolerance": a["tolerance"], "trace_covariance": a["trace_covariance"], "measurement": a["measurements"]}
    first = np.cumsum([0, *map(len, log.header["slots"])])
    for what in ("measurements", "estimates"):
        arrived = a[f"{what}_arrived"]
        together[f"missing_{what}"] = np.stack([(arrived[:, i:j] == 0).sum(axis=1) for i, j in zip(first, first[1:])], axis=1)
    if truth:
        together["nis_ratio"] = ratio
    for key, values in together.items():
        np.testing.assert_allclose(recording.series(f"{key}/nodes"), values, rtol=1e-12)


def test_only_named_nodes_have_ellipsoids(tmp_path):
    log = Log(nodes=130, steps=6)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    named, estimate = worst(log), log.arrays["estimate"][0].reshape(6, 130, 4)
    centers = np.array(recording.rows("scene/ellipsoids_3_sigma", "Ellipsoids3D:centers")[2])
    np.testing.assert_allclose(centers[:, :, :2], estimate[:, named, :2], rtol=1e-6)
    np.testing.assert_array_equal(np.array(recording.rows("scene/estimates", "Points3D:positions")[2]), centers)
    others = np.array(recording.rows("scene/other_estimates", "Points3D:positions")[2])
    np.testing.assert_allclose(others[:, :, :2], estimate[:, [k for k in range(130) if k not in named], :2], rtol=1e-6)
    (labels,) = recording.rows("scene/named_sensors", "Points3D:labels", static=True)[2]
    assert labels == [str(k) for k in named]


def test_nodes_named_later(tmp_path, monkeypatch):
    """Of a run that goes on: the second half of the steps has other names."""
    from meshkal_log import reader
    from meshkal_log.scenario import parse_scenario
    from meshkal_rerun.numbers import survey
    from meshkal_rerun.recording.output import recording_file
    from meshkal_rerun.recording.recorder import Recorder, recording_id
    from meshkal_rerun.views.blueprint import blueprint

    monkeypatch.setattr(reader, "BATCH_STEPS", 4)
    log = Log(nodes=130, steps=8)
    data = reader.LogReader(io.BufferedReader(io.BytesIO(log.data())))
    header, scenario = data.header, parse_scenario(data.header)
    first, second = data.batches(0)
    found = survey.survey([first, second], header, scenario)
    begun = survey.unknown(header)
    named = survey.focus(header, begun)
    shown = blueprint(header, scenario, first, begun, named)
    with recording_file(tmp_path / "run.rrd", recording_id(header, 0), shown) as rec:
        recorder = Recorder(rec, header, scenario, 0, begun, named)
        recorder.batch(first)
        recorder.rename(found, survey.focus(header, found))
        recorder.batch(second)
        recorder.finish("complete")
    recording = Recording(tmp_path / "run.rrd")
    estimate = log.arrays["estimate"][0].reshape(8, 130, 4)
    now = worst(log)
    assert named == (0, 1, 2, 3, 4) and set(now) != set(named)
    drawn = np.array(recording.rows("scene/estimates", "Points3D:positions")[2])[:, :, :2]
    np.testing.assert_allclose(drawn, np.concatenate([estimate[:4, named, :2], estimate[4:, now, :2]]), rtol=1e-6)
    assert recording.rows("network/named", "Points2D:labels", static=True)[2][-1][0] == f"node {now[0]} (worst)"
    np.testing.assert_array_equal(recording.series(f"theta/node/{now[0]}"), log.arrays["theta"][0, :, now[0]])
    assert recording.rows(f"theta/node/{now[0]}", "SeriesLines:names", static=True)[2][-1] == [f"node {now[0]} (worst)"]


def missing_links(recording, log) -> list[set]:
    """(from, to) of each step, told by where the dashes are: in the half of the link at its receiver, in its direction."""
    (places,) = recording.rows("network/nodes", "Points2D:positions", static=True)[2]
    places, nodes = np.array(places), log.header["nodes"]
    receivers = [nodes] if log.header["estimators"] == 1 else range(nodes)
    links = [(j, k) for k, slots in zip(receivers, log.header["slots"]) for j in slots if j != k]
    out = []
    for strips in recording.rows("network/missing", "LineStrips2D:strips")[2]:
        found = set()
        for strip in np.reshape(strips, (-1, 2, 2)):
            on = []
            for j, k in links:
                along = places[k] - places[j]
                share = (strip - places[j]) @ along / (along @ along)
                off = np.abs(strip - places[j] - share[:, None] * along).max()
                if off < 1e-4 * np.linalg.norm(along) and 0.499 < share[0] < share[1] < 1.0:
                    on.append((j, k))
            assert len(on) == 1, "a dash that is on no link, or on two"
            found.add(on[0])
        out.append(found)
    return out


@pytest.mark.parametrize("make", [lambda: Log(nodes=7, steps=9), lambda: Log(nodes=101, steps=2), lambda: TrackingLog(steps=9)])
def test_missing_links_are_those_of_the_log(tmp_path, make):
    log = make()
    arrived = log.arrays["estimates_arrived"][0]
    slots = [(j, k) for k, row in enumerate(log.header["slots"]) for j in row]
    expected = [{link for link, came in zip(slots, row) if not came and link[0] != link[1]} for row in arrived]
    assert sum(map(len, expected)) > 5
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert missing_links(recording, log) == expected


@pytest.mark.parametrize("make", [lambda: Log(nodes=7, steps=9, filter="rkfc"), lambda: TrackingLog(filter="ekf", steps=30)])
def test_missing_readings_of_a_centre(tmp_path, make):
    log = make()
    arrived = log.arrays["measurements_arrived"][0]
    there = log.arrays["measuring"][0] if "measuring" in log.arrays else np.ones_like(arrived)
    expected = [{(j, log.header["nodes"]) for j in log.header["slots"][0] if there[t, j] and not arrived[t, j]} for t in range(len(arrived))]
    assert sum(map(len, expected)) > 2
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert missing_links(recording, log) == expected


def test_colours_of_position_errors_are_told_in_metres(tmp_path):
    log = TrackingLog(steps=9)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    estimate = log.arrays["estimate"][0].reshape(9, 5, 4)
    low, high = 10 ** (np.percentile(decibels(np.linalg.norm(estimate[:, :, :2] - log.arrays["truth"][0][:, None, :2], axis=2)), [10, 90]) / 20)
    assert recording.rows("network/scale/labels", "Points2D:labels", static=True)[2][0][::2] == [f"{low:.2g} m or less", f"{high:.2g} m or more"]
    assert f"blue {low:.2g} m or less, red {high:.2g} m or more; position error" in recording.summary()


@pytest.mark.parametrize("nodes", [5, 20, 130])
def test_a_node_has_one_colour(tmp_path, nodes):
    log = Log(nodes=nodes, steps=6)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    named = worst(log) if nodes > 8 else list(range(nodes))
    (rings,) = recording.rows("network/named", "Points2D:colors", static=True)[2]
    (sensors,) = recording.rows("scene/sensors", "Points3D:colors", static=True)[2]
    (estimates,) = recording.rows("scene/estimates", "Points3D:colors", static=True)[2]
    (lines,) = recording.rows("state/0/estimates", "SeriesLines:colors", static=True)[2]
    assert len(set(rings)) == len(named)
    for i, k in enumerate(named):
        of = {rings[i], sensors[k], estimates[i if nodes > 100 else k], lines[k]}
        for quantity in ("error_db", "theta", "tolerance", "nis_ratio", "missing_estimates"):
            of |= set(recording.rows(f"{quantity}/node/{k}", "SeriesLines:colors", static=True)[2][0])
        assert len(of) == 1
    assert len({sensors[k] for k in range(nodes) if k not in named}) == (nodes > 8)


# Machado, Oliveira, Fernandes 2009, severity 1.
_VISION = {
    "normal": np.eye(3),
    "deuteranopia": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]),
    "protanopia": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
}


def lab(colour: int, vision: str) -> np.ndarray:
    srgb = np.array([colour >> shift & 255 for shift in (24, 16, 8)]) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    f = to_xyz @ np.clip(_VISION[vision] @ linear, 0, 1) / to_xyz.sum(axis=1)
    f = np.where(f > 0.008856, np.cbrt(f), 7.787 * f + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", _VISION)
def test_the_colour_blind_tell_nodes_apart(vision):
    from meshkal_rerun.recording import colours

    seen = [lab(int(colour), vision) for colour in colours.cycled(8)]
    apart = np.array([[np.linalg.norm(a - b) for b in seen] for a in seen]) + np.diag([np.inf] * 8)
    assert apart[:5, :5].min() > 25 and apart.min() > 12
    # Dots and texts are seen on the background; no colour of the scale comes twice, and its ends are far apart.
    assert min(colour[0] for colour in seen) > 35
    ramp = [lab(int(colour), vision) for colour in colours.scale_colours(np.linspace(0.0, 1.0, 9), 0.0, 1.0)]
    apart = np.array([[np.linalg.norm(a - b) for b in ramp] for a in ramp]) + np.diag([np.inf] * 9)
    assert min(colour[0] for colour in ramp) > 40 and apart.min() > 6 and apart[0, -1] > 80


@pytest.mark.parametrize("view, tab", [(None, "Overview"), ("overview", "Overview"), ("summary", "Summary"), ("integrity", None)])
def test_the_tab_in_front(tmp_path, view, tab):
    from meshkal_log.reader import LogError
    from meshkal_rerun import conversion

    def run():
        data = io.BufferedReader(io.BytesIO(Log(nodes=4, steps=5).data()))
        conversion.convert({"log": data}, tmp_path / "run.rrd", conversion.Wanted(view=view))

    if tab is None:
        with pytest.raises(LogError, match="nothing for the view integrity; it has overview, .*summary"):
            run()
        assert not (tmp_path / "run.rrd").exists()
        return
    run()
    assert front(Recording(tmp_path / "run.rrd")) == tab


def front(recording: Recording) -> str:
    """The name of the active tab of the outermost container."""
    found: dict[str, dict[str, list]] = {}
    for chunk in recording.reader.stream(store=recording.reader.blueprints()[0]):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            key = name.split(":")[-1]
            if key in ("display_name", "active_tab", "root_container"):
                found.setdefault(chunk.entity_path.strip("/"), {})[key] = [v for row in batch.column(name).to_pylist() if row for v in row]
    root = next(of["root_container"][0] for of in found.values() if "root_container" in of)
    root = "".join(f"{byte:02x}" for byte in root) if not isinstance(root, str) else root
    (path,) = [path for path in found if path.startswith("container/") and path.split("/")[1].replace("-", "") == root.replace("-", "")]
    return found[found[path]["active_tab"][0].strip("/")]["display_name"][0]
