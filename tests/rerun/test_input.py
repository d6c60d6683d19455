# SPDX-License-Identifier: MIT
"""Logs that are cut, damaged, of another kind or not logs; the command around them."""

import io
import os
import subprocess
import sys

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


def step_with(where: int = 1, **changes) -> bytes:
    """A log of two nodes and four steps, with one item changed: the first step."""
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
    "header cut": (lambda: Log(nodes=2, steps=2).items()[0][:-3], "ends inside the header"),
    "no dt": (lambda: header_with(dt_s=0), "header: dt_s is missing or wrong"),
    "endless time": (lambda: header_with(dt_s=1e300), "beyond the clock"),
    "estimators": (lambda: header_with(estimators=1), "1 estimators do not fit filter rkfdu with 2 nodes"),
    "slots": (lambda: header_with(slots=[[0], [2]]), "header: slots is missing or wrong"),
    "filter": (lambda: header_with(filter="ekf"), "header: filter is missing or wrong"),
    "scenario": (lambda: header_with(scenario="{"), "the scenario is not JSON"),
    "length": (lambda: step_with(theta=typed([1.0], "<f8")), "): theta has 1 numbers instead of 2"),
    "type": (lambda: step_with(theta=typed([1.0, 1.0], "<f4")), "theta is missing or not an array of float64"),
    "odd bytes": (lambda: step_with(theta=cbor2.CBORTag(86, b"123")), "item 2 (byte "),
    "lost array": (lambda: step_with(theta=None), "theta is missing"),
    "negative step": (lambda: step_with(step=-1), "step is missing or not an unsigned number"),
    "not a map": (lambda: Log(nodes=2, steps=2).items()[0] + b"\x01", "it is not a map"),
    "damage": (lambda: Log(nodes=2, steps=2).items()[0] + b"\xff" * 20, "item 2 (byte "),
    "another run": (lambda: step_with(run=1), "it is of run 1, and the header says 1 runs"),
    "a node that is not there": (lambda: Log(nodes=2, steps=2).data(), "there is no node 2; the log has 0 to 1", "--node", "1,2"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(tmp_path, case):
    make, message, *options = BAD[case]
    refuse(tmp_path, make(), message, *options)


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
    for output, message in ((tmp_path / "none" / "run.rrd", "cannot be written: No such file"), (tmp_path, "is a directory")):
        done = command("-", "-o", output, stdin=data)
        assert done.returncode == 2 and done.stderr.count(b"\n") == 1 and f"{output} {message}".encode() in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("output", ["run.cbor", "link.cbor"])
def test_the_log_is_not_replaced(tmp_path, output):
    data = Log(nodes=2, steps=2).data()
    (tmp_path / "run.cbor").write_bytes(data)
    (tmp_path / "link.cbor").symlink_to("run.cbor")
    done = command(tmp_path / "run.cbor", "-o", tmp_path / output)
    assert done.returncode == 2 and b"would replace the log" in done.stderr
    assert (tmp_path / "run.cbor").read_bytes() == data
    assert sorted(os.listdir(tmp_path)) == ["link.cbor", "run.cbor"]


def test_a_log_that_is_not_there(tmp_path):
    done = command(tmp_path / "none.cbor")
    assert done.returncode == 2 and done.stderr.decode() == f"meshkal-rerun: {tmp_path}/none.cbor: No such file or directory\n"
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_is_given_twice(tmp_path):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=2, steps=2).data())
    done = command(*[tmp_path / "run.cbor"] * 2, "-o", tmp_path / "run.rrd")
    assert done.returncode == 2 and b"is given twice" in done.stderr


@pytest.mark.parametrize("arguments", [[], ["-"], ["run.cbor", "--view", "chess"], ["run.cbor", "--node", "a"], ["run.cbor", "--node", ""], ["run.cbor", "--port", "x"],
                                       ["run.cbor", "--live", "-"], ["--live", "-", "--port", "0"]])
def test_wrong_arguments(arguments):
    done = command(*arguments)
    assert done.returncode == 2 and b"Traceback" not in done.stderr and b"meshkal-rerun: error: " in done.stderr


def test_help_is_quick_and_into_a_closed_pipe():
    script = f"{sys.executable} -X importtime -m meshkal_rerun --help | head -c 1"
    done = subprocess.run(["bash", "-c", script], capture_output=True, env={**os.environ, "PYTHONPATH": str(PACKAGE)}, check=True)
    assert done.stdout == b"u" and b"Traceback" not in done.stderr and b"Exception" not in done.stderr
    imported = {line.rsplit(b"|", 1)[1].strip() for line in done.stderr.splitlines() if b"|" in line}
    assert b"argparse" in imported and not imported & {b"rerun", b"pyarrow", b"matplotlib", b"tqdm", b"mcap"}


def test_closed_standard_streams(tmp_path):
    (tmp_path / "run.cbor").write_bytes(Log(nodes=2, steps=3).data()[:-30])
    script = f"exec {sys.executable} -m meshkal_rerun {tmp_path}/run.cbor >&- 2>&-"
    done = subprocess.run(["bash", "-c", script], env={**os.environ, "PYTHONPATH": str(PACKAGE)}, check=False)
    assert done.returncode == 0 and len(Recording(tmp_path / "run.rrd").series("theta/node/0")) >= 2
    script = f"exec {sys.executable} -m meshkal_rerun - -o {tmp_path}/b.rrd <&-"
    done = subprocess.run(["bash", "-c", script], capture_output=True, env={**os.environ, "PYTHONPATH": str(PACKAGE)}, check=False)
    assert done.returncode == 2 and b"standard input is closed" in done.stderr and not (tmp_path / "b.rrd").exists()


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
