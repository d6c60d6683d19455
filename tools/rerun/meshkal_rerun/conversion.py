# SPDX-License-Identifier: MIT
"""From logs to a recording: a first reading finds what to show, a second one writes it."""

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from meshkal_log.fields import Batch, Header
from meshkal_log.interrupts import Interrupts
from meshkal_log.joined import JoinedReader
from meshkal_log.progress import Progress
from meshkal_log.reader import LogError, LogReader
from meshkal_log.scenario import Scenario, parse_scenario
from meshkal_log.together import Label, check_comparable, groups, labels, spans

from .numbers.difference import Difference, Differences
from .numbers.survey import ALL_NAMED, Survey, focus, survey
from .recording import begun as only_begun
from .recording.colours import Palette
from .recording.comparison import Compared, Comparison
from .recording.output import recording_file
from .recording.recorder import Recorder, recording_id
from .views.blueprint import blueprint

_CHUNK = 1 << 20
# Nodes that are named since their errors differ most between logs.
_STRIKING = 3


@dataclass(frozen=True)
class Wanted:
    """What is to be shown."""

    run: int = 0
    view: str | None = None  # of views.VIEWS; None: chosen by what is in the log
    nodes: tuple[int, ...] = ()  # to be named, before those that a survey finds; satellites by their numbers


@dataclass(frozen=True)
class Converted:
    remarks: list[str]  # for the user
    steps: tuple[int, int] | None  # the first and the last that the recording has

    @property
    def holds(self) -> str:
        if self.steps is None:
            return "no step"
        first, last = self.steps
        return f"step {first}" if first == last else f"steps {first} to {last}"


