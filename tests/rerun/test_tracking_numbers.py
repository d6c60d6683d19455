# SPDX-License-Identifier: MIT
"""Tracking logs: what the series of a recording hold is what the log holds."""

import numpy as np
import pytest
from readback import convert
from scipy.stats import chi2
from synthetic_tracking import TrackingLog

STEPS = 40


@pytest.fixture(scope="module", params=["duif", "rekfd", "ukf"])
def made(request, tmp_path_factory):
    log = TrackingLog(steps=STEPS, filter=request.param)
    recording, remarks = convert(log.data(), tmp_path_factory.mktemp("r") / "run.rrd")
    assert remarks == []
    return log, recording


def paths(log) -> list[str]:
    return ["centre"] if log.header["estimators"] == 1 else [f"node/{k}" for k in range(log.header["nodes"])]


def test_instants_have_their_own_times(made):
    log, recording = made
    steps, times, _ = recording.rows(f"position_error/{paths(log)[0]}", "Scalars:scalars")
    assert steps.tolist() == list(range(1, STEPS + 1))
    np.testing.assert_array_equal(times, np.rint(log.arrays["time_s"][0, :, 0] * 1e9).astype(np.int64))
    assert len(set(np.diff(times).tolist())) > 2


def test_position_error_and_nees(made):
    log, recording = made
    e = log.header["estimators"]
    estimate = log.arrays["estimate"][0].reshape(STEPS, e, 4)
    error = np.hypot(*(estimate[:, :, i] - log.arrays["truth"][0][:, None, i] for i in (0, 1)))
    for k, path in enumerate(paths(log)):
        np.testing.assert_allclose(recording.series(f"position_error/{path}"), error[:, k], rtol=1e-12)
        np.testing.assert_array_equal(recording.series(f"nees/{path}"), log.arrays["nees"][0, :, k])
    np.testing.assert_allclose(recording.series("position_error/network/rms"), np.sqrt((error**2).mean(axis=1)), rtol=1e-12)
    np.testing.assert_allclose(recording.series("nees/network/mean"), log.arrays["nees"][0].mean(axis=1), rtol=1e-12)
    for name, value in (("lower", chi2.ppf(0.025, 4)), ("upper", chi2.ppf(0.975, 4)), ("expected", 4.0)):
        np.testing.assert_allclose(recording.series(f"nees/band/{name}"), value, rtol=1e-12)


@pytest.mark.parametrize("degrees", [*range(1, 13), 63, 64])
def test_band_of_any_number_of_states(degrees):
    from meshkal_rerun.numbers.tracking import nees_band

    np.testing.assert_allclose(nees_band(degrees), chi2.ppf([0.025, 0.975], degrees), rtol=1e-11)


def test_position_states_in_any_order(tmp_path):
    log = TrackingLog(filter="ukf")
    log.scenario["model"]["states"] = ["vx", "py", "vy", "px"]
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    estimate, truth = log.arrays["estimate"][0], log.arrays["truth"][0]
    np.testing.assert_allclose(recording.series("position_error/centre"), np.hypot(*(estimate - truth)[:, [1, 3]].T), rtol=1e-12)
    shown = np.array(recording.rows("scene/estimates", "Points3D:positions")[2])[:, 0]
    np.testing.assert_allclose(shown, np.column_stack([estimate[:, [3, 1]], np.zeros(len(estimate))]), rtol=1e-6)


def test_gate_ratio_where_it_was_judged(made):
    log, recording = made
    ratio, decision = log.arrays["gate_ratio"][0], log.arrays["decision"][0]
    drawn = 0
    for at, e, node in log.heard():
        path = f"gate_ratio/{paths(log)[e]}/sensor/{node}"
        judged = np.flatnonzero(ratio[:, at] > 0)
        steps, _, _ = recording.rows(path, "Scalars:scalars")
        assert steps.tolist() == (judged + 1).tolist()
        np.testing.assert_array_equal(recording.series(path), ratio[judged, at])
        for state, number in (("rejected", 2), ("inflated", 3)):
            some = np.flatnonzero(decision[:, at] == number)
            assert (recording.rows(f"{path}/{state}", "Scalars:scalars")[0] - 1).tolist() == some.tolist()
            drawn += len(some)
    assert drawn > 10
    np.testing.assert_array_equal(recording.series("gate_ratio/threshold"), np.ones(STEPS))
    together = log.arrays["gate_stacked_ratio"][0]
    for e, path in enumerate(paths(log)):
        assert (recording.rows(f"gate_ratio/{path}/together", "Scalars:scalars")[0] - 1).tolist() == np.flatnonzero(together[:, e]).tolist()
    largest = np.array([max([0.0, *ratio[t, [at for at, _, _ in log.heard()]], *together[t]]) for t in range(STEPS)])
    np.testing.assert_array_equal(np.nan_to_num(recording.series("gate_ratio/network/largest")), largest)


