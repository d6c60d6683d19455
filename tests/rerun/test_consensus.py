# SPDX-License-Identifier: MIT
"""How far nodes agree: numbers against the log decoded on its own."""

import numpy as np
import pytest
from decoded import Decoded
from readback import Recording, command
from synthetic import Log
from synthetic_tracking import TrackingLog


@pytest.fixture
def show(tmp_path):
    def run(log: Log, options=()):
        path = tmp_path / "run.cbor"
        path.write_bytes(log.data())
        done = command(path, "-o", tmp_path / "run.rrd", *options)
        return (Recording(tmp_path / "run.rrd") if done.returncode == 0 else done.stderr.decode()), Decoded(path)

    return run


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).mean(axis=-1))


@pytest.mark.parametrize("log", [Log(12, 40), Log(12, 40, real="float32"), Log(6, 40, position_states=None), TrackingLog(), TrackingLog(filter="kcf"),
                                 TrackingLog(positions=False)], ids=["linear", "float32", "norm", "duif", "kcf", "no-positions"])
def test_distances_and_errors(show, log):
    recording, a = show(log, ("--view", "consensus"))
    states = slice(0, 2) if log.header["positions"] else slice(None)
    estimates, truth = a.estimates()[:, :, states], a["truth"][:, states]
    mean = estimates.mean(axis=1)
    distance = np.linalg.norm(estimates - mean[:, None], axis=2)
    path = "agreement/distance"
    for name, values in (("rms", rms(distance)), ("median", np.median(distance, axis=1)), ("largest", distance.max(axis=1))):
        np.testing.assert_allclose(recording.series(f"{path}/over_nodes/{name}"), values, rtol=1e-9)
    named = [int(entity.rsplit("/")[-1]) for entity in recording.entities() if entity.startswith(f"{path}/node/")]
    assert len(named) == min(3, log.header["nodes"])
    for k in named:
        np.testing.assert_allclose(recording.series(f"{path}/node/{k}"), distance[:, k], rtol=1e-9)
    error = np.linalg.norm(estimates - truth[:, None], axis=2)
    np.testing.assert_allclose(recording.series("agreement/error/mean"), np.linalg.norm(mean - truth, axis=1), rtol=1e-9)
    np.testing.assert_allclose(recording.series("agreement/error/nodes"), rms(error), rtol=1e-9)
    np.testing.assert_allclose(recording.series("agreement/error/spread"), rms(distance), rtol=1e-9)
    (text,) = recording.rows("agreement/summary", "TextDocument:text", static=True)[2][0]
    unit = " m" if log.header["positions"] else ""
    t, k = np.unravel_index(distance.argmax(), distance.shape)
    share = 100 * (distance**2).mean() / (error**2).mean()
    each = rms(distance.T)
    for line in (f"| RMS distance from the mean estimate | {rms(distance.ravel()):.3g}{unit} |", f"| at the last step | {rms(distance[-1]):.3g}{unit} |",
                 f"| largest distance | {distance[t, k]:.3g}{unit}, node {k} at step {a.step[t]} |", f"| disagreement's share of squared error | {share:.0f} % |",
                 f"| farthest node, RMS | node {each.argmax()}, {each.max():.3g}{unit} |"):
        assert line in text


def others(a: Decoded) -> np.ndarray:
    """Slots that are not an estimator's own."""
    sizes = [len(s) for s in a.header["slots"]]
    return np.delete(np.arange(sum(sizes)), np.concatenate(([0], np.cumsum(sizes)[:-1])))


def test_messages_that_arrived(show):
    recording, a = show(Log(12, 40))
    for name, key in (("readings", "measurements_arrived"), ("estimates", "estimates_arrived")):
        np.testing.assert_allclose(recording.series(f"agreement/arrived/{name}"), 100 * a[key][:, others(a)].mean(axis=1))
    recording, a = show(TrackingLog(iterations=4))
    np.testing.assert_allclose(recording.series("agreement/arrived/messages"), 100 * a["messages_arrived"][:, others(a)].mean(axis=1) / 4)


def test_spread_over_the_graph(show):
    """A ring where each node listens to two on either side."""
    recording, a = show(Log(12, 40))
    estimates = a.estimates()[:, :, :2]
    around = np.abs(np.arange(12)[:, None] - np.arange(12))
    links = -(-np.minimum(around, 12 - around) // 2)
    apart = np.linalg.norm(estimates[:, :, None] - estimates[:, None], axis=3)
    wanted = [np.sqrt((apart[:, links == l] ** 2).mean()) for l in (1, 2, 3)]
    got = recording.rows("agreement/over_graph", "BarChart:values", static=True)[2][0][0]["buffer"]
    np.testing.assert_allclose(got, wanted, rtol=1e-9)


def test_a_diverged_node_is_left_out(show):
    log = Log(5, 20)
    values = log.arrays["estimate"].copy()
    values[0, 10:, 8:12] = np.nan
    values[0, 15, :] = np.inf
    log.arrays["estimate"] = values
    recording, a = show(log)
    estimates = a.estimates()[:, :, :2]
    kept = np.delete(estimates, 2, axis=1)[10:15]
    distance = np.linalg.norm(kept - kept.mean(axis=1, keepdims=True), axis=2)
    got = recording.series("agreement/distance/over_nodes/largest")
    assert np.isnan(got[15]) and np.isfinite(np.delete(got, 15)).all()
    np.testing.assert_allclose(got[10:15], distance.max(axis=1))
    assert np.isnan(recording.series("agreement/distance/node/2")[10:]).all()


def test_without_truth(show):
    recording, _ = show(Log(5, 20, truth=False))
    assert "agreement/distance/over_nodes/rms" in recording.entities() and not [e for e in recording.entities() if e.startswith("agreement/error")]


@pytest.mark.parametrize("log", [Log(5, 20, filter="kfc"), Log(1, 20), TrackingLog(filter="ukf")], ids=["centre", "one", "ukf"])
def test_who_has_nobody_to_agree_with(show, log):
    said, _ = show(log, ("--view", "consensus"))
    assert isinstance(said, str) and "nothing for the view consensus" in said
    recording, _ = show(log)
    assert not [entity for entity in recording.entities() if entity.startswith("agreement")]


def test_a_run_that_goes_on(tmp_path):
    """What sums up the run is there before its end."""
    import io

    import rerun.blueprint as rrb
    from meshkal_log.reader import LogReader
    from meshkal_log.scenario import parse_scenario
    from meshkal_rerun.numbers.survey import unknown
    from meshkal_rerun.recording.output import recording_file
    from meshkal_rerun.recording.recorder import Recorder

    reader = LogReader(io.BufferedReader(io.BytesIO(Log(6, 20).data())))
    found = unknown(reader.header)
    with recording_file(tmp_path / "run.rrd", "id", rrb.Blueprint()) as rec:
        recorder = Recorder(rec, reader.header, parse_scenario(reader.header), 0, found, (0, 1))
        for batch in reader.batches(0):
            recorder.batch(batch)
        recorder.refresh(batch, found, [])
    recording = Recording(tmp_path / "run.rrd")
    steps, _, texts = recording.rows("agreement/summary", "TextDocument:text")
    assert steps.tolist() == [19] and "| RMS distance from the mean estimate |" in texts[0][0]
    steps, _, values = recording.rows("agreement/over_graph", "BarChart:values")
    assert steps.tolist() == [19] and values[0][0]["shape"] == [2]
