# SPDX-License-Identifier: MIT
"""The command: reads a log from a file or standard input and writes an .rrd file, whole or not at all."""

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import rerun as rr

from meshkal_log.joined import JoinedReader
from meshkal_log.reader import LogError, LogReader
from meshkal_log.scenario import parse_scenario
from .recording import comparison
from .recording.output import recording_file
from .recording.recorder import Recorder, recording_id
from .views.blueprint import blueprint

PROGRAM = "meshkal-rerun"
EXIT_BAD = 2
EXIT_INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    options = _options(arguments)
    shown = options.log[0] if len(options.log) == 1 else "joined logs"
    # Without it, rerun only warns about what it could not record, and the file would lack data.
    rr.set_strict_mode(True)
    try:
        with _signals("-" in options.log), ExitStack() as streams:
            opened = {name: streams.enter_context(_open(name)) for name in options.log}
            if len(options.log) == 1:
                remarks = convert(opened[options.log[0]], Path(options.output), options.run)
            else:
                remarks = convert_joined(opened, Path(options.output), options.run)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except LogError as error:
        print(f"{PROGRAM}: {shown}: {error}", file=sys.stderr)
        return EXIT_BAD
    except OSError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return EXIT_BAD
    for remark in remarks:
        print(f"{PROGRAM}: {shown}: warning: {remark}", file=sys.stderr)
    return 0


def convert(stream: BinaryIO, output: Path, run: int) -> list[str]:
    """Writes the recording of one run and returns warnings for the user. Raises LogError or OSError and leaves `output` alone."""
    return _convert(LogReader(stream), output, run)


def convert_joined(streams: dict[str, BinaryIO], output: Path, run: int) -> list[str]:
    """The same of several logs, by their names: of nodes of one network; or of filters for tracking or navigation, the first of which is shown and the
    others are compared with it."""
    readers = {}
    for name, stream in streams.items():
        try:
            readers[name] = LogReader(stream)
        except LogError as error:
            raise LogError(f"{name}: {error}") from None
    first = next(iter(readers.values()))
    if first.header.timed:
        others = [(name, label, readers[name]) for name, label in comparison.labels(readers).items()]
        remarks = _convert(first, output, run, others)
        return remarks + [f"{name}: {text}" for name, reader in readers.items() if reader is not first for text in reader.warnings]
    return _convert(JoinedReader(readers), output, run)


def _convert(reader: LogReader, output: Path, run: int, others: Sequence[tuple[str, str, LogReader]] = ()) -> list[str]:
    scenario = parse_scenario(reader.header)
    batches = reader.batches(run)
    first = next(batches, None)
    if first is None:
        raise LogError(f"the log has no step of run {run}")
    compared = tuple(label for _, label, _ in others) if scenario.position_states else ()
    with recording_file(output, recording_id(reader.header, run, compared), blueprint(reader.header, scenario, first, compared)) as rec:
        recorder = Recorder(rec, reader.header, scenario, run)
        beside = comparison.Comparison(rec, scenario) if compared else None
        batches = chain([first], batches)
        del first
        for batch in batches:
            recorder.batch(batch)
            if beside:
                beside.shown(batch)
        recorder.finish(reader.end, _compared(beside, others, run) if beside else [])
    return reader.warnings


def _compared(beside: comparison.Comparison, others: Sequence[tuple[str, str, LogReader]], run: int) -> list[tuple[str, str]]:
    rows = []
    for index, (name, label, reader) in enumerate(others):
        try:
            rows.append(beside.other(label, reader, run, index))
        except LogError as error:
            raise LogError(f"{name}: {error}") from None
    return [row for row in rows if row]


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=PROGRAM, description="Turns a Meshkal run log into a rerun recording (.rrd).")
    parser.add_argument("log", nargs="+", help="the log, or - for standard input; several: those of nodes of one network, as meshkal-node writes "
                        "them, or those of filters over the same tracking or navigation run: the first is shown, the others are compared with it")
    parser.add_argument("-o", "--output", required=True, metavar="RUN.rrd", help="the recording to write")
    parser.add_argument("--run", type=_run_number, default=0, metavar="K", help="which Monte Carlo run (default: 0)")
    return parser.parse_args(arguments)


def _run_number(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a run number")
    return int(text)


@contextmanager
def _open(log: str) -> Iterator[BinaryIO]:
    if log == "-":
        yield sys.stdin.buffer
    else:
        with open(log, "rb") as stream:
            yield stream


@contextmanager
def _signals(reading_pipe: bool) -> Iterator[None]:
    """SIGTERM cleans up as Ctrl-C does. In a pipe, Ctrl-C reaches the simulator too, which then ends its log properly: the first
    one is left to it and what it wrote becomes a recording, the second one stops this program."""

    def first_interrupt(_number: int, _frame: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGTERM, signal.default_int_handler), signal.getsignal(signal.SIGINT)
    if reading_pipe:
        signal.signal(signal.SIGINT, first_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGINT, before[1])
