# SPDX-License-Identifier: MIT
"""From logs to a recording in a file: a first reading finds what to show, a second one writes it."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from meshkal_log.fields import Batch
from meshkal_log.joined import JoinedReader
from meshkal_log.reader import LogError, LogReader
from meshkal_log.scenario import parse_scenario
from meshkal_log.together import check_comparable, groups, labels, spans

from .numbers.difference import Difference, Differences
from .numbers.survey import ALL_NAMED, focus, survey
from .recording.colours import Palette
from .recording.comparison import Compared, Comparison
from .recording.output import recording_file
from .recording.recorder import Recorder, recording_id
from .views.blueprint import blueprint

# Nodes that are named since their errors differ most between logs.
STRIKING = 3


@dataclass(frozen=True)
class Wanted:
    """What is to be shown."""

    run: int = 0
    view: str | None = None  # of views.blueprint.VIEWS; None: chosen by what is in the log
    nodes: tuple[int, ...] = ()  # to be named, before those that a survey finds


class Logs:
    """Logs by their names, that can be read from their beginnings again. Input that cannot go back is kept in a temporary file."""

    def __init__(self, streams: dict[str, BinaryIO], keep: ExitStack) -> None:
        self._streams = {name: stream if stream.seekable() else _kept(stream, keep) for name, stream in streams.items()}
        self._groups: list[list[str]] | None = None

    def open(self) -> list[Compared]:
        """The log that is shown, and those that it is compared with. Logs of nodes of one network are one log together."""
        readers = {name: self._reader(name) for name in self._streams}
        if self._groups is None:
            headers = {name: reader.header for name, reader in readers.items()}
            self._groups = groups(headers, lambda name: spans(self._reader(name)))
            if len(readers) > 1:
                readers = {name: self._reader(name) for name in self._streams}
        parts = [(names[0], {name: readers[name] for name in names}) for names in self._groups]
        whole = [(first, JoinedReader(part) if len(part) > 1 else part[first]) for first, part in parts]
        (first_name, first), *others = whole
        for name, other in others:
            check_comparable(first_name, first.header, name, other.header)
        return [Compared(name, label, reader) for (name, reader), label in zip(whole, labels([reader.header for _, reader in whole]))]

    def _reader(self, name: str) -> LogReader:
        self._streams[name].seek(0)
        try:
            return LogReader(self._streams[name])
        except LogError as error:
            raise LogError(f"{name}: {error}" if len(self._streams) > 1 else str(error)) from None


def _kept(stream: BinaryIO, keep: ExitStack) -> BinaryIO:
    kept = keep.enter_context(tempfile.TemporaryFile())
    shutil.copyfileobj(stream, kept, 1 << 20)
    kept.flush()
    return open(kept.fileno(), "rb", closefd=False)


def convert(streams: dict[str, BinaryIO], output: Path, wanted: Wanted) -> list[str]:
    """Writes the recording of one run and returns warnings for the user. Several logs: those of nodes of one network; or of the same network by other
    filters, settings or programs, the first of which is shown and the others are compared with it. Raises LogError or OSError and leaves
    `output` alone."""
    with ExitStack() as keep:
        logs = Logs(streams, keep)
        shown, *others = logs.open()
        header, scenario = shown.reader.header, parse_scenario(shown.reader.header)
        differences = [Differences(header, other.reader.header, scenario, _named(other, wanted.run)) for other in others]
        found = survey(_watched(shown.reader.batches(wanted.run), differences), header, scenario)
        if not found.steps:
            raise LogError(f"the log has no step of run {wanted.run}")
        results = [difference.result() for difference in differences]
        for other, result in zip(others, results):
            if not result.steps:
                raise LogError(f"{other.name} cannot be compared with {shown.name}: they have no step of run {wanted.run} in common")
        named = focus(header, found, (*wanted.nodes, *_striking(results)))
        shown, *others = logs.open()
        others = [replace(other, found=result) for other, result in zip(others, results)]
        compared = [(shown.label, None), *((other.label, other.found) for other in others)] if others else []
        batches = shown.reader.batches(wanted.run)
        first = next(batches)
        screen = blueprint(header, scenario, first, found, named, compared, wanted.view)
        ids = [recording_id(other.reader.header, wanted.run) for other in others]
        with recording_file(output, recording_id(header, wanted.run, ids), screen) as rec:
            recorder = Recorder(rec, header, scenario, wanted.run, found, named)
            beside = Comparison(rec, shown, others, scenario, wanted.run, Palette(header, named), named) if others else None
            batch = first
            del first
            while batch is not None:
                recorder.batch(batch)
                if beside:
                    beside.batch(batch)
                batch = next(batches, None)
            recorder.finish(shown.reader.end, beside.finish() if beside else [])
        return shown.reader.warnings + [f"{other.name}: {text}" for other in others for text in other.reader.warnings]


def _watched(batches: Iterator[Batch], differences: Sequence[Differences]) -> Iterator[Batch]:
    for batch in batches:
        for difference in differences:
            difference.batch(batch)
        yield batch


def _named(other: Compared, run: int) -> Iterator[Batch]:
    """Its batches; what is wrong with them is said with its name."""
    try:
        yield from other.reader.batches(run)
    except LogError as error:
        raise LogError(f"{other.name}: {error}") from None


def _striking(results: Sequence[Difference]) -> tuple[int, ...]:
    """Nodes whose errors differ most: where there are many, they are named before the worst ones."""
    nodes = [k for result in results if len(result.pairing) > ALL_NAMED for k in result.striking(STRIKING // len(results) or 1)]
    return tuple(dict.fromkeys(nodes))
