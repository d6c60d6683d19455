# SPDX-License-Identifier: MIT
"""What a recording holds is what the log holds."""

import numpy as np
import pytest
from readback import convert
from synthetic import Log


def decibels(x):
    return 20 * np.log10(x)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    log = Log(nodes=5, steps=30)
    recording, remarks = convert(log.data(), tmp_path_factory.mktemp("r") / "run.rrd")
    assert remarks == []
    return log, recording


def test_times_on_both_timelines(made):
    log, recording = made
    steps, times, _ = recording.rows("theta/node/0", "Scalars:scalars")
    assert steps.tolist() == list(range(30))
    # 0.1 s is not a binary fraction: rounded, not truncated, to nanoseconds.
    assert times.tolist() == [k * 100_000_000 for k in range(30)]


@pytest.mark.parametrize("quantity", ["theta", "tolerance", "trace_covariance"])
def test_copied_quantities(made, quantity):
    log, recording = made
    for k in range(5):
        np.testing.assert_array_equal(recording.series(f"{quantity}/node/{k}"), log.arrays[quantity][0, :, k])
    np.testing.assert_allclose(recording.series(f"{quantity}/network/median"), np.median(log.arrays[quantity][0], axis=1))
    np.testing.assert_array_equal(recording.series(f"{quantity}/network/largest"), log.arrays[quantity][0].max(axis=1))


def test_error_in_db(made):
    log, recording = made
    error = log.arrays["error"][0]
    for k in range(5):
        np.testing.assert_allclose(recording.series(f"error_db/node/{k}"), decibels(error[:, k]), rtol=1e-12)
    np.testing.assert_allclose(recording.series("error_db/network/rms"), decibels(np.sqrt((error**2).mean(axis=1))), rtol=1e-10)
    np.testing.assert_allclose(recording.series("error_db/network/worst"), decibels(error.max(axis=1)), rtol=1e-12)
    np.testing.assert_allclose(recording.series("error_db/network/median"), decibels(np.median(error, axis=1)), rtol=1e-12)


def test_test_quantity(made):
    log, recording = made
    nis, rows = log.arrays["nis"][0], log.arrays["nis_rows"][0]
    for k in range(5):
        np.testing.assert_allclose(recording.series(f"nis_ratio/node/{k}"), nis[:, k] / rows[:, k], rtol=1e-12)
    np.testing.assert_allclose(recording.series("nis_ratio/network/pooled"), nis.sum(axis=1) / rows.sum(axis=1), rtol=1e-12)


def test_missing_counts(made):
    log, recording = made
    for what in ("measurements", "estimates"):
        arrived = log.arrays[f"{what}_arrived"][0]
        first = 0
        for k, slots in enumerate(log.header["slots"]):
            expected = (arrived[:, first : first + len(slots)] == 0).sum(axis=1)
            first += len(slots)
            np.testing.assert_array_equal(recording.series(f"missing_{what}/node/{k}"), expected)
        np.testing.assert_array_equal(recording.series(f"missing_{what}/network/total"), (arrived == 0).sum(axis=1))


def test_slots_of_different_lengths(tmp_path):
    log = Log(nodes=3, steps=4)
    log.header["slots"] = [[0, 1, 2], [1, 0], [2, 0]]
    arrived = np.array([[1, 0, 0, 1, 0, 1, 1]] * 4)
    log.arrays["measurements_arrived"] = log.arrays["estimates_arrived"] = arrived[None]
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert [recording.series(f"missing_measurements/node/{k}").tolist() for k in range(3)] == [[2] * 4, [1] * 4, [0] * 4]


def test_states_and_measurements(made):
    log, recording = made
    estimate = log.arrays["estimate"][0].reshape(30, 5, 4)
    for i in range(4):
        np.testing.assert_array_equal(recording.series(f"state/{i}/estimates"), estimate[:, :, i])
        np.testing.assert_array_equal(recording.series(f"state/{i}/truth"), log.arrays["truth"][0, :, i])
        np.testing.assert_array_equal(recording.series(f"state/{i}/network/smallest"), estimate[:, :, i].min(axis=1))
    for k in range(5):
        np.testing.assert_array_equal(recording.series(f"measurement/node/{k}"), log.arrays["measurements"][0, :, k])


def test_measurements_of_several_rows(tmp_path):
    log = Log(nodes=3, steps=4, rows=(3, 0, 2))
    y = np.arange(20.0).reshape(1, 4, 5)
    log.arrays["measurements"] = y
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("measurement/node/0"), y[0, :, :3])
    np.testing.assert_array_equal(recording.series("measurement/node/2"), y[0, :, 3:])
    assert "measurement/node/1" not in recording.entities()


def test_unknown_readings_are_gaps(tmp_path):
    log = Log(nodes=3, steps=6)
    log.arrays["measurements"][0, 2, 1] = np.nan
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("measurement/node/1"), log.arrays["measurements"][0, :, 1])