def test_decisions_of_every_sensor(made):
    log, recording = made
    measuring, arrived, decision = (log.arrays[key][0] for key in ("measuring", "measurements_arrived", "decision"))
    words = ["no reading", "lost", "used", "inflated", "rejected"]
    rank = {1: "used", 2: "rejected", 3: "inflated"}
    for node, rows in enumerate(log.header["rows"]):
        changes = recording.rows(f"decisions/node/{node}", "StateChange:state")
        if not rows:
            assert not len(changes[2])
            continue
        held, now = [], None
        assert log.header["source"] == "drawn"
        at = dict(zip(changes[0].tolist(), (row[0] for row in changes[2])))
        for t in range(STEPS):
            now = at.get(t + 1, now)
            held.append(now)
        for t in range(STEPS):
            heard = [slot for slot, _, k in log.heard() if k == node]
            fates = ["no reading"] + [rank[int(decision[t, s])] if arrived[t, s] else "lost" for s in heard if measuring[t, node]]
            assert held[t] == max(fates, key=words.index), (node, t)
        assert len(at) < STEPS


def test_entries_of_readings_that_were_not_used(made):
    log, recording = made
    steps, _, texts = recording.rows("rejections", "TextLog:text")
    levels = recording.rows("rejections", "TextLog:level")[2]
    expected = []
    for at, e, node in log.heard():
        for t in np.flatnonzero(log.arrays["decision"][0][:, at] > 1):
            kind = {2: "rejected", 3: "inflated"}[int(log.arrays["decision"][0][t, at])]
            where = f" at node {e}" if log.header["estimators"] > 1 and e != node else ""
            fault = ", faulty" if log.arrays["faulty"][0][t, node] else ""
            text = f"reading of node {node}{where}: {kind}, test ratio {log.arrays['gate_ratio'][0][t, at]:.3g}{fault}"
            expected.append((t + 1, text, "WARN" if kind == "rejected" else "INFO"))
    assert sorted(zip(steps.tolist(), (t[0] for t in texts), (v[0] for v in levels))) == sorted(expected)
    assert any("faulty" in text for _, text, _ in expected)
    assert "faults" not in recording.entities()


def test_missing_readings_are_those_that_sensors_gave(made):
    log, recording = made
    measuring, arrived = log.arrays["measuring"][0], log.arrays["measurements_arrived"][0]
    for e, path in enumerate(paths(log)):
        lost = sum(measuring[:, node] & (arrived[:, at] == 0) for at, k, node in log.heard() if k == e) + np.zeros(STEPS)
        np.testing.assert_array_equal(recording.series(f"missing_measurements/{path}"), lost)


def test_missing_messages(made):
    log, recording = made
    if log.header["estimators"] == 1:
        assert not [name for name in recording.entities() if name.startswith("missing_messages")]
        return
    messages, first = log.arrays["messages_arrived"][0], 0
    expected = 4 if log.header["filter"] == "duif" else 1
    for k, slots in enumerate(log.header["slots"]):
        short = (expected - messages[:, first + 1 : first + len(slots)]).sum(axis=1)
        first += len(slots)
        np.testing.assert_array_equal(recording.series(f"missing_messages/node/{k}"), short)


def test_disagreement_and_consensus(made):
    log, recording = made
    if log.header["estimators"] == 1:
        assert not [name for name in recording.entities() if name.startswith(("disagreement", "consensus"))]
        return
    np.testing.assert_array_equal(recording.series("disagreement/positions"), log.arrays["disagreement"][0, :, 0])
    if log.header["filter"] != "duif":
        return
    apart = log.arrays["consensus_disagreement"][0]
    assert {name for name in recording.entities() if name.startswith("consensus")} == {f"consensus/after/{l}" for l in (0, 1, 2, 4)}
    for l in (0, 1, 2, 4):
        np.testing.assert_allclose(recording.series(f"consensus/after/{l}"), 20 * np.log10(apart[:, l]), rtol=1e-12, atol=1e-12)


