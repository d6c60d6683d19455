# SPDX-License-Identifier: MIT
"""`meshkal_log.read`: every array of every kind of log, shaped as documented."""

import io
import json
import subprocess
import sys
import tracemalloc

import cbor2
import numpy as np
import pytest
from logs_of_all_kinds import LOGS, beside_measurements, state_names, stored
from readback import PACKAGE
from synthetic import Log
from synthetic_tracking import TrackingLog
from test_some_nodes import one_by_one

import meshkal_log
from meshkal_log import LogError, LogWarning, reader
from meshkal_log.fields import MONITORS, lengths
from meshkal_log.layout import ARRAYS

FLAGS = {"measurements_arrived", "estimates_arrived", "frozen", "measuring", "faulty", "monitor_alarm", "monitor_ended", "excluded"}


def stream(data: bytes) -> io.BufferedReader:
    return io.BufferedReader(io.BytesIO(data))


def symmetric(lower: np.ndarray, size: int) -> np.ndarray:
    """Entry by entry."""
    full = np.zeros((len(lower), size, size), dtype=lower.dtype)
    at = 0
    for i in range(size):
        for j in range(i + 1):
            full[:, i, j] = full[:, j, i] = lower[:, at]
            at += 1
    return full


@pytest.mark.parametrize("name", LOGS)
def test_every_array(name):
    log = LOGS[name]()
    run, h = meshkal_log.read(stream(log.data())), log.header
    steps, e, n, p = h["steps"], h["estimators"], h["states"], h["positions"]
    assert set(run) == log.arrays.keys() - {"time_s"} and len(run) == len(set(run))
    for key in run:
        wanted = stored(log, key)
        if key in ("estimate", "variance"):
            wanted = wanted.reshape(steps, e, n)
        elif key == "position_covariance":
            wanted = symmetric(wanted.reshape(steps * e, -1), p).reshape(steps, e, p, p)
        elif key == "innovation_covariance":
            wanted = symmetric(wanted, h["nodes"])
        elif key in ("innovation", "innovation_variance"):
            wanted = beside_measurements(log, wanted)
        elif key == "disagreement":
            wanted = wanted[:, 0]
        np.testing.assert_array_equal(run[key], wanted)
        assert run[key].shape == wanted.shape and run[key].dtype == (bool if key in FLAGS else wanted.dtype)
        assert getattr(run, key) is run[key] and key in dir(run)
    np.testing.assert_array_equal(run.step, log.first_step + np.arange(steps))
    np.testing.assert_array_equal(run.time_s, stored(log, "time_s")[:, 0] if "time_s" in log.arrays else np.arange(steps) * h["dt_s"])
    assert run.scenario == json.loads(json.dumps(log.scenario))
    assert list(run.state_names) == state_names(log)
    assert (run.end, run.warnings, run.run) == ("complete", [], 0)
    assert run.header_item["slots"] == h["slots"] and run.header.filter == h["filter"]
    assert f"{steps} steps" in repr(run) and h["filter"] in repr(run) and "trace_covariance" in repr(run)


def test_whose_slots_and_rows_are():
    log = LOGS["some nodes"]()
    run = meshkal_log.read(stream(log.data()))
    assert run.estimator_nodes == (1, 3)
    assert run.slot_estimator.tolist() == [0, 0, 0, 1]
    assert run.slot_node.tolist() == [1, 0, 3, 3]
    assert run.row_node.tolist() == [1, 1, 2, 3]
    assert run.estimator(3) == 1
    assert run.slots(1).tolist() == [0, 1, 2] and run.slots(3).tolist() == [3]
    np.testing.assert_array_equal(run.readings(1), log.arrays["measurements"][0][:, :2])
    assert run.readings(0).shape == (7, 0)
    for ask in (lambda: run.estimator(2), lambda: run.slots(0), lambda: run.readings(4), lambda: run.readings(-1)):
        with pytest.raises(KeyError, match="node"):
            ask()
    centre = meshkal_log.read(stream(LOGS["central"]().data()))
    assert centre.estimator_nodes == () and centre.estimator(2) == 0 and centre.slot_node.tolist() == [0, 1, 2]


def test_what_is_not_there_is_said_with_what_is():
    run = meshkal_log.read(stream(Log(nodes=2, steps=2).data()))
    with pytest.raises(KeyError, match="no nees; it has truth, estimate"):
        run["nees"]
    with pytest.raises(AttributeError, match="no nees; it has truth, estimate"):
        _ = run.nees
    assert "nees" not in run and "error" in run


def test_a_run_or_all(tmp_path):
    log = Log(nodes=3, steps=4, runs=3)
    (tmp_path / "run.cbor").write_bytes(log.data())
    one = meshkal_log.read(tmp_path / "run.cbor", run=2)
    runs = meshkal_log.read_runs(str(tmp_path / "run.cbor"))
    assert [each.run for each in runs] == [0, 1, 2] and one.run == 2
    for each in (one, *runs):
        np.testing.assert_array_equal(each.error, log.arrays["error"][each.run])
        assert (each.end, each.warnings) == ("complete", [])
    with pytest.raises(LogError, match="run 3 is not in the log, which has 3"):
        meshkal_log.read(tmp_path / "run.cbor", run=3)


