# SPDX-License-Identifier: MIT
"""Opens one log, or several of nodes of one network as one, and goes through its runs."""

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

from .fields import Batch
from .joined import JoinedReader
from .layout import whole_rows
from .reader import LogError, LogReader

Source = str | os.PathLike | BinaryIO


@contextmanager
def opened(source: Source | Sequence[Source]) -> Iterator[LogReader]:
    """A reader of a path or a binary stream that can peek; of a list of them, whose logs are joined. Raises LogError, OSError."""
    with ExitStack() as streams:

        def reader(one: Source) -> LogReader:
            return LogReader(streams.enter_context(open(one, "rb")) if isinstance(one, (str, os.PathLike)) else one)

        if isinstance(source, (list, tuple)):
            readers = {}
            for one in source:
                name = str(Path(one)) if isinstance(one, (str, os.PathLike)) else f"log {len(readers)}"
                if name in readers:
                    raise LogError(f"{name} is given twice")
                try:
                    readers[name] = reader(one)
                except LogError as error:
                    raise LogError(f"{name}: {error}") from None
            if not readers:
                raise LogError("no log is given")
            if len(readers) > 1:
                yield JoinedReader(readers)
            else:
                yield next(iter(readers.values()))
        else:
            yield reader(source)


def batches_of(reader: LogReader, run: int | None) -> Iterator[tuple[int, Batch]]:
    """(run, batch by `whole_rows`) of one run, or of all, one after another, in one pass; `reader.end` and `reader.warnings` are whole afterwards."""
    found = False
    for number, batch in reader.numbered_batches() if run is None else ((run, batch) for batch in reader.batches(run)):
        found = True
        yield number, whole_rows(batch, reader.header)
    if run is not None and not found and run >= reader.header.runs:
        raise LogError(f"the log has no step of run {run}")
