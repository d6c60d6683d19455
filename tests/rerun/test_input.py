# SPDX-License-Identifier: MIT
"""Logs that are cut, damaged, of another kind or not logs; the command around them."""

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cbor2
import numpy as np
import pytest
from readback import PACKAGE, Recording, command, convert
from synthetic import Log, typed

from meshkal_log.reader import LogError, LogReader


def read(data: bytes, run: int = 0):
    reader = LogReader(io.BufferedReader(io.BytesIO(data)))
    return reader, list(reader.batches(run))


def test_every_cut_reads_up_to_the_cut():
    log = Log(nodes=2, steps=4)
    items = log.items()
    data = b"".join(items)
    ends = np.cumsum([len(item) for item in items])
    for cut in range(len(data)):
        whole = int(np.searchsorted(ends, cut, side="right"))  # items that are there whole
        if whole < 1:
            with pytest.raises(LogError, match="empty" if cut == 0 else "ends inside the header"):
                read(data[:cut])
            continue
        reader, batches = read(data[:cut])
        steps = [t for batch in batches for t in batch.step.tolist()]
        assert steps == list(range(min(whole - 1, 4)))
        assert reader.end is None
        assert reader.warnings == [f"the log was cut: it ends after {whole - 1} step items, without its end item"]
        if steps:
            np.testing.assert_array_equal(batches[0].theta, log.arrays["theta"][0, : len(steps)])


def test_cut_log_on_the_command_line(tmp_path):
    items = Log(nodes=3, steps=10).items()
    (tmp_path / "cut.cbor").write_bytes(b"".join(items[:6]) + items[6][:50])
    done = command(tmp_path / "cut.cbor", "-o", tmp_path / "run.rrd")
    assert done.returncode == 0
    assert b"warning: the log was cut: it ends after 5 step items" in done.stderr
    recording = Recording(tmp_path / "run.rrd")
    assert len(recording.series("theta/node/0")) == 5
    assert "**cut" in recording.summary()


def test_interrupted_run_is_said(tmp_path):
    log = Log(nodes=3, steps=4)
    log.end = "interrupted"
    recording, remarks = convert(log.data(), tmp_path / "run.rrd")
    assert remarks == ["the run was interrupted after 4 step items"]
    assert "run was interrupted" in recording.summary()


def refuse(tmp_path, data: bytes, message: str, *options):
    """Exit status 2, one line on stderr, and the output as it was."""
    output = tmp_path / "out" / "run.rrd"
    output.parent.mkdir()
    output.write_bytes(b"before")
    done = command("-", "-o", output, *options, stdin=data)
    assert done.returncode == 2
    assert message in done.stderr.decode()
    assert done.stderr.count(b"\n") == 1
    assert output.read_bytes() == b"before"
    assert os.listdir(output.parent) == ["run.rrd"]


def header_with(**changes) -> bytes:
    header = {**cbor2.loads(Log(nodes=2, steps=2).items()[0]), **changes}
    return cbor2.dumps(header) + b"".join(Log(nodes=2, steps=2).items()[1:])


def step_with(where: int = 2, **changes) -> bytes:
    """A log of two nodes and four steps, with one step item changed."""
    items = Log(nodes=2, steps=4).items()
    item = {**cbor2.loads(items[where]), **changes}
    items[where] = cbor2.dumps({key: value for key, value in item.items() if value is not None})
    return b"".join(items)


