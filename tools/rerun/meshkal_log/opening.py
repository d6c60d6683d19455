# SPDX-License-Identifier: MIT
"""Opens one log, or several of nodes of one network as one, and goes through its runs."""

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO

from .fields import Batch, lengths
from .joined import JoinedReader
from .layout import whole_rows
from .reader import LogError, LogReader

Source = str | os.PathLike | BinaryIO


class NotingReader(LogReader):
    """Says in `warnings` which arrays of the log it does not know; they are left out."""

    def _steps(self) -> Iterator[dict]:
        known, unknown = {*lengths(self.header), "run", "step"}, set()
        for item in super()._steps():
            if not known.issuperset(item):
                unknown |= item.keys() - known
            yield item
        if unknown:
            self.warnings.append(f"left out, because this program does not know what it is: {', '.join(sorted(map(str, unknown)))}")


@contextmanager
def opened(source: Source | Sequence[Source]) -> Iterator[LogReader]:
    """A reader of a path or a binary stream that can peek; of a list of them, whose logs are joined. Raises LogError, OSError."""
    with ExitStack() as streams:

        def reader(one: Source) -> LogReader:
            return NotingReader(streams.enter_context(open(one, "rb")) if isinstance(one, (str, os.PathLike)) else one)

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


class _OneRun(LogReader):
    """The items of one run among those of another reader."""

    def __init__(self, whole: LogReader, items: Iterator[dict]) -> None:
        self.header, self.end, self.warnings = whole.header, None, []
        self._whole, self._given = whole, items

    @property
    def _items(self) -> int:
        return self._whole._items

    def _steps(self) -> Iterator[dict]:
        return self._given


def batches_of(reader: LogReader, run: int | None) -> Iterator[tuple[int, Batch]]:
    """(run, batch by `whole_rows`) of one run, or of all, one after another, in one pass; `reader.end` and `reader.warnings` are whole afterwards."""
    if run is not None:
        found = False
        for batch in reader.batches(run):
            found = True
            yield run, whole_rows(batch, reader.header)
        if not found and run >= reader.header.runs:
            raise LogError(f"the log has no step of run {run}")
        return
    for number, items in groupby(reader._steps(), key=itemgetter("run")):
        for batch in _OneRun(reader, items).batches(number):
            yield number, whole_rows(batch, reader.header)