def test_a_live_log_whose_clock_was_put_back():
    log = Log(nodes=2, steps=3, runs=2, truth=False)
    log.header["source"] = "live"
    items = log.items()
    log.header["runs"] = 1
    data = log.items()[0] + b"".join(items[1:])
    np.testing.assert_array_equal(meshkal_log.read(stream(data), run=1).theta, log.arrays["theta"][1])
    assert [run.run for run in meshkal_log.read_runs(stream(data))] == [0, 1]
    with pytest.raises(LogError, match="no step of run 2"):
        meshkal_log.read(stream(data), run=2)


def test_a_header_that_asks_for_too_much():
    log = Log(nodes=2, steps=1)
    log.header["states"] = 10**15
    with pytest.raises(LogError, match="states are more"):
        meshkal_log.read(stream(log.items()[0]))


def test_cut_log(tmp_path):
    log = Log(nodes=3, steps=10, runs=2)
    items = log.items()
    (tmp_path / "cut.cbor").write_bytes(b"".join(items[:16]) + items[16][:50])
    with pytest.warns(LogWarning, match="cut.cbor: the log was cut: it ends after 15 step items") as said:
        run = meshkal_log.read(tmp_path / "cut.cbor", run=1)
    assert said[0].filename == __file__
    assert run.end is None and len(run.warnings) == 1 and "cut" in repr(run)
    np.testing.assert_array_equal(run.theta, log.arrays["theta"][1, :5])
    with pytest.warns(LogWarning):
        runs = meshkal_log.read_runs(tmp_path / "cut.cbor")
    assert [len(each.step) for each in runs] == [10, 5] and all(each.end is None and each.warnings == run.warnings for each in runs)


def test_no_step():
    for name in ("linear", "central", "duif", "navigation"):
        log = LOGS[name]()
        run = meshkal_log.read(stream(log.items()[0] + cbor2.dumps({"end": "complete", "items": 0})))
        h = log.header
        assert run.step.shape == run.time_s.shape == (0,) and run.end == "complete"
        assert run.estimate.shape == (0, h["estimators"], h["states"])
        assert run.measurements.shape == (0, sum(h["rows"])) and run.nis.dtype == ("<f8" if log.real == "float64" else "<f4")
        assert "truth" not in run


def test_not_a_log(tmp_path):
    (tmp_path / "text").write_text("hello")
    for source, what in ((stream(b"hello"), "not a Meshkal log"), (stream(b""), "empty"), (tmp_path / "text", "not a Meshkal log")):
        with pytest.raises(LogError, match=what):
            meshkal_log.read(source)
    with pytest.raises(FileNotFoundError):
        meshkal_log.read(tmp_path / "missing")
    with pytest.raises(LogError, match="no log is given"):
        meshkal_log.read([])


def test_unknown_arrays_are_left_out_with_a_warning():
    log = Log(nodes=2, steps=3)
    log.arrays["from_the_future"] = log.arrays["nis"]
    with pytest.warns(LogWarning, match="from_the_future"):
        run = meshkal_log.read(stream(log.data()))
    assert "from_the_future" not in run


def test_logs_of_nodes_are_one(tmp_path):
    paths = one_by_one(tmp_path)
    log = Log(nodes=5)
    with pytest.warns(LogWarning):
        run = meshkal_log.read(paths)
    assert run.estimator_nodes == tuple(range(5)) and run.header_item["slots"] == log.header["slots"]
    np.testing.assert_array_equal(run.theta[:, 3], log.arrays["theta"][0, :, 3])
    with pytest.raises(LogError, match="given twice"):
        meshkal_log.read([paths[0], paths[0]])


def test_memory_is_the_arrays_once(monkeypatch):
    log = Log(nodes=100, steps=600)
    data = stream(log.data())
    monkeypatch.setattr(reader, "BATCH_BYTES", 1 << 20)
    tracemalloc.start()
    run = meshkal_log.read(data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    arrays = [run[key].nbytes for key in run]
    assert sum(arrays) > 5 << 20
    assert peak < sum(arrays) + max(arrays) + (4 << 20), (peak, sum(arrays), max(arrays))


def test_every_array_of_the_format_has_a_place():
    """A new array in the format is in `read`, tables and messages, or this fails."""
    for log in (Log(nodes=2, steps=1), TrackingLog(steps=1), LOGS["navigation"]()):
        header = meshkal_log.read(stream(log.items()[0] + cbor2.dumps({"end": "complete", "items": 0}))).header
        for monitor in ("", *MONITORS):
            assert lengths(header.__class__(**{**header.__dict__, "monitor": monitor})).keys() <= ARRAYS.keys() | {"time_s"}


def test_import_is_quick():
    check = "import sys, meshkal_log; print([m for m in ('rerun', 'matplotlib', 'pyarrow', 'google.protobuf', 'mcap') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, env={"PYTHONPATH": str(PACKAGE)}, check=True)
    assert done.stdout == "[]\n"