class Logs:
    """Logs by their names, that can be read from their beginnings again. Input that cannot go back is kept in a temporary file. readings: how many there
    will be, for the bar that shows how far they are."""

    def __init__(self, streams: dict[str, BinaryIO], keep: ExitStack, interrupts: Interrupts | None = None, *, readings: int = 2) -> None:
        self._interrupts = interrupts or Interrupts()  # never entered: none comes
        self._streams = {name: stream if stream.seekable() else self._kept(name, stream, keep) for name, stream in streams.items()}
        # Who writes into the pipe has ended.
        self._interrupts.spare = False
        self._sizes = {name: stream.seek(0, 2) for name, stream in self._streams.items()}
        # A signal that ended the input lets what came be read.
        self._limit = math.inf if self._interrupts.came else None
        self._keep, self._progress = keep, None
        self._opened, self._readings = 0, readings
        self._groups: list[list[str]] | None = None  # names of logs that are one log together
        self._last: dict[str, LogReader] = {}  # by what is said before their warnings

    def open(self) -> list[Compared]:
        """The log that is shown, and those that it is compared with. Logs of nodes of one network are one log together."""
        readers = self._readers()
        if self._groups is None:
            self._groups = groups({name: reader.header for name, reader in readers.items()}, lambda name: spans(name, self._reader(name)))
            readers = self._readers()
        parts = [(names[0], {name: readers[name] for name in names}) for names in self._groups]
        whole = [(first, JoinedReader(part) if len(part) > 1 else part[first]) for first, part in parts]
        (first_name, first), *others = whole
        for name, other in others:
            check_comparable(first_name, first.header, name, other.header)
        self._last = {f"{name}: " if i else "": reader for i, (name, reader) in enumerate(whole)}
        self._follow()
        texts = labels([reader.header for _, reader in whole])
        return [Compared(name, label, reader, self._shown(names)) for (name, reader), label, names in zip(whole, texts, self._groups)]

    def _shown(self, names: Sequence[str]) -> str:
        """The file without its folder, where that is enough, and how many more belong to it."""
        short = [Path(name).name for name in self._streams]
        first = Path(names[0]).name if len(set(short)) == len(short) else names[0]
        return first + (f" and {len(names) - 1} more" if len(names) > 1 else "")

    def _readers(self) -> dict[str, LogReader]:
        return {name: self._reader(name) for name in self._streams}

    def _reader(self, name: str) -> LogReader:
        self._streams[name].seek(0)
        try:
            return LogReader(self._streams[name])
        except LogError as error:
            raise LogError(f"{name}: {error}" if len(self._streams) > 1 else str(error)) from None

    def _follow(self) -> None:
        """All logs are read side by side."""
        size, readers = sum(self._sizes.values()), list(self._last.values())
        if not self._progress:
            self._progress = Progress("reading", self._readings * size)
            self._keep.callback(self._progress.close)
        done = self._opened * size
        self._opened += 1
        for reader in readers:
            reader.watch = partial(self._watch, lambda: done + sum(r.position or 0 for r in readers))

    def quiet(self, readings: int = 2) -> None:
        """Nothing more is shown until the next of so many readings."""
        if self._progress:
            self._progress.close()
        self._progress, self._opened, self._readings = None, 0, readings

    @property
    def damage(self) -> list[str]:
        """Those warnings of the last reading that say where logs are damaged."""
        return [name + text for name, reader in self._last.items() for text in reader.damage]

    @property
    def stopped(self) -> str | None:
        """By which signal the last reading was stopped, and where; the end of what comes from a pipe may have been left there."""
        readers = list(self._last.values())
        if not self._interrupts.came or not (readers[0].end is None or any(reader.end == "stopped" for reader in readers)):
            return None
        steps = readers[0].header.steps
        place = "before the first step" if readers[0].step is None else f"at step {readers[0].step}" + (f" of {steps}" if steps else "")
        return f"stopped by {self._interrupts.name} {place}"

    def _watch(self, position: Callable[[], int], reader: LogReader) -> bool:
        """Reading stops at the first item after a signal; a later reading goes as far."""
        self._progress.at(position, reader.items - 1)
        if self._interrupts.came and self._limit is None:
            self._limit = reader.items
        return self._limit is not None and reader.items >= self._limit

    def _kept(self, name: str, stream: BinaryIO, keep: ExitStack) -> BinaryIO:
        kept = keep.enter_context(tempfile.TemporaryFile())
        progress = Progress(f"receiving {name}", None)
        try:
            while chunk := self._interrupts.read(stream.fileno(), _CHUNK):
                kept.write(chunk)
                progress.at(kept.tell)
        finally:
            progress.close()
        kept.flush()
        return open(kept.fileno(), "rb", closefd=False)


@dataclass(frozen=True)
class Plan:
    """What a first reading of logs found, for the second one."""

    header: Header
    scenario: Scenario
    found: Survey
    named: tuple[int, ...]  # nodes
    compared: tuple[tuple[Label, Difference | None], ...]  # the shown log without, and others with their difference from it; or nothing


Into = Path | Callable[[str, rrb.Blueprint], AbstractContextManager[rr.RecordingStream]]


def convert(streams: dict[str, BinaryIO], output: Into, wanted: Wanted, interrupts: Interrupts | None = None) -> Converted:
    """Writes the recording of one run. Several logs: those of nodes of one network; or of one network by other filters, settings or programs, the
    first of which is shown and the others are compared with it. output: a file, or what makes a stream of an id and a blueprint. Raises LogError or
    OSError and leaves a file alone."""
    with ExitStack() as keep:
        return convert_logs(Logs(streams, keep, interrupts), output, wanted)


def convert_logs(logs: Logs, output: Into, wanted: Wanted) -> Converted:
    """The same of logs that are open."""
    # A filter that diverged has numbers that overflow; that they are infinite then is shown.
    with np.errstate(all="ignore"):
        planned = plan(logs, wanted, begun=True)
        return record(logs, planned, output, wanted) if planned.found.steps else _begun(logs, output, wanted)


