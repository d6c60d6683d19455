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

from .live import options as live
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
        if command:
            return command(arguments[1:])
        options = _options(arguments)
        return _live(options) if options.live else _record(options, program=program)
    except BrokenPipeError:
        # What reads our standard output has ended; without this, Python complains again when it flushes it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return EXIT_PART


class Work:
    status = EXIT_BAD

    def __init__(self, interrupts: Interrupts) -> None:
        self.interrupts = interrupts


@contextmanager
def guarded(names: list[str], shown: str, *, stay: bool = True) -> Iterator[Work]:
    """A block that reads logs, and says why it could not be ended: `status` is then what the program ends with. stay: that of Interrupts."""
    with Interrupts(stay=stay) as interrupts:
        interrupts.spare = "-" in names
        work = Work(interrupts)
        try:
            yield work
        except KeyboardInterrupt:
            say("stopped at once; what was not whole is not written")
            work.status = interrupts.exit_status
        except LogError as error:
            say(f"{shown}: {error}")
            work.status = interrupts.exit_status if interrupts.came else EXIT_BAD
        except OSError as error:
            say(f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error))
            work.status = EXIT_BAD


def _record(options: argparse.Namespace, *, program: bool) -> int:
    shown = options.log[0] if len(options.log) == 1 else "joined logs"
    with guarded(options.log, shown, stay=program) as work:
        work.status = _written(options, shown, work.interrupts)
    return work.status


def _written(options: argparse.Namespace, shown: str, interrupts: Interrupts) -> int:
    output = None if options.png and not options.output else _output(options)
    _check_names(options.log, output)
    import rerun as rr

    from .conversion import Logs, Wanted, convert_logs

    # Without it, rerun only warns about what it could not record, and the file would lack data.
    rr.set_strict_mode(True)
    wanted, status, known = Wanted(options.run, options.view, options.node), 0, []
    with logs(options.log) as streams, ExitStack() as keep:
        opened = Logs(streams, keep, interrupts)
        if output:
            done = convert_logs(opened, output, wanted)
            known = done.remarks
            status = told(known, opened, shown, f"{output.name} holds {done.holds}", interrupts)
        if options.png and not interrupts.came:
            from . import pictures

            opened.quiet(readings=3)
            try:
                remarks = pictures.write(opened, wanted, Path(options.png), size=options.size or pictures.SIZE, time_s=options.time)
            except pictures.viewer.ViewerError as error:
                opened.quiet()
                say(f"{shown}: {error}; {options.png} has the figures, and not all views")
                return EXIT_PART
            status = told([text for text in remarks if text not in known], opened, shown, f"{options.png} shows what was read before", interrupts)
    return status


def told(remarks: list[str], opened: "Logs", shown: str, has: str, interrupts: Interrupts) -> int:  # noqa: F821
    """Says what there is to say of logs that were read, and what is written of them; the exit status."""
    opened.quiet()
    damage = opened.damage
    for remark in remarks:
        say(f"{shown}: {remark}; {has}" if remark in damage else f"{shown}: warning: {remark}")
    if opened.stopped:
        say(f"{shown}: {opened.stopped}: {has}")
        return interrupts.exit_status
    return EXIT_PART if damage else 0


def say(text: str) -> None:
    # Where standard error is closed, nobody is told; print would take standard output.
    if sys.stderr is not None:
        print(f"{PROGRAM}: {text}", file=sys.stderr)


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=PROGRAM, description="Turns a Meshkal run log into a recording for the rerun viewer (.rrd), or into pictures.",
                                     epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", nargs="*", help=_LOG_HELP)
    parser.add_argument("-o", "--output", metavar="RUN.rrd", help="the recording to write (default: beside the log, .rrd instead of its suffix)")
    parser.add_argument("--run", type=run_number, default=0, metavar="K", help="which Monte Carlo run (default: 0)")
    parser.add_argument("--view", choices=VIEWS, help="what is in front when the recording is opened (default: by what is in the log)")
    parser.add_argument("--node", type=node_numbers, default=(), metavar="K[,K...]", help="nodes to show by name, before the worst ones")
    parser.add_argument("--png", metavar="DIR", help="write the views and plots as pictures into DIR; without -o, only these")
    parser.add_argument("--time", type=float, metavar="SECONDS", help="of --png: the moment that is shown (default: the end)")
    parser.add_argument("--size", type=_size, metavar="WxH", help="of --png: of the views, in pixels (default: 1600x1000)")
    live.add_arguments(parser)
    options = parser.parse_args(arguments)
    if options.live:
        if options.log or options.png:
            parser.error("--live SOURCE is instead of a log, and makes no pictures")
        if not options.output:
            parser.error("a recording of a live run needs a name: -o RUN.rrd")
    elif not options.log:
        parser.error("no log is given; see --help")
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


def _size(text: str) -> tuple[int, int]:
    parts = text.split("x")
    if len(parts) != 2 or not all(part.isdecimal() and 200 <= int(part) <= 8000 for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size from 200x200 to 8000x8000, as 1600x1000")
    return int(parts[0]), int(parts[1])


def node_numbers(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    if not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of node numbers, as 3 or 3,17")
    return tuple(int(part) for part in parts)


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


def _live(options: argparse.Namespace) -> int:
    # What rerun says of viewers that do not take what is sent, the summary says, too.
    os.environ.setdefault("RUST_LOG", "warn,re_quota_channel=error")
    from .live import command

    return command.main(options)


def _convert(arguments: list[str]) -> int:
    from meshkal_log import converting

    return converting.command(arguments)


_COMMANDS = {"report": _report, "convert": _convert}