def test_iterations_that_are_drawn():
    from meshkal_rerun.recording.tracking import shown_iterations

    assert shown_iterations(0) == [0]
    assert shown_iterations(1) == [0, 1]
    assert shown_iterations(30) == [0, 1, 2, 5, 10, 20, 30]


def test_readings_and_states(made):
    log, recording = made
    y = log.arrays["measurements"][0]
    np.testing.assert_array_equal(recording.series("measurement/node/0"), y[:, 0])
    np.testing.assert_array_equal(recording.series("measurement/node/2"), y[:, 2:4])
    assert np.isnan(y).any() and "measurement/node/4" not in recording.entities()
    estimate = log.arrays["estimate"][0].reshape(STEPS, log.header["estimators"], 4)
    shown = recording.series("state/3/estimates")
    np.testing.assert_array_equal(shown.reshape(STEPS, -1), estimate[:, :, 3])


def test_theta_and_tolerance_of_the_robust_filter_only(made):
    log, recording = made
    if log.header["filter"] == "rekfd":
        np.testing.assert_array_equal(recording.series("theta/node/2"), log.arrays["theta"][0, :, 2])
        np.testing.assert_array_equal(recording.series("tolerance/node/4"), log.arrays["tolerance"][0, :, 4])
    else:
        assert not [name for name in recording.entities() if name.startswith(("theta", "tolerance"))]


def test_summary_tells_the_facts(made):
    log, recording = made
    text = recording.summary()
    estimate = log.arrays["estimate"][0].reshape(STEPS, -1, 4)
    square = ((estimate - log.arrays["truth"][0][:, None])[:, :, :2] ** 2).sum(axis=2)
    assert f"| position RMSE, all instants | {np.sqrt(square.mean()):.4g} m |" in text
    nees = log.arrays["nees"][0]
    inside = (nees >= chi2.ppf(0.025, 4)) & (nees <= chi2.ppf(0.975, 4))
    assert f"| mean NEES (an exact filter: 4) | {nees.mean():.3g} |" in text and f"| {100 * inside.mean():.1f} % (exact: 95 %) |" in text
    decided = log.arrays["decision"][0][:, [at for at, _, _ in log.heard()]]
    faulty = log.arrays["faulty"][0][:, [node for _, _, node in log.heard()]]
    due = log.arrays["measuring"][0][:, [node for _, _, node in log.heard()]].sum()
    assert f"| readings used as they were | {(decided == 1).sum()} of {due} |" in text
    assert f"| readings rejected | {(decided == 2).sum()}, {(faulty & (decided == 2)).sum()} of them faulty |" in text
    assert f"| faulty readings used as they were | {(faulty & (decided == 1)).sum()} |" in text
    t = log.arrays["time_s"][0, :, 0]
    assert f"| log | complete, {STEPS} instants, {t[0]:g} s to {t[-1]:g} s |" in text
    assert "1 bearing, 1 range, 1 range-bearing, 1 range-rate" in text


def test_batches_join_without_a_seam(made, tmp_path, monkeypatch):
    from meshkal_log import reader

    log, whole = made
    monkeypatch.setattr(reader, "BATCH_STEPS", 7)
    parts, _ = convert(log.data(), tmp_path / "run.rrd")
    assert parts.entities() == whole.entities()
    assert parts.summary() == whole.summary()
    for entity, component in (
        ("decisions/node/1", "StateChange:state"),
        ("scene/estimate_trail", "LineStrips3D:strips"),
        ("scene/readings", "LineStrips3D:strips"),
        (f"nees/{paths(log)[0]}", "Scalars:scalars"),
        ("network/nodes", "Points2D:colors"),
    ):
        for one, other in zip(whole.rows(entity, component), parts.rows(entity, component)):
            assert np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other


