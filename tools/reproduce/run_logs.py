# SPDX-License-Identifier: MIT
"""What a run's log says, and its recording."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import cbor2
import numpy as np
import rerun as rr
from meshkal_rerun.conversion import Wanted, convert
from meshkal_log.reader import ARRAY_DTYPES, LogError, LogReader
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


def every_run(stream: BinaryIO, keys: Iterable[str]) -> dict[str, np.ndarray]:
    """Quantities of all runs, (runs, steps, length); those that the log has. Whether it ends, and nothing else, is checked."""
    decoder = cbor2.CBORDecoder(stream)
    try:
        header, item = decoder.decode(), decoder.decode()
        wanted = [key for key in keys if key in item]
        dtypes = {key: ARRAY_DTYPES[item[key].tag] for key in wanted}
        parts = {key: [] for key in wanted}
        while "end" not in item:
            for key in wanted:
                parts[key].append(item[key].value)
            item = decoder.decode()
    except (cbor2.CBORDecodeError, AttributeError, KeyError, TypeError) as error:
        raise ReproduceError(f"a log cannot be read: {error}") from None
    if item["end"] != "complete":
        raise ReproduceError("a log was cut")
    return {key: np.frombuffer(b"".join(parts[key]), dtypes[key]).reshape(header["runs"], header["steps"], -1) for key in wanted}


def record(logs: list[Path], output: Path) -> None:
    """The recording of the first log's filter, the others compared with it."""
    rr.set_strict_mode(True)
    try:
        with ExitStack() as streams:
            convert({path.stem: streams.enter_context(path.open("rb")) for path in logs}, output, Wanted())
    except LogError as error:
        raise ReproduceError(f"{output}: {error}") from None