def test_what_has_no_logarithm_is_a_gap_and_not_infinite(tmp_path):
    log = Log(nodes=3, steps=6)
    log.arrays["error"][0, :, 1] = [0.0, np.inf, np.nan, 1.0, 10.0, 1e-3]
    log.arrays["theta"][0, 0, 0] = np.inf
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_allclose(recording.series("error_db/node/1"), [np.nan] * 3 + [0, 20, -60], atol=1e-12)
    assert np.isnan(recording.series("theta/node/0")[0])
    assert "| infinite errors, not in the RMS | 1 |" in recording.summary()
    others = log.arrays["error"][0, 2, [0, 2]]
    np.testing.assert_allclose(recording.series("error_db/network/rms")[2], decibels(np.sqrt((others**2).mean())))


def test_a_diverging_node_does_not_overflow_the_rms(tmp_path):
    log = Log(nodes=2, steps=3)
    log.arrays["error"][0] = 1e200
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    np.testing.assert_allclose(recording.series("error_db/network/rms"), 4000.0)


def test_without_degrees_of_freedom_there_is_no_test_quantity(tmp_path):
    log = Log(nodes=2, steps=3)
    log.arrays["nis_rows"] = np.array([[[0, 1]] * 3])
    log.arrays["nis"] = np.array([[[0.0, 4.0]] * 3])
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert np.isnan(recording.series("nis_ratio/node/0")).all()
    assert recording.series("nis_ratio/network/pooled").tolist() == [4.0] * 3


def test_truth_without_any_entry_gives_no_error(tmp_path):
    log = Log(nodes=2, steps=3)
    log.arrays["truth"][0, 1] = np.nan
    log.arrays["error"][0, 1] = 5.0
    log.arrays["truth"][0, 2, 3] = np.nan
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    assert np.isnan(recording.series("error_db/network/rms")).tolist() == [False, True, False]


def test_float32_values_are_exact(tmp_path):
    log = Log(nodes=4, steps=8, real="float32")
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    theta = log.arrays["theta"].astype(np.float32)
    np.testing.assert_array_equal(recording.series("theta/node/2"), theta[0, :, 2].astype(np.float64))
    estimate = log.arrays["estimate"][0].reshape(8, 4, 4).astype(np.float32)
    np.testing.assert_array_equal(recording.series("state/3/estimates"), estimate[:, :, 3].astype(np.float64))


def test_the_run_that_was_asked_for(tmp_path):
    log = Log(nodes=2, steps=5, runs=3)
    for run in range(3):
        recording, _ = convert(log.data(), tmp_path / "run.rrd", run)
        np.testing.assert_array_equal(recording.series("theta/node/1"), log.arrays["theta"][run, :, 1])


def test_batches_join_without_a_seam(tmp_path, monkeypatch):
    from meshkal_log import reader

    monkeypatch.setattr(reader, "BATCH_STEPS", 7)
    log = Log(nodes=3, steps=20)
    log.arrays["faults"][0, 5:9, 1] = 12  # across the seam between step 6 and step 7
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    steps, _, _ = recording.rows("theta/node/2", "Scalars:scalars")
    assert steps.tolist() == list(range(20))
    np.testing.assert_array_equal(recording.series("theta/node/2"), log.arrays["theta"][0, :, 2])
    assert recording.rows("faults", "TextLog:text")[0].tolist() == [5, 9]
    trail = recording.rows("scene/truth_trail", "LineStrips3D:strips")[2]
    assert [len(row[0]) for row in trail] == list(range(1, 21))


def test_faults_are_logged_when_they_change(made, tmp_path):
    log = Log(nodes=3, steps=10)
    log.arrays["faults"][0, 4:7, 1] = 0b10000100
    log.arrays["faults"][0, 6, 2] = 8
    log.arrays["faults"][0, ::2] += 3  # losses: counted elsewhere, not logged
    recording, _ = convert(log.data(), tmp_path / "run.rrd")
    steps, _, texts = recording.rows("faults", "TextLog:text")
    levels = recording.rows("faults", "TextLog:level")[2]
    rows = sorted(zip(steps.tolist(), (t[0] for t in texts), (v[0] for v in levels)))
    assert rows == [
        (4, "node 1: input refused, fault bit 7", "WARN"),
        (6, "node 2: no measurement at all", "WARN"),
        (7, "node 1: faults over", "INFO"),
        (7, "node 2: faults over", "INFO"),
    ]
    assert "| fault entries | 2 |" in recording.summary()
    assert "faults" not in made[1].entities()


def test_summary_tells_the_facts(made):
    log, recording = made
    text = recording.summary()
    error = log.arrays["error"][0]
    assert f"| RMS error, all nodes and steps | {10 * np.log10((error**2).mean()):.1f} dB |" in text
    worst = int((error**2).mean(axis=0).argmax())
    assert f", node {worst}: " in text
    arrived = log.arrays["measurements_arrived"][0]
    assert f"| measurements missing | {100 * (arrived == 0).mean():.1f} % |" in text
    assert "| log | complete, 30 steps, to step 29 |" in text
    assert "| nodes | 5 |" in text and "| tolerance | 0.02 |" in text
