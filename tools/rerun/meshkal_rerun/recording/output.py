# SPDX-License-Identifier: MIT
"""Writes an .rrd file whole or not at all."""

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
    rec = rr.RecordingStream(APPLICATION_ID, recording_id=recording_id)
    if not rec.is_enabled():
        raise OSError("rerun is switched off by the environment variable RERUN")
    with whole_file(output) as temporary:
        rec.save(temporary, default_blueprint=blueprint)
        try:
            yield rec
        finally:
            rec.disconnect()
        _check_whole(temporary)


def _check_whole(path: Path) -> None:
    """rerun writes in a thread of its own, which only prints that a disk is full. The footer, written last, tells a whole file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            RrdReader(path).recordings()
    except Exception:
        raise OSError("the recording could not be written whole (is the disk full?)") from None
