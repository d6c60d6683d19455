# SPDX-License-Identifier: MIT
"""From logs to a recording in a file: a first reading finds what to show, a second one writes it."""

import shutil
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from meshkal_log.fields import Header
from meshkal_log.joined import JoinedReader
from meshkal_log.reader import LogError, LogReader
from meshkal_log.scenario import Scenario, parse_scenario

from .numbers.survey import Survey, focus, survey
from .recording import comparison
from .recording.output import recording_file
from .recording.recorder import Recorder, recording_id
from .views.blueprint import blueprint


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

    def open(self) -> tuple[LogReader, list[tuple[str, str, LogReader]]]:
        """The log that is shown, and names, labels and logs of those that it is compared with."""
        readers = {}
        for name, stream in self._streams.items():
            stream.seek(0)
            try:
                readers[name] = LogReader(stream)
            except LogError as error:
                raise LogError(f"{name}: {error}" if len(self._streams) > 1 else str(error)) from None
        first = next(iter(readers.values()))
        if len(readers) == 1:
            return first, []
        if first.header.timed:
            return first, [(name, label, readers[name]) for name, label in comparison.labels(readers).items()]
        return JoinedReader(readers), []


def _kept(stream: BinaryIO, keep: ExitStack) -> BinaryIO:
    kept = keep.enter_context(tempfile.TemporaryFile())
    shutil.copyfileobj(stream, kept, 1 << 20)
    kept.flush()
    return open(kept.fileno(), "rb", closefd=False)


@dataclass(frozen=True)
class Plan:
    """What a first reading of logs found, for the second one."""

    header: Header
    scenario: Scenario
    found: Survey
    named: tuple[int, ...]  # nodes
    compared: tuple[str, ...]  # labels of other logs


def plan(logs: Logs, wanted: Wanted) -> Plan:
    """Raises LogError if the log has no step of the run."""
    reader, others = logs.open()
    header, scenario = reader.header, parse_scenario(reader.header)
    found = survey(reader.batches(wanted.run), header, scenario)
    if not found.steps:
        raise LogError(f"the log has no step of run {wanted.run}")
    return Plan(header, scenario, found, focus(header, found, wanted.nodes), tuple(label for _, label, _ in others) if scenario.position_states else ())


def convert(streams: dict[str, BinaryIO], output: Path, wanted: Wanted) -> list[str]:
    """Writes the recording of one run and returns warnings for the user. Several logs: those of nodes of one network; or of filters for tracking
    or navigation, the first of which is shown and the others are compared with it. Raises LogError or OSError and leaves `output` alone."""
    with ExitStack() as keep:
        logs = Logs(streams, keep)
        return record(logs, plan(logs, wanted), output, wanted)


def record(logs: Logs, planned: Plan, output: Path, wanted: Wanted) -> list[str]:
    """The second reading: writes the recording; returns warnings for the user."""
    header, scenario, found, named, compared = planned.header, planned.scenario, planned.found, planned.named, planned.compared
    reader, others = logs.open()
    batches = reader.batches(wanted.run)
    first = next(batches)
    shown = blueprint(header, scenario, first, found, named, compared, wanted.view)
    with recording_file(output, recording_id(header, wanted.run, compared), shown) as rec:
        recorder = Recorder(rec, header, scenario, wanted.run, found, named)
        beside = comparison.Comparison(rec, scenario) if compared else None
        batch = first
        del first
        while batch is not None:
            recorder.batch(batch)
            if beside:
                beside.shown(batch)
            batch = next(batches, None)
        recorder.finish(reader.end, _compared(beside, others, wanted.run) if beside else [])
    return reader.warnings + [f"{name}: {text}" for name, _, other in others for text in other.warnings]


def _compared(beside: comparison.Comparison, others: Sequence[tuple[str, str, LogReader]], run: int) -> list[tuple[str, str]]:
    rows = []
    for index, (name, label, reader) in enumerate(others):
        try:
            rows.append(beside.other(label, reader, run, index))
        except LogError as error:
            raise LogError(f"{name}: {error}") from None
    return [row for row in rows if row]