BAD = {
    "empty": (lambda: b"", "the input is empty"),
    "text": (lambda: b'{"name": "a scenario"}\n', "not a Meshkal log"),
    "binary": (lambda: bytes(range(256)), "not a Meshkal log"),
    "another map": (lambda: cbor2.dumps({"format": "other"}), "not a Meshkal log"),
    "broken map": (lambda: b"\xa1\xff\xff", "not a Meshkal log"),
    "version": (lambda: header_with(format_version=2), "log format version 2 is not supported"),
    "header only": (lambda: Log(nodes=2, steps=2).items()[0], "the log has no step of run 0"),
    "header cut": (lambda: Log(nodes=2, steps=2).items()[0][:-3], "ends inside the header"),
    "no dt": (lambda: header_with(dt_s=0), "header: dt_s is missing or wrong"),
    "endless time": (lambda: header_with(dt_s=1e300), "beyond the clock"),
    "estimators": (lambda: header_with(estimators=1), "1 estimators do not fit filter rkfdu with 2 nodes"),
    "slots": (lambda: header_with(slots=[[0], [2]]), "header: slots is missing or wrong"),
    "filter": (lambda: header_with(filter="ekf"), "header: filter is missing or wrong"),
    "scenario": (lambda: header_with(scenario="{"), "the scenario is not JSON"),
    "length": (lambda: step_with(theta=typed([1.0], "<f8")), "item 3 (run 0, step 1): theta has 1 numbers instead of 2"),
    "type": (lambda: step_with(theta=typed([1.0, 1.0], "<f4")), "theta is missing or not an array of float64"),
    "odd bytes": (lambda: step_with(theta=cbor2.CBORTag(86, b"123")), "item 3 is damaged"),
    "lost array": (lambda: step_with(theta=None), "theta is missing"),
    "lost truth": (lambda: step_with(truth=None), "truth is in some steps and not in others"),
    "order": (lambda: step_with(step=0), "comes after step 0"),
    "negative step": (lambda: step_with(step=-1), "step is missing or not an unsigned number"),
    "not a map": (lambda: Log(nodes=2, steps=2).items()[0] + b"\x01", "item 2 is not a map"),
    "damage": (lambda: b"".join(Log(nodes=2, steps=2).items()[:2]) + b"\xff" * 20, "item 3"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(tmp_path, case):
    make, message = BAD[case]
    refuse(tmp_path, make(), message)


def test_a_run_that_is_not_there(tmp_path):
    refuse(tmp_path, Log(nodes=2, steps=2, runs=2).data(), "run 2 is not in the log", "--run", "2")


@pytest.mark.parametrize("indices", [[], [0, 9], "01", [0, 1, 2, 3]])
def test_position_states_that_are_not_states(tmp_path, indices):
    log = Log(nodes=2, steps=2)
    log.scenario["model"]["position_states"] = indices
    refuse(tmp_path, log.data(), "position_states is not a list of 1 to 3 states from 0 to 3")


def test_altered_scenario_is_told(tmp_path):
    _, remarks = convert(header_with(scenario_sha256="0" * 64), tmp_path / "run.rrd")
    assert remarks == ["the scenario in the log does not match its SHA-256"]


def test_where_nothing_can_be_written(tmp_path):
    data = Log(nodes=2, steps=2).data()
    for output in (tmp_path / "none" / "run.rrd", tmp_path):
        done = command("-", "-o", output, stdin=data)
        assert done.returncode == 2 and done.stderr.count(b"\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_rerun_switched_off_is_an_error(tmp_path):
    done = command("-", "-o", tmp_path / "run.rrd", stdin=Log(nodes=2, steps=2).data(), RERUN="off")
    assert done.returncode == 2 and b"switched off" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_full_disk_leaves_nothing(tmp_path):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=20, steps=200).data())
    (tmp_path / "out").mkdir()
    script = f"ulimit -f 200; exec {sys.executable} -m meshkal_rerun {tmp_path}/run.cbor -o {tmp_path}/out/run.rrd"
    done = subprocess.run(["bash", "-c", script], capture_output=True, env={**os.environ, "PYTHONPATH": str(PACKAGE)}, check=False)
    assert done.returncode == 2 and b"could not be written whole" in done.stderr
    assert list((tmp_path / "out").iterdir()) == []


def pipe(output: Path) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "meshkal_rerun", "-", "-o", str(output)],
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(PACKAGE)},
    )


def test_reads_a_pipe_while_it_is_written(tmp_path):
    log = Log(nodes=3, steps=20)
    process = pipe(tmp_path / "run.rrd")
    for item in log.items():
        for half in (item[: len(item) // 2], item[len(item) // 2 :]):
            process.stdin.write(half)
            process.stdin.flush()
            time.sleep(0.002)
    assert not (tmp_path / "run.rrd").exists()
    _, stderr = process.communicate(timeout=60)
    assert (process.returncode, stderr) == (0, b"")
    np.testing.assert_array_equal(Recording(tmp_path / "run.rrd").series("theta/node/1"), log.arrays["theta"][0, :, 1])


def started(tmp_path) -> subprocess.Popen:
    """A process that has made its temporary file and waits for more of the log."""
    process = pipe(tmp_path / "run.rrd")
    # Enough for a first batch, which is what makes it open its output.
    items = Log(nodes=1, steps=5000, position_states=None).items()
    process.stdin.write(b"".join(items[:4500]))
    process.stdin.flush()
    deadline = time.monotonic() + 30
    while not list(tmp_path.glob(".run.rrd.*.tmp")):
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.05)
    return process


def test_first_interrupt_leaves_the_end_to_the_simulator(tmp_path):
    process = started(tmp_path)
    process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    process.stdin.write(cbor2.dumps({"end": "interrupted", "items": 4499}))
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 0 and b"interrupted after 4499 step items" in stderr
    assert len(Recording(tmp_path / "run.rrd").series("theta/node/0")) == 4499


def test_terminated_leaves_nothing(tmp_path):
    process = started(tmp_path)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert list(tmp_path.iterdir()) == []
