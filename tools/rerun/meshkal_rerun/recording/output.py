# SPDX-License-Identifier: MIT
"""Where recordings go: an .rrd file, whole or not at all, or standard output."""

import os
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from meshkal_log.output import whole_file

APPLICATION_ID = "meshkal"


@contextmanager
def recording_file(output: Path, recording_id: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """A stream to log into. `output` is there when the block ends without an exception, and is as it was otherwise. Raises OSError."""
    rec = _recording(recording_id)
    with whole_file(output) as temporary:
        with open(temporary, "wb") as file:
            writing = _Writing(file.fileno())
            try:
                rec.save(writing.path, default_blueprint=blueprint)
                yield rec
            finally:
                rec.disconnect()
                writing.finish()
        if writing.error:
            raise OSError(f"{output} could not be written whole: {writing.error.strerror}")
        _check_whole(temporary)


class _Writing:
    """What rerun writes to `path` goes to a file. Where it cannot be written, rerun itself may wait for ever for a thread of its own that has failed: so it
    does not hear of it, and `error` is there at the end."""

    def __init__(self, file: int) -> None:
        self.error: OSError | None = None
        self._read, self._write = os.pipe()
        self.path = f"/proc/self/fd/{self._write}"
        self._thread = threading.Thread(target=self._copy, args=(file,), daemon=True)
        self._thread.start()

    def finish(self) -> None:
        os.close(self._write)
        self._thread.join()
        os.close(self._read)

    def _copy(self, file: int) -> None:
        while data := os.read(self._read, 1 << 20):
            while data and not self.error:
                try:
                    data = data[os.write(file, data) :]
                except OSError as error:
                    self.error = error


@contextmanager
def recording_to_stdout(recording_id: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """What was sent by then is there also after an exception. Raises OSError."""
    rec = _recording(recording_id)
    if sys.stdout is None or sys.stdout.isatty():
        raise OSError("a recording is not for a terminal")
    rec.stdout(default_blueprint=blueprint)
    try:
        yield rec
    finally:
        rec.disconnect()


def _recording(recording_id: str) -> rr.RecordingStream:
    rec = rr.RecordingStream(APPLICATION_ID, recording_id=recording_id)
    if not rec.is_enabled():
        raise OSError("rerun is switched off by the environment variable RERUN")
    return rec


def _check_whole(path: Path) -> None:
    """rerun writes in a thread of its own, which only prints that a disk is full. The footer, written last, tells a whole file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            RrdReader(path).recordings()
    except Exception:
        raise OSError("the recording could not be written whole (is the disk full?)") from None
