# SPDX-License-Identifier: MIT
"""Turns a log into CSV, Parquet or MCAP (tables.md), whole or not at all."""

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path

from .fields import Batch
from .opening import Source, batches_of, opened
from .interrupts import Interrupts
from .output import whole_file, whole_folder
from .progress import Progress
from .reader import LogError, LogReader
from .run import nothing

PROGRAM = "meshkal-rerun convert"
CSV, PARQUET, MCAP = FORMS = ("csv", "parquet", "mcap")


def convert(
    source: Source | Sequence[Source],
    output: str | os.PathLike,
    *,
    to: str | None = None,
    run: int | None = 0,
    progress: Callable[[int], None] | None = None,
    watch: Callable[[LogReader], bool] | None = None,
) -> list[str]:
    """Writes one run of a log, or of logs of nodes of one network; with `run` None all runs, which MCAP cannot have. The form is `to`, or
    what the name of `output` says. Calls `progress` with the number of steps after each batch of them; `watch` is that of `LogReader`. Returns
    warnings for the user. Raises LogError or OSError and leaves `output` as it was."""
    output = Path(output)
    form = form_of(output, to)
    if form == MCAP and run is None:
        raise LogError("an MCAP file has one run, because runs are at the same times; name it with --run")
    # pyarrow and protobuf take longer to import than many logs to read.
    from .columnar import FolderWriter, own_files
    from .mcap_file import McapFile

    with opened(source) as reader:
        reader.watch = watch
        batches = batches_of(reader, run)
        # A log without a step has nothing but its header; so do the tables.
        first = next(batches, None) or (run or 0, nothing(reader.header))
        with whole_file(output) if form == MCAP else whole_folder(output, own_files(form)) as temporary:
            if form == MCAP:
                writer = McapFile(temporary, reader.header, first[1], reader.header_item)
            else:
                writer = FolderWriter(form, temporary, reader.header, first[1], reader.header_item)
            batches = chain([first], batches)
            del first  # some 100 MB
            _write(writer, reader, batches, progress)
        return reader.warnings


def _write(writer: object, reader: LogReader, batches: Iterator[tuple[int, Batch]], progress: Callable[[int], None] | None) -> None:
    try:
        present = None
        for number, batch in batches:
            present = present or _present(batch)
            if _present(batch) != present:
                raise LogError(f"run {number}: {', '.join(sorted(_present(batch) ^ present))} is in some runs and not in others")
            writer.batch(number, batch)
            if progress:
                progress(len(batch.step))
            del batch  # before the next one is read
        writer.finish({"end": reader.end or "cut", "warnings": reader.warnings})
    finally:
        writer.stop()


def _present(batch: Batch) -> set[str]:
    return {key for key, value in vars(batch).items() if value is not None}


def form_of(output: Path, to: str | None) -> str:
    if to is not None:
        return to
    ending = output.suffix.lower().removeprefix(".")
    if ending in FORMS:
        return ending
    if not ending:
        return PARQUET
    raise LogError(f"{output}: what to write is not clear from .{ending}; name it .mcap, .parquet or .csv, or say --to")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Writes a log as a folder of Parquet or CSV tables, or as an MCAP file. tables.md says what is in them."
    parser.add_argument("log", nargs="+", help="the log, or - for standard input; several: those of nodes of one network, read as one")
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help="RUN.mcap, or a folder to make: RUN.parquet, RUN.csv, or any name")
    parser.add_argument("--to", choices=FORMS, help="what to write (default: as OUT ends; parquet where it has no ending)")
    parser.add_argument("--run", type=_run, default=0, metavar="K", help="which Monte Carlo run, or all: tables have a column for it (default: 0)")


def _run(text: str) -> int | None:
    if text == "all":
        return None
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a run number")
    return int(text)


def main(options: argparse.Namespace, *, program: bool = False) -> int:
    """Exit status: 0 done, 1 done up to where the log is damaged, 2 nothing written, 130 or 143 stopped by Ctrl-C or SIGTERM, and what was read is
    written, unless a second one came. program: it ends then."""
    shown = options.log[0] if len(options.log) == 1 else "joined logs"
    with Interrupts(stay=program) as interrupts:
        interrupts.spare = "-" in options.log
        sizes = [os.stat(log).st_size if log != "-" and os.path.isfile(log) else None for log in options.log]
        progress = Progress("converting", None if None in sizes else sum(sizes))
        try:
            seen = _Watch(interrupts, progress)
            logs = [interrupts.stream(_standard_input()) if log == "-" else log for log in options.log]
            warnings = convert(logs[0] if len(logs) == 1 else logs, options.output, to=options.to, run=options.run, watch=seen)
            progress.close()
        except KeyboardInterrupt:
            progress.close()
            return _say("stopped; nothing is written", interrupts.exit_status)
        except LogError as error:
            progress.close()
            return _say(f"{shown}: {error}", 2)
        except OSError as error:
            progress.close()
            return _say(f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error), 2)
        for text in warnings:
            _say(f"{shown}: warning: {text}")
        holds = f"{Path(options.output).name} holds what was read before"
        if interrupts.came and (seen.reader is None or seen.reader.end in ("stopped", None)):
            return _say(f"{shown}: stopped by {interrupts.name}: {holds}", interrupts.exit_status)
        return _say(f"{shown}: {holds}", 1) if seen.reader is not None and seen.reader.damage else 0


class _Watch:
    """Shows how far a log was read; reading stops at the first item after a signal."""

    def __init__(self, interrupts: Interrupts, progress: Progress) -> None:
        self.reader: LogReader | None = None
        self._interrupts, self._progress = interrupts, progress

    def __call__(self, reader: LogReader) -> bool:
        self.reader = reader
        self._progress.at(lambda: reader.position or 0, reader.items - 1)
        return self._interrupts.came


def _standard_input() -> int:
    if sys.stdin is None:
        raise OSError("standard input is closed")
    return sys.stdin.fileno()


def _say(text: str, status: int = 0) -> int:
    if sys.stderr is not None:
        print(f"{PROGRAM}: {text}", file=sys.stderr)
    return status


def command(arguments: list[str] | None = None) -> int:
    """The command with these arguments, those after its name."""
    parser = argparse.ArgumentParser(prog=PROGRAM)
    add_arguments(parser)
    return main(parser.parse_args(arguments), program=True)


if __name__ == "__main__":
    sys.exit(command())