def test_float32_values_are_exact(tmp_path):
    log = TrackingLog(filter="rekfd", real="float32")
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("theta/node/2"), log.arrays["theta"].astype(np.float32)[0, :, 2].astype(np.float64))
    np.testing.assert_array_equal(recording.series("nees/node/2"), log.arrays["nees"][0, :, 2])


def test_a_gate_that_judged_all_together(tmp_path):
    log = TrackingLog(filter="ukf", sensors=("range", "range"), steps=3)
    log.arrays["gate_ratio"][:] = 0.0
    log.arrays["measuring"][:] = log.arrays["measurements_arrived"][:] = 1
    log.arrays["faulty"] = np.array([[[0, 0], [0, 1], [0, 0]]])
    log.arrays["gate_stacked_ratio"] = np.array([[[0.5], [7.0], [2.0]]])
    log.arrays["decision"] = np.array([[[1, 1], [2, 2], [3, 3]]])
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert recording.series("gate_ratio/centre/together").tolist() == [0.5, 7.0, 2.0]
    assert recording.rows("gate_ratio/centre/together/rejected", "Scalars:scalars")[0].tolist() == [2]
    assert recording.rows("gate_ratio/centre/together/inflated", "Scalars:scalars")[0].tolist() == [3]
    texts = [row[0] for row in recording.rows("rejections", "TextLog:text")[2]]
    rejected = "rejected with the others, test ratio 7"
    assert texts[:2] == [f"reading of node 0: {rejected}", f"reading of node 1: {rejected}, faulty"]


def test_a_reading_that_a_model_refuses(tmp_path):
    log = TrackingLog(filter="ukf", sensors=("range", "range"), steps=2)
    log.arrays["measuring"][:] = log.arrays["measurements_arrived"][:] = 1
    log.arrays["decision"] = np.array([[[4, 1], [1, 1]]])
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    fault = ", faulty" if log.arrays["faulty"][0, 0, 0] else ""
    assert recording.rows("rejections", "TextLog:text")[2] == [[f"reading of node 0: refused by the model{fault}"]]
    assert recording.rows("decisions/node/0", "StateChange:state")[2] == [["refused by the model"], ["used"]]
    assert "| readings refused by a model | 1" in recording.summary()


def test_times_of_day(tmp_path):
    log = TrackingLog(steps=5, filter="ukf")
    log.header["start_s"] = 1.7e9
    log.arrays["time_s"] = 1.7e9 + np.array([[[0.25], [0.5], [1.0], [1.125], [60.0]]])
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    _, times, _ = recording.rows("nees/centre", "Scalars:scalars")
    np.testing.assert_array_equal(times, np.rint(log.arrays["time_s"][0, :, 0] * 1e9).astype(np.int64))
    (chunk, *_) = recording.reader.stream().filter(content="/nees/centre", is_static=False, components="Scalars:scalars")
    assert str(chunk.to_record_batch().column("time_s").type) == "timestamp[ns]"


@pytest.mark.parametrize("batch", [3, 4096])
def test_recorded_sensors_that_take_turns_hold_their_state(tmp_path, monkeypatch, batch):
    """Node 0 measures at every second instant, then is silent; node 1 at the others."""
    from meshkal_log import reader

    log = TrackingLog(steps=20, filter="ukf", sensors=("range", "range"), truth=False)
    measuring = np.zeros((1, 20, 2), dtype=int)
    measuring[0, 0:8:2, 0] = measuring[0, 1::2, 1] = 1
    log.arrays["time_s"] = np.arange(20.0).reshape(1, 20, 1) + 11
    log.arrays["measuring"] = log.arrays["measurements_arrived"] = measuring
    log.arrays["decision"] = measuring.copy()
    log.arrays["decision"][0, 4, 0] = 2
    if batch == 3:
        monkeypatch.setattr(reader, "BATCH_STEPS", batch)
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    steps, _, states = recording.rows("decisions/node/0", "StateChange:state")
    # Intervals of 2 s: a state holds for 10 s, from step 7 on to step 17.
    assert list(zip(steps.tolist(), (row[0] for row in states))) == [(1, "used"), (5, "rejected"), (7, "used"), (18, "no reading")]
    steps, _, states = recording.rows("decisions/node/1", "StateChange:state")
    assert list(zip(steps.tolist(), (row[0] for row in states)))[:2] == [(1, "no reading"), (2, "used")]
