# SPDX-License-Identifier: MIT
"""Live mode as a process, and clients of it that need no window."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import rerun_cli
from readback import PACKAGE, Recording

RERUN = Path(rerun_cli.__file__).with_name("rerun")
DEADLINE_S = 90.0


def wait_for(condition, what: str, seconds: float = DEADLINE_S):
    until = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < until, f"waited in vain for {what}"
        time.sleep(0.02)
    return value


class Live:
    """The process, what it has said, and where its viewers connect."""

    def __init__(self, source: str, output: Path, *options) -> None:
        self.output = output
        command = [sys.executable, "-m", "meshkal_rerun", "--live", source, "-o", str(output), "--port", "0", *map(str, options)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(PACKAGE)})
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        wait_for(lambda: "rerun+http" in self.said or self.process.poll() is not None, "a server")
        self.url = next((word for word in self.said.split() if word.startswith("rerun+http")), "")

    def _read(self) -> None:
        for line in self.process.stderr:
            self._lines.append(line.decode())

    @property
    def said(self) -> str:
        return "".join(self._lines)

    def write(self, *items: bytes) -> None:
        for item in items:
            self.process.stdin.write(item)
        self.process.stdin.flush()

    def kept(self) -> bytes:
        """What it has kept until now, of all logs."""
        return b"".join(path.read_bytes() for path in sorted(self.output.parent.glob("*.part.cbor")))

    def end(self) -> tuple[int, str]:
        """Exit status and what was said."""
        self.process.stdin.close()
        status = self.process.wait(DEADLINE_S)
        self._reader.join(DEADLINE_S)
        return status, self.said


@contextmanager
def live(source: str, output: Path, *options):
    process = Live(source, output, *options)
    try:
        yield process
    finally:
        process.process.kill()
        process.process.wait()


@contextmanager
def client(url: str, path: Path):
    """rerun's own client, which writes what it receives."""
    process = subprocess.Popen([RERUN, url, "--save", path, "--port", "auto", "--bind", "127.0.0.1"], stdin=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()


def size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def rows(path: Path) -> dict:
    """All that is in a recording: of each entity, component and time, the value."""
    out = {}
    for chunk in Recording(path).reader.stream():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        at = batch.column("step").to_pylist() if "step" in names else [None] * batch.num_rows
        seconds = [name for name in names if name in ("sim_time", "time_s")]
        when = batch.column(seconds[0]).cast("int64").to_pylist() if seconds else at
        for name in names:
            if ":" in name and "rerun.controls" not in name:
                for step, time_ns, value in zip(at, when, batch.column(name).to_pylist()):
                    if value is not None:
                        out.setdefault((chunk.entity_path, name), []).append((step, time_ns, repr(value)))
    return {key: sorted(values, key=repr) for key, values in out.items()}


def same(one: Path, other: Path) -> None:
    """The recordings have the same numbers and all else, except when they were made."""
    first, second = ({key: value for key, value in rows(path).items() if "RecordingInfo:start_time" not in key[1]} for path in (one, other))
    assert first.keys() == second.keys()
    for key in first:
        assert first[key] == second[key], key
