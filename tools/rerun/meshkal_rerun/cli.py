# SPDX-License-Identifier: MIT
"""The command. Exit status: 0 done; 1 done in part, because a log is damaged; 2 nothing written; 130 or 143 stopped by Ctrl-C or SIGTERM, and what was
read is written, unless a second one came."""

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

from meshkal_log.interrupts import Interrupts
from meshkal_log.reader import LogError

from .views import VIEWS

# rerun, pyarrow and matplotlib are imported where they are needed: they take longer than all the rest of a short command.

PROGRAM = "meshkal-rerun"
EXIT_PART = 1
EXIT_BAD = 2

_LOG_HELP = ("the log, or - for standard input; several: those of nodes of one network, as meshkal-node writes them, or those of filters over the same run: "
             "the first is shown, the others are compared with it")
_EXAMPLES = """examples:
  meshkal-rerun run.cbor                          run.rrd beside it; then: rerun run.rrd (or at once: rerun run.cbor)
  meshkal-rerun run.cbor --view node --node 3,17  nodes 3 and 17 in front
  meshkal-rerun run.cbor --png pictures           its views and plots as pictures
  meshkal-rerun ekf.cbor ukf.cbor -o both.rrd     the second filter compared with the first one
  meshkal-rerun --live udp:9870 -o run.rrd        shows a network that runs, and records it
  meshkal-rerun report run.cbor -o run.html       one page with tables and plots (report --help)
  meshkal-rerun convert run.cbor -o run.mcap      MCAP, Parquet or CSV (convert --help)
A log that is called report or convert is given as ./report.

exit status: 0 done; 1 done in part, because the log is damaged: the message says where; 2 nothing written; 130 (Ctrl-C), 143 (SIGTERM): stopped, and
what was read by then is written, unless a second Ctrl-C came."""


def main(arguments: list[str] | None = None) -> int:
    program = arguments is None
    arguments = sys.argv[1:] if program else arguments
    command = _COMMANDS.get(arguments[0]) if arguments else None
    try:
        return command(arguments[1:]) if command else _record(_options(arguments), program=program)
    except BrokenPipeError:
        # What reads our standard output has ended; without this, Python complains again when it flushes it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return EXIT_PART


def _record(options: argparse.Namespace, *, program: bool) -> int:
    shown = options.log[0] if len(options.log) == 1 else "joined logs"
    with Interrupts(stay=program) as interrupts:
        interrupts.spare = "-" in options.log
        try:
            return _written(options, shown, interrupts)
        except KeyboardInterrupt:
            say("stopped; nothing is written")
            return interrupts.exit_status
        except LogError as error:
            say(f"{shown}: {error}")
            return interrupts.exit_status if interrupts.came else EXIT_BAD
        except OSError as error:
            say(_text(error))
            return EXIT_BAD


def _written(options: argparse.Namespace, shown: str, interrupts: Interrupts) -> int:
    output = None if options.png and not options.output else _output(options)
    _check_names(options.log, output)
    import rerun as rr

    from .conversion import Wanted, convert

    # Without it, rerun only warns about what it could not record, and the file would lack data.
    rr.set_strict_mode(True)
    wanted, status = Wanted(options.run, options.view, options.node), 0
    if output:
        with logs(options.log) as opened:
            status = told(convert(opened, output, wanted, interrupts), shown, output.name, interrupts)
    if options.png and not interrupts.came:
        from . import pictures

        with logs(options.log) as opened:
            status = max(status, pictures.write(opened, wanted, Path(options.png)))
    return status


def told(done: "Converted", shown: str, name: str, interrupts: Interrupts) -> int:  # noqa: F821
    """Says what there is to say of a recording that was written as `name`; the exit status."""
    for remark in done.remarks:
        if remark not in done.damage:
            say(f"{shown}: warning: {remark}")
    for damage in done.damage:
        say(f"{shown}: {damage}; {name} holds {done.holds}")
    if done.stopped:
        of = f" of {done.asked}" if done.asked else ""
        say(f"{shown}: stopped by {done.stopped} at step {done.steps[1]}{of}: {name} holds {done.holds}")
        return interrupts.exit_status
    return EXIT_PART if done.damage else 0


def say(text: str) -> None:
    # Where standard error is closed, nobody is told; print would take standard output.
    if sys.stderr is not None:
        print(f"{PROGRAM}: {text}", file=sys.stderr)


def _text(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error)


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=PROGRAM, description="Turns a Meshkal run log into a recording for the rerun viewer (.rrd), or into pictures.",
                                     epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", nargs="*", help=_LOG_HELP)
    parser.add_argument("-o", "--output", metavar="RUN.rrd", help="the recording to write (default: beside the log, .rrd instead of its suffix)")
    parser.add_argument("--run", type=run_number, default=0, metavar="K", help="which Monte Carlo run (default: 0)")
    parser.add_argument("--view", choices=VIEWS, help="what is in front when the recording is opened (default: by what is in the log)")
    parser.add_argument("--node", type=node_numbers, default=(), metavar="K[,K...]", help="nodes to show by name, before the worst ones")
    parser.add_argument("--png", metavar="DIR", help="write the views and plots as pictures into DIR; without -o, only these")
    parser.add_argument("--live", metavar="SOURCE", help="show and record a run while it is written: SOURCE is - (standard input), a log that grows, unix:PATH "
                        "or udp:[HOST:]PORT")
    parser.add_argument("--port", type=_port, metavar="P", help="with --live: where the viewer finds it (default: 9876)")
    options = parser.parse_args(arguments)
    if options.live:
        if options.log or options.png:
            parser.error("--live SOURCE is instead of a log, and makes no pictures")
    elif not options.log:
        parser.error("no log is given; see --help")
    elif options.port is not None:
        parser.error("--port is for --live")
    elif not options.output and not options.png and options.log[0] == "-":
        parser.error("a recording of standard input needs a name: -o RUN.rrd")
    return options


def _output(options: argparse.Namespace) -> Path:
    return Path(options.output) if options.output else Path(options.log[0]).with_suffix(".rrd")


def _check_names(names: list[str], output: Path | None) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise LogError(f"{name} is given twice")
        if name != "-" and output and output.exists() and Path(name).exists() and output.samefile(name):
            raise LogError(f"the recording would replace the log {name}: give it another name with -o")


def run_number(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a run number")
    return int(text)


def node_numbers(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of node numbers, as 3 or 3,17")
    return tuple(int(part) for part in parts)


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) < 1 << 16:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port")
    return int(text)


@contextmanager
def logs(names: list[str]) -> Iterator[dict[str, BinaryIO]]:
    with ExitStack() as streams:
        yield {name: _standard_input() if name == "-" else streams.enter_context(open(name, "rb")) for name in names}


def _standard_input() -> BinaryIO:
    if sys.stdin is None:
        raise OSError("standard input is closed")
    return sys.stdin.buffer


def _report(arguments: list[str]) -> int:
    from .pictures import report

    return report.main(arguments)


def _convert(arguments: list[str]) -> int:
    from meshkal_log import converting

    return converting.command(arguments)


_COMMANDS = {"report": _report, "convert": _convert}