def plan(logs: Logs, wanted: Wanted, *, begun: bool = False) -> Plan:
    """begun: the run may have no steps yet. Raises LogError."""
    shown, *others = logs.open()
    header, scenario = shown.reader.header, parse_scenario(shown.reader.header)
    nodes = node_numbers(header, wanted.nodes)
    differences = [Differences(header, other.reader.header, scenario, _named(other, wanted.run)) for other in others]
    found = survey(_beside(shown.reader.batches(wanted.run), differences), header, scenario)
    if not found.steps and logs.stopped:
        raise LogError(f"{logs.stopped} of run {wanted.run}; nothing is written")
    if not found.steps and not begun:
        raise LogError(f"the log has no step of run {wanted.run}")
    if not found.steps:
        return Plan(header, scenario, found, (), ())
    results = [difference.result() for difference in differences]
    for other, result in zip(others, results):
        if not result.steps:
            raise LogError(f"{other.name} cannot be compared with {shown.name}: they have no step of run {wanted.run} in common")
    compared = ((shown.label, None), *((other.label, result) for other, result in zip(others, results))) if others else ()
    return Plan(header, scenario, found, focus(header, found, (*nodes, *_striking(results))), compared)


def _beside(batches: Iterator[Batch], differences: Sequence[Differences]) -> Iterator[Batch]:
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
    nodes = [k for result in results if len(result.pairing) > ALL_NAMED for k in result.striking(_STRIKING // len(results) or 1)]
    return tuple(dict.fromkeys(nodes))


def record(logs: Logs, planned: Plan, output: Into, wanted: Wanted) -> Converted:
    """The second reading: writes the recording."""
    header, scenario, found, named, compared = planned.header, planned.scenario, planned.found, planned.named, planned.compared
    shown, *others = logs.open()
    others = [replace(other, found=result) for other, (_, result) in zip(others, compared[1:])]
    reader, ids = shown.reader, [recording_id(other.reader.header, wanted.run) for other in others]
    batches = reader.batches(wanted.run)
    batch: Batch | None = next(batches, None)
    if batch is None:
        raise LogError("the log has changed while it was read")
    first_step = int(batch.step[0])
    screen = blueprint(header, scenario, batch, found, named, compared, wanted.view)
    with _into(output)(recording_id(header, wanted.run, ids), screen) as rec:
        recorder = Recorder(rec, header, scenario, wanted.run, found, named)
        beside = Comparison(rec, shown, others, scenario, wanted.run, Palette(header, named), named) if others else None
        while batch is not None:
            recorder.batch(batch)
            if beside:
                beside.batch(batch)
            last_step = int(batch.step[-1])
            batch = next(batches, None)
        recorder.finish(reader.end, beside.finish() if beside else [])
    remarks = reader.warnings + [f"{other.name}: {text}" for other in others for text in other.reader.warnings]
    return Converted(remarks, (first_step, last_step))


def _into(output: Into) -> Callable[[str, rrb.Blueprint], AbstractContextManager[rr.RecordingStream]]:
    return partial(recording_file, output) if isinstance(output, Path) else output


def _begun(logs: Logs, output: Into, wanted: Wanted) -> Converted:
    reader = logs.open()[0].reader
    for _ in reader.batches(wanted.run):
        raise LogError("the log has changed while it was read")
    with _into(output)(recording_id(reader.header, wanted.run), only_begun.blueprint()) as rec:
        only_begun.record(rec, reader.header, parse_scenario(reader.header), wanted.run, reader.end)
    return Converted([f"the log has no step of run {wanted.run} yet", *reader.warnings], None)


def node_numbers(header: Header, wanted: Sequence[int]) -> tuple[int, ...]:
    """Node numbers of those that the user names. Raises LogError."""
    if header.navigation:
        numbers, what = {number: k for k, number in enumerate(header.satellites)}, "satellite"
    else:
        numbers, what = {k: k for k in (range(header.nodes) if header.central else header.estimator_nodes)}, "node"
    for number in wanted:
        if number not in numbers:
            raise LogError(f"there is no {what} {number}; the log has {_ranges(sorted(numbers))}")
    return tuple(numbers[number] for number in wanted)


def _ranges(numbers: list[int]) -> str:
    """0 to 19; or 3, 5 to 7."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in parts)
