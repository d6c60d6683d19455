# SPDX-License-Identifier: MIT
"""What a run's log says, and its recording."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rerun as rr
from meshkal_rerun.cli import convert_joined
from meshkal_rerun.reader import LogError, LogReader
from program import ReproduceError


def over_time(path: Path, key: str) -> np.ndarray:
    """One quantity of the first run; steps are the first axis."""
    try:
        with path.open("rb") as stream:
            reader = LogReader(stream)
            values = np.concatenate([getattr(batch, key) for batch in reader.batches(0)])
    except LogError as error:
        raise ReproduceError(f"{path}: {error}") from None
    if reader.end != "complete":
        raise ReproduceError(f"{path}: the log was cut")
    return values


def record(logs: list[Path], output: Path) -> None:
    """The recording of the first log's filter, the others compared with it."""
    rr.set_strict_mode(True)
    try:
        with ExitStack() as streams:
            convert_joined({path.stem: streams.enter_context(path.open("rb")) for path in logs}, output, 0)
    except LogError as error:
        raise ReproduceError(f"{output}: {error}") from None
