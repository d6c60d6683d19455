# SPDX-License-Identifier: MIT
"""Where recordings go: an .rrd file, whole or not at all, or standard output."""

import sys
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
        rec.save(temporary, default_blueprint=blueprint)
        try:
            yield rec
        finally:
            rec.disconnect()
        _check_whole(temporary)


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
