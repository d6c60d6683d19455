# SPDX-License-Identifier: MIT
"""The command. Exit status: 0 done, 1 done in part, 2 wrong input and nothing written, 130 interrupted."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

import rerun as rr

from meshkal_log import converting
from meshkal_log.reader import LogError
from meshkal_log.signals import interruptible

from .conversion import Wanted, convert
from .views.blueprint import VIEWS

PROGRAM = "meshkal-rerun"
EXIT_BAD = 2
EXIT_INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == ["convert"]:
        return converting.command(arguments[1:])
    options = _options(arguments)
    shown = options.log[0] if len(options.log) == 1 else "joined logs"
    # Without it, rerun only warns about what it could not record, and the file would lack data.
    rr.set_strict_mode(True)
    try:
        with interruptible("-" in options.log), ExitStack() as streams:
            opened = {name: streams.enter_context(_open(name)) for name in options.log}
            remarks = convert(opened, _output(options), Wanted(options.run, options.view, options.node))
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


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=PROGRAM, description="Turns a Meshkal run log into a rerun recording (.rrd).")
    parser.add_argument("log", nargs="+", help="the log, or - for standard input; several: those of nodes of one network, as meshkal-node writes "
                        "them, or those of filters over the same tracking or navigation run: the first is shown, the others are compared with it")
    parser.add_argument("-o", "--output", metavar="RUN.rrd", help="the recording to write (default: beside the log, .rrd instead of its suffix)")
    parser.add_argument("--run", type=_run_number, default=0, metavar="K", help="which Monte Carlo run (default: 0)")
    parser.add_argument("--view", choices=VIEWS, help="what is in front when the recording is opened (default: by what is in the log)")
    parser.add_argument("--node", type=_nodes, default=(), metavar="K[,K]", help="nodes to show by name, before the worst ones")
    options = parser.parse_args(arguments)
    if not options.output and options.log[0] == "-":
        parser.error("a recording of standard input needs a name: -o RUN.rrd")
    return options


def _output(options: argparse.Namespace) -> Path:
    return Path(options.output) if options.output else Path(options.log[0]).with_suffix(".rrd")


def _run_number(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a run number")
    return int(text)


def _nodes(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of node numbers, as 3 or 3,17")
    return tuple(int(part) for part in parts)


@contextmanager
def _open(log: str) -> Iterator[BinaryIO]:
    if log == "-":
        yield sys.stdin.buffer
    else:
        with open(log, "rb") as stream:
            yield stream
