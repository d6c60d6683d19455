# SPDX-License-Identifier: MIT
"""Ctrl-C and its like while a log is read: what was read is a whole recording. The bar on a terminal."""

import fcntl
import io
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import cbor2
import numpy as np
import pytest
from readback import PACKAGE, Recording
from synthetic import Log
from synthetic_tracking import TrackingLog

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(PACKAGE)}
STEPS = 1500


@pytest.fixture(scope="module")
def log() -> Log:
    return Log(nodes=12, steps=STEPS)


@pytest.fixture(scope="module")
def data(log) -> bytes:
    return log.data()


def start(*arguments, **streams) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "meshkal_rerun", *map(str, arguments)], env=ENVIRONMENT, **{"stderr": subprocess.PIPE, **streams})


def ready(process: subprocess.Popen) -> None:
    """Waits until the process catches SIGTERM."""
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline and process.poll() is None:
        caught = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{process.pid}/status").read_text())
        if int(caught[1], 16) >> (signal.SIGTERM - 1) & 1:
            return
        time.sleep(0.002)
    raise AssertionError("it does not catch signals")


def taken(pipe) -> None:
    """Waits until what was written into the pipe was read."""
    deadline = time.monotonic() + 30
    while struct.unpack("i", fcntl.ioctl(pipe.fileno(), termios.FIONREAD, b"\0" * 4))[0]:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.1)


def held(log: Log, output: Path) -> int:
    """How many steps the recording has; they are those of the log."""
    theta = Recording(output).series("theta/node/3")
    np.testing.assert_array_equal(theta, log.arrays["theta"][0, : len(theta), 3])
    return len(theta)


# --- a pipe ----------------------------------------------------------------------------------------------------------------


def into_pipe(tmp_path, items: list[bytes]) -> subprocess.Popen:
    process = start("-", "-o", tmp_path / "run.rrd", stdin=subprocess.PIPE)
    process.stdin.write(b"".join(items))
    process.stdin.flush()
    ready(process)
    taken(process.stdin)
    return process


def test_reads_a_pipe_while_it_is_written(tmp_path):
    log = Log(nodes=3, steps=20)
    process = start("-", "-o", tmp_path / "run.rrd", stdin=subprocess.PIPE)
    for item in log.items():
        for half in (item[: len(item) // 2], item[len(item) // 2 :]):
            process.stdin.write(half)
            process.stdin.flush()
            time.sleep(0.002)
    assert not (tmp_path / "run.rrd").exists()
    _, stderr = process.communicate(timeout=60)
    assert (process.returncode, stderr) == (0, b"")
    np.testing.assert_array_equal(Recording(tmp_path / "run.rrd").series("theta/node/1"), log.arrays["theta"][0, :, 1])


def test_first_interrupt_leaves_the_end_to_the_simulator(tmp_path, log):
    process = into_pipe(tmp_path, log.items()[:800])
    process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    process.stdin.write(cbor2.dumps({"end": "interrupted", "items": 799}))
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 0 and b"interrupted after 799 step items" in stderr
    assert held(log, tmp_path / "run.rrd") == 799


@pytest.mark.parametrize("signals", [[signal.SIGTERM], [signal.SIGINT, signal.SIGINT], [signal.SIGHUP]])
def test_what_came_out_of_the_pipe_is_recorded(tmp_path, log, signals):
    process = into_pipe(tmp_path, [*log.items()[:800], log.items()[800][:100]])
    for number in signals:
        process.send_signal(number)
        time.sleep(0.2)
    status = process.wait(60)
    stderr = process.stderr.read().decode()
    assert status == 128 + signals[-1]
    name = {signal.SIGTERM: "SIGTERM", signal.SIGINT: "Ctrl-C", signal.SIGHUP: "SIGHUP"}[signals[-1]]
    assert f"stopped by {name} at step 798 of {STEPS}: run.rrd holds steps 0 to 798\n" in stderr
    assert held(log, tmp_path / "run.rrd") == 799 and os.listdir(tmp_path) == ["run.rrd"]
    process.stdin.close()


def test_nothing_came_out_of_the_pipe(tmp_path, log):
    process = into_pipe(tmp_path, log.items()[:1])
    process.send_signal(signal.SIGTERM)
    status = process.wait(60)
    stderr = process.stderr.read().decode()
    assert status == 143 and "stopped by SIGTERM before the first step" in stderr and stderr.count("\n") == 1
    assert os.listdir(tmp_path) == []
    process.stdin.close()


def test_ignored_signals_stay_ignored(tmp_path, log, data):
    """Of nohup, and of jobs that a script starts in the background."""
    (tmp_path / "run.cbor").write_bytes(data)
    process = start(tmp_path / "run.cbor", preexec_fn=lambda: (signal.signal(signal.SIGINT, signal.SIG_IGN), signal.signal(signal.SIGHUP, signal.SIG_IGN)))
    ready(process)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGHUP)
    assert process.communicate(timeout=60)[1] == b"" and process.returncode == 0
    assert held(log, tmp_path / "run.rrd") == STEPS


# --- a file ----------------------------------------------------------------------------------------------------------------


class Tripped:
    """Interrupts, one of which comes when it was asked for so often."""

    def __init__(self, after: int) -> None:
        self._left, self.spare, self.name, self.exit_status = after, False, "Ctrl-C", 130

    @property
    def came(self) -> bool:
        self._left -= 1
        return self._left < 0


@pytest.mark.parametrize("kind", [Log, TrackingLog])
@pytest.mark.parametrize("reading", [0, 1])
@pytest.mark.parametrize("step", [0, 7, 10, 11])
def test_stopped_at_any_step_of_either_reading(tmp_path, kind, reading, step):
    """In the first reading, too: what it saw is written."""
    from contextlib import ExitStack

    from meshkal_rerun.conversion import Logs, Wanted, convert_logs

    log = kind(steps=12)
    # Once when the logs are opened, once a step.
    interrupts = Tripped(1 + 12 * reading + step)
    stream = io.BufferedReader(io.BytesIO(log.data()))
    first = log.first_step
    with ExitStack() as keep:
        logs = Logs({"log": stream}, keep, interrupts)
        done = convert_logs(logs, tmp_path / "run.rrd", Wanted())
        assert logs.stopped == f"stopped by Ctrl-C at step {first + step} of 12" and done.steps == (first, first + step)
    recording = Recording(tmp_path / "run.rrd")
    np.testing.assert_array_equal(recording.series("trace_covariance/node/1"), log.arrays["trace_covariance"][0, : step + 1, 1])
    assert "not read to its end" in recording.summary()


@pytest.mark.parametrize("delay", [0.0, 0.5, 0.8, 1.1])
def test_interrupted_at_any_moment(tmp_path, log, data, delay):
    (tmp_path / "run.cbor").write_bytes(data)
    process = start(tmp_path / "run.cbor")
    ready(process)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    stderr = process.communicate(timeout=60)[1].decode()
    if "before the first step" in stderr:
        assert process.returncode == 130 and os.listdir(tmp_path) == ["run.cbor"]
        return
    count = held(log, tmp_path / "run.rrd")
    if process.returncode in (0, -signal.SIGINT):  # when all was written, while Python ended
        assert stderr == "" and count == STEPS
    else:
        assert process.returncode == 130 and stderr.count("\n") == 1
        assert f"stopped by Ctrl-C at step {count - 1} of {STEPS}: run.rrd holds step" in stderr
    assert sorted(os.listdir(tmp_path)) == ["run.cbor", "run.rrd"]


def test_a_second_one_leaves_nothing(tmp_path, data):
    (tmp_path / "run.cbor").write_bytes(data)
    process = start(tmp_path / "run.cbor")
    ready(process)
    deadline = time.monotonic() + 30
    while not list(tmp_path.glob(".run.rrd.*.tmp")) and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    time.sleep(0.02)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    stderr = process.communicate(timeout=60)[1].decode()
    assert process.returncode == 130 and "Traceback" not in stderr and time.monotonic() - began < 3
    # The first one may have been quicker.
    assert ("what was not whole is not written" in stderr) == (os.listdir(tmp_path) == ["run.cbor"])
    assert not list(tmp_path.glob(".run.rrd.*"))


# --- the bar ---------------------------------------------------------------------------------------------------------------


def on_terminal(*arguments, **streams) -> tuple[int, str]:
    main, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 100, 0, 0))
    process = start(*arguments, stderr=terminal, **streams)
    os.close(terminal)
    out = b""
    try:
        while piece := os.read(main, 1 << 16):
            out += piece
    except OSError:  # the terminal's way to say that all have left
        pass
    os.close(main)
    return process.wait(60), out.decode()


def screen(text: str) -> list[str]:
    """What is left to be seen: a carriage return goes back to the beginning of the line."""
    lines = []
    for line in text.replace("\r\n", "\n").split("\n"):
        shown = ""
        for part in re.sub(r"\x1b\[\w+", "", line).split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return lines


@pytest.fixture(scope="module")
def cut(data, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("bar") / "run.cbor"
    path.write_bytes(data[:-8])  # for a message beside the bar
    return path


def test_a_bar_on_a_terminal_and_none_in_a_pipe(tmp_path, cut):
    status, text = on_terminal(cut, "-o", tmp_path / "run.rrd")
    said = f"meshkal-rerun: {cut}: warning: the log was cut: it ends after {STEPS} step items, without its end item"
    assert status == 0 and re.search(r"reading: +\d+%\|.*B/s, \d+ steps", text), text
    assert [line for line in screen(text) if line] == [said]
    percents = [int(p) for p in re.findall(r"(\d+)%\|", text)]
    assert percents == sorted(percents) and percents[-1] >= 50
    process = start(cut, "-o", tmp_path / "run.rrd")
    assert process.communicate(timeout=60)[1].decode() == said + "\n"


def test_bytes_of_a_pipe_whose_length_nobody_knows(tmp_path, data):
    source = tmp_path / "run.cbor"
    source.write_bytes(data)
    slowly = subprocess.Popen(["bash", "-c", f"for i in 1 2 3; do head -c 100000; sleep 0.2; done <{source}; tail -c +300001 {source}"], stdout=subprocess.PIPE)
    status, text = on_terminal("-", "-o", tmp_path / "run.rrd", stdin=slowly.stdout)
    slowly.stdout.close()
    assert slowly.wait(60) == 0 and status == 0
    assert re.search(r"receiving -: [\d.]+.?B ", text) and re.search(r"reading: +\d+%\|.*steps", text), text
    assert [line for line in screen(text) if line] == []
